"""Computations as data: scalar operations, traced from the mathematics, and passes over them."""
