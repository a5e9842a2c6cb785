"""Numbers written as expressions: `-sqrt(2)/2`, `pi/2`, `m1*L1**2`; calculated here, never run as code."""

import ast
import math
import operator
from collections.abc import Callable, Mapping

from jounce.core.errors import JounceError, listed, quoted

CONSTANTS = {"pi": math.pi, "E": math.e}
FUNCTIONS: dict[str, Callable[..., float]] = {
    name: getattr(math, name) for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sqrt", "exp", "log")
}
OPERATIONS: dict[type, Callable[..., float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: math.pow,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}
LONGEST = 1000  # characters: Python's parser takes the stack for what is nested


def value(text: str, assigned: Mapping[str, float]) -> float:
    """The finite number that a text stands for, its symbols those assigned."""
    try:
        if len(text) > LONGEST:
            raise JounceError(f"an expression of at most {LONGEST} characters")
        number = _value(ast.parse(text.strip(), mode="eval").body, assigned)
    except (SyntaxError, ValueError, TypeError, ArithmeticError, MemoryError, RecursionError):
        raise JounceError("a finite number, or an expression of one") from None
    if not math.isfinite(number):
        raise JounceError("a finite number, or an expression of one")
    return number


def _value(node: ast.expr, assigned: Mapping[str, float]) -> float:
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return float(number)
        case ast.Name(id=name):
            if name in CONSTANTS or name in assigned:
                return CONSTANTS[name] if name in CONSTANTS else assigned[name]
            known = listed(assigned) or "none"
            raise JounceError(f"a number: the symbol {quoted(name)} has no value; symbols with values: {known}")
        case ast.UnaryOp(op=op, operand=x) if type(op) in OPERATIONS:
            return OPERATIONS[type(op)](_value(x, assigned))
        case ast.BinOp(left=x, op=op, right=y) if type(op) in OPERATIONS:
            return OPERATIONS[type(op)](_value(x, assigned), _value(y, assigned))
        case ast.Call(func=ast.Name(id=name), args=given, keywords=[]) if name in FUNCTIONS:
            return FUNCTIONS[name](*(_value(x, assigned) for x in given))
    raise JounceError(f"a number: operators are + - * / **, functions {listed(FUNCTIONS)}")
