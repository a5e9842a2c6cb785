"""Computes the iiwa example of Müller & Kumar, Section 6.2, with pictures.

`example` computes the forces along its motion; `step_errors` and `time_methods` measure the errors and the time of
their rates. All differences are the largest over the joints and the motion, as shares of the largest exact value.

`published` is the paper's figure of the drive forces Q, and `deviations` compares it with the paper's formulas.
The authors' published code draws it, in which two things differ from the formulas along the motion `paper`: inertias
about the centres of mass stand where those about the origins of the frames belong, without Steiner's theorem; and the
last body exerts a wrench, that of the motion `paper-wrench`, which the text does not mention.

`gallery` has the pictures by name.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce.core.typing import Method
from jounce.dynamics.quantities import DEFAULT_QUANTITY
from jounce.engine import backends
from jounce.engine.engine import Engine
from jounce.engine.plan import compute
from jounce.figures import canvas
from jounce.figures.canvas import Style
from jounce.figures.curves import RING_STYLE, draw_curves, overlay_runs
from jounce.figures.panels import DrawnRun, Panel, columns_of
from jounce.io import motions
from jounce.io.bundled import iiwa14
from jounce.motion import Motion
from jounce.motion.channel import Channel
from jounce.motion.joint_matching import build_motion
from jounce.spatial import inertia, lie

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
    """The forces along a motion, with rates by central differences of samples."""

    robot: Engine
    motion: Motion
    t: np.ndarray
    forces: Forces
    differentiated: Forces  # Qd from Q, Q2d from Qd

    def states(self, t: Any) -> tuple[Any, Any]:
        """Return the rates and the wrench at times."""
        return self.motion(t), self.motion.wrench(t)

    def differences(self) -> tuple[float, ...]:
        """Return the largest errors of the differentiated rates."""
        return tuple(relative_error(a - b, b) for a, b in zip(self.differentiated, self.forces[1:], strict=True))


@dataclass(frozen=True)
class StepErrors:
    """The errors of differentiation over the step h, by scheme.

    `exact` is the difference of two exact methods, which have no step.
    """

    h: np.ndarray
    of_scheme: dict[str, np.ndarray]
    exact: float


def example(name: str, states: int) -> Example:
    """Compute the paper's robot along `paper` or `paper-wrench`, at `states` times."""
    robot, terms = Engine(iiwa14()), motions.read_bundled(name)
    t = np.linspace(terms.t[0], terms.t[-1], states)
    motion = build_motion(terms, robot.mechanism)
    forces = forces_of(robot, motion, t)
    return Example(robot, motion, t, forces, tuple(np.gradient(Q, t, axis=0, edge_order=2) for Q in forces[:2]))


def forces_of(robot: Engine, motion: Motion, t: np.ndarray, method: Method | None = None) -> Forces:
    """Compute Q, Qd, Q2d at times of a motion."""
    return compute(robot, DEFAULT_QUANTITY.name, motion(t), wrench=motion.wrench(t), method=method)


def step_errors(robot: Engine) -> tuple[StepErrors, StepErrors]:
    """Return the errors of differentiated Qd and Q2d.

    Qd is differentiated from Q, and Q2d from Qd or Q, along `paper`, at every 64th of a second except near its ends.
    """
    # Two exact methods give the error of rounding. All schemes take their values from five shifts per step h.
    motion = build_motion(motions.read_bundled("paper"), robot.mechanism)
    t = np.arange(motion.start + 0.125, motion.stop - 0.125, 1 / 64)
    exact, second_path = forces_of(robot, motion, t, "recursion"), forces_of(robot, motion, t, "closed_form")
    shifted_forces = [{j: forces_of(robot, motion, t + j * h) for j in range(-2, 3)} for h in DEMO_DIFFERENCE_STEPS]

    def errors(k: int) -> StepErrors:
        of_scheme = {
            name: np.array([
                relative_error(sum(w * Q[j][k - times] for j, w in weights.items()) / h**times - exact[k], exact[k])
                for h, Q in zip(DEMO_DIFFERENCE_STEPS, shifted_forces, strict=True)
            ])
            for name, (times, weights) in SCHEMES.items()
            if times <= k
        }  # fmt: skip
        return StepErrors(DEMO_DIFFERENCE_STEPS, of_scheme, relative_error(second_path[k] - exact[k], exact[k]))

    return errors(1), errors(2)


def methods() -> list[Method]:
    """Return the methods for the forces that are available here."""
    return [method for method in EXAMPLE_METHODS if method != "kernel" or backends.is_available()]


def time_methods(example: Example) -> Iterator[tuple[str, float, float]]:
    """Yield methods with seconds per state, in a batch and alone."""
    batch_states, single_states = example.states(example.t), [example.states(t) for t in example.t[:20]]
    for method in methods():
        start = perf_counter()
        compute(example.robot, DEFAULT_QUANTITY.name, batch_states[0], wrench=batch_states[1], method=method)
        batch_seconds = perf_counter() - start
        times = []
        for rates, wrench in single_states:
            start = perf_counter()
            compute(example.robot, DEFAULT_QUANTITY.name, rates, wrench=wrench, method=method)
            times.append(perf_counter() - start)
        yield method, batch_seconds / len(example.t), float(np.median(times))


def relative_error(difference: np.ndarray, exact: np.ndarray) -> float:
    """Return the largest difference over the largest exact value."""
    return float(np.abs(difference).max() / np.abs(exact).max())


# The paper's figure.
FORMULAS, WRENCH, STEINER, FIGURE = "formulas", "wrench alone", "no Steiner's theorem alone", "both: the figure"


@dataclass(frozen=True)
class Deviation:
    """The largest differences of curves from the formulas and from the figure.

    The formulas are those of Q, Qd, Q2d without a wrench; the figure shows Q alone.
    """

    largest: tuple[float, ...]  # N m, N m/s, N m/s^2
    shares: tuple[float, ...]  # of the largest value of the formulas
    from_figure: float  # N m, at the points that were read off the figure


def read_figure() -> tuple[np.ndarray, np.ndarray]:
    """Read times and Q of the points of the paper's figure.

    They are exact to 4e-4 N m.
    """
    from importlib.resources import files

    lines = (files(__package__) / "figure_Q.csv").read_text(encoding="utf-8").splitlines()
    points = np.array([line.split(",") for line in lines[2:]], dtype=float)
    return points[:, 0], points[:, 1:]


def published(example: Example, t: np.ndarray | None = None) -> Forces:
    """Compute Q, Qd, Q2d as the authors' published code does.

    The times are those of the example by default. The code puts the inertia about the centre of mass where the one
    about the origin of the frame belongs.
    """
    mechanism = example.robot.mechanism
    m, h, _ = inertia.moments(mechanism.M)
    M = mechanism.M.copy()
    M[:, :3, :3] += lie.hat(h[..., 0]) @ lie.hat(h[..., 0]) / m  # Theta_c = Theta_b + m c~ c~
    return forces_of(Engine(replace(mechanism, M=M)), example.motion, example.t if t is None else t)


def deviations(alone: Example, loaded: Example) -> Mapping[str, Deviation]:
    """Return the deviations from the formulas by cause.

    The causes are the wrench, the missing Steiner's theorem, and both.
    """
    # Forces at the times of the example, and at those of the points of the figure.
    t, Q_figure = read_figure()
    both_times = {
        FORMULAS: (alone.forces, forces_of(alone.robot, alone.motion, t)),
        WRENCH: (loaded.forces, forces_of(loaded.robot, loaded.motion, t)),
        STEINER: (published(alone), published(alone, t)),
        FIGURE: (published(loaded), published(loaded, t)),
    }

    def deviation(forces: Forces, at_points: Forces) -> Deviation:
        largest = tuple(float(np.abs(x - y).max()) for x, y in zip(forces, alone.forces, strict=True))
        shares = tuple(float(d / np.abs(y).max()) for d, y in zip(largest, alone.forces, strict=True))
        return Deviation(largest, shares, float(np.abs(at_points[0] - Q_figure).max()))

    return {name: deviation(*pair) for name, pair in both_times.items()}


# Pictures.
EXACT_STYLE: Any = {"color": canvas.INK, "linewidth": 2}
FORCE_LABELS = (r"$Q$ [N m]", r"$\dot{Q}$ [N m/s]", r"$\ddot{Q}$ [N m/s²]")


def gallery(
    alone: Example, loaded: Example, errors: tuple[StepErrors, StepErrors]
) -> Mapping[str, "Callable[[], Figure]"]:
    """Return the pictures by name, as functions that draw them."""
    wrench = r"the last body exerts $10\,\sin(\pi t)$ in all six components of its wrench, N m and N"
    return {
        "forces": lambda: forces(alone, "", loaded),
        "forces-wrench": lambda: forces(loaded, wrench, alone),
        "step-size": lambda: errors_over_steps(*errors),
        "figure": lambda: figure_of_the_paper(alone, loaded),
        "figure-rates": lambda: rates_of_the_figure(alone, loaded),
    }


def forces(example: Example, title: str, other: Example) -> "Figure":
    """Draw q, Q, Qd and Q2d over time, with numerical differentiation.

    The columns suit this example and the other one, so that their pictures can be compared.
    """
    panels = _panels(example)
    return draw_curves([DrawnRun(panels)], title, columns_of([*panels, *_panels(other)]))


def _panels(example: Example) -> list[Panel]:
    labels, exact = (r"$q$ [rad]", *FORCE_LABELS), (example.motion(example.t, 0)[0], *example.forces)
    return [
        Panel(
            _channel(example, label, example.t, values),
            differentiated=None if rough is None else _channel(example, label, example.t, rough),
        )
        for label, values, rough in zip(labels, exact, (None, None, *example.differentiated), strict=True)
    ]


def errors_over_steps(of_Qd: StepErrors, of_Q2d: StepErrors) -> "Figure":
    """Draw the errors of Qd and Q2d over the step of differentiation.

    Each scheme falls to its best step and rises again; the exact rates have no step.
    """
    entries = {name: _style(i) for i, name in enumerate(of_Q2d.of_scheme)}
    entries["exact: closed form against recursion"] = EXACT_STYLE

    def paint(figure: "Figure") -> None:
        left, right = figure.subplots(1, 2, sharey=True)
        _draw(left, of_Qd, r"largest error of $\dot{Q}$ / largest $|\dot{Q}|$")
        _draw(right, of_Q2d, r"largest error of $\ddot{Q}$ / largest $|\ddot{Q}|$")
        canvas.legend_above(figure, entries, columns=3)

    return canvas.painted(paint, 9, 4.2)


def figure_of_the_paper(alone: Example, loaded: Example) -> "Figure":
    """Draw Q of each joint: points of the paper's figure, the authors' code, the formulas."""
    t, Q = read_figure()
    points = Panel(_channel(alone, FORCE_LABELS[0], t, Q), style=RING_STYLE | {"color": canvas.INK})
    return overlay_runs([*_runs(alone, loaded, [0]), DrawnRun([points], "points of the paper's figure")])


def rates_of_the_figure(alone: Example, loaded: Example) -> "Figure":
    """Draw Qd and Q2d of the two joints with the largest deviations.

    They are the deviations of the authors' Q2d from the formulas without a wrench.
    """
    farthest = np.abs(published(loaded)[2] - alone.forces[2]).max(0).argsort()[-2:]
    return overlay_runs(_runs(alone, loaded, [1, 2], sorted(farthest)))


def _runs(alone: Example, loaded: Example, orders: Sequence[int], joints: Sequence[int] = range(7)) -> list[DrawnRun]:
    curves = {
        "authors' code: with wrench, without Steiner's theorem": published(loaded),
        "formulas, with wrench": loaded.forces,
        "formulas, without wrench": alone.forces,
    }
    return [
        DrawnRun([Panel(_channel(alone, FORCE_LABELS[k], alone.t, Q[k]).columns(joints)) for k in orders], title)
        for title, Q in curves.items()
    ]


def _channel(example: Example, label: str, t: np.ndarray, values: np.ndarray) -> Channel:
    """Return a channel of all joints, whose unit is in the label."""
    names = example.robot.joint_names
    return Channel(label, names, ("",) * len(names), t, (values,))


def _style(i: int) -> Style:
    return {"marker": "osD^"[i], "ms": 3.5, "mfc": "white", **canvas.line_style(i)}


def _draw(axes: "Axes", errors: StepErrors, label: str) -> None:
    for i, values in enumerate(errors.of_scheme.values()):
        axes.loglog(errors.h, values, **_style(i))
    axes.axhline(errors.exact, **EXACT_STYLE)
    axes.set_ylabel(label)
    axes.set_xlabel("step h [s]")
