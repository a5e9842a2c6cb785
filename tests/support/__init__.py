"""What tests share: robots, oracles, programs that they run, and pages that they read back."""
