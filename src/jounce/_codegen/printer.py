"""The printer: the statements of a function in a language."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from jounce._codegen.function import Array, Function
from jounce._codegen.header import effort
from jounce._codegen.language import Language, digits
from jounce._codegen.schedule import Schedule, schedule

SIGNS = {"add": "+", "sub": "-", "mul": "*"}
SUM, PRODUCT, ATOM = range(3)  # how tightly an expression holds together


@dataclass(frozen=True)
class Part:
    """Some of the statements, as lines, and the arrays of states that they read; `parametric` where they read p."""

    lines: list[str]
    inputs: list[Array]
    parametric: bool


@dataclass(frozen=True, eq=False)
class Printed:
    """A function in a language: `parts` and `results` are what templates put into functions."""

    function: Function
    language: Language
    single: bool

    @property
    def name(self) -> str:
        """Of the quantity."""
        return self.function.name

    @property
    def inputs(self) -> tuple[Array, ...]:
        """The arrays of states that it takes."""
        return self.function.inputs

    @property
    def outputs(self) -> tuple[Array, ...]:
        """The arrays that it gives."""
        return self.function.outputs

    @property
    def effort(self) -> str:
        """How many operations it takes, in words."""
        return effort(self.function.program)

    @cached_property
    def schedule(self) -> Schedule:
        """Its statements."""
        return schedule(self.function.program)

    @property
    def scratch(self) -> int:
        """How many scalars of scratch memory its parts share; none where it is whole."""
        return self.schedule.scratch

    @cached_property
    def parts(self) -> list[Part]:
        """The statements, part by part; a single part is the body of the function itself."""
        return [self._part(part) for part in self.schedule.parts]

    @property
    def unused(self) -> list[str]:
        """The arguments that no statement reads."""
        read = {array.name for part in self.parts for array in part.inputs}
        parametric = not self.function.parameters or any(part.parametric for part in self.parts)
        return [array.name for array in self.inputs if array.name not in read] + ([] if parametric else ["p"])

    @cached_property
    def results(self) -> list[str]:
        """The lines that write the outputs."""
        lines = []
        for array in self.function.outputs:
            for j, i in enumerate(self.function.program.outputs[array.start : array.start + array.size]):
                place = self.language.element(array, j)
                lines.append(self.language.put.format(place=place, value=self._expression(i)[0]))
        return lines

    def number(self, x: float) -> str:
        """A number of the code."""
        return self.language.literal(digits(x, self.single), self.single)

    def _part(self, statements: Sequence[int]) -> Part:
        steps = self.function.program.steps
        read = {int(steps[j].value) for i in statements for j in self.schedule.leaves(i) if steps[j].kind == "input"}
        used = [array for array in self.inputs if any(array.start <= j < array.start + array.size for j in read)]
        first = self.inputs[0].start  # parameters come before
        return Part([self._statement(i) for i in statements], used, any(j < first for j in read))

    def _statement(self, i: int) -> str:
        value = self._expression(i, whole=True)[0]
        if i in self.schedule.slots:
            return self.language.put.format(place=self._name(i), value=value)
        return self.language.let.format(real=self.language.real[self.single], name=self._name(i), value=value)

    def _name(self, i: int) -> str:
        slot = self.schedule.slots.get(i)
        return self.schedule.names[i] if slot is None else self.language.scratch(slot)

    def _expression(self, i: int, whole: bool = False) -> tuple[str, int]:
        """The text of a step, or of what it is called, and how tightly it holds together.

        Sums and products run from left to right, as all languages have it; what does not is in parentheses.
        """
        if i in self.schedule.names and not whole:
            return self._name(i), ATOM
        step = self.function.program.steps[i]
        match step.kind:
            case "input":
                return self._input(int(step.value)), ATOM
            case "constant":
                return self.number(step.value), ATOM if step.value >= 0 else SUM
            case "neg":
                return f"-{self._operand(step.operands[0], ATOM)}", SUM
            case "add" | "sub" | "mul" as kind:
                holds = PRODUCT if kind == "mul" else SUM
                left, right = self._operand(step.operands[0], holds), self._operand(step.operands[1], holds + 1)
                return f"{left} {SIGNS[kind]} {right}", holds
        return self.language.function(step.kind, self._operand(step.operands[0], SUM), self.single), ATOM

    def _operand(self, i: int, least: int) -> str:
        text, holds = self._expression(i)
        return text if holds >= least else f"({text})"

    def _input(self, number: int) -> str:
        for arrays, written in (
            (self.function.parameters, self.language.parameter),
            (self.function.inputs, self.language.element),
        ):
            array = _that_holds(number, arrays)
            if array:
                return written(array, number - array.start)
        raise IndexError(number)


def _that_holds(number: int, arrays: Sequence[Array]) -> Array | None:
    return next((array for array in arrays if array.start <= number < array.start + array.size), None)
