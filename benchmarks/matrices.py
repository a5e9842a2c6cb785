"""M and C of the iiwa with their rates, by the default methods."""

from collections.abc import Iterator
from functools import partial

from benchmarks.measure import Case
from benchmarks.robots import Rates, states
from jounce import Robot, load

NAMES = {"mass_matrix": ("M", "M, Md", "M, Md, M2d"), "coriolis_matrix": ("C", "C, Cd", "C, Cd, C2d")}
ALL = "M, Md, M2d, C, Cd, C2d"
BATCHES = (1, 1_000)


def cases() -> Iterator[Case]:
    """Keyed ("matrix", names, states)."""
    robot = load("iiwa14")
    for count in BATCHES:
        q = states(robot.n, count, 1)
        for method, names in NAMES.items():
            least = 1 if method == "mass_matrix" else 2
            for k, name in enumerate(names):
                call = partial(getattr(robot, method), *q[: k + least])
                call()  # compiles
                yield Case(("matrix", name, count), call, count)
        yield Case(("matrix", ALL, count), partial(_all, robot, q), count)


def _all(robot: Robot, q: Rates) -> None:
    robot.mass_matrix(*q[:3])
    robot.coriolis_matrix(*q)
