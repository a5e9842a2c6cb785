"""What callers give, checked once: rates of the coordinates, joint names, wrenches."""
