"""The table of operations of programs: one row holds all about one operation.

The tape, the passes, native code, generated code and derivatives derive what they need from these rows. A new operation
takes a row; a function that processors lack also takes its LLVM text in `native/vector_functions`, and its name in
languages that spell it differently.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from operator import methodcaller
from typing import Any

Instruction = tuple[str, *tuple[int | float, ...]]  # of LLVM, or the name of an intrinsic, and what it takes
SUM, PRODUCT, ATOM = range(3)  # precedence of expressions: those of a lower one take parentheses in a higher one


@dataclass(frozen=True)
class Expression:
    """The text of an operation, alike in all languages.

    ``{0}`` and so on are its operands, ``{one}`` is the number 1. Sums and products run from left to right, as all
    languages have it; operands that hold together less tightly than `operands` says are in parentheses.
    """

    text: str
    holds: int
    operands: tuple[int, ...]


@dataclass(frozen=True)
class VectorFunction:
    """A function of `native/vector_functions` on vectors.

    It returns its value, or it writes two values, of which `result` is the number of this one.
    """

    name: str
    result: int | None = None


@dataclass(frozen=True)
class Operation:
    """One operation on scalars.

    `partials` takes operands that are nodes of a tape and returns the partial derivative by each, nodes or numbers. For
    z of operands x, tangents are z' = sum of partial * x', and adjoints of x grow by partial * adjoint of z. Partials
    that hold the value itself write no new step for it: equal expressions are one node.

    `llvm` are instructions on vectors. Whole numbers stand for the operands and, after them, the values of the
    instructions before; a float stands for itself. The last value is that of the operation.
    """

    name: str
    noun: str  # what many of them are called
    arity: int
    value: Callable[..., float]
    partials: Callable[..., tuple[Any, ...]]
    llvm: tuple[Instruction, ...] = ()
    unfused: tuple[Instruction, ...] = ()  # the instructions where the host cannot fuse products with sums
    function: VectorFunction | None = None  # what native code calls instead
    expression: Expression | None = None  # how code writes it; None: it is called by its name
    free: bool = False  # signs are kept outside, and end in subtractions
    involution: bool = False  # whether it undoes itself


def _nan_at_infinity(function: Callable[[float], float]) -> Callable[[float], float]:
    """Return sine or cosine with NaN at infinite angles.

    Python raises an error there.
    """
    return lambda x: function(x) if math.isfinite(x) else math.nan


def _reciprocal(x: float) -> float:
    """Return 1 / x, infinite where x is zero.

    Python raises an error there.
    """
    return 1 / x if x else math.copysign(math.inf, x)


def _exponential(x: float) -> float:
    """Return exp(x), infinite where it overflows and Python raises an error."""
    try:
        return math.exp(x)
    except OverflowError:
        return math.inf


def _square_root(x: float) -> float:
    """Return the square root, NaN of negative numbers.

    Python raises an error there.
    """
    return math.sqrt(x) if not x < 0 else math.nan


def square_sech(x: Any, y: Any, exp: Callable[[Any], Any]) -> Any:
    """Return 1 / cosh(x)^2, the derivative of y = tanh x.

    All digits are right. The formula 1 - y^2 has no digits left where y rounds to 1. The value is 4 a b / (a + b)^2 of
    a = e^(x - x y) and b = e^(-x - x y). The factor e^(-x y) cancels, and keeps both within [0, 1.4]: nothing
    overflows, in derivatives either.
    """
    xy = x * y
    a, b = exp(x + -xy), exp(-(x + xy))
    inverse = 1 / (a + b)
    return (a * inverse) * (b * inverse) * 4


# fmt: off
OPERATIONS: Mapping[str, Operation] = {operation.name: operation for operation in (
    Operation("mul", "products", 2, lambda x, y: x * y, lambda x, y: (y, x),
              llvm=(("fmul", 0, 1),), expression=Expression("{0} * {1}", PRODUCT, (PRODUCT, ATOM))),
    Operation("add", "sums", 2, lambda x, y: x + y, lambda x, y: (1, 1),
              llvm=(("fadd", 0, 1),), expression=Expression("{0} + {1}", SUM, (SUM, PRODUCT))),
    Operation("sub", "differences", 2, lambda x, y: x - y, lambda x, y: (1, -1),
              llvm=(("fsub", 0, 1),), expression=Expression("{0} - {1}", SUM, (SUM, PRODUCT))),
    Operation("neg", "signs", 1, lambda x: -x, lambda x: (-1,),
              llvm=(("fneg", 0),), expression=Expression("-{0}", SUM, (ATOM,)), free=True, involution=True),
    Operation("inv", "reciprocals", 1, _reciprocal, lambda x: (-((1 / x) * (1 / x)),),
              llvm=(("fdiv", 1.0, 0),), expression=Expression("{one} / {0}", PRODUCT, (ATOM,)), involution=True),
    Operation("sin", "sin", 1, _nan_at_infinity(math.sin), lambda x: (x.cos(),), function=VectorFunction("sincos", 0)),
    Operation("cos", "cos", 1, _nan_at_infinity(math.cos), lambda x: (-x.sin(),), function=VectorFunction("sincos", 1)),
    Operation("tanh", "tanh", 1, math.tanh, lambda x: (square_sech(x, x.tanh(), methodcaller("exp")),),
              function=VectorFunction("tanh")),
    Operation("exp", "exp", 1, _exponential, lambda x: (x.exp(),), function=VectorFunction("exp")),
    Operation("sqrt", "sqrt", 1, _square_root, lambda x: (0.5 / x.sqrt(),), llvm=(("llvm.sqrt", 0),)),
    # Native code rounds the following once.
    Operation("fma", "fused sums", 3, lambda x, y, z: x * y + z, lambda x, y, z: (y, x, 1),
              llvm=(("llvm.fma", 0, 1, 2),), unfused=(("fmul", 0, 1), ("fadd", 3, 2)),
              expression=Expression("{0} * {1} + {2}", SUM, (PRODUCT, ATOM, PRODUCT))),
    Operation("fms", "fused differences", 3, lambda x, y, z: x * y - z, lambda x, y, z: (y, x, -1),
              llvm=(("fneg", 2), ("llvm.fma", 0, 1, 3)), unfused=(("fmul", 0, 1), ("fsub", 3, 2)),
              expression=Expression("{0} * {1} - {2}", SUM, (PRODUCT, ATOM, PRODUCT))),
    Operation("fnma", "fused negative products", 3, lambda x, y, z: z - x * y, lambda x, y, z: (-y, -x, 1),
              llvm=(("fneg", 0), ("llvm.fma", 3, 1, 2)), unfused=(("fmul", 0, 1), ("fsub", 2, 3)),
              expression=Expression("{2} - {0} * {1}", SUM, (PRODUCT, ATOM, SUM))),
)}
# fmt: on
LEAVES = ("input", "constant")  # the kinds of steps that are no operations: they have a number, and no operands
FREE_KINDS = (*LEAVES, *(name for name, operation in OPERATIONS.items() if operation.free))  # not counted
FUNCTION_KINDS = tuple(name for name, operation in OPERATIONS.items() if operation.expression is None)  # called by name
