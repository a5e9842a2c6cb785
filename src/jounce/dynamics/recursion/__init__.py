"""The equations of motion by sweeps outward and inward over the tree: any order, any scalar type.

`forces` is the recursive Newton-Euler algorithm (RNEA) with rates, `matrices` the composite-rigid-body algorithm (CRBA)
and its like for the Coriolis matrices, `momenta` has momentum and energy, `bodies` poses, twists and Jacobians. Forces,
momentum and what belongs to one body take O(n) steps, matrices as many as they have entries. Every function takes
coordinates as columns (..., n, 1) and returns a series, computed as far as it is asked for.
"""
