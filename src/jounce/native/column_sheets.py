"""Sheets on which the steps of the columns form are traced: where their inputs and results are in memory."""

from typing import Any

import numpy as np

from jounce.core.scalars import Array, concatenate
from jounce.dynamics.recursion.force_partials import CarriedBodies
from jounce.native.column_layout import BODY, WRENCH_NUMBERS
from jounce.native.emit import JointStep
from jounce.program.passes import factor, fuse
from jounce.program.trace import Tape
from jounce.spatial.inertia import from_moment_matrix
from jounce.spatial.series import Series

TRIANGLE = np.triu_indices(4)
CONSTANT_SIZES = {"R": 9, "r": 3, "X": 6, "offset": 1, "Pi": 10}  # of a joint and its body
JOINT_SIZE = sum(CONSTANT_SIZES.values())


class ColumnSheet:
    """A tape whose inputs and outputs have places in memory."""

    def __init__(self, constants: np.ndarray | None = None) -> None:
        self.tape = Tape()
        self.reads: list[tuple[str, int]] = []
        self.outputs: list[tuple[str, int, Any]] = []
        self.constants: dict[str, np.ndarray] = {}
        if constants is not None:
            row = [
                self.read("constants", k, 1)[0] if (column != column[0]).any() else column[0]
                for k, column in enumerate(constants.T)
            ]
            ends = np.cumsum(list(CONSTANT_SIZES.values()))
            self.constants = dict(zip(CONSTANT_SIZES, np.split(np.array(row, dtype=object), ends[:-1]), strict=True))

    def read(self, memory: str, place: int, count: int) -> np.ndarray:
        """Numbers one behind the other."""
        self.reads += [(memory, place + k) for k in range(count)]
        return self.tape.variables(count)

    def write(self, memory: str, place: int, values: Any) -> None:
        """Results one behind the other."""
        self.outputs += [(memory, place + k, x) for k, x in enumerate(np.ravel(values))]

    def motion(self, memory: str) -> tuple[Series, Series]:
        """The twist of a body with its rate, and gravity as a twist."""
        V = self.read(memory, BODY.start("V"), 12).reshape(2, 6, 1)
        g = self.read(memory, BODY.start("field"), 3)[:, None]
        return Series.of([*V]), Series.of([concatenate([0 * g, g], axis=-2)])

    def carried(self, memory: str) -> CarriedBodies:
        """The bodies that a joint carries."""
        Pi = [symmetric_matrix(x) for x in self.read(memory, BODY.start("Pi"), 20).reshape(2, 10)]
        return CarriedBodies(Series.of(Pi), Series.of([*self.read(memory, BODY.start("p"), 12).reshape(2, 6, 1)]))

    def write_body(self, V: Series, field: Series, Pi: Array) -> None:
        """The motion of a body with moments Pi, which so far carries itself alone."""
        self.write("body", BODY.start("V"), V.upto(1))
        self.write("body", BODY.start("field"), field[0][3:])
        self.write_carried("body", Series.constant(Pi), from_moment_matrix(Pi) @ V)

    def write_carried(self, memory: str, Pi: Series, p: Series) -> None:
        """The bodies that a joint carries."""
        self.write(memory, BODY.start("Pi"), [x[TRIANGLE] for x in Pi.upto(1)])
        self.write(memory, BODY.start("p"), p.upto(1))

    def wrenches(self, width: int) -> list[Series]:
        """The wrenches of a column: momentum with its rate, reaction, change."""
        x = np.stack([self.read("columns", k * width, 1) for k in range(WRENCH_NUMBERS)]).reshape(4, 6, 1)
        return [Series.of([x[0], x[1]]), Series.of([x[2]]), Series.of([x[3]])]

    def write_column(self, width: int, momentum: Series, reaction: Series, change: Series) -> None:
        """The wrenches of a column."""
        for k, x in enumerate(np.ravel([momentum[0], momentum[1], reaction[0], change[0]])):
            self.write("columns", k * width, [x])

    def step(self) -> JointStep:
        """Return the recorded step; results that are 0 are the mask, as NaN of any input makes all results NaN."""
        [mask], zero = self.read("mask", 0, 1), self.tape.node(0)
        self.outputs = [(m, place, mask if self.tape.node(x) is zero else x) for m, place, x in self.outputs]
        program = fuse(factor(self.tape.program([x for _, _, x in self.outputs])))
        return JointStep(program, tuple(self.reads), tuple((memory, place) for memory, place, _ in self.outputs))


def symmetric_matrix(entries: np.ndarray) -> np.ndarray:
    """A symmetric matrix from its ten entries on and above the diagonal."""
    matrix = np.zeros((4, 4), dtype=object)
    matrix[TRIANGLE] = matrix.T[TRIANGLE] = entries
    return matrix
