"""Actuators: motors that move the links through springs."""
