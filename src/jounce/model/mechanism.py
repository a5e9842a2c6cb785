"""Mechanism: the frozen data of a tree of rigid bodies on 1-DOF joints.

Body i hangs by joint i on body ``parent[i] < i`` (or on the ground, -1), with the joint screw X_i in its own frame:
``C_i = C_p B_i exp(X_i theta_i)``. The joint variables follow the coordinates by ``theta = G q + g`` with constant G
and g: the identity, unless joints mimic others. Where loops are closed, some coordinates follow the others (`Closure`).
"""

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, one_of
from jounce.core.scalars import Array, is_numeric, is_zero, reciprocal
from jounce.model.drives import Drives
from jounce.model.elasticity import Elasticity
from jounce.model.frame import Frame
from jounce.model.limits import Limits
from jounce.model.loops import Closure, Loop

GRAVITY = (0, 0, -9.81)  # m/s^2, unless told otherwise
DATA = ("B", "X", "M", "gravity", "G", "g")  # the arrays of a mechanism


@dataclass(frozen=True, eq=False)
class FloatingBase:
    """The body of a floating robot that moves freely in space: its name, and its inertia matrix (6, 6) in its frame."""

    name: str
    M: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Mechanism:
    """The data of a robot: a tree or forest of nb bodies, each behind one joint, with n coordinates.

    `jounce.load` and the constructors of `Robot` make one and check it: ``robot.mechanism``. Its arrays are read-only;
    `dataclasses.replace` changes some of them, without a check.

    Attributes
    ----------
    B : (nb, 4, 4)
        Pose of body i in its parent's frame at theta_i = 0.
    X : (nb, 6)
        Joint screw in the body frame, (xi; eta).
    M : (nb, 6, 6)
        Inertia matrix in the body frame.
    parent : tuple of int
        Index of each body's parent, smaller than its own; -1 is the ground, or the base if the robot floats.
    gravity : (3,)
        Gravitational acceleration in the inertial frame, m/s^2.
    G, g : (nb, n) and (nb,)
        The joint variables are theta = G q + g.
    bodies, joints : tuple of str
        The names of the bodies, and of the joints that move them.
    coordinates : tuple of str
        The names of the coordinates: those joints that follow no other.
    limits : Limits
        The limits of the joint variables.
    drives : Drives
        The drive trains as stated.
    acting : tuple of str
        Those terms of the drives that enter Q.
    elasticity : Elasticity, or None
        The springs between motors and links; None if all joints are rigid.
    base : FloatingBase, or None
        The body in the place of the ground, -1, if the robot floats: its `name`, and its inertia matrix `M` (6, 6).
    frames : tuple of Frame
        The frames of links that are merged into bodies: `name`, `body` (its index, -1 for the ground or base), `T`
        (4, 4), the pose in the frame of the body.
    name : str
        The robot's name.
    default_axes : tuple of str
        Joints whose axis the file leaves out, so that it is the format's default; robots are equal all the same.
    loops : tuple of Loop
        The loops that the tree is left of, each cut at a joint. They are closed if there is a closure.
    closure : Closure, or None
        Which coordinates move the robot with its loops closed. Then G, g and `coordinates` are those of the independent
        ones, and `tree` is the robot with its loops open.

    Examples
    --------
    >>> import jounce
    >>> mechanism = jounce.load("planar2r").mechanism
    >>> mechanism.parent, mechanism.coordinates
    ((-1, 0), ('joint1', 'joint2'))
    """

    B: Array
    X: Array
    M: Array
    parent: tuple[int, ...]
    gravity: Array
    G: Array
    g: Array
    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    coordinates: tuple[str, ...]
    limits: Limits
    drives: Drives
    acting: tuple[str, ...] = ()
    elasticity: Elasticity | None = None
    base: FloatingBase | None = None
    frames: tuple[Frame, ...] = ()
    name: str = "robot"
    default_axes: tuple[str, ...] = field(default=(), compare=False)
    loops: tuple[Loop, ...] = ()
    closure: Closure | None = None

    def __post_init__(self) -> None:
        beside = (self.limits.table, *vars(self.drives).values(), *(frame.T for frame in self.frames))
        elastic = self.elasticity.arrays.values() if self.elasticity else ()
        closing = [*self.closure.arrays.values(), self.closure.start] if self.closure else []
        closing += [array for loop in self.loops for array in loop.arrays]
        for array in (*self.arrays.values(), *beside, *elastic, *closing):
            array.flags.writeable = False

    def __setstate__(self, state: dict[str, Any]) -> None:  # a copy or an unpickled one is as frozen as any
        self.__dict__.update(state)
        self.__post_init__()

    @property
    def arrays(self) -> dict[str, Array]:
        """The numbers of the rigid bodies and their joints by name; under ``"base"`` the inertia of a floating base."""
        own = {name: getattr(self, name) for name in DATA}
        return own | {"base": self.base.M} if self.base else own

    @property
    def is_numeric(self) -> bool:
        """Whether these are numbers, not symbols."""
        return all(map(is_numeric, self.arrays.values()))

    @cached_property
    def tree(self) -> "Mechanism":
        """The robot with its loops open and its joints rigid; the mechanism itself where none is closed."""
        c = self.closure
        return (
            self if c is None else replace(self, G=c.G, g=c.g, coordinates=c.coordinates, closure=None, elasticity=None)
        )

    @property
    def nb(self) -> int:
        """The number of bodies behind joints: all but the base of a floating robot."""
        return len(self.parent)

    @property
    def n(self) -> int:
        """The number of coordinates."""
        return len(self.coordinates)

    @property
    def nv(self) -> int:
        """The number of velocities, n, and 6 more if the robot floats: those of its base, which come first."""
        return self.n + (6 if self.base else 0)

    @property
    def body_names(self) -> tuple[str, ...]:
        """The names of all bodies, the base of a floating robot first, in the order of rows of wrenches and poses."""
        return (self.base.name, *self.bodies) if self.base else self.bodies

    @property
    def inertias(self) -> Array:
        """The inertia matrices of all bodies, (len(body_names), 6, 6), in the order of `body_names`."""
        return np.concatenate([self.base.M[None], self.M]) if self.base else self.M

    @property
    def base_inertia(self) -> Array:
        """The inertia matrix (6, 6) of the base; that of the ground, on which a fixed robot stands, is zero."""
        return self.base.M if self.base else np.zeros((6, 6), dtype=int)

    @property
    def first(self) -> int:
        """The row of body 0 among `body_names`: 1 if the robot floats, as row 0 is that of its base."""
        return 1 if self.base else 0

    @property
    def frame_names(self) -> tuple[str, ...]:
        """The names of the bodies, and of the links merged into them."""
        return (*self.body_names, *(frame.name for frame in self.frames))

    def frame(self, name: str) -> Frame:
        """Where a body, or a link merged into one, sits.

        Parameters
        ----------
        name : str
            The name of the body or link.

        Returns
        -------
        Frame
            With its `name`, its `body` (an index, -1 for the ground or base), and its pose `T` (4, 4) in the frame of
            the body.

        Raises
        ------
        JounceError
            If the name is unknown.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("panda").mechanism.frame("panda_hand_tcp").body
        6
        """
        one_of("body", name, self.frame_names)
        if name in self.body_names:
            return Frame(name, self.body_names.index(name) - self.first, np.eye(4, dtype=int))
        return next(frame for frame in self.frames if frame.name == name)


@lru_cache(maxsize=64)
def reciprocal_mass(mechanism: Mechanism) -> Array:
    """1 / m of the mass m of all bodies that move, a floating base included, (1,).

    Raises
    ------
    JounceError : if they have no mass, and hence no centre of mass.
    """
    mass = mechanism.inertias[:, 3:4, 3].sum(axis=0)
    if is_zero(mass[0]):
        raise JounceError(f"{mechanism.name!r} has no centre of mass, as all masses are 0; give its bodies mass")
    return reciprocal(mass)


def body_name(mechanism: Mechanism, body: int, ground: str = "ground") -> str:
    """The name of a body by its index; -1 is a floating base, or what the ground is called."""
    row = body + mechanism.first
    return mechanism.body_names[row] if row >= 0 else ground


def ancestors(mechanism: Mechanism) -> np.ndarray:
    """(nb, nb) integers: 1 where body j is body i itself or carries it."""
    carriers = np.eye(mechanism.nb, dtype=int)
    for i, p in enumerate(mechanism.parent):
        if p >= 0:
            carriers[i] += carriers[p]
    return carriers


def path_to(mechanism: Mechanism, body: int) -> list[int]:
    """Return the bodies on the path from the ground to a body, the body last; none for the ground, -1."""
    path: list[int] = []
    while body >= 0:
        path.append(body)
        body = mechanism.parent[body]
    return path[::-1]


def reference_poses(mechanism: Mechanism) -> list[Array]:
    """The poses of all the bodies at theta = 0."""
    poses: list[Array] = []
    for B, p in zip(mechanism.B, mechanism.parent, strict=True):
        poses.append(B if p < 0 else poses[p] @ B)
    return poses
