"""The iiwa example of Müller & Kumar, Section 6.2, computed: the forces along its motion, and how good their rates are.

All differences are the largest over the joints and the motion, as shares of the largest exact value.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np

from jounce.core.typing import Method
from jounce.dynamics.quantities import DEFAULT_QUANTITY
from jounce.engine.backends import is_available
from jounce.engine.engine import Engine
from jounce.engine.plan import compute
from jounce.io import motions
from jounce.io.bundled import iiwa14
from jounce.motion import Motion
from jounce.motion.joint_matching import build_motion

PAPER_MS = 1.6  # of the authors: an evaluation of order 2, on an Intel Core i9-7960X; Section 6.2
EXAMPLE_METHODS: tuple[Method, ...] = ("closed_form", "paper", "recursion", "kernel")
DEMO_DIFFERENCE_STEPS = 2.0 ** -np.arange(4, 29)  # s; powers of two, which add to the times without rounding
SCHEMES = {  # of differentiation: how often they differentiate, and the weights of the values at t + j h
    "forward, 2 points": (1, {0: -1.0, 1: 1.0}),
    "central, 2 points": (1, {-1: -1 / 2, 1: 1 / 2}),
    "central, 4 points": (1, {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}),
    "second difference of Q": (2, {-1: 1.0, 0: -2.0, 1: 1.0}),
}

Forces = tuple[np.ndarray, ...]  # Q, Qd, Q2d


@dataclass(frozen=True)
class Example:
    """The forces along a motion, and their rates as central differences of the samples make them."""

    robot: Engine
    motion: Motion
    t: np.ndarray
    forces: Forces
    differentiated: Forces  # Qd from Q, Q2d from Qd

    def states(self, t: Any) -> tuple[Any, Any]:
        """The rates and the wrench at times."""
        return self.motion(t), self.motion.wrench(t)

    def differences(self) -> tuple[float, ...]:
        """The largest differences of the differentiated rates from the exact ones."""
        return tuple(relative_error(a - b, b) for a, b in zip(self.differentiated, self.forces[1:], strict=True))


@dataclass(frozen=True)
class StepErrors:
    """The errors of differentiation over the step h, by scheme; and how far two exact paths, no step, are apart."""

    h: np.ndarray
    of_scheme: dict[str, np.ndarray]
    exact: float


def example(name: str, states: int) -> Example:
    """Compute the paper's robot along `paper` or `paper-wrench`, at `states` times over its five seconds."""
    robot, terms = Engine(iiwa14()), motions.read_bundled(name)
    t = np.linspace(terms.t[0], terms.t[-1], states)
    motion = build_motion(terms, robot.mechanism)
    forces = forces_of(robot, motion, t)
    return Example(robot, motion, t, forces, tuple(np.gradient(Q, t, axis=0, edge_order=2) for Q in forces[:2]))


def forces_of(robot: Engine, motion: Motion, t: np.ndarray, method: Method | None = None) -> Forces:
    """Q, Qd, Q2d at times of a motion."""
    return compute(robot, DEFAULT_QUANTITY.name, motion(t), wrench=motion.wrench(t), method=method)


def step_errors(robot: Engine) -> tuple[StepErrors, StepErrors]:
    """The errors of Qd from Q, and of Q2d from Qd or Q, along `paper`, at every 64th of a second but near its ends."""
    motion = build_motion(motions.read_bundled("paper"), robot.mechanism)
    t = np.arange(motion.start + 0.125, motion.stop - 0.125, 1 / 64)
    exact, again = forces_of(robot, motion, t, "recursion"), forces_of(robot, motion, t, "closed_form")
    moved = [{j: forces_of(robot, motion, t + j * h) for j in range(-2, 3)} for h in DEMO_DIFFERENCE_STEPS]

    def errors(k: int) -> StepErrors:
        of_scheme = {
            name: np.array([
                relative_error(sum(w * at[j][k - times] for j, w in weights.items()) / h**times - exact[k], exact[k])
                for h, at in zip(DEMO_DIFFERENCE_STEPS, moved, strict=True)
            ])
            for name, (times, weights) in SCHEMES.items()
            if times <= k
        }  # fmt: skip
        return StepErrors(DEMO_DIFFERENCE_STEPS, of_scheme, relative_error(again[k] - exact[k], exact[k]))

    return errors(1), errors(2)


def methods() -> list[Method]:
    """Return the methods for the forces that are available here."""
    return [method for method in EXAMPLE_METHODS if method != "kernel" or is_available()]


def time_methods(found: Example) -> Iterator[tuple[str, float, float]]:
    """Map methods to the time per state in a batch of the whole motion, and of a single call."""
    whole, alone = found.states(found.t), [found.states(t) for t in found.t[:20]]
    for method in methods():
        start = perf_counter()
        compute(found.robot, DEFAULT_QUANTITY.name, whole[0], wrench=whole[1], method=method)
        batch = perf_counter() - start
        times = []
        for rates, wrench in alone:
            start = perf_counter()
            compute(found.robot, DEFAULT_QUANTITY.name, rates, wrench=wrench, method=method)
            times.append(perf_counter() - start)
        yield method, batch / len(found.t), float(np.median(times))


def relative_error(difference: np.ndarray, exact: np.ndarray) -> float:
    """The largest difference over the largest exact value."""
    return float(np.abs(difference).max() / np.abs(exact).max())
