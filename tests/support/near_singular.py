"""Closed robots near singular positions: all that they compute, against our own equations in 50 digits."""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, cached_property

import numpy as np
from scipy.optimize import brentq

import jounce
from jounce import UncertainError
from jounce.arguments import requests
from jounce.dynamics.computation import Computation
from jounce.dynamics.loop_assembly import MIN_INVERSE_CONDITION, inverse_conditions
from jounce.dynamics.quantities import QUANTITIES
from jounce.dynamics.quantities.row import ELASTIC
from jounce.engine import certain_digits
from jounce.model.frame import Frame
from support import own_equations
from support.linkages import Z, elbows, fivebar, fourbar, shift
from support.quantities import tupled

PROMISED = 1e-6  # of its size: the largest error of a result that is returned
ZEROS = (0.9, 1.3, -0.7)  # rad, coordinates of the four-bar where it lies: angles near 0 would be rounded less
MOTOR = jounce.Motor(gear=100, inertia=1e-5, constant=0.05, resistance=0.5, inductance=1e-3)


@dataclass(frozen=True)
class NearSingular:
    """A closed robot, `position(rng, s)` at a distance s, rad, from a singular one, and it with a passive joint."""

    robot: jounce.Robot
    position: Callable[[np.random.Generator, float], np.ndarray]
    passive: jounce.Robot | None = None

    @cached_property
    def elastic(self) -> jounce.Robot:
        """The robot with elastic joints."""
        return self.robot.elastic(800.0, motors=MOTOR)

    def serving(self, quantity: str) -> jounce.Robot:
        """The robot, with the motors or the passive joint that a quantity takes."""
        row = QUANTITIES[quantity]
        if quantity == "passive_accelerations" and self.passive:
            return self.passive
        return self.elastic if ELASTIC in row.needs else self.robot


def crossed_fourbar(ground: float = 1.0, crank: float = 0.5) -> NearSingular:
    """A crossed parallelogram, which meets the other branch where its crank lies on the ground: a change point."""

    def closed(q: float) -> np.ndarray:
        d = -2 * np.arctan((ground + crank) / (ground - crank) * np.tan(q / 2))  # of the rocker, by half angles
        return np.array([q, d, d])

    def position(rng: np.random.Generator, s: float) -> np.ndarray:
        return closed(s * rng.choice([-1, 1])) + ZEROS

    return NearSingular(fourbar(ground, crank, ground, crank, closed(0.7), zeros=ZEROS), position)


def folded_fivebar() -> NearSingular:
    """A five-bar near where its forearms fold onto each other."""
    lengths, start = (1.0, [0.5, 0.7], [0.6, 1.2]), np.array([2.0, 1.0])

    def position(rng: np.random.Generator, s: float) -> np.ndarray:
        left, side = rng.uniform(0.3, 0.9), int(rng.choice([-1, 1]))
        edge = brentq(lambda x: float(elbows(*lengths, np.array([left, x]), side)[1]), 1.5, 2.5, xtol=1e-15)
        at = np.array([left, edge - s])
        turned, _ = elbows(*lengths, at, side)
        return np.array([at[0], turned[0], at[1], turned[1]])

    first, second = elbows(*lengths, start, 1)[0]
    closed = [start[0], first, start[1], second]
    robot = fivebar(*lengths, closed)
    tree, names = jounce.Robot(robot.mechanism.tree), robot.mechanism.tree.joints
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # nothing but inertia moves the passive joint
        passive = tree.closed([("end0", "end1")], [names[0]], passive=[names[2]], start=closed)
    return NearSingular(robot, position, passive)


def slider_crank(crank: float = 0.5, rod: float = 0.9) -> NearSingular:
    """A slider-crank near its dead centre, moved by its slide: rad and m, a fold."""
    bodies = ((1.0, 0.25, crank), (0.7, 0.45, rod), (1.5, 0.0, 0.1))  # mass, place of the centre, length
    M = [jounce.inertia_matrix(m, [x, 0.02, 0], np.diag([1e-3, *[m * a * a / 12] * 2])) for m, x, a in bodies]
    screws, parent = [Z, Z, [0, 0, 0, 1, 0, 0]], [-1, 0, -1]
    open_ = jounce.Robot.from_screws([np.eye(4), shift(crank), np.eye(4)], screws, M, parent, gravity=[0.3, -9.81, 0])
    frames = Frame("end", 1, shift(rod)), Frame("slide", 2, np.eye(4))
    tree = jounce.Robot(replace(open_.mechanism, frames=frames))

    def closed(angle: float) -> np.ndarray:
        tilt = -np.arcsin(np.sin(angle) * crank / rod)
        return np.array([angle, tilt - angle, crank * np.cos(angle) + rod * np.cos(tilt)])

    def position(rng: np.random.Generator, s: float) -> np.ndarray:
        return closed(s * rng.choice([-1, 1]))

    return NearSingular(tree.closed([("end", "slide")], [tree.joint_names[2]], start=closed(0.7)), position)


@dataclass
class Digits:
    """What became of results: errors relative to their size of those returned, and of refused ones if they were not."""

    returned: list[float] = field(default_factory=list)
    refused: list[float] = field(default_factory=list)

    def judge(self, robot: jounce.Robot, quantity: str, order: int, q: np.ndarray, rng: np.random.Generator) -> None:
        """Compare a quantity at coordinates q, for random rates, with 50 digits."""
        m = robot.mechanism
        if inverse_conditions(m, q[None])[0] < 2 * MIN_INVERSE_CONDITION:
            return  # positions are lost
        asked = Computation(quantity, order, more_rates=requests.count_more_rates(m, quantity))
        given = [q, *(rng.normal(size=port.shape) for port in asked.state_ports(m)[1:])]
        method, uncertain = getattr(robot, quantity), [False] * asked.count
        try:
            found = tupled(method(*given))
        except UncertainError as error:
            found, uncertain = error.results, [bool(x.any()) for x in error.uncertain]
        with unchecked():
            values = tupled(method(*given, method="recursion"))
        for x, value, exact, lost in zip(
            found, values, own_equations.results(robot, asked, given), uncertain, strict=True
        ):
            size = np.abs(exact).max()
            assert np.isnan(x).all() if lost else np.isfinite(x).all()
            (self.refused if lost else self.returned).append(float(np.abs((value if lost else x) - exact).max() / size))


@contextmanager
def unchecked() -> Iterator[None]:
    """Within this context, nothing is refused near singular positions."""
    kept, certain_digits._MAX_ERROR = certain_digits._MAX_ERROR, np.inf
    try:
        yield
    finally:
        certain_digits._MAX_ERROR = kept


ROBOTS: dict[str, Callable[[], NearSingular]] = {
    f.__name__: cache(f) for f in (crossed_fourbar, folded_fivebar, slider_crank)
}
ABSENT = ("second_partials", "joint_wrenches", "contact_wrenches")  # which no robot with closed loops has
CASES = [
    (robot, quantity)
    for robot in ROBOTS
    for quantity in QUANTITIES
    if not quantity.endswith(ABSENT) and (quantity != "passive_accelerations" or robot == "folded_fivebar")
]
