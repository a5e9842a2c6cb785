"""Sheets on which the steps of the columns form are traced: where their inputs and results are in memory."""

from typing import Any

import numpy as np

from jounce.core.scalars import Array, concatenate
from jounce.dynamics.recursion.force_partials import CarriedBodies
from jounce.native.column_layout import BODY, WRENCH_NUMBERS
from jounce.native.emit import JointStep
from jounce.native.loop_steps import Sheet
from jounce.spatial.inertia import from_moment_matrix, symmetric_matrix
from jounce.spatial.series import Series

TRIANGLE = np.triu_indices(4)
CONSTANT_SIZES = {"R": 9, "r": 3, "X": 6, "offset": 1, "Pi": 10}  # of a joint and its body
JOINT_SIZE = sum(CONSTANT_SIZES.values())


class ColumnSheet(Sheet):
    """A sheet of the columns form."""

    def __init__(self, numbers: np.ndarray | None = None) -> None:
        super().__init__(body=BODY, parent=BODY)
        self.numbers: dict[str, np.ndarray] = {}
        if numbers is not None:
            row = [
                self.take("constants", k, 1)[0] if (column != column[0]).any() else column[0]
                for k, column in enumerate(numbers.T)
            ]
            ends = np.cumsum(list(CONSTANT_SIZES.values()))
            self.numbers = dict(zip(CONSTANT_SIZES, np.split(np.array(row, dtype=object), ends[:-1]), strict=True))

    def take(self, memory: str, place: int, count: int) -> np.ndarray:
        """Numbers one behind the other."""
        self.reads += [(memory, place + k) for k in range(count)]
        return self.tape.variables(count)

    def put(self, memory: str, place: int, values: Any) -> None:
        """Results one behind the other."""
        self.outputs += [(memory, place + k, x) for k, x in enumerate(np.ravel(values))]

    def motion(self, memory: str) -> tuple[Series, Series]:
        """The twist of a body with its rate, and gravity as a twist."""
        V, g = self.read(memory, "V"), self.read(memory, "field")[0]
        return V, Series.of([concatenate([0 * g, g], axis=-2)])

    def carried(self, memory: str) -> CarriedBodies:
        """The bodies that a joint carries."""
        Pi = [symmetric_matrix(x[:, 0]) for x in self.read(memory, "Pi").upto(1)]
        return CarriedBodies(Series.of(Pi), self.read(memory, "p"))

    def write_body(self, V: Series, field: Series, Pi: Array) -> None:
        """The motion of a body with moments Pi, which so far carries itself alone."""
        self.write("body", "V", V)
        self.write("body", "field", field.map(lambda g: g[3:]))
        self.write_carried("body", Series.constant(Pi), from_moment_matrix(Pi) @ V)

    def write_carried(self, memory: str, Pi: Series, p: Series) -> None:
        """The bodies that a joint carries."""
        self.write(memory, "Pi", Pi.map(lambda x: x[TRIANGLE]))
        self.write(memory, "p", p)

    def wrenches(self, width: int) -> list[Series]:
        """The wrenches of a column: momentum with its rate, reaction, change."""
        x = np.stack([self.take("columns", k * width, 1) for k in range(WRENCH_NUMBERS)]).reshape(4, 6, 1)
        return [Series.of([x[0], x[1]]), Series.of([x[2]]), Series.of([x[3]])]

    def write_column(self, width: int, momentum: Series, reaction: Series, change: Series) -> None:
        """The wrenches of a column."""
        for k, x in enumerate(np.ravel([momentum[0], momentum[1], reaction[0], change[0]])):
            self.put("columns", k * width, [x])

    def step(self) -> JointStep:
        """Return the recorded step; results that are 0 are the mask, as NaN of any input makes all results NaN."""
        [mask], zero = self.take("mask", 0, 1), self.tape.node(0)
        self.outputs = [(m, place, mask if self.tape.node(x) is zero else x) for m, place, x in self.outputs]
        return super().step()
