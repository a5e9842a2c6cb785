"""Compile small laws for the short way of calls: Newton's step that closes loops, and poses of a base.

`CompiledLaw` is what both are: a law of a few arrays, traced, compiled and kept in the cache, which NumPy calls as a
ufunc. NumPy's own operations would take longer for them than kernels take for the forces.

**Loops** (`native_step`). Problem: of coordinates q, keep the independent ones and find the dependent ones with which
the gaps of all loops are 0. Algorithm: Newton's method by the step of `loop_assembly`, from where loops are nearly
closed; its error is about the square of the one before [1]. Invariants: independent coordinates do not change; results
are those of a step from where gaps were within `max_gap`, hence closed to rounding. Failure: no result where the loops
are not closed after `MAX_CLOSING_STEPS`, where a state of the batch is too near to a singularity or has moved to
another branch. The caller then closes the loops without assumptions, or refuses the state.

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
Missed = Any  # how far matrices are from poses: sums of squares (...), whose root is at least the largest part
MAX_CLOSING_STEPS = 5  # from nearly closed loops, which converge quadratically
MAX_MISSED = POSE_TOLERANCE**2


class CompiledLaw:
    """A law of arrays as a ufunc, with the code and the scratch memory that it needs; `key` is that of its code.

    A law of more steps than compile within `most_seconds` raises `TapeFullError`.
    """

    def __init__(self, name: str, key: str, signature: Signature, law: Law, most_seconds: float = math.inf) -> None:
        target = host()
        code = cache.read_or_make(key, lambda: _object_code(signature, law, most_seconds))
        self._code = jit.load_object(code, target)
        self._pool = make_pool(self._code)
        scratch = self._pool.address if self._pool else None
        self.ufunc, self._alive = jit.make_ufunc(self._code.address("states"), signature, name, scratch)


def _object_code(signature: Signature, law: Law, most_seconds: float) -> bytes:
    """A law traced on scalars, its operations shared and fused, as object code."""
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
        self.signature = signature = _step_signature(mechanism)
        self.own, self.others = np.array(closure.independent), np.array(closure.dependent)
        self.still, self.count = np.zeros(mechanism.n), len(closure.coordinates)
        sizes = scales(mechanism).coordinates
        self.closed, self.near = loop_closure.max_gap(mechanism), MAX_DIRECT_CORRECTION * sizes[self.others]
        self.following = np.searchsorted(closure.dependent, closure.ratios.places)
        self.has_followers = len(self.following) > 0
        self.in_place = loop_closure.FOLLOWER_PLACE_TOLERANCE * sizes[list(closure.ratios.places)]
        key = hashlib.sha256(f"closing {cache.key(mechanism, Computation('coordinates', 0), host())}".encode())
        exact = with_exact_integers(mechanism)

        def step(q: Array, change: Array) -> list[Any]:
            return [x for result in newton_step(exact, q, change) for x in result.ravel()]

        self._compiled = CompiledLaw("closing", key.hexdigest(), signature, step, memory_layout.MAX_COMPILE_SECONDS)
        self.ufunc = self._compiled.ufunc

    def __call__(self, q: np.ndarray, change: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The dependent coordinates (..., N - n) after the step, its measures, and A_d."""
        with np.errstate(all="ignore"):  # constraints may be lost, or coordinates far away
            return self.ufunc(q, change)

    def max_measures(self, limit: float) -> tuple[float, float]:
        """The measures of a step up to which loops were closed before it, and a condition number within a limit."""
        return self.closed, min(limit, loop_closure.MAX_CONDITION_ESTIMATE) ** 2

    def close(self, q: np.ndarray, most: tuple[float, float]) -> tuple[np.ndarray, np.ndarray] | None:
        """The independent coordinates (..., n) of q, (..., N), and the dependent ones, with loops closed.

        None if they are not nearly closed, measures exceed `most`, followers are not at their places, or q is no array
        of this shape.
        """
        if q.shape[-1:] != (self.count,) or q.dtype != FLOAT:
            return None
        # A single step both checks that the loops are closed and removes the rounding errors that they have.
        found, measures, _ = self.ufunc(q, self.still)
        if not _are_within(measures, most):
            # Newton's method for the whole batch, until the loops of every state were closed before the step.
            x = q.copy()
            for _ in range(MAX_CLOSING_STEPS):
                x[..., self.others] = found
                found, measures, _ = self.ufunc(x, self.still)
                if _are_within(measures, most):
                    break
            else:
                return None
            # A long way leads to another branch.
            if not (np.abs(found - q.take(self.others, -1)) <= self.near).all():
                return None
        if self.has_followers:  # which may be on another branch: their loops are not looked at
            off = (found - q.take(self.others, -1)).take(self.following, -1)
            if not (np.abs(off) <= self.in_place).all():
                return None
        return q.take(self.own, -1), found


def _are_within(measures: np.ndarray, most: tuple[float, float]) -> bool:
    """Whether all loops were closed before a step, and far from singular."""
    if measures.ndim > 1:
        return bool((measures <= most).all())
    gap, bound = measures.tolist()  # of one state: NumPy compares its scalars slowly
    return bool(gap <= most[0] and bound <= most[1])


def _step_signature(m: Mechanism) -> Signature:
    c, rows = closure_of(m), sum(len(loop.rows) for loop in with_solved_loops(m).loops)
    inputs = [Port("q", (len(c.coordinates),), "state"), Port("change", (m.n,), "state")]
    outputs = [Port(DEPENDENT_INPUT, (len(c.dependent),), "result"), Port("measures", (STEP_MEASURES,), "result")]
    outputs.append(Port("constraints", (rows, len(c.solved)), "result"))
    return Signature(number_scalars(inputs), number_scalars(outputs))


def native_step(mechanism: Mechanism) -> NativeStep | None:
    """The step of a closed robot of numbers, unless it takes long to compile, or nothing is solved for."""
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
    """Whether all matrices (..., 4, 4) are poses for certain; False also of NaN, and of what is on the verge."""
    if C.dtype is not FLOAT and C.dtype != FLOAT:  # unpickled, it is another object
        return False
    if C.shape != (4, 4) and C.shape[-2:] != (4, 4):
        return False
    check = _made.get("poses") or _make_ufunc("poses", _CHECK, _sum_of_squares)
    return is_within_tolerance(check(C))


def is_within_tolerance(missed: Missed) -> bool:
    """Whether all matrices are poses to the tolerance of `check_pose`, which compares the largest part."""
    if type(missed) is np.ndarray:
        return bool((missed <= MAX_MISSED).all())
    return float(missed) <= MAX_MISSED  # of one pose: NumPy compares its scalars slowly


def place_base(p: np.ndarray) -> tuple[np.ndarray, Missed]:
    """The pose (..., 4, 4) of place and quaternion (..., 7), `FREE.pose`, and how far it is from one."""
    place = _made.get("placement") or _make_ufunc("placement", _PLACEMENT, _placement)
    found: tuple[np.ndarray, Missed] = place(p)
    return found


def pose_of_numbers(p: Array) -> Array:
    """`FREE.pose`, to the last bit that of `place_base` for arrays of float64."""
    if type(p) is np.ndarray and p.dtype == FLOAT:
        return place_base(p)[0]
    return groups.FREE.pose(p)


def _sum_of_squares(C: Array) -> list[Any]:
    return [sum(x * x for part in pose_residuals(C) for x in np.ravel(part))]


def _placement(p: Array) -> list[Any]:
    C = groups.FREE.pose(p)
    return [*C.ravel(), *_sum_of_squares(C)]


_made: dict[str, Callable[..., Any]] = {}
_compiled: list[CompiledLaw] = []  # what the ufuncs need


def _make_ufunc(name: str, signature: Signature, law: Law) -> Callable[..., Any]:
    """The ufunc of a law of poses, which is kept."""
    _compiled.append(CompiledLaw(name, cache.code_key(name, host()), signature, law))
    _made[name] = _compiled[-1].ufunc
    return _made[name]
