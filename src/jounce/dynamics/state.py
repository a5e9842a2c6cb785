"""State: what the laws of the equations of motion take."""

from dataclasses import dataclass

from jounce.spatial.series import Series


@dataclass(frozen=True)
class State:
    """A motion at an instant, with its rates, and of which body something is asked.

    Coordinates are columns (..., n, 1), wrenches on the bodies (..., 6nb, 1).
    """

    q: Series
    W: Series | None = None
    body: str | None = None  # a body or a link merged into one; None: all bodies
    frame: str = "body"  # of twists: "body", "world" or "spatial"
