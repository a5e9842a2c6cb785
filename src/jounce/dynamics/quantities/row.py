"""A row of the table of quantities says what a quantity takes, gives and needs, its laws, and what is printed.

A `Need` is what a quantity asks of a robot, with why one that lacks it has none of the quantity. `quantity` declares a
row by the function that computes it by recursion. `Quantity.law` gives the law of a method for a robot: that of the
rigid mechanism, with loops closed, drive terms, contacts and friction by the load put around it, as far as they act.
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
    """One thing that a quantity asks of a robot.

    Its obstacle is why a robot lacks it, as the end of a sentence that begins with the quantity and the robot, or None.
    """

    obstacle: Callable[[Mechanism], str | None]


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
        """How many of its first inputs are q, qd, ...; the others are forces, or the state of the motors."""
        if self.motors:
            return min(count, 2)
        return min(count, self.rates - 1) if self.forces else count

    def names(self, count: int) -> tuple[str, ...]:
        """The names of its first inputs: q, qd, q2d, ..., or q, qd, Q, Qd, ..."""
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
    """What heads of generated code, docstrings and pages print of a quantity, beyond what follows from its row."""

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
        """Why friction by the load that acts would be left out, as that of a `Need`."""
        concerned = m.has_load_friction and "friction" in self.terms
        if not concerned or (self.load and m.lone_joints[m.drives.load_friction > 0].all()):
            return None
        why = "inverse and forward dynamics and their kernels do, of rigid joints without followers and loops"
        return f" does not hold {LOAD_FRICTION}: {why}; {OMIT_LOAD_FRICTION}"


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """One quantity: what it takes, gives, needs and prints, and its laws, the first the default; all agree."""

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
        return self.takes.forces or bool(self.takes.motors)

    @property
    def are_accelerations(self) -> bool:
        """Whether it is accelerations, which forces or motors cause."""
        return self.gives.unit.startswith("rad/s^2")

    @property
    def takes_stiffness(self) -> bool:
        """Whether the stiffness of joints with two motors enters, as often as wrenches."""
        return ELASTIC in self.needs and not self.takes.motors

    @property
    def held_rates(self) -> int:
        """The highest rate of coordinates that follow which it holds, where loops are closed.

        The map F of the independent velocities to all others counts as the first rate, its derivative as the second.
        Columns of velocities hold one more of F than values along a motion do, rows at least F itself.
        """
        rates, shape = self.takes.rates, self.gives.shape
        along_a_motion = max(rates - 1, int("nv" in shape))
        return rates if "nv" in shape[1:] and shape[-1] == "nv" else along_a_motion

    @property
    def everywhere(self) -> bool:
        """Whether all robots have it but for those with an obstacle of their own."""
        return not {ELASTIC, CLOSED, ON_CONTACTS}.intersection(self.needs)

    @property
    def follows_others(self) -> bool:
        """Whether its laws take those of other quantities, with loops closed as they are."""
        return self.takes.forces or not self.everywhere or "rates" in self.gives.shape

    @property
    def on_contacts(self) -> bool:
        """Whether the wrenches of contacts are in it."""
        return self.balanced or ON_CONTACTS in self.needs

    @property
    def of_bodies(self) -> bool:
        """Whether it is a quantity of bodies, one of which may be selected."""
        return "nb" in self.gives.shape

    def names(self, order: int) -> tuple[str, ...]:
        """The names of the quantity and its rates, or of its results."""
        given = self.gives
        return given.results or tuple(rate_name(given.symbol, given.first_rate + k) for k in range(order + 1))

    def highest(self, order: int) -> int:
        """The highest order up to this one that the quantity has."""
        return 0 if self.gives.results else order

    def obstacle(self, mechanism: Mechanism) -> str | None:
        """Return why a robot has none of it, as the end of a sentence that begins with both, or None."""
        for need in self.needs:
            if reason := need.obstacle(mechanism):
                return reason
        return self.drives.obstacle(mechanism)

    def law(self, method: str, mechanism: Mechanism) -> Law:
        """Return the law of a method for a mechanism, with the drive terms that act and the wrenches of contacts."""
        law = self.free_law(method, mechanism)
        if mechanism.contacts and self.balanced:
            law = contacts.balance_law(law)
        return partial(self.drives.load, law) if self.drives.load and mechanism.has_load_friction else law

    def free_law(self, method: str, mechanism: Mechanism) -> Law:
        """Return the law without the wrenches of contacts and the friction by the loads that these change."""
        if mechanism.closure and not self.follows_others:
            of_turning = self.turns_with.law(method, mechanism.tree) if self.turns_with else None
            return loops.close_law(self.law(method, mechanism.tree), self.gives.shape, of_turning)
        rigid, added, shape = self.laws[method], self.drives.law, self.gives.shape
        if added is None or mechanism.closure or not set(self.drives.terms) & set(mechanism.acting):
            return rigid  # where loops are closed, it has those of the tree
        if shape:
            axes = tuple(k - len(shape) for k, axis in enumerate(shape) if axis == "nv")
            return lambda m, x: rigid(m, x) + drive_terms.pad_base(m, added(m, x), axes)
        return lambda m, x: (rigid(m, x) + added(m, x)).map(_as_array)


def quantity(
    *, printed: Printed, closed_form: Law | None = None, paper: Law | None = None, **fields: Any
) -> Callable[[Any], Quantity]:
    """Declare a quantity by the function that computes it by recursion, with laws of other methods and its row.

    A function that takes the name of a method as its last argument is the law of the closed form as well.
    """

    def row(declared: Any) -> Quantity:
        recursion = declared.__func__  # of a static method
        laws = {"recursion": recursion}
        if dense_law := closed_form or (partial(recursion, method="closed_form") if recursion.__defaults__ else None):
            laws["closed_form"] = dense_law
        if paper is not None:
            laws["paper"] = paper
        name = recursion.__name__
        caption, text = printed.caption or name.replace("_", " "), cleandoc(recursion.__doc__ or "")
        return Quantity(name=name, laws=laws, printed=replace(printed, caption=caption, text=text), **fields)

    return row


@cache
def _input_names(of_motors: tuple[str, ...], own: int, count: int) -> tuple[str, ...]:
    if of_motors:
        return (*of_motors, *(rate_name(of_motors[-1], k + 1) for k in range(count)))[:count]
    return tuple(rate_name("q", k) if k < own else rate_name("Q", k - own) for k in range(count))


def row_vector(columns: Series) -> Series:
    """Columns (..., n, 1) as (..., n)."""
    return columns.map(lambda Q: Q[..., 0])


def scalar(column: Series) -> Series:
    """(..., 1, 1) as (...)."""
    return column.map(lambda T: T[..., 0, 0])


def _as_array(total: Any) -> Array:
    """A sum of arrays without axes as an array again: NumPy makes a scalar of it."""
    return np.asarray(total) if isinstance(total, np.ndarray | np.generic) else convert_element(total, "a sum")
