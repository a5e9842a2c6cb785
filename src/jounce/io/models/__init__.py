"""Models of other libraries, read from their attributes."""
