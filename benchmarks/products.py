"""Products of the derivatives of Q, Qd, Q2d by all their inputs, next to the values themselves."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.measure import Case
from benchmarks.robots import states
from jounce import load
from jounce.dynamics.computation import FIRST_PRODUCTS, Computation
from jounce.native import code_forms

ROBOTS = ("iiwa14", "ur5", "panda")
ORDER = 2
COUNT = 1_000


def operations() -> dict[tuple[str, str], int]:
    """The operations of the values, keyed (robot, ""), and of each product."""
    asked = Computation("inverse_dynamics", ORDER)
    return {
        (name, product): code_forms.trace_program(
            load(name).mechanism, replace(asked, product=product or None)
        ).operations
        for name in ROBOTS
        for product in ("", *FIRST_PRODUCTS)
    }


def cases() -> Iterator[Case]:
    """Keyed ("product", robot, product), of the values with the product ""."""
    for name in ROBOTS:
        robot = load(name)
        for product in ("", *FIRST_PRODUCTS):
            kernel = robot.compile("inverse_dynamics", order=ORDER, product=product or None)
            given, results = ([np.zeros((COUNT, *shape)) for shape in shapes] for shapes in kernel.shapes)
            for array, x in zip(given, 2 * states(robot.n, COUNT, ORDER), strict=False):
                array[:] = x
            yield Case(("product", name, product), partial(kernel, *given, out=results), COUNT)
