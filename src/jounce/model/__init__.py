"""The model of a robot: the frozen data of its mechanism, and transformations of mechanisms."""
