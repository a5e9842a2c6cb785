"""Compile small laws for the short way of calls: Newton's step that closes loops, and poses of a base.

`CompiledLaw` is what both are: a law of a few arrays, traced, compiled and kept in the cache, which NumPy calls as a
ufunc. NumPy's own operations would take longer for them than kernels take for the forces.

**Loops** (`native_step`). Problem: of coordinates q, keep the independent ones and find the dependent ones with which
the gaps of all loops are 0. Algorithm: Newton's method by the step of `loop_assembly`, from where loops are nearly
closed; its error is about the square of the one before [1]. Invariants: independent coordinates do not change; results
are those of a step from where gaps were within `max_gap`, hence closed to rounding. Failure: no result where the loops
are not closed after `MAX_CLOSING_STEPS`, where a state of the batch is too near to a singularity or has moved to
another branch. The caller then closes the loops without assumptions, or refuses the state. A law is traced once per
robot; `close` takes one step per call where the loops are closed already, as in a control loop, and a few elsewhere.

**Poses.** `are_poses` checks that matrices are poses, `place_base` makes them of place and quaternion.

[1] J. Nocedal, S. J. Wright, Numerical Optimization, 2nd ed., Springer 2006, chapter 11.
"""

import hashlib
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jounce.arguments.poses import POSE_TOLERANCE, pose_residuals
from jounce.core.scalars import FLOAT, Array
from jounce.dynamics import loop_closure
from jounce.dynamics.computation import DEPENDENT_INPUT, Computation, Port, Signature, number_scalars
from jounce.dynamics.loop_assembly import MAX_DIRECT_CORRECTION, STEP_MEASURES, newton_step
from jounce.dynamics.loop_branches import scales, with_solved_loops
from jounce.dynamics.loops import closure_of
from jounce.model.mechanism import Mechanism, with_exact_integers
from jounce.native import cache, jit, memory_layout
from jounce.native.jit import host
from jounce.native.scratch_pool import make_pool
from jounce.program.program import Tape, TapeFullError
from jounce.spatial import groups

Law = Callable[..., Sequence[Any]]  # from traced arrays to the scalars of the results
Missed = Any  # how far matrices are from poses: sums of squares (...), whose root is at least the largest residual
MAX_CLOSING_STEPS = 5  # from nearly closed loops, which converge quadratically
MAX_MISSED = POSE_TOLERANCE**2


class CompiledLaw:
    """A law of arrays as a ufunc, with its code and memory.

    `key` is that of its code in the cache. A law of more steps than compile within `most_seconds` raises
    `TapeFullError`.
    """

    def __init__(self, name: str, key: str, signature: Signature, law: Law, most_seconds: float = math.inf) -> None:
        target = host()
        code = cache.read_or_make(key, lambda: _object_code(signature, law, most_seconds))
        self._code = jit.load_object(code, target)
        self._pool = make_pool(self._code)
        scratch = self._pool.address if self._pool else None
        self.ufunc, self._alive = jit.make_ufunc(self._code.address("states"), signature, name, scratch)


def _object_code(signature: Signature, law: Law, most_seconds: float) -> bytes:
    """Return object code of a law, traced and fused."""
    from jounce.native import calls, straight  # imported here, as a warm cache needs none of it
    from jounce.native.code_forms import SECONDS_PER_STEP
    from jounce.program.passes import factor, fuse

    target = host()
    tape = Tape(most_seconds / SECONDS_PER_STEP)
    results = law(*(tape.variables(*port.shape) for port in signature.inputs))
    steps = fuse(factor(tape.program(results)))
    block = straight.straight_block(steps, signature, target)
    return jit.assemble(calls.write_modules(block, signature, target), target)


class NativeStep:
    """`loop_assembly.newton_step` of a robot on arrays (..., N) and (..., n)."""

    def __init__(self, mechanism: Mechanism) -> None:
        closure = closure_of(mechanism)
        # All that does not depend on a call is prepared here: places of coordinates, and what gaps are compared with.
        self.signature = signature = _step_signature(mechanism)
        self.independent, self.dependent = np.array(closure.independent), np.array(closure.dependent)
        self.no_change, self.count = np.zeros(mechanism.n), len(closure.coordinates)
        sizes = scales(mechanism).coordinates
        self.max_gap, self.max_correction = (
            loop_closure.max_gap(mechanism),
            MAX_DIRECT_CORRECTION * sizes[self.dependent],
        )
        # Followers are dependent coordinates at a fixed ratio to others, which no loop is solved for.
        self.followers = np.searchsorted(closure.dependent, closure.ratios.places)
        self.has_followers = len(self.followers) > 0
        self.max_follower_error = loop_closure.FOLLOWER_PLACE_TOLERANCE * sizes[list(closure.ratios.places)]
        key = hashlib.sha256(f"closing {cache.key(mechanism, Computation('coordinates', 0), host())}".encode())
        exact = with_exact_integers(mechanism)

        def step(q: Array, change: Array) -> list[Any]:
            """Return the scalars of all results of `newton_step`, one after the other."""
            return [x for result in newton_step(exact, q, change) for x in result.ravel()]

        self._compiled = CompiledLaw("closing", key.hexdigest(), signature, step, memory_layout.MAX_COMPILE_SECONDS)
        self.ufunc = self._compiled.ufunc

    def __call__(self, q: np.ndarray, change: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return dependent coordinates (..., N - n), measures and A_d.

        They are those after the step.
        """
        # Constraints may be lost, or coordinates far away: measures say so, not NumPy's warnings.
        with np.errstate(all="ignore"):
            return self.ufunc(q, change)

    def max_measures(self, limit: float) -> tuple[float, float]:
        """Return the largest measures of a step that `close` accepts.

        They are the gap before the step, and the square of the condition number, which stays within `limit`.
        """
        return self.max_gap, min(limit, loop_closure.MAX_CONDITION_ESTIMATE) ** 2

    def close(self, q: np.ndarray, most: tuple[float, float]) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the independent and dependent coordinates of closed loops.

        They are (..., n) and (..., N - n) of q, (..., N). None if they are not nearly closed, measures exceed
        `most`, followers are not at their places, or q is no array of this shape.
        """
        if q.shape[-1:] != (self.count,) or q.dtype != FLOAT:
            return None
        # A single step both checks that the loops are closed and removes the rounding errors that they have.
        dependent, measures, _ = self.ufunc(q, self.no_change)
        if not _are_within(measures, most):
            # Newton's method for the whole batch, until the loops of every state were closed before the step.
            x = q.copy()
            for _ in range(MAX_CLOSING_STEPS):
                x[..., self.dependent] = dependent
                dependent, measures, _ = self.ufunc(x, self.no_change)
                if _are_within(measures, most):
                    break
            else:
                return None
            # A long way leads to another branch.
            if not (np.abs(dependent - q.take(self.dependent, -1)) <= self.max_correction).all():
                return None
        # A follower may be given on another branch, which no gap shows: the step computes it without its loop.
        if self.has_followers:
            follower_errors = (dependent - q.take(self.dependent, -1)).take(self.followers, -1)
            if not (np.abs(follower_errors) <= self.max_follower_error).all():
                return None
        return q.take(self.independent, -1), dependent


def _are_within(measures: np.ndarray, most: tuple[float, float]) -> bool:
    """Return whether loops were closed before a step, and regular.

    Regular are positions that are far from singular ones.
    """
    if measures.ndim > 1:
        return bool((measures <= most).all())
    # One state has two numbers, which Python compares faster than NumPy.
    gap, bound = measures.tolist()
    return bool(gap <= most[0] and bound <= most[1])


def _step_signature(m: Mechanism) -> Signature:
    """Return the ports of `newton_step`: q (N,) and change (n,) to dependent coordinates, measures and A_d."""
    c, rows = closure_of(m), sum(len(loop.rows) for loop in with_solved_loops(m).loops)
    inputs = [Port("q", (len(c.coordinates),), "state"), Port("change", (m.n,), "state")]
    outputs = [Port(DEPENDENT_INPUT, (len(c.dependent),), "result"), Port("measures", (STEP_MEASURES,), "result")]
    outputs.append(Port("constraints", (rows, len(c.solved)), "result"))
    return Signature(number_scalars(inputs), number_scalars(outputs))


def native_step(mechanism: Mechanism) -> NativeStep | None:
    """Return the step of a closed robot of numbers.

    None if it takes long to compile, or if no coordinate is solved for.
    """
    if not closure_of(mechanism).solved:
        return None
    try:
        return NativeStep(mechanism)
    except TapeFullError:
        return None


_POSE, _NUMBERS = Port("C", (4, 4), "base"), Port("p", (len(groups.FREE.positions),), "base")
_MISSED = Port("missed", (), "result")
_CHECK = Signature((_POSE,), (_MISSED,))
_PLACEMENT = Signature((_NUMBERS,), number_scalars((Port("C", (4, 4), "result"), _MISSED)))


def are_poses(C: np.ndarray) -> bool:
    """Return whether all matrices (..., 4, 4) are poses for certain.

    It is False for NaN, and for matrices on the verge: their sum of squares is too large, if no residual is.
    """
    # An identity is compared faster than types. The type of unpickled arrays is another object.
    if C.dtype is not FLOAT and C.dtype != FLOAT:
        return False
    if C.shape != (4, 4) and C.shape[-2:] != (4, 4):
        return False
    check = _ufuncs.get("poses")
    if check is None:
        check = _make_ufunc("poses", _CHECK, _sum_of_squares)
    return is_within_tolerance(check(C))


def is_within_tolerance(missed: Missed) -> bool:
    """Return whether all matrices are poses to the tolerance of `check_pose`.

    That compares the largest residual, which is at most the root of the sum of squares.
    """
    if type(missed) is np.ndarray:
        return bool((missed <= MAX_MISSED).all())
    # One pose has one number, which Python compares faster than NumPy.
    return float(missed) <= MAX_MISSED


def place_base(p: np.ndarray) -> tuple[np.ndarray, Missed]:
    """Return the pose of place and quaternion (..., 7), and its error.

    The pose is (..., 4, 4); the error is how far it is from a pose, as the quaternion may not be of length 1. The
    law is `FREE.pose`.
    """
    place = _ufuncs.get("placement")
    if place is None:
        place = _make_ufunc("placement", _PLACEMENT, _placement)
    placed: tuple[np.ndarray, Missed] = place(p)
    return placed


def pose_of_numbers(p: Array) -> Array:
    """Return `FREE.pose`, for float64 by `place_base`.

    Both are equal to the last bit.
    """
    if type(p) is np.ndarray and p.dtype == FLOAT:
        return place_base(p)[0]
    return groups.FREE.pose(p)


def _sum_of_squares(C: Array) -> list[Any]:
    """Return how far a matrix (4, 4) is from a pose: the sum of squares of `pose_residuals`."""
    return [sum(x * x for part in pose_residuals(C) for x in np.ravel(part))]


def _placement(p: Array) -> list[Any]:
    """Return the pose of p, (7,), and its error, as scalars."""
    C = groups.FREE.pose(p)
    return [*C.ravel(), *_sum_of_squares(C)]


_ufuncs: dict[str, Callable[..., Any]] = {}  # of laws of poses, by name
_compiled: list[CompiledLaw] = []  # what the ufuncs need


def _make_ufunc(name: str, signature: Signature, law: Law) -> Callable[..., Any]:
    """Return the ufunc of a law of poses, kept for the process."""
    _compiled.append(CompiledLaw(name, cache.code_key(name, host()), signature, law))
    _ufuncs[name] = _compiled[-1].ufunc
    return _ufuncs[name]
