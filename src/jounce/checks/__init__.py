"""Checks of a robot: an audit of its data, and comparison with other libraries and other methods."""
