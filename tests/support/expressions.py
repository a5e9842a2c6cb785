"""SymPy expressions of many parts as numbers."""

import math

import sympy

RULES = {"Add": sum, "Mul": math.prod, "Pow": lambda x: x[0] ** x[1]}
FUNCTIONS = {name: getattr(math, name) for name in ("sin", "cos", "tanh", "cosh", "exp", "log")}


def entries(x):
    """The entries of a matrix or an array, or what is none."""
    if isinstance(x, sympy.NDimArray):
        return list(x.reshape(len(x)))
    return list(x) if isinstance(x, sympy.MatrixBase) else [x]


def evaluated(x, known):
    """The value of an expression; `known` takes those of its parts, of which most stand in many places."""
    if x not in known:
        name, parts = type(x).__name__, [evaluated(part, known) for part in x.args]
        known[x] = FUNCTIONS[name](*parts) if name in FUNCTIONS else RULES[name](parts) if parts else float(x)
    return known[x]
