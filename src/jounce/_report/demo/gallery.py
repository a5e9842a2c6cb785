"""The pictures of the paper's example, by name."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce._report.demo.example import Example, StepErrors
from jounce._report.demo.published import published, read_figure
from jounce.figures.canvas import INK, Style, legend_above, line_style, painted
from jounce.figures.curves import RING_STYLE, draw_curves, overlay_runs
from jounce.figures.panels import DrawnRun, Panel, columns_of
from jounce.motion.channel import Channel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EXACT_STYLE: Any = {"color": INK, "linewidth": 2}
FORCE_LABELS = (r"$Q$ [N m]", r"$\dot{Q}$ [N m/s]", r"$\ddot{Q}$ [N m/s²]")


def gallery(
    alone: Example, loaded: Example, errors: tuple[StepErrors, StepErrors]
) -> Mapping[str, "Callable[[], Figure]"]:
    """Name of each picture, and what paints it."""
    wrench = r"the last body exerts $10\,\sin(\pi t)$ in all six components of its wrench, N m and N"
    return {
        "forces": lambda: forces(alone, "", loaded),
        "forces-wrench": lambda: forces(loaded, wrench, alone),
        "step-size": lambda: errors_over_steps(*errors),
        "figure": lambda: figure_of_the_paper(alone, loaded),
        "figure-rates": lambda: rates_of_the_figure(alone, loaded),
    }


def forces(found: Example, title: str, other: Example) -> "Figure":
    """q, Q, Qd and Q2d over time, the last two with numerical differentiation laid over.

    The columns are those that suit this example and the other alike, so that their pictures can be compared.
    """
    panels = _panels(found)
    return draw_curves([DrawnRun(panels)], title, columns_of([*panels, *_panels(other)]))


def _panels(found: Example) -> list[Panel]:
    labels, exact = (r"$q$ [rad]", *FORCE_LABELS), (found.motion(found.t, 0)[0], *found.forces)
    return [
        Panel(
            _channel(found, label, found.t, values),
            differentiated=None if rough is None else _channel(found, label, found.t, rough),
        )
        for label, values, rough in zip(labels, exact, (None, None, *found.differentiated), strict=True)
    ]


def errors_over_steps(of_Qd: StepErrors, of_Q2d: StepErrors) -> "Figure":
    """Two panels, Qd and Q2d: each scheme falls to its best step and rises again; the exact rates have no step."""
    entries = {name: _style(i) for i, name in enumerate(of_Q2d.of_scheme)}
    entries["exact: closed form against recursion"] = EXACT_STYLE

    def paint(figure: "Figure") -> None:
        left, right = figure.subplots(1, 2, sharey=True)
        _draw(left, of_Qd, r"largest error of $\dot{Q}$ / largest $|\dot{Q}|$")
        _draw(right, of_Q2d, r"largest error of $\ddot{Q}$ / largest $|\ddot{Q}|$")
        legend_above(figure, entries, columns=3)

    return painted(paint, 9, 4.2)


def figure_of_the_paper(alone: Example, loaded: Example) -> "Figure":
    """Q of each joint: the authors' code, which meets the points of the figure, and the formulas."""
    t, Q = read_figure()
    points = Panel(_channel(alone, FORCE_LABELS[0], t, Q), style=RING_STYLE | {"color": INK})
    return overlay_runs([*_runs(alone, loaded, [0]), DrawnRun([points], "points of the paper's figure")])


def rates_of_the_figure(alone: Example, loaded: Example) -> "Figure":
    """Qd and Q2d of the two joints in which the authors' Q2d is farthest from the formulas without a wrench."""
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


def _channel(found: Example, label: str, t: np.ndarray, values: np.ndarray) -> Channel:
    """Values of the joints, whose unit is in the label."""
    names = found.robot.joint_names
    return Channel(label, names, ("",) * len(names), t, (values,))


def _style(i: int) -> Style:
    return {"marker": "osD^"[i], "ms": 3.5, "mfc": "white", **line_style(i)}


def _draw(axes: "Axes", errors: StepErrors, label: str) -> None:
    for i, values in enumerate(errors.of_scheme.values()):
        axes.loglog(errors.h, values, **_style(i))
    axes.axhline(errors.exact, **EXACT_STYLE)
    axes.set_ylabel(label)
    axes.set_xlabel("step h [s]")
