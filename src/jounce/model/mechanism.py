"""A mechanism holds data of a tree of rigid bodies on joints.

Body i hangs by a joint on body ``parent[i] < i`` (or on the ground, -1), with the joint screw X_i in its own frame:
``C_i = C_p B_i exp(X_i theta_i)``. The joint variables follow the coordinates by ``theta = G q + g`` with constant G
and g: the identity, unless joints mimic others. Where loops are closed, some coordinates follow the others (`Closure`).
The base of a floating robot is the first body; its joint leaves it all six motions.

Functions below the class give what follows from the tree alone: paths, sizes, names. `cast_model` converts the data to
the scalars of a state: exact integers for symbols, long doubles.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from jounce.core.display import HtmlDisplay, print_table
from jounce.core.errors import JounceError, check_choice, join_names, shorten
from jounce.core.scalars import Array, is_numeric, is_symbolic, is_zero, reciprocal, restore_integers
from jounce.model.contacts import Contact
from jounce.model.drive_trains import LOAD_FRICTION, Drives
from jounce.model.elasticity import Elasticity
from jounce.model.frame import Frame
from jounce.model.limits import Limits
from jounce.model.loops import Closure, Loop, convert_loops

MASSLESS_TIPS, INERTIAS = "massless tips", "inertias"  # what may be meant although it looks like a mistake
GRAVITY = (0, 0, -9.81)  # m/s^2, unless a caller or a file states another


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Mechanism(HtmlDisplay):
    """The data of a robot: a tree or forest of nb bodies, each behind one joint, with n coordinates.

    Joint variables are those of all joints but the one of a base that floats.

    `jounce.load` and the constructors of `Robot` make one and check it: ``robot.mechanism``. Its arrays are read-only;
    `dataclasses.replace` changes some of them, without a check. Mechanisms are equal by identity, not by value: what is
    computed once for a mechanism, such as its code, is kept by it.

    Attributes
    ----------
    B : (nb, 4, 4)
        Pose of body i in its parent's frame where its joint variable is 0; the identity for a base that floats.
    X : (nc, 6)
        Screw of each joint variable in the frame of the body that it moves, (xi; eta).
    M : (nb, 6, 6)
        Inertia matrix in the body frame.
    parent : tuple of int
        Index of each body's parent, smaller than its own; -1 is the ground.
    owners : tuple of int
        The body that each of the nc joint variables moves.
    gravity : (3,)
        Gravitational acceleration in the inertial frame, m/s^2.
    G, g : (nc, n) and (nc,)
        The joint variables are theta = G q + g.
    bodies, joints : tuple of str
        The names of the bodies, and of the joint variables that move them.
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
    floats : bool
        Whether the first body is the base of a floating robot, which moves freely and has no joint variable.
    frames : tuple of Frame
        The frames of links that are merged into bodies: `name`, `body` (its index, -1 for the ground), `T` (4, 4), the
        pose in the frame of the body.
    name : str
        The robot's name.
    meant : tuple of str
        What is meant although it looks like a mistake: "massless tips", "inertias" that no body can have. Verdicts on
        limits rely on it; robots are equal all the same.
    default_axes : tuple of str
        Joints whose axis the file leaves out, so that it is the format's default; robots are equal all the same.
    confirmed_band : float, or None
        The frequency in Hz up to which torques confirmed positions where the robot was identified, if its encoders move
        faster than its links do, as by play; robots are equal all the same.
    loops : tuple of Loop
        The loops that the tree is left of, each cut at a joint. They are closed if there is a closure.
    closure : Closure, or None
        Which coordinates move the robot with its loops closed. Then G, g and `coordinates` are those of the independent
        ones, and `tree` is the robot with its loops open.
    contacts : tuple of Contact
        What a floating robot stands on: its forces are balanced by the wrenches of these contacts.

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
    owners: tuple[int, ...]
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
    floats: bool = False
    frames: tuple[Frame, ...] = ()
    name: str = "robot"
    meant: tuple[str, ...] = field(default=(), compare=False)
    default_axes: tuple[str, ...] = field(default=(), compare=False)
    confirmed_band: float | None = field(default=None, compare=False)
    loops: tuple[Loop, ...] = ()
    closure: Closure | None = None
    contacts: tuple[Contact, ...] = ()

    def __post_init__(self) -> None:
        # All arrays become read-only: caches rely on mechanisms that never change.
        arrays = [*self.arrays.values(), self.limits.table, *vars(self.drives).values()]
        arrays += [frame.T for frame in self.frames]
        if self.elasticity is not None:
            arrays += self.elasticity.arrays.values()
        if self.closure is not None:
            arrays += [*self.closure.arrays.values(), self.closure.start]
        arrays += [array for loop in self.loops for array in loop.arrays]
        for array in arrays:
            array.flags.writeable = False

    def __setstate__(self, state: dict[str, object]) -> None:  # a copy or an unpickled one is as frozen as any
        self.__dict__.update(state)
        self.__post_init__()

    @property
    def summary(self) -> str:
        """The sizes, mass and special features of the robot."""
        special = []
        if self.floats:
            special.append("floats")
        if len(self.loops) > 0:
            special.append(f"{len(self.loops)} loops cut")
        if len(self.contacts) > 0:
            special.append(f"{len(self.contacts)} contacts")
        if self.elasticity is not None:
            special.append("elastic joints")
        if len(self.acting) > 0:
            special.append(f"acting: {join_names(self.acting)}")
        mass = _format_number(self.M[:, 3, 3].sum())
        counts = f"{self.n} coordinates, {self.nb} bodies of {mass} kg"
        return ", ".join([f"Mechanism {shorten(self.name)}: {counts}", *special])

    def __repr__(self) -> str:
        """Return at most twelve lines: the joint variables and the bodies that they move."""
        rows = [
            (self.joints[j], "rad" if np.any(self.X[j, :3]) else "m", self.bodies[i], body_name(self, self.parent[i]),
             _format_number(self.M[i, 3, 3]))
            for j, i in enumerate(self.owners)
        ]  # fmt: skip
        return print_table(self.summary, ("joint", "unit", "moves", "on", "mass, kg"), rows)

    @property
    def has_load_friction(self) -> bool:
        """Whether friction acts that grows with the load of a joint."""
        return LOAD_FRICTION in self.acting and bool(np.any(self.drives.load_friction))

    @property
    def lone_joints(self) -> np.ndarray:
        """Whether each joint variable (nc,) transmits the whole force of a coordinate.

        No spring, loop or follower shares the force.
        """
        # A joint that moves one coordinate alone has a unit row in G, perpendicular to all others.
        is_alone = (np.eye(len(self.G)) == self.G @ self.G.T).all(axis=0)
        return np.asarray(is_alone & (self.closure is None and self.elasticity is None))

    @property
    def arrays(self) -> dict[str, Array]:
        """The numbers of the rigid bodies and their joints by name."""
        return {name: getattr(self, name) for name in ("B", "X", "M", "gravity", "G", "g")}

    @property
    def is_numeric(self) -> bool:
        """Whether `arrays` hold numbers, not symbols."""
        return all(map(is_numeric, self.arrays.values()))

    @cached_property
    def tree(self) -> "Mechanism":
        """The robot with its loops open and its joints rigid.

        It is the mechanism itself where no loop is closed.
        """
        c = self.closure
        if c is None:
            return self
        return replace(self, G=c.G, g=c.g, coordinates=c.coordinates, closure=None, elasticity=None)

    @property
    def takes_dependent(self) -> bool:
        """Whether computations take the dependent coordinates, after loops are closed."""
        return self.is_closed and bool(self.loops)

    @property
    def has_constant_ratios(self) -> bool:
        """Whether no coordinate follows others by a polynomial."""
        return self.closure is None or len(self.closure.ratios.powers) == 0

    @property
    def is_closed(self) -> bool:
        """Whether coordinates follow others, by loops, ratios or polynomials."""
        return self.closure is not None

    @property
    def is_fixed_tree(self) -> bool:
        """Whether it is a tree of independent joints on the ground."""
        return not self.is_closed and not self.floats

    @property
    def independent_places(self) -> tuple[int, ...]:
        """The coordinates of the tree that are those of the robot.

        They are all, unless loops are closed or joints follow others.
        """
        return tuple(range(self.n)) if self.closure is None else tuple(self.closure.independent)

    @property
    def base_body(self) -> str | None:
        """The name of the base if the robot floats."""
        return self.bodies[0] if self.floats else None

    @property
    def moving_bodies(self) -> range:
        """The places of the bodies that joints move: all but a base that floats."""
        return range(int(self.floats), self.nb)

    @property
    def columns(self) -> tuple[tuple[int, ...], ...]:
        """The joint variables that move each body.

        A base that floats has none, a joint of several screws several.
        """
        return _body_columns(self.owners, self.nb)

    @property
    def nb(self) -> int:
        """The number of bodies."""
        return len(self.parent)

    @property
    def n(self) -> int:
        """The number of coordinates."""
        return len(self.coordinates)

    @property
    def nv(self) -> int:
        """The number of velocities: n, and 6 of the base ahead of them if the robot floats."""
        return self.n + 6 * self.floats

    @property
    def frame_names(self) -> tuple[str, ...]:
        """The names of the bodies, and of the links merged into them."""
        return (*self.bodies, *(frame.name for frame in self.frames))

    def frame(self, name: str) -> Frame:
        """Return where a body, or a link merged into one, sits.

        Parameters
        ----------
        name : str
            The name of the body or link.

        Returns
        -------
        Frame
            With its `name`, its `body` (an index, -1 for the ground), and its pose `T` (4, 4) in the frame of the body.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("panda").mechanism.frame("panda_hand_tcp").body
        6
        """
        check_choice("body", name, self.frame_names)
        if name in self.bodies:
            return Frame(name, self.bodies.index(name), np.eye(4, dtype=int))
        return next(frame for frame in self.frames if frame.name == name)


@lru_cache(maxsize=64)
def _body_columns(owners: tuple[int, ...], nb: int) -> tuple[tuple[int, ...], ...]:
    columns: list[list[int]] = [[] for _ in range(nb)]
    for j, i in enumerate(owners):
        columns[i].append(j)
    return tuple(map(tuple, columns))


def single_variables(mechanism: Mechanism) -> dict[int, int]:
    """Return the joint variable of each body that moves along one screw."""
    return {i: columns[0] for i, columns in enumerate(mechanism.columns) if len(columns) == 1}


@lru_cache(maxsize=64)
def robot_size(mechanism: Mechanism) -> float:
    """Return the largest length of a robot, m.

    It is 1 m of a robot without lengths. Lengths are those from joint to joint, cut joint or contact, and from a frame
    to its axis. Other lengths are compared with it, never with a number of metres.
    """
    turning = mechanism.X[:, :3].any(axis=1)
    cuts = [frame.T[:3, 3] for loop in mechanism.loops for frame in (loop.a, loop.b)]
    contacts = [(mechanism.frame(contact.frame).T @ contact.place)[:3, 3] for contact in mechanism.contacts]
    lengths = [
        *np.linalg.norm(np.stack([*mechanism.B[:, :3, 3], *cuts, *contacts]).astype(float), axis=1),
        *np.linalg.norm(mechanism.X[turning, 3:].astype(float), axis=1),
    ]
    return float(max(lengths)) or 1.0


@lru_cache(maxsize=64)
def reciprocal_mass(mechanism: Mechanism) -> Array:
    """Return 1 / m, (1,), of the mass m of all bodies.

    A floating base is one of them. Raises `JounceError` if the mass is 0.
    """
    mass = mechanism.M[:, 3:4, 3].sum(axis=0)
    if is_zero(mass[0]):
        raise JounceError(f"{mechanism.name!r} has no centre of mass, as all masses are 0; give its bodies mass")
    return reciprocal(mass)


def body_name(mechanism: Mechanism, body: int, ground: str = "ground") -> str:
    """Return the name of a body by its index, -1 for the ground."""
    return mechanism.bodies[body] if body >= 0 else ground


def ancestors(mechanism: Mechanism) -> np.ndarray:
    """Return integers (nb, nb), 1 where body j carries body i.

    A body counts as carrying itself.
    """
    carriers = np.eye(mechanism.nb, dtype=int)
    for i, p in enumerate(mechanism.parent):
        if p >= 0:
            carriers[i] += carriers[p]
    return carriers


def path_to(mechanism: Mechanism, body: int) -> list[int]:
    """Return the bodies on the path from ground to body.

    The body comes last; the ground, -1, has none.
    """
    path: list[int] = []
    while body >= 0:
        path.append(body)
        body = mechanism.parent[body]
    return path[::-1]


def reference_poses(mechanism: Mechanism) -> list[Array]:
    """Return the poses of all bodies where their joint variables are 0.

    That of a floating base is the identity.
    """
    poses: list[Array] = []
    for B, p in zip(mechanism.B, mechanism.parent, strict=True):
        poses.append(B if p < 0 else poses[p] @ B)
    return poses


def _format_number(x: Any) -> str:
    """Return a number, or a symbolic expression, in short."""
    return f"{x:.4g}" if is_numeric(np.asarray(x)) else shorten(str(x))


def with_closure(mechanism: Mechanism, closure: Closure) -> Mechanism:
    """Return a tree whose independent coordinates lead all others."""
    # theta = G q + g by the independent coordinates alone: (joints, N) -> (joints, n).
    leaders = list(closure.independent)
    names = tuple(closure.coordinates[j] for j in leaders)
    return replace(mechanism, G=mechanism.G[:, leaders], coordinates=names, closure=closure)


# The data in other scalars.
@lru_cache(maxsize=64)
def with_exact_integers(mechanism: Mechanism) -> Mechanism:
    """Convert integer-valued floats to ints.

    Symbolic results show L then, not 1.0*L.
    """
    return _convert(mechanism, restore_integers)


@lru_cache(maxsize=64)
def with_extended_precision(mechanism: Mechanism) -> Mechanism:
    """Convert the data to long doubles.

    Quantities derived from them are not rounded to doubles then.
    """
    return _convert(mechanism, lambda array: array.astype(np.longdouble))


def _convert(mechanism: Mechanism, convert: Callable[[Array], Array]) -> Mechanism:
    """Return the mechanism with all its numbers converted, those of limits apart."""
    converted = with_arrays(mechanism, lambda _, array: convert(array))
    frames = tuple(replace(frame, T=convert(frame.T)) for frame in mechanism.frames)
    drives = Drives(**{name: convert(array) for name, array in vars(mechanism.drives).items()})
    elasticity = mechanism.elasticity and mechanism.elasticity.map(convert)
    loops, closure = convert_loops(mechanism.loops, mechanism.closure, convert)
    return replace(converted, frames=frames, drives=drives, elasticity=elasticity, loops=loops, closure=closure)


def with_arrays(mechanism: Mechanism, convert: Callable[[str, Array], Array]) -> Mechanism:
    """Return the mechanism with its `arrays` converted by name and array."""
    B, X, M, gravity, G, g = (convert(name, array) for name, array in mechanism.arrays.items())
    return replace(mechanism, B=B, X=X, M=M, gravity=gravity, G=G, g=g)


def cast_model(mechanism: Mechanism, arrays: Sequence[Array]) -> Mechanism:
    """Convert the data to the scalar type of states and wrenches."""
    if any(map(is_symbolic, arrays)):
        return with_exact_integers(mechanism)
    if any(is_numeric(x) and x.dtype == np.longdouble for x in arrays):
        return with_extended_precision(mechanism)
    return mechanism


def structure_key(mechanism: Mechanism) -> Hashable:
    """Return the hashable data that equal mechanisms share: names and tree, no numbers."""
    return mechanism.name, mechanism.parent, mechanism.bodies, mechanism.coordinates
