"""The functions of generated code: programs with their arrays, and their names."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

from jounce._codegen.parametric import ParametricRobot
from jounce.dynamics.computation import Computation, Port, Signature
from jounce.program.program import Program


@dataclass(frozen=True)
class Function:
    """A computation as a program; the scalars of all inputs, parameters first, are numbered as in the signature.

    Several matrices stand one below the other, since not all languages have arrays of three axes.
    """

    name: str  # without the prefix
    computation: Computation
    signature: Signature
    program: Program

    @property
    def parameters(self) -> tuple[Port, ...]:
        """The parameters that it takes."""
        return self.signature.of_role("parameter")

    @property
    def inputs(self) -> tuple[Port, ...]:
        """The arrays of states that it takes."""
        return tuple(port for port in self.signature.inputs if port.role != "parameter")

    @property
    def outputs(self) -> tuple[Port, ...]:
        """The arrays that it gives."""
        return self.signature.outputs

    @property
    def operations(self) -> int:
        """The number of operations on scalars."""
        return self.program.operations


def trace(robot: ParametricRobot, name: str, computation: Computation) -> Function:
    """A computation for a robot, traced."""
    from jounce.native.code_forms import trace_program
    from jounce.program.program import Tape

    tape = Tape()
    signature = computation.signature(robot.origin, robot.shapes).as_matrices()
    values = {port.name: tape.variables(*port.shape) for port in signature.of_role("parameter")}
    return Function(name, computation, signature, trace_program(robot.mechanism(values), computation, tape))


def function_names(computations: Iterable[Computation]) -> list[str]:
    """Return the names of functions: inverse_dynamics_vjp, jacobian_tool0_world, without the frame "body".

    Characters of body names that are not ASCII letters or digits become _. Names that are then equal, also if case is
    ignored as in some file systems, are numbered.
    """
    names: list[str] = []
    for asked in computations:
        parts = [asked.name, asked.product or "", asked.body or "", asked.frame if asked.frame != "body" else ""]
        stem = name = re.sub(r"[\W_]+", "_", "_".join(parts), flags=re.ASCII).strip("_")
        taken, number = {known.casefold() for known in names}, 2
        while name.casefold() in taken:
            name, number = f"{stem}_{number}", number + 1
        names.append(name)
    return names
