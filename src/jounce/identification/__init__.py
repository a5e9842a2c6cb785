"""Identification: inertial parameters and drive terms of a robot from a motion and the forces measured along it."""
