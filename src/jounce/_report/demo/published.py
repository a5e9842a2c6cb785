"""The paper's figure of the drive forces Q: what its curves are, and what sets them apart from the paper's formulas.

The authors' published code draws it, in which two things differ from the formulas along the motion `paper`: inertias
about the centres of mass stand where those about the origins of the frames belong, without Steiner's theorem; and the
last body exerts a wrench, that of the motion `paper-wrench`, which the text does not mention.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from jounce._report.demo.example import Example, Forces, forces_of
from jounce.engine.engine import Engine
from jounce.spatial.inertia import moments
from jounce.spatial.lie import hat

FORMULAS, WRENCH, STEINER, FIGURE = "formulas", "wrench alone", "no Steiner's theorem alone", "both: the figure"


@dataclass(frozen=True)
class Deviation:
    """How far Q, Qd, Q2d of some curves are from the formulas without a wrench, and Q from the paper's figure."""

    largest: tuple[float, ...]  # N m, N m/s, N m/s^2
    shares: tuple[float, ...]  # of the largest value of the formulas
    from_figure: float  # N m, at the points that were read off the figure


def read_figure() -> tuple[np.ndarray, np.ndarray]:
    """The times and Q of points of the paper's figure, to 4e-4 N m."""
    from importlib.resources import files

    lines = (files(__package__) / "figure_Q.csv").read_text(encoding="utf-8").splitlines()
    points = np.array([line.split(",") for line in lines[2:]], dtype=float)
    return points[:, 0], points[:, 1:]


def published(found: Example, t: np.ndarray | None = None) -> Forces:
    """Q, Qd, Q2d as the authors' published code computes them, at the example's times or others.

    It puts the inertia about the centre of mass where the one about the origin of the frame belongs.
    """
    mechanism = found.robot.mechanism
    m, h, _ = moments(mechanism.M)
    M = mechanism.M.copy()
    M[:, :3, :3] += hat(h[..., 0]) @ hat(h[..., 0]) / m  # Theta_c = Theta_b + m c~ c~
    return forces_of(Engine(replace(mechanism, M=M)), found.motion, found.t if t is None else t)


def deviations(alone: Example, loaded: Example) -> Mapping[str, Deviation]:
    """What each of the two causes, and both together, make of the formulas' forces without a wrench."""
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
