"""Trace the functions of generated code, with data of robots as parameters.

A `Function` is a computation as a program with its input and output arrays; `trace` makes it, once for each output that
is asked for, by the recursion on a tape. What generated code takes at run time stands in the robot of a
`ParametricRobot`: `make_parametric` takes the parameters that are asked for, as `model.body_parameters` lists them, and
SymPy's symbols in the robot's data. Its mechanism for given values, numbers or nodes of the tape, is the robot with
these in their places. Symbols may stand in sums, products, whole powers, sines and cosines.
"""

import re
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise
from operator import mul
from typing import Any

import numpy as np

from jounce.core import scalars
from jounce.core.errors import JounceError
from jounce.core.scalars import Array
from jounce.dynamics.computation import Computation, Port, Shape, Signature
from jounce.model import body_parameters
from jounce.model.mechanism import Mechanism, with_arrays
from jounce.program.program import Program
from jounce.spatial import lie


@dataclass(frozen=True, eq=False)
class ParametricRobot:
    """A robot of which some data are parameters of generated code.

    They are SymPy's symbols in it by their names, and the parts that a caller asks for, `asked`. `own` are the values
    with which it is the robot itself; symbols have none.
    """

    origin: Mechanism
    asked: tuple[str, ...]
    shapes: dict[str, Shape]
    own: dict[str, np.ndarray]

    def mechanism(self, values: Mapping[str, Array]) -> Mechanism:
        """Return the mechanism of values, an array for each of the parameters.

        They are numbers or nodes of a tape.
        """
        symbol_values = {name: value.item() for name, value in values.items() if name not in self.own}
        return body_parameters.parametrise(
            substitute(self.origin, symbol_values), self.asked, lambda name, shape: values[name].reshape(shape)
        )[0]


@dataclass(frozen=True)
class Function:
    """A computation as a program.

    The scalars of all inputs, parameters first, are numbered as in the signature. Several matrices stand one below the
    other, since not all languages have arrays of three axes.
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
    """Trace a computation for a robot."""
    from jounce.native.code_forms import trace_program
    from jounce.program.program import Tape

    # Parameters are the first inputs of the program; the state follows, as the computation takes it.
    tape = Tape()
    signature = computation.signature(robot.origin, robot.shapes).as_matrices()
    values = {port.name: tape.variables(*port.shape) for port in signature.of_role("parameter")}
    return Function(name, computation, signature, trace_program(robot.mechanism(values), computation, tape))


def function_names(computations: Iterable[Computation]) -> list[str]:
    """Return the names of functions: inverse_dynamics_vjp, jacobian_tool0_world.

    The frame "body" is left out. Characters of body names that are not ASCII letters or digits become _. Names that are
    then equal, also if case is ignored as in some file systems, are numbered.
    """
    names: list[str] = []
    for asked in computations:
        parts = [asked.name, asked.product or "", asked.body or "", asked.frame if asked.frame != "body" else ""]
        stem = name = re.sub(r"[\W_]+", "_", "_".join(parts), flags=re.ASCII).strip("_")
        # What is left of names may be alike: a-b and a_b.
        other_names, number = {other.casefold() for other in names}, 2
        while name.casefold() in other_names:
            name, number = f"{stem}_{number}", number + 1
        names.append(name)
    return names


def make_parametric(mechanism: Mechanism, asked: Sequence[str]) -> ParametricRobot:
    """Return a robot with its own and the asked parameters.

    `model.body_parameters` lists the latter. Raises `JounceError` where one that is asked for is unknown, comes twice,
    or has the name of a symbol.
    """
    own = body_parameters.own_values(mechanism, asked)
    if "masses" in own:
        _check_masses(mechanism)
    # Symbols in data that parameters replace are no parameters any more.
    mechanism = _without_replaced_data(mechanism, own)
    free = symbols(mechanism)
    ambiguous = sorted(set(free) & set(own))
    if len(ambiguous) > 0:
        raise JounceError(f"parameter {ambiguous[0]!r} is also the name of a symbol of the robot; rename the symbol")
    shapes: dict[str, Shape] = dict.fromkeys(free, ())
    shapes |= {name: () if value.size == 1 else value.shape for name, value in own.items()}
    return ParametricRobot(mechanism, tuple(asked), shapes, own)


def _check_masses(mechanism: Mechanism) -> None:
    """Raise `JounceError` if a mass is a symbol: 'masses' replaces numbers."""
    for body, mass in zip(mechanism.bodies, mechanism.M[:, 3, 3], strict=True):
        if _is_sympy(mass) and mass.free_symbols:
            raise JounceError(
                f"the mass of {body!r} is {mass}; 'masses' applies to numbers; symbols are parameters already"
            )


def _without_replaced_data(mechanism: Mechanism, replaced: Container[str]) -> Mechanism:
    """Return the mechanism without the data that parameters replace.

    Symbols in these data need no values then.
    """
    if "gravity" in replaced:
        mechanism = replace(mechanism, gravity=np.zeros(3))
    if "lengths" in replaced:
        mechanism = replace(mechanism, B=lie.pose(lie.rotation(mechanism.B), np.zeros((mechanism.nb, 3, 1))))
    e = mechanism.elasticity
    if e is not None:
        stiffness, rotor = (
            np.zeros(mechanism.n) if name in replaced else e.arrays[name] for name in body_parameters.ELASTIC_PARAMETERS
        )
        mechanism = replace(mechanism, elasticity=replace(e, stiffness=stiffness, rotor=rotor))
    return mechanism


def symbols(mechanism: Mechanism) -> list[str]:
    """Return the sorted names of SymPy's symbols in a mechanism."""
    symbolic_arrays = [array for array in mechanism.arrays.values() if scalars.is_symbolic(array)]
    entries = [x for array in symbolic_arrays for x in array.flat]
    odd = next((x for x in entries if not isinstance(x, int | float | np.number) and not _is_sympy(x)), None)
    if odd is not None:
        raise JounceError(
            f"the robot contains a {type(odd).__name__}; code generation supports numbers and SymPy symbols"
        )
    # Two symbols of one name differ by their assumptions, and would be one parameter.
    free = set[Any]().union(*(x.free_symbols for x in entries if _is_sympy(x)))
    names = sorted(symbol.name for symbol in free)
    repeated = next((name for name, following in pairwise(names) if name == following), None)
    if repeated is not None:
        raise JounceError(f"the robot contains two symbols named {repeated}; expected distinct names")
    return names


def substitute(mechanism: Mechanism, values: Mapping[str, Any]) -> Mechanism:
    """Return the mechanism with values in place of SymPy's symbols."""
    if not any(map(scalars.is_symbolic, mechanism.arrays.values())):
        return mechanism
    evaluate = np.frompyfunc(lambda x: _value(x, values) if _is_sympy(x) else x, 1, 1)
    return with_arrays(mechanism, lambda _, array: np.asarray(evaluate(array), dtype=object))


def _is_sympy(x: object) -> bool:
    return type(x).__module__.startswith("sympy.")


def _value(x: Any, values: Mapping[str, Any]) -> Any:
    """Return the value of a SymPy expression.

    It holds sums, products, whole powers, sines and cosines.
    """
    if x.is_Symbol:
        return values[x.name]
    if x.is_number:
        if not x.is_real:
            raise JounceError(f"the robot contains {x}; code generation supports real numbers and symbols")
        return int(x) if x.is_Integer else float(x)
    name = type(x).__name__
    if name == "Pow" and x.exp.is_Integer and x.exp > 0:
        return _power(_value(x.base, values), int(x.exp))
    if name not in _SYMPY_RULES:
        raise JounceError(
            f"the robot contains {x}; code generation supports sums, products, sines and cosines of symbols"
        )
    return _SYMPY_RULES[name]([_value(part, values) for part in x.args])


def _power(x: Any, k: int) -> Any:
    """Return the k-th power, k > 0, by squares, with few products."""
    if k == 1:
        return x
    half = _power(x, k // 2)
    return half * half * x if k % 2 else half * half


_SYMPY_RULES: dict[str, Callable[[list[Any]], Any]] = {
    "Add": sum,
    "Mul": lambda parts: reduce(mul, parts),
    "sin": lambda parts: np.sin(parts[0]),
    "cos": lambda parts: np.cos(parts[0]),
}
