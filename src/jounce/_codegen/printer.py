"""The printer: the statements of a routine in a language."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from jounce._codegen.language import Language, digits
from jounce._codegen.listing import Listing, listing
from jounce._codegen.notes import effort
from jounce._codegen.routine import Array, Routine
from jounce.program.operations import ATOM, OPERATIONS, SUM


@dataclass(frozen=True)
class Part:
    """Some of the statements, as lines, and the arrays of states that they read; `parametric` where they read p."""

    lines: list[str]
    inputs: list[Array]
    parametric: bool


@dataclass(frozen=True, eq=False)
class Printed:
    """A routine in a language: `parts` and `results` are what templates put into functions."""

    routine: Routine
    language: Language
    single: bool

    @property
    def name(self) -> str:
        """Of the quantity."""
        return self.routine.name

    @property
    def inputs(self) -> tuple[Array, ...]:
        """The arrays of states that it takes."""
        return self.routine.inputs

    @property
    def outputs(self) -> tuple[Array, ...]:
        """The arrays that it gives."""
        return self.routine.outputs

    @property
    def effort(self) -> str:
        """How many operations it takes, in words."""
        return effort(self.routine.program)

    @cached_property
    def listing(self) -> Listing:
        """Its statements."""
        return listing(self.routine.program)

    @property
    def scratch(self) -> int:
        """How many scalars of scratch memory its parts share; none where it is whole."""
        return self.listing.scratch

    @cached_property
    def parts(self) -> list[Part]:
        """The statements, part by part; a single part is the body of the routine itself."""
        return [self._part(part) for part in self.listing.parts]

    @property
    def unused(self) -> list[str]:
        """The arguments that no statement reads."""
        read = {array.name for part in self.parts for array in part.inputs}
        parametric = not self.routine.parameters or any(part.parametric for part in self.parts)
        return [array.name for array in self.inputs if array.name not in read] + ([] if parametric else ["p"])

    @cached_property
    def results(self) -> list[str]:
        """The lines that write the outputs."""
        lines = []
        for array in self.routine.outputs:
            for j, i in enumerate(self.routine.program.outputs[array.start : array.start + array.size]):
                place = self.language.element(array, j)
                lines.append(self.language.put.format(place=place, value=self._expression(i)[0]))
        return lines

    def number(self, x: float) -> str:
        """A number of the code."""
        return self.language.literal(digits(x, self.single), self.single)

    def _part(self, statements: Sequence[int]) -> Part:
        steps = self.routine.program.steps
        read = {int(steps[j].value) for i in statements for j in self.listing.leaves(i) if steps[j].kind == "input"}
        used = [array for array in self.inputs if any(array.start <= j < array.start + array.size for j in read)]
        first = self.inputs[0].start  # parameters come before
        return Part([self._statement(i) for i in statements], used, any(j < first for j in read))

    def _statement(self, i: int) -> str:
        value = self._expression(i, whole=True)[0]
        if i in self.listing.slots:
            return self.language.put.format(place=self._name(i), value=value)
        return self.language.let.format(real=self.language.real[self.single], name=self._name(i), value=value)

    def _name(self, i: int) -> str:
        slot = self.listing.slots.get(i)
        return self.listing.names[i] if slot is None else self.language.scratch(slot)

    def _expression(self, i: int, whole: bool = False) -> tuple[str, int]:
        """The text of a step, or of what it is called, and how tightly it holds together."""
        if i in self.listing.names and not whole:
            return self._name(i), ATOM
        step = self.routine.program.steps[i]
        match step.kind:
            case "input":
                return self._input(int(step.value)), ATOM
            case "constant":
                return self.number(step.value), ATOM if step.value >= 0 else SUM
        operation = OPERATIONS[step.kind]
        if operation.expression is None:
            return self.language.function(step.kind, self._operand(step.operands[0], SUM), self.single), ATOM
        expression = operation.expression
        operands = map(self._operand, step.operands, expression.operands)
        return expression.text.format(*operands, one=self.number(1.0)), expression.holds

    def _operand(self, i: int, least: int) -> str:
        text, holds = self._expression(i)
        return text if holds >= least else f"({text})"

    def _input(self, number: int) -> str:
        for arrays, written in (
            (self.routine.parameters, self.language.parameter),
            (self.routine.inputs, self.language.element),
        ):
            array = _that_holds(number, arrays)
            if array:
                return written(array, number - array.start)
        raise IndexError(number)


def _that_holds(number: int, arrays: Sequence[Array]) -> Array | None:
    return next((array for array in arrays if array.start <= number < array.start + array.size), None)
