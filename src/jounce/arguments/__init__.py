"""The arguments of callers, checked once: rates of the coordinates, joint names, wrenches."""
