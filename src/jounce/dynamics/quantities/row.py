"""A row of the table says everything about one quantity.

That is what it takes, gives and needs, its laws, and what is printed. A `Need` is what a quantity needs of a robot,
with the reason why a robot without it has none of the quantity. `quantity` declares a row by the function that computes
it by recursion. `Quantity.law` gives the law of a method for a robot: that of the rigid mechanism, with loops closed,
drive terms, contacts and friction by the load put around it, as far as they act.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from inspect import cleandoc
from typing import Any, Self

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.scalars import Array, convert_element
from jounce.dynamics import contacts, drive_terms, loops
from jounce.dynamics.recursion.forces import Sweep
from jounce.dynamics.state import Law, State
from jounce.model.drive_trains import LOAD_FRICTION, OMIT_LOAD_FRICTION
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series, rate_name


@dataclass(frozen=True, eq=False)  # the same need is the same object
class Need:
    """One thing that a quantity needs of a robot.

    Its obstacle is why a robot lacks it, as the end of a sentence that begins with the quantity and the robot, or None.
    """

    obstacle: Callable[[Mechanism], str | None]


# Obstacles: None where a robot has what the quantity needs, else why not, with a cure.
def _rigid_joints(m: Mechanism) -> str | None:
    if m.elasticity is not None:
        return None
    return f": its joints are rigid{Remedy('; robot.elastic(stiffness) makes them elastic')}"


def _open_tree(m: Mechanism) -> str | None:
    return f": no loop is closed{_CLOSE_LOOPS}" if m.closure is None else None


def _uncut_tree(m: Mechanism) -> str | None:
    return None if m.loops else f": no loop is closed{_CLOSE_LOOPS}"


def _no_contacts(m: Mechanism) -> str | None:
    if m.contacts:
        return None
    return f": it has no contacts{Remedy('; robot.contacts([jounce.Contact(frame, kind), ...]) states them')}"


def _contacts(m: Mechanism) -> str | None:
    without = Remedy("; robot.contacts([]) is the robot without contacts")
    return f": the wrenches of its contacts would enter{without}" if m.contacts else None


_CLOSE_LOOPS = Remedy("; robot.closed(loops, actuated) closes some")
ELASTIC = Need(_rigid_joints)
CLOSED = Need(_open_tree)  # coordinates that others follow, by loops or by constant ratios
CUT_JOINTS = Need(_uncut_tree)  # loops, whose constraints are solved for followers with constant ratios too
ON_CONTACTS = Need(_no_contacts)
WITHOUT_CONTACTS = Need(_contacts)  # what these do would enter
# "n" coordinates, "nv" velocities, "nb" bodies, one of which may be selected, "bodies" all of them, "parameters" ten
# inertial ones per body, "rates" q, qd, ..., as many as the quantity or its rate takes; of closed robots the
# coordinates of the "tree", "loops", "motors"
Axis = int | str


@dataclass(frozen=True, kw_only=True)
class Inputs:
    """What a quantity takes: the motion, with forces or the state of motors in it, wrenches, keywords of its own."""

    rates: int  # how many of q, qd, ... the quantity itself takes
    forces: bool = False  # whether the last of these, and what follows, are generalized forces Q, Qd, ...
    motors: tuple[str, ...] = ()  # the names of all where motors have a state of their own: q, qd, theta, thetad, ...
    inductive: bool = False  # whether it takes a rate more if a motor has an inductance
    wrenches: bool = False  # whether wrenches on the bodies enter
    wrench_rates: int = 1  # how many of W, Wd, ... the quantity itself takes, where they enter
    without_base: tuple[str, ...] = ()  # frames in which neither the pose nor the twist of the base enters
    options: tuple[str, ...] = ()  # keywords of its own

    def coordinates(self, count: int) -> int:
        """Return how many of its first `count` inputs are q, qd, ...

        The others are forces, or the state of the motors.
        """
        if len(self.motors) > 0:
            return min(count, 2)
        return min(count, self.rates - 1) if self.forces else count

    def names(self, count: int) -> tuple[str, ...]:
        """Return the names of its first inputs: q, qd, q2d, ..., or q, qd, Q, Qd, ..."""
        return _input_names(self.motors, self.coordinates(count), count)


@dataclass(frozen=True)
class Outputs:
    """What a quantity gives: names, axes, units and frames of results."""

    symbol: str  # names of results: Q, Qd, Q2d
    shape: tuple[Axis, ...]  # of one state; the axis "nb" is absent where one body is named
    unit: str
    first_rate: int = 0  # of the symbol, which the quantity itself is: 2 of accelerations
    results: tuple[str, ...] = ()  # of a quantity of several results, which has no rates: the terms of its law
    frames: tuple[str, ...] = ()  # in which its components may be given, the default first


@dataclass(frozen=True, kw_only=True)
class Printed:
    """What generated code, docstrings and pages print of a quantity."""

    meaning: str  # a sentence for the head of generated code
    tex: str
    tex_symbol: str = ""  # where it is not printed as it is named; one index at most, in braces
    caption: str = ""  # a noun phrase, by default its name in words
    wrench_term: str = ""  # what wrenches on the bodies add to it, a noun phrase
    wrench_tex: str = ""
    text: str = ""  # a sentence and remarks, then sections of numpydoc: references, examples
    returns: str = ""  # sentences on its results
    raises: str = ""  # when it raises an error


@dataclass(frozen=True)
class DriveTrains:
    """What drive trains add to a quantity."""

    terms: tuple[str, ...] = ()  # which of those that act enter
    law: Law | None = None  # what they add, unless the laws of the quantity hold them
    load: Callable[[Law, Mechanism, State], Series] | None = None  # how friction by the load changes a law without

    def obstacle(self, m: Mechanism) -> str | None:
        """Return why friction by the load would be left out, or None.

        It is an obstacle as that of a `Need`.
        """
        needs_load_friction = m.has_load_friction and "friction" in self.terms
        if not needs_load_friction:
            return None
        # A law with such friction holds for joints that carry the force of one coordinate alone.
        if self.load is not None and m.lone_joints[m.drives.load_friction > 0].all():
            return None
        why = "inverse and forward dynamics and their kernels do, of rigid joints without followers and loops"
        return f" does not hold {LOAD_FRICTION}: {why}; {OMIT_LOAD_FRICTION}"


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """One quantity: what it takes, gives, needs and prints, and its laws.

    The laws agree; the first one is the default.
    """

    name: str
    takes: Inputs
    gives: Outputs
    laws: Mapping[str, Law]  # by method
    printed: Printed
    needs: tuple[Need, ...] = ()  # what robots that have it are like
    drives: DriveTrains = DriveTrains()
    sweep: Sweep | None = None  # of the recursion, where its steps are those of forces
    balanced: bool = False  # whether the wrenches of contacts balance it
    turns_with: Self | None = None  # of a matrix of velocities, which it times F' is added where loops are closed
    of_motors: str = ""  # its counterpart of the motors, where joints are elastic

    @property
    def inverts(self) -> bool:
        """Whether it takes the inverse of the mass matrix."""
        return self.takes.forces or len(self.takes.motors) > 0

    @property
    def are_accelerations(self) -> bool:
        """Whether it is accelerations, which forces or motors cause."""
        return self.gives.unit.startswith("rad/s^2")

    @property
    def takes_stiffness(self) -> bool:
        """Whether the stiffness of joints with two motors enters.

        It has as many rates as wrenches.
        """
        return ELASTIC in self.needs and len(self.takes.motors) == 0

    @property
    def held_rates(self) -> int:
        """The highest rate of dependent coordinates that it holds.

        The map F of the independent velocities to all others counts as the first rate, its derivative as the second.
        Columns of velocities hold one more of F than values along a motion do, rows at least F itself.
        """
        rates, shape = self.takes.rates, self.gives.shape
        along_a_motion = max(rates - 1, int("nv" in shape))
        return rates if "nv" in shape[1:] and shape[-1] == "nv" else along_a_motion

    @property
    def everywhere(self) -> bool:
        """Whether all robots without an obstacle of their own have it."""
        return not {ELASTIC, CLOSED, ON_CONTACTS}.intersection(self.needs)

    @property
    def follows_others(self) -> bool:
        """Whether its laws take those of other quantities.

        These have loops closed already.
        """
        return self.takes.forces or not self.everywhere or "rates" in self.gives.shape

    @property
    def on_contacts(self) -> bool:
        """Whether the wrenches of contacts are in it."""
        return self.balanced or ON_CONTACTS in self.needs

    @property
    def of_bodies(self) -> bool:
        """Whether it is a quantity of bodies; one may be selected."""
        return "nb" in self.gives.shape

    def names(self, order: int) -> tuple[str, ...]:
        """Return the names of the quantity with rates, or of results."""
        gives = self.gives
        if len(gives.results) > 0:
            return gives.results
        return tuple(rate_name(gives.symbol, gives.first_rate + k) for k in range(order + 1))

    def highest(self, order: int) -> int:
        """Return the highest order up to this one that the quantity has."""
        return 0 if len(self.gives.results) > 0 else order

    def obstacle(self, mechanism: Mechanism) -> str | None:
        """Return why a robot has none of it, or None.

        The reason is the end of a sentence that begins with the quantity and the robot.
        """
        for need in self.needs:
            reason = need.obstacle(mechanism)
            if reason is not None:
                return reason
        return self.drives.obstacle(mechanism)

    def law(self, method: str, mechanism: Mechanism) -> Law:
        """Return the law of a method, with drive terms and contacts."""
        # From the inside: the rigid tree, drive terms, loops; then contacts, then friction by the load, which takes the
        # forces with all these.
        law = self.free_law(method, mechanism)
        if mechanism.contacts and self.balanced:
            law = contacts.balance_law(law)
        if self.drives.load is not None and mechanism.has_load_friction:
            law = partial(self.drives.load, law)
        return law

    def free_law(self, method: str, mechanism: Mechanism) -> Law:
        """Return the law without contacts and friction by the load."""
        # Where loops are closed, the law of the tree, with its drive terms, is projected. Quantities that take others
        # get those with loops closed.
        if mechanism.closure and not self.follows_others:
            of_turning = None if self.turns_with is None else self.turns_with.law(method, mechanism.tree)
            return loops.close_law(self.law(method, mechanism.tree), self.gives.shape, of_turning)
        rigid, drive_law, shape = self.laws[method], self.drives.law, self.gives.shape
        acting_terms = set(self.drives.terms) & set(mechanism.acting)
        if drive_law is None or mechanism.closure or len(acting_terms) == 0:
            return rigid
        # Drives act on no velocity of a floating base: rows and columns of zeros there. Scalars have no axes.
        if len(shape) > 0:
            axes = tuple(k - len(shape) for k, axis in enumerate(shape) if axis == "nv")
            return lambda m, x: rigid(m, x) + drive_terms.pad_base(m, drive_law(m, x), axes)
        return lambda m, x: (rigid(m, x) + drive_law(m, x)).map(_as_array)


def quantity(
    *, printed: Printed, closed_form: Law | None = None, paper: Law | None = None, **fields: Any
) -> Callable[[Any], Quantity]:
    """Declare a quantity by the function that computes it by recursion.

    The arguments are laws of other methods, and its row. A function that takes the name of a method as its last
    argument is the law of the closed form as well.
    """

    def row(declared: Any) -> Quantity:
        recursion = declared.__func__  # of a static method
        # The order of laws is that of methods, the default first.
        laws = {"recursion": recursion}
        if closed_form is not None:
            laws["closed_form"] = closed_form
        elif recursion.__defaults__ is not None:
            laws["closed_form"] = partial(recursion, method="closed_form")
        if paper is not None:
            laws["paper"] = paper
        name = recursion.__name__
        caption = printed.caption if printed.caption != "" else name.replace("_", " ")
        text = "" if recursion.__doc__ is None else cleandoc(recursion.__doc__)
        return Quantity(name=name, laws=laws, printed=replace(printed, caption=caption, text=text), **fields)

    return row


@cache
def _input_names(motors: tuple[str, ...], coordinates: int, count: int) -> tuple[str, ...]:
    """Return the names of the first `count` inputs.

    So many of them are coordinates and their rates.
    """
    # After the state of motors, rates of its last name: tau, taud, ...
    if len(motors) > 0:
        return (*motors, *(rate_name(motors[-1], k + 1) for k in range(count)))[:count]
    return tuple(rate_name("q", k) if k < coordinates else rate_name("Q", k - coordinates) for k in range(count))


def row_vector(columns: Series) -> Series:
    """Return columns (..., n, 1) as (..., n)."""
    return columns.map(lambda Q: Q[..., 0])


def scalar(column: Series) -> Series:
    """Return columns (..., 1, 1) as (...)."""
    return column.map(lambda T: T[..., 0, 0])


def _as_array(total: Any) -> Array:
    """Return a sum of arrays without axes as an array: NumPy makes a scalar of it."""
    return np.asarray(total) if isinstance(total, np.ndarray | np.generic) else convert_element(total, "a sum")
