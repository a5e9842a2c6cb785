"""The equations of motion by sweeps outward and inward over the tree: any order, any scalar type.

`joints` has the joints in motion, `tree` the tree of them and the sweeps over it, behind a base that moves. `forces` is
the recursive Newton-Euler algorithm (RNEA) with rates, `regressor` the same on unit parameters, `matrices` the
composite-rigid-body algorithm (CRBA) and its extension to the Coriolis matrices, `articulated` solves equations of the
mass matrix (ABA), `bodies` has poses, twists and Jacobians, momentum, energy and the centre of mass, `force_partials`
the derivatives of forces. Forces, momentum and quantities of one body take O(n) operations, matrices O(n^2). Every
function takes coordinates as columns (..., n, 1) and returns a series, whose terms are computed on demand.
"""
