"""Coordinates of closed robots that follow by constant ratios: parallelograms of palletizers and of parallel grippers.

Entries of F are analytic along a branch: one that is the same at several arbitrary positions is constant. Such a
coordinate has no singular position, where constraints, solved for it, lose all digits near their change points.
"""

from dataclasses import replace

import numpy as np

from jounce.core.errors import JounceError
from jounce.dynamics import loop_closure
from jounce.dynamics.loop_assembly import (
    MIN_SAMPLE_INVERSE_CONDITION,
    compute_inverse_conditions,
    scaled_constraints,
    tangent_map,
)
from jounce.dynamics.loop_branches import scales
from jounce.dynamics.loops import closure_of
from jounce.model.loops import FollowerRatios
from jounce.model.mechanism import Mechanism

RATIO_SAMPLES = 6  # positions at which F is compared with that at the start: one would do, but for accidents
RATIO_SAMPLE_REACH = 0.3  # rad or sizes of the robot around the start: large enough that F changes, within most reaches
RATIO_TOLERANCE = 1e-10  # of F and positions: lengths rounded to doubles leave less, those rounded to micrometers more


def with_ratios(m: Mechanism) -> Mechanism:
    """A closed robot with its followers found; the start must be regular."""
    c, s, rng = closure_of(m), scales(m), np.random.default_rng(0)
    own = list(c.independent)
    sizes = s.coordinates[:, None] / s.coordinates[own]
    F = _tangent(m, c.start) * sizes
    constant = np.isin(range(len(F)), c.dependent)
    found, reach = 0, RATIO_SAMPLE_REACH / 16  # first near the start, where most robots show that they have none
    for _ in range(3 * RATIO_SAMPLES):
        u = c.start[own] + rng.uniform(-reach, reach, m.n) * s.coordinates[own]
        try:
            [q] = loop_closure.close_loops(m, u[None])
        except JounceError:  # out of reach
            reach /= 4
            continue
        A = scaled_constraints(m, q[None])[..., c.dependent]
        if compute_inverse_conditions(A)[0] < np.sqrt(MIN_SAMPLE_INVERSE_CONDITION):
            continue
        found, reach = found + 1, RATIO_SAMPLE_REACH
        turned = np.abs((_tangent(m, q) * sizes - F) / sizes).max(axis=1)
        off = np.abs(q - c.start - F @ (u - c.start[own])) / s.coordinates
        constant &= np.maximum(turned, off) <= RATIO_TOLERANCE
        if found == RATIO_SAMPLES or not constant.any():
            break
    if found < RATIO_SAMPLES or not constant.any():
        return m
    places = np.flatnonzero(constant)
    F, sizes = F[places], sizes[places]
    whole = np.rint(F / sizes)
    F = np.where(np.abs(F / sizes - whole) <= RATIO_TOLERANCE, whole * sizes + 0.0, F)
    ratios = FollowerRatios(tuple(places.tolist()), F, c.start[places] - F @ c.start[own])
    return replace(m, closure=replace(c, ratios=ratios))


def _tangent(m: Mechanism, q: np.ndarray) -> np.ndarray:
    """F (N, n) at coordinates (N,), without units."""
    c = closure_of(m)
    return tangent_map(scaled_constraints(m, q[None])[0], c.independent, c.dependent)
