"""The error of numerical differentiation over its step: why exact rates matter."""

from typing import TYPE_CHECKING, Any

from jounce.demo.example import StepErrors
from jounce.figures.canvas import INK, legend_above, line_style, painted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EXACT: Any = {"color": INK, "linewidth": 2}


def errors_over_steps(of_Qd: StepErrors, of_Q2d: StepErrors) -> "Figure":
    """Two panels, Qd and Q2d: each scheme falls to its best step and rises again; the exact rates have no step."""
    entries = {name: _style(i) for i, name in enumerate(of_Q2d.of_scheme)}
    entries["exact: closed form against recursion"] = EXACT

    def paint(figure: "Figure") -> None:
        left, right = figure.subplots(1, 2, sharey=True)
        _draw(left, of_Qd, r"largest error of $\dot{Q}$ / largest $|\dot{Q}|$")
        _draw(right, of_Q2d, r"largest error of $\ddot{Q}$ / largest $|\ddot{Q}|$")
        legend_above(figure, entries, columns=3)

    return painted(paint, 9, 4.2)


def _style(i: int) -> dict[str, Any]:
    return {"marker": "osD^"[i], "ms": 3.5, "mfc": "white", **line_style(i)}


def _draw(axes: "Axes", errors: StepErrors, label: str) -> None:
    for i, values in enumerate(errors.of_scheme.values()):
        axes.loglog(errors.h, values, **_style(i))
    axes.axhline(errors.exact, **EXACT)
    axes.set_ylabel(label)
    axes.set_xlabel("step h [s]")
