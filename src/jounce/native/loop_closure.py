"""Newton's method for the positions of one closed robot as native code, from where its loops are nearly closed.

Problem: of coordinates q, keep the independent ones and find the dependent ones with which the gaps of all loops are 0.
Algorithm: the step of `loop_assembly`, traced and compiled; its error is about the square of the one before [1].
Invariants: independent coordinates do not change; results are those of a step from where gaps were within `max_gap`,
hence closed to rounding. Failure: no result where the loops are not closed after
`MAX_CLOSING_STEPS`, where a state of the batch is too near to a singularity or has moved to another branch. The caller
then closes the loops without assumptions, or refuses the state.

[1] J. Nocedal, S. J. Wright, Numerical Optimization, 2nd ed., Springer 2006, chapter 11.
"""

import hashlib

import numpy as np

from jounce.core.scalars import FLOAT
from jounce.dynamics.computation import DEPENDENT_INPUT, Computation, Port, Signature, number_scalars
from jounce.dynamics.loop_assembly import MAX_DIRECT_CORRECTION, STEP_MEASURES, newton_step
from jounce.dynamics.loop_branches import scales, with_solved_loops
from jounce.dynamics.loop_closure import FOLLOWER_PLACE_TOLERANCE, MAX_CONDITION_ESTIMATE, max_gap
from jounce.dynamics.loops import closure_of
from jounce.model.mechanism import Mechanism, with_exact_integers
from jounce.native import cache, jit
from jounce.native.jit import host
from jounce.native.memory_layout import MAX_COMPILE_SECONDS
from jounce.native.scratch_pool import make_pool
from jounce.program.program import Tape, TapeFullError

MAX_CLOSING_STEPS = 5  # from nearly closed loops, which converge quadratically


class NativeStep:
    """`loop_assembly.newton_step` of a robot on arrays (..., N) and (..., n)."""

    def __init__(self, mechanism: Mechanism) -> None:
        closure = closure_of(mechanism)
        self.signature = signature = _signature(mechanism)
        self.own, self.others = np.array(closure.independent), np.array(closure.dependent)
        self.still, self.count = np.zeros(mechanism.n), len(closure.coordinates)
        sizes = scales(mechanism).coordinates
        self.closed, self.near = max_gap(mechanism), MAX_DIRECT_CORRECTION * sizes[self.others]
        self.following = np.searchsorted(closure.dependent, closure.ratios.places)
        self.has_followers = len(self.following) > 0
        self.in_place = FOLLOWER_PLACE_TOLERANCE * sizes[list(closure.ratios.places)]
        self._code = jit.load_object(_object_code(mechanism, signature), host())
        self._pool = make_pool(self._code)
        scratch = self._pool.address if self._pool else 0
        self.ufunc, self._alive = jit.make_ufunc(self._code.address("states"), signature, "closing", scratch)

    def __call__(self, q: np.ndarray, change: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The dependent coordinates (..., N - n) after the step, its measures, and A_d."""
        with np.errstate(all="ignore"):  # constraints may be lost, or coordinates far away
            return self.ufunc(q, change)

    def max_measures(self, limit: float) -> tuple[float, float]:
        """The measures of a step up to which loops were closed before it, and a condition number within a limit."""
        return self.closed, min(limit, MAX_CONDITION_ESTIMATE) ** 2

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


def _signature(m: Mechanism) -> Signature:
    c, rows = closure_of(m), sum(len(loop.rows) for loop in with_solved_loops(m).loops)
    inputs = [Port("q", (len(c.coordinates),), "state"), Port("change", (m.n,), "state")]
    outputs = [Port(DEPENDENT_INPUT, (len(c.dependent),), "result"), Port("measures", (STEP_MEASURES,), "result")]
    outputs.append(Port("constraints", (rows, len(c.solved)), "result"))
    return Signature(number_scalars(inputs), number_scalars(outputs))


def _object_code(m: Mechanism, signature: Signature) -> bytes:
    """Object code, from the cache where it is there."""
    target = host()

    def make() -> bytes:
        from jounce.native import calls, straight  # imported here, as a warm cache needs none of it
        from jounce.native.code_forms import SECONDS_PER_STEP
        from jounce.program.passes import factor, fuse

        tape = Tape(MAX_COMPILE_SECONDS / SECONDS_PER_STEP)
        q, change = (tape.variables(*port.shape) for port in signature.inputs)
        results = [x for result in newton_step(with_exact_integers(m), q, change) for x in result.ravel()]
        steps = fuse(factor(tape.program(results)))
        return jit.assemble(
            calls.write_modules(straight.straight_block(steps, signature, target), signature, target), target
        )

    of_robot = cache.key(m, Computation("coordinates", 0), target)
    return cache.read_or_make(hashlib.sha256(f"closing {of_robot}".encode()).hexdigest(), make)


def native_step(mechanism: Mechanism) -> NativeStep | None:
    """The step of a closed robot of numbers, unless it takes long to compile, or nothing is solved for."""
    if not closure_of(mechanism).solved:
        return None
    try:
        return NativeStep(mechanism)
    except TapeFullError:
        return None
