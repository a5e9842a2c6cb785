"""Rates and forces from encoders while the robot moves: a causal filter of samples at a fixed lag."""
