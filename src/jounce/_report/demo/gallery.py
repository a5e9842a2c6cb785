"""The pictures of the paper's example, by name."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce._report.demo.example import Example, Forces, StepErrors, published
from jounce.figures.canvas import INK, axes_letter, legend_above, line_style, painted
from jounce.figures.curves import draw_curves
from jounce.figures.panels import CurvePanel, TableRun, columns_of

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
        "published-code": lambda: overlay(alone, published(alone)),
    }


def forces(found: Example, title: str, other: Example) -> "Figure":
    """q, Q, Qd and Q2d over time, the last two with numerical differentiation laid over.

    The columns are those that suit this example and the other alike, so that their pictures can be compared.
    """
    panels = _panels(found)
    return draw_curves([TableRun(found.t, panels)], title, columns_of([*panels, *_panels(other)]))


def _panels(found: Example) -> list[CurvePanel]:
    differentiated = (None, None, *found.differentiated)
    labels = (r"$q$ [rad]", *FORCE_LABELS)

    def by_joint(values: np.ndarray) -> dict[str, np.ndarray]:
        return dict(zip(found.robot.joint_names, values.T, strict=True))

    return [
        CurvePanel(label, by_joint(exact), None if rough is None else by_joint(rough))
        for label, exact, rough in zip(
            labels, (found.motion(found.t, 0)[0], *found.forces), differentiated, strict=True
        )
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


def overlay(found: Example, other: Forces) -> "Figure":
    """Q, Qd and Q2d of the two joints in which the published code is farthest off, with its curves laid over."""
    joints = np.sort(np.abs(other[-1] - found.forces[-1]).max(0).argsort()[-2:])
    styles = {"formulas of the paper": line_style(0), "published code": line_style(1)}

    def paint(figure: "Figure") -> None:
        grid = figure.subplots(len(FORCE_LABELS), len(joints), sharex=True)
        for row, label, values in zip(grid, FORCE_LABELS, zip(found.forces, other, strict=True), strict=True):
            for axes, joint in zip(row, joints, strict=True):
                for curves, style in zip(values, styles.values(), strict=True):
                    axes.plot(found.t, curves[:, joint], **style)
                axes.margins(x=0.01)
            row[0].set_ylabel(label)
        for axes, joint in zip(grid[0], joints, strict=True):
            axes.set_title(found.robot.joint_names[joint])
        for axes in grid[-1]:
            axes.set_xlabel("t [s]")
        for i, axes in enumerate(grid.flat):
            axes.set_title(f"({axes_letter(i)})", loc="left")
        figure.align_ylabels(grid)
        legend_above(figure, styles)

    return painted(paint, 9, 6)


def _style(i: int) -> dict[str, Any]:
    return {"marker": "osD^"[i], "ms": 3.5, "mfc": "white", **line_style(i)}


def _draw(axes: "Axes", errors: StepErrors, label: str) -> None:
    for i, values in enumerate(errors.of_scheme.values()):
        axes.loglog(errors.h, values, **_style(i))
    axes.axhline(errors.exact, **EXACT_STYLE)
    axes.set_ylabel(label)
    axes.set_xlabel("step h [s]")
