"""M and C of the iiwa and of a general arm with their rates, by the default methods."""

from collections.abc import Iterator
from functools import partial
from itertools import product

from benchmarks.measure import Case
from benchmarks.robots import ARMS, Rates, load, states
from jounce import Robot

NAMES = {"mass_matrix": ("M", "M, Md", "M, Md, M2d"), "coriolis_matrix": ("C", "C, Cd", "C, Cd, C2d")}
ALL = "M, Md, M2d, C, Cd, C2d"
BATCHES = (1, 1_000)


def cases() -> Iterator[Case]:
    """Keyed ("matrix", arm, names, states)."""
    for arm, count in product(ARMS, BATCHES):
        robot = load(arm)
        q = states(robot.n, count, 1)
        for method, names in NAMES.items():
            least = 1 if method == "mass_matrix" else 2
            for k, name in enumerate(names):
                call = partial(getattr(robot, method), *q[: k + least])
                call()  # compiles
                yield Case(("matrix", arm, name, count), call, count)
        yield Case(("matrix", arm, ALL, count), partial(_all, robot, q), count)


def _all(robot: Robot, q: Rates) -> None:
    robot.mass_matrix(*q[:3])
    robot.coriolis_matrix(*q)
