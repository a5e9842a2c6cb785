"""A row of the table of quantities: what a quantity is, what it takes, and what it is called."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from inspect import cleandoc
from typing import Any, Self

import numpy as np

from jounce.core.scalars import Array, convert_element
from jounce.dynamics import contacts, drive_terms, loops
from jounce.dynamics.recursion.forces import Sweep
from jounce.dynamics.state import Law, State
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series, rate_name

# "n" coordinates, "nv" velocities, "nb" bodies, one of which may be selected, "bodies" all of them, "parameters" ten
# inertial ones per body, "rates" q, qd, ..., as many as the quantity or its rate takes; of closed robots the
# coordinates of the "tree", "loops", "motors"
Axis = int | str


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """One quantity: what it is called and printed as, what it takes, and its laws, the first the default; all agree."""

    name: str
    symbol: str  # names of results: Q, Qd, Q2d
    first_rate: int = 0  # of the symbol, which the quantity itself is: 2 of accelerations
    unit: str
    caption: str  # a noun phrase, by default its name in words
    meaning: str  # a sentence for the head of generated code
    tex: str
    tex_symbol: str = ""  # where it is not printed as it is named; one index at most, in braces
    wrench_term: str = ""  # what wrenches on the bodies add to it, a noun phrase; empty where they do not enter
    wrench_tex: str = ""

    # what the docstring of a robot's method says beyond what follows from the rest of the row
    text: str = ""  # a sentence and remarks, then sections of numpydoc: references, examples
    returns: str = ""  # sentences on its results
    raises: str = ""  # when it raises an error
    options: tuple[str, ...] = ()  # keywords of its own
    # what it takes, and what enters
    rates: int  # how many of q, qd, ... the quantity itself takes
    forces: bool = False  # whether the last of these, and what follows, are generalized forces Q, Qd, ...
    inputs: tuple[str, ...] = ()  # their names where motors have a state of their own: q, qd, theta, thetad, ...
    shape: tuple[Axis, ...]  # of one state; the axis "nb" is absent where one body is named
    methods: Mapping[str, Law]
    wrench_rates: int = 1  # how many of W, Wd, ... the quantity itself takes, where they enter
    elastic: bool = False  # whether it is one of robots with elastic joints only
    closed: bool = False  # whether it is one of robots with closed loops only
    standing: bool = False  # whether it is one of robots with contacts only
    balanced: bool = False  # whether the wrenches of contacts balance it
    without_contacts: bool = False  # whether it is one of robots without contacts only: what these do would enter
    inductive: bool = False  # whether it takes a rate more if a motor has an inductance
    obstacle: Callable[[Mechanism], str | None] | None = None  # why a robot has none of it, the end of a sentence
    of_motors: str = ""  # the quantity that release 0.1 had under its name for robots with elastic joints
    all_constraints: bool = False  # whether constraints are solved for followers with constant ratios too
    drive_terms: tuple[str, ...] = ()  # which of those that act enter
    drive_law: Law | None = None  # what they add
    load_law: Callable[[Law, Mechanism, State], Series] | None = None  # how friction by the load changes a law without
    results: tuple[str, ...] = ()  # of a quantity of several results, which has no rates: the terms of its law
    frames: tuple[str, ...] = ()  # in which its components may be given, the default first
    sweep: Sweep | None = None  # of the recursion, where its steps are those of forces
    without_base: tuple[str, ...] = ()  # frames in which neither the pose nor the twist of the base enters
    turns_with: Self | None = None  # of a matrix of velocities, which it times F' is added where loops are closed

    @property
    def wrenches(self) -> bool:
        """Whether wrenches on the bodies enter."""
        return bool(self.wrench_term)

    @property
    def inverts(self) -> bool:
        """Whether it takes the inverse of the mass matrix."""
        return self.forces or bool(self.inputs)

    @property
    def are_accelerations(self) -> bool:
        """Whether it is accelerations, which forces or motors cause."""
        return self.unit.startswith("rad/s^2")

    @property
    def takes_stiffness(self) -> bool:
        """Whether the stiffness of joints with two motors enters, as often as wrenches."""
        return self.elastic and not self.inputs

    @property
    def held_rates(self) -> int:
        """The highest rate of coordinates that follow which it holds, where loops are closed.

        The map F of the independent velocities to all others counts as the first rate, its derivative as the second.
        Columns of velocities hold one more of F than values along a motion do, rows at least F itself.
        """
        along_a_motion = max(self.rates - 1, int("nv" in self.shape))
        return self.rates if "nv" in self.shape[1:] and self.shape[-1] == "nv" else along_a_motion

    @property
    def everywhere(self) -> bool:
        """Whether all robots have it but for those with an obstacle."""
        return not (self.elastic or self.closed or self.standing)

    @property
    def follows_others(self) -> bool:
        """Whether its laws take those of other quantities, with loops closed as they are."""
        return self.forces or self.elastic or self.closed or self.standing or "rates" in self.shape

    @property
    def of_bodies(self) -> bool:
        """Whether it is a quantity of bodies, one of which may be selected."""
        return "nb" in self.shape

    def names(self, order: int) -> tuple[str, ...]:
        """The names of the quantity and its rates, or of its results."""
        return self.results or tuple(rate_name(self.symbol, self.first_rate + k) for k in range(order + 1))

    def highest(self, order: int) -> int:
        """The highest order up to this one that the quantity has."""
        return 0 if self.results else order

    def coordinate_inputs(self, count: int) -> int:
        """How many of its first inputs are q, qd, ...; the others are forces, or the state of the motors."""
        return min(count, 2 if self.inputs else self.rates - 1) if self.inverts else count

    def input_names(self, count: int) -> tuple[str, ...]:
        """The names of its first inputs: q, qd, q2d, ..., or q, qd, Q, Qd, ..."""
        return _input_names(self.inputs, self.coordinate_inputs(count), count)

    def law(self, method: str, mechanism: Mechanism) -> Law:
        """Return the law of a method for a mechanism, with the drive terms that act and the wrenches of contacts."""
        law = self.free_law(method, mechanism)
        if mechanism.contacts and self.balanced:
            law = contacts.balance_law(law)
        return partial(self.load_law, law) if self.load_law and mechanism.has_load_friction else law

    def free_law(self, method: str, mechanism: Mechanism) -> Law:
        """Return the law without the wrenches of contacts and the friction by the loads that these change."""
        if mechanism.closure and not self.follows_others:
            of_turning = self.turns_with.law(method, mechanism.tree) if self.turns_with else None
            return loops.close_law(self.law(method, mechanism.tree), self.shape, of_turning)
        rigid, added = self.methods[method], self.drive_law
        if added is None or mechanism.closure or not set(self.drive_terms) & set(mechanism.acting):
            return rigid  # where loops are closed, it has those of the tree
        if self.shape:
            axes = tuple(k - len(self.shape) for k, axis in enumerate(self.shape) if axis == "nv")
            return lambda m, x: rigid(m, x) + drive_terms.pad_base(m, added(m, x), axes)
        return lambda m, x: (rigid(m, x) + added(m, x)).map(_as_array)


def quantity(*, closed_form: Law | None = None, paper: Law | None = None, **fields: Any) -> Callable[[Any], Quantity]:
    """Declare a quantity by the function that computes it by recursion, with laws of other methods and its row.

    A function that takes the name of a method as its last argument is the law of the closed form as well.
    """

    def row(declared: Any) -> Quantity:
        recursion = declared.__func__  # of a static method
        methods = {"recursion": recursion}
        if dense_law := closed_form or (partial(recursion, method="closed_form") if recursion.__defaults__ else None):
            methods["closed_form"] = dense_law
        if paper is not None:
            methods["paper"] = paper
        name = recursion.__name__
        fields.setdefault("caption", name.replace("_", " "))
        return Quantity(name=name, text=cleandoc(recursion.__doc__ or ""), methods=methods, **fields)

    return row


@cache
def _input_names(inputs: tuple[str, ...], own: int, count: int) -> tuple[str, ...]:
    if inputs:
        return (*inputs, *(rate_name(inputs[-1], k + 1) for k in range(count)))[:count]
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
