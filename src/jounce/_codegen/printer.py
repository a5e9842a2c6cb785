"""The printer: the statements of a function in a language."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from jounce._codegen.function import Function
from jounce._codegen.header import effort
from jounce._codegen.language import Language, digits
from jounce._codegen.schedule import Schedule, schedule
from jounce.dynamics.computation import Port
from jounce.program.operations import ATOM, OPERATIONS, SUM


@dataclass(frozen=True)
class StatementPart:
    """Some of the statements, as lines, and the arrays of states that they read; `parametric`: parameters too."""

    lines: list[str]
    inputs: list[Port]
    parametric: bool


@dataclass(frozen=True, eq=False)
class PrintedFunction(Function):
    """A function in a language: `parts` and `results` are what templates put into functions."""

    language: Language
    single: bool

    @property
    def effort(self) -> str:
        """A description of its number of operations."""
        return effort(self.program)

    @cached_property
    def schedule(self) -> Schedule:
        """Its statements."""
        return schedule(self.program)

    @property
    def scratch(self) -> int:
        """The number of scalars of scratch memory that its parts share; 0 if it has one part."""
        return self.schedule.scratch

    @cached_property
    def parts(self) -> list[StatementPart]:
        """The statements, part by part; a single part is the body of the function itself."""
        return [self._part(part) for part in self.schedule.parts]

    @property
    def unused(self) -> list[str]:
        """The arguments that no statement reads."""
        read = {port.name for part in self.parts for port in part.inputs}
        parametric = not self.parameters or any(part.parametric for part in self.parts)
        return [port.name for port in self.inputs if port.name not in read] + ([] if parametric else ["params"])

    @cached_property
    def results(self) -> list[str]:
        """The lines that write the outputs."""
        lines = []
        for port in self.outputs:
            for j, i in enumerate(self.program.outputs[port.start : port.end]):
                place = self.language.element(port, j)
                lines.append(self.language.put.format(place=place, value=self._expression(i)[0]))
        return lines

    def number(self, x: float) -> str:
        """A number of the code."""
        return self.language.literal(digits(x, self.single), self.single)

    def _part(self, statements: Sequence[int]) -> StatementPart:
        steps = self.program.steps
        read = {int(steps[j].value) for i in statements for j in self.schedule.leaves(i) if steps[j].kind == "input"}
        used = [port for port in self.signature.inputs if any(port.start <= j < port.end for j in read)]
        states = [port for port in used if port.role != "parameter"]
        return StatementPart([self._statement(i) for i in statements], states, len(states) < len(used))

    def _statement(self, i: int) -> str:
        value = self._expression(i, whole=True)[0]
        if i in self.schedule.slots:
            return self.language.put.format(place=self._name(i), value=value)
        return self.language.let.format(real=self.language.real[self.single], name=self._name(i), value=value)

    def _name(self, i: int) -> str:
        slot = self.schedule.slots.get(i)
        return self.schedule.names[i] if slot is None else self.language.scratch(slot)

    def _expression(self, i: int, whole: bool = False) -> tuple[str, int]:
        """The text of a step, or of what it is called, and how tightly it holds together."""
        if i in self.schedule.names and not whole:
            return self._name(i), ATOM
        step = self.program.steps[i]
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
        port = next(port for port in self.signature.inputs if port.start <= number < port.end)
        written = self.language.parameter if port.role == "parameter" else self.language.element
        return written(port, number - port.start)
