"""The mathematics of one rigid body: SE(3), time series of arrays, spatial inertia."""
