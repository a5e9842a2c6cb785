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
from jounce.spatial.series import Series

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
    """Dependent coordinates that follow independent ones by themselves, without constraints to solve.

    ``d = F u + offset``, by constant ratios, as the joints of parallelograms; or by polynomials, to which the powers
    add ``sum over p of P_p u^(p + 2)``, entry by entry of u. Then ratios vary: ``d' = R u'`` with
    ``R = F + sum (p + 2) P_p diag(u^(p + 1))``.
    """

    places: tuple[int, ...]  # of the k dependent coordinates among those of the tree
    F: Array  # (k, n)
    offset: Array  # (k,), rad or m
    powers: tuple[Array, ...] = ()  # P_0, P_1, ..., (k, n) each

    def positions(self, u: Array) -> Array:
        """Return the followers (..., k) of independent coordinates (..., n)."""
        followers, power = (self.F @ u[..., None])[..., 0] + self.offset, u
        for P in self.powers:
            power = power * u
            followers = followers + (P @ power[..., None])[..., 0]
        return followers

    def velocities(self, u: Series, x: Series) -> Series:
        """Return R x, (..., k, m), of independent velocities x (..., n, m) at u, (..., n, 1)."""
        return self.F @ x if len(self.powers) == 0 else self._ratios(u) @ x

    def forces(self, u: Series, Q: Series) -> Series:
        """Return R^T Q, (..., n, m), of forces Q (..., k, m) on the followers."""
        return self.F.mT @ Q if len(self.powers) == 0 else self._ratios(u).mT @ Q

    def curvature(self, u: Series, Q: Series) -> Series:
        """Return d(R^T Q)/du of forces (..., k, 1) that do not change: the diagonal (..., n, 1) of a matrix."""
        total, power = 0 * (self.F.mT @ Q), Series.constant(np.ones((self.F.shape[1], 1), dtype=int))
        for p, P in enumerate(self.powers):
            total = total + (p + 2) * (p + 1) * (power * (P.mT @ Q))
            power = power * u
        return total

    def _ratios(self, u: Series) -> Series:
        """Return R, (..., k, n)."""
        R, power = Series.constant(self.F), Series.constant(np.ones((1, self.F.shape[1]), dtype=int))
        for p, P in enumerate(self.powers):
            power = power * u.mT
            R = R + (p + 2) * (P * power)
        return R


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
        Those of the dependent coordinates that follow by constant ratios or polynomials; constraints are solved for
        the others.

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
        powers = {f"power {p + 2}": P for p, P in enumerate(self.ratios.powers)}
        return tree | {"ratios": self.ratios.F, "offset": self.ratios.offset, **powers}


def convert_loops(
    loops: Sequence[Loop], closure: Closure | None, convert: Callable[[Array], Array]
) -> tuple[tuple[Loop, ...], Closure | None]:
    """Return loops and their closure with the numbers converted to other scalars."""

    def convert_frame(frame: Frame) -> Frame:
        return replace(frame, T=convert(frame.T))

    converted = tuple(replace(loop, a=convert_frame(loop.a), b=convert_frame(loop.b)) for loop in loops)
    if closure is None:
        return converted, None
    ratios = closure.ratios
    powers = tuple(convert(P) for P in ratios.powers)
    ratios = replace(ratios, F=convert(ratios.F), offset=convert(ratios.offset), powers=powers)
    return converted, replace(closure, G=convert(closure.G), g=convert(closure.g), ratios=ratios)


def all_coordinates(closure: Closure, independent: Array, dependent: Array) -> Array:
    """Return all coordinates (..., N) of the tree.

    They come from (..., n) that move and (..., N - n) that follow.
    """
    order = np.argsort([*closure.independent, *closure.dependent])
    return concatenate([independent, dependent], axis=-1)[..., order]
