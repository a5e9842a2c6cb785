"""Loops of a robot: joints at which they are cut, so that a tree is left, and the coordinates of the closed robot.

A cut joint joins two frames on bodies of the tree. Its kind says which relative motions it leaves: those that a lower
pair, a sphere, or no motion at all allows. They are subgroups of SE(3), so that the rows of one constant matrix vanish
on the relative twist, seen from the first frame, wherever the loop is closed.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jounce.core.equality import EqualByValue
from jounce.core.scalars import Array, concatenate
from jounce.model.frame import UNIT_ROUNDING, Frame

DEFAULT_LOOP_AXIS = (0, 0, 1)  # the axis of a cut joint that states none
_I = np.eye(3, dtype=int)


def _perpendicular_directions(axis: np.ndarray) -> np.ndarray:
    """Return two unit vectors (2, 3) perpendicular to a unit vector.

    They are perpendicular to each other, too. They are axes of the frame where the vector is one.
    """
    first = np.cross(axis, _I[np.argmin(np.abs(axis))])
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)]) + 0.0


def _round_directions(directions: np.ndarray) -> np.ndarray:
    """Return directions along axes as integers, which keep zeros and symbols exact."""
    whole = np.rint(directions)
    return whole.astype(int) if (np.abs(directions - whole) <= UNIT_ROUNDING).all() else directions


# of a cut joint, the directions in which it allows no turn and no slide
HELD_DIRECTIONS: Mapping[str, Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]] = {
    "spherical": lambda axis: (_I[:0], _I),
    "revolute": lambda axis: (_perpendicular_directions(axis), _I),
    "prismatic": lambda axis: (_I, _perpendicular_directions(axis)),
    "cylindrical": lambda axis: (_perpendicular_directions(axis), _perpendicular_directions(axis)),
    "planar": lambda axis: (_perpendicular_directions(axis), axis[None]),
    "fixed": lambda axis: (_I, _I),
}


@dataclass(frozen=True, eq=False)
class Loop(EqualByValue):
    """A loop of bodies, cut at the joint between two frames.

    Attributes
    ----------
    a, b : Frame
        The frames that the joint joins, on two bodies; their origins meet, but for slides that the joint allows.
    joint : str
        What the joint is: "spherical", "revolute", "prismatic", "cylindrical", "planar" or "fixed".
    axis : (3,)
        The axis of turns and slides, or the normal of the plane, in the axes of frame a, of length 1.

    Examples
    --------
    >>> import jounce
    >>> [loop] = jounce.load("fivebar").mechanism.loops
    >>> loop.name, loop.joint, loop.rows.shape
    ('left_tip-right_tip', 'spherical', (3, 6))
    """

    a: Frame
    b: Frame
    joint: str
    axis: Array

    @property
    def name(self) -> str:
        """The names of both frames."""
        return f"{self.a.name}-{self.b.name}"

    @property
    def held(self) -> tuple[np.ndarray, np.ndarray]:
        """The directions (k, 3) and (l, 3) without turns and slides.

        They are in the axes of frame a.
        """
        turns, slides = HELD_DIRECTIONS[self.joint](np.asarray(self.axis, dtype=float))
        return _round_directions(turns), _round_directions(slides)

    @property
    def arrays(self) -> tuple[Array, ...]:
        """The arrays of the loop."""
        return self.a.T, self.b.T, self.axis

    @cached_property
    def rows(self) -> np.ndarray:
        """The rows (k + l, 6) that vanish on the relative twist.

        They are seen from frame a.
        """
        turns, slides = self.held
        return np.concatenate([np.pad(turns, ((0, 0), (0, 3))), np.pad(slides, ((0, 0), (3, 0)))])

    @cached_property
    def allowed(self) -> np.ndarray:
        """The projection (6, 6) of twists on what the joint allows.

        It is the projection across the rows.
        """
        return _round_directions(np.eye(6, dtype=int) - self.rows.T @ self.rows)


@dataclass(frozen=True, eq=False)
class FollowerRatios:
    """Dependent coordinates that follow independent ones by constant ratios.

    d = F u + offset. The joints of parallelograms follow so.
    """

    places: tuple[int, ...]  # of the k dependent coordinates among those of the tree
    F: Array  # (k, n)
    offset: Array  # (k,), rad or m

    def positions(self, u: Array) -> Array:
        """Return the followers (..., k) of independent coordinates (..., n)."""
        return (self.F @ u[..., None])[..., 0] + self.offset


NO_RATIOS = FollowerRatios((), np.zeros((0, 0)), np.zeros(0))


@dataclass(frozen=True, eq=False)
class Closure:
    """The coordinates that move a robot with its loops closed.

    Attributes
    ----------
    coordinates : tuple of str
        The N coordinates of the tree.
    G, g : (nb, N) and (nb,)
        The joint variables of the tree, theta = G q + g.
    independent : tuple of int
        Those n of the coordinates that move the closed robot.
    start : (N,)
        A configuration in which the loops are closed: the branch that positions are continued from.
    actuated : tuple of int
        The coordinates whose joints have motors.
    passive : tuple of int
        The places, among the independent coordinates, of those that no motor moves, but springs or nothing.
    weights : (len(actuated),)
        Of their forces, where there are more than independent coordinates: the sum of weight times force squared
        is least.
    ratios : FollowerRatios
        Those of the dependent coordinates that follow by constant ratios; constraints are solved for the others.

    Examples
    --------
    >>> import jounce
    >>> closure = jounce.load("fivebar").mechanism.closure
    >>> closure.coordinates, closure.independent
    (('left_shoulder', 'left_elbow', 'right_shoulder', 'right_elbow'), (0, 2))
    """

    coordinates: tuple[str, ...]
    G: Array
    g: Array
    independent: tuple[int, ...]
    start: np.ndarray
    actuated: tuple[int, ...]
    weights: np.ndarray
    ratios: FollowerRatios = NO_RATIOS
    passive: tuple[int, ...] = ()

    @property
    def force_places(self) -> tuple[int, ...]:
        """The coordinates of the tree at which forces act.

        First come those of motors, then passive ones, at which forces are what these coordinates lack.
        """
        return (*self.actuated, *(self.independent[k] for k in self.passive))

    @property
    def driven(self) -> list[int]:
        """The places, among the independent coordinates, of those that motors move."""
        return [k for k in range(len(self.independent)) if k not in self.passive]

    @cached_property
    def dependent(self) -> tuple[int, ...]:
        """The coordinates of the tree that follow the others."""
        return tuple(j for j in range(len(self.coordinates)) if j not in self.independent)

    @cached_property
    def solved(self) -> tuple[int, ...]:
        """The dependent coordinates that constraints are solved for."""
        return tuple(j for j in self.dependent if j not in self.ratios.places)

    @property
    def arrays(self) -> dict[str, Array]:
        """The numbers that quantities depend on, by name."""
        tree = {"tree G": self.G, "tree g": self.g, "weights": self.weights}
        return tree | {"ratios": self.ratios.F, "offset": self.ratios.offset}


def convert_loops(
    loops: Sequence[Loop], closure: Closure | None, convert: Callable[[Array], Array]
) -> tuple[tuple[Loop, ...], Closure | None]:
    """Return loops and their closure with the numbers converted to other scalars."""

    def convert_frame(frame: Frame) -> Frame:
        return replace(frame, T=convert(frame.T))

    converted = tuple(replace(loop, a=convert_frame(loop.a), b=convert_frame(loop.b)) for loop in loops)
    if closure is None:
        return converted, None
    ratios = replace(closure.ratios, F=convert(closure.ratios.F), offset=convert(closure.ratios.offset))
    return converted, replace(closure, G=convert(closure.G), g=convert(closure.g), ratios=ratios)


def all_coordinates(closure: Closure, independent: Array, dependent: Array) -> Array:
    """Return all coordinates (..., N) of the tree.

    They come from (..., n) that move and (..., N - n) that follow.
    """
    order = np.argsort([*closure.independent, *closure.dependent])
    return concatenate([independent, dependent], axis=-1)[..., order]
