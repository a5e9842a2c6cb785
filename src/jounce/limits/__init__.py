"""Limits along a motion: what breaks them, and how fast the motion may be."""
