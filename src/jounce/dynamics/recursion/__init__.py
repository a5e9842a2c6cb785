"""The equations of motion by sweeps outward and inward over the tree: any order, any scalar type.

`forces` is the recursive Newton-Euler algorithm (RNEA) with rates, `matrices` the composite-rigid-body algorithm (CRBA)
and its extension to the Coriolis matrices, `momenta` has momentum, energy and the centre of mass, `bodies` poses,
twists and Jacobians; `tree` has the joints, and a base that moves ahead of them.
Forces, momentum and quantities of one body take O(n) operations, matrices O(n^2). Every function takes coordinates as
columns (..., n, 1) and returns a series, whose terms are computed on demand.
"""
