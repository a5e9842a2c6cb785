"""``python -m benchmarks.literature``: the forms of the literature on the same inputs, operations and accuracy.

Operations as written are counted by running an algorithm on scalars that count; traced ones are those of the program
that is left when equal operations are done once and those with 0 and 1 are not done. Errors are those of doubles
against a program of 50 digits.
"""

import operator
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import click
import mpmath
import numpy as np

import jounce
from benchmarks.peers import buondonno
from benchmarks.robots import ARMS, GENERAL, load, states
from benchmarks.tables import paragraph, share, table
from jounce.core.typing import Method
from jounce.dynamics.computation import Computation
from jounce.io import files
from jounce.model.mechanism import with_exact_integers
from jounce.native import code_forms
from jounce.program.program import Program, Tape

ORDER, STATES, DIGITS = 2, 20, 50
Form = Callable[[jounce.Mechanism, Sequence[Any]], list[Any]]  # from q, qd, ..., each (n,), to Q, Qd, ...
HEAD = (
    "form", "as written", "iiwa: Q", "Q, Qd", "Q, Qd, Q2d", "general: Q, Qd, Q2d", "error, iiwa", "error, general",
)  # fmt: skip
TEXT = """Operations on scalars, sines and cosines among them, for one state of seven revolute joints, of the iiwa and
of an arm at no special angles. As written: products with 0 and 1 are done, nothing is shared but what formulas name.
Traced: the same algorithm, equal operations done once and trivial ones not at all. Errors of doubles over {states}
states, the largest of Q, Qd and Q2d, each as a share of its largest value, against {digits} digits. Factored: sums and
products are regrouped, as the native code runs them. The recursion of Buondonno and De Luca is written
for this table, from its mathematics; each row agrees with `robot.inverse_dynamics` to 1e-12, which a test asserts."""


class Counted:
    """A double that counts the operations on it and on others of its kind."""

    __slots__ = ("value",)
    operations = 0

    def __init__(self, value: float) -> None:
        self.value = value

    def _counted(self, value: float) -> "Counted":
        Counted.operations += 1
        return Counted(value)

    def __add__(self, other: Any) -> "Counted":
        return self._counted(self.value + getattr(other, "value", other))

    def __sub__(self, other: Any) -> "Counted":
        return self._counted(self.value - getattr(other, "value", other))

    def __rsub__(self, other: Any) -> "Counted":
        return self._counted(other - self.value)

    def __mul__(self, other: Any) -> "Counted":
        return self._counted(self.value * getattr(other, "value", other))

    def __neg__(self) -> "Counted":
        return Counted(-self.value)  # a sign is free: the sum after it becomes a difference

    def sin(self) -> "Counted":
        """Counted as one operation."""
        return self._counted(np.sin(self.value))

    def cos(self) -> "Counted":
        """Counted as one operation."""
        return self._counted(np.cos(self.value))

    __radd__, __rmul__ = __add__, __mul__


def _form_by_method(method: Method) -> Form:
    def form(m: jounce.Mechanism, rates: Sequence[Any]) -> list[Any]:
        found = Computation("inverse_dynamics", len(rates) - 3).series(method, with_exact_integers(m), rates)
        return [Q.ravel() for Q in found.upto(len(rates) - 3)]

    return form


def _buondonno(m: jounce.Mechanism, rates: Sequence[Any]) -> list[Any]:
    return buondonno.inverse_dynamics(buondonno.links(m), np.array(m.gravity), rates)


FORMS: dict[str, Form] = {
    "Buondonno and De Luca: recursion of vectors": _buondonno,
    "Müller and Kumar: Sections 3 and 4, dense": _form_by_method("paper"),
    "jounce, `closed_form`: Section 2 over series, dense": _form_by_method("closed_form"),
    "jounce, `recursion`": _form_by_method("recursion"),
}


@cache
def written(form: str) -> int:
    """The operations of a form as it is written, zeros included: the same for every arm of seven joints."""
    given = [np.array([Counted(float(x)) for x in rate[0]]) for rate in states(7, 1, ORDER)]
    Counted.operations = 0
    FORMS[form](load(GENERAL).mechanism, given)
    return Counted.operations


@cache
def program(form: str, arm: str, order: int) -> Program:
    """The program of a form."""
    m, tape = load(arm).mechanism, Tape()
    results = FORMS[form](m, [np.array(tape.variables(m.n)) for _ in range(order + 3)])
    return tape.program([x for Q in results for x in Q])


def errors(form: str, arm: str, count: int = STATES) -> list[float]:
    """The largest errors of Q, Qd, Q2d over states, as shares of the largest values."""
    m, given = load(arm).mechanism, states(7, count, ORDER)
    return _shares(np.array([FORMS[form](m, [x[k] for x in given]) for k in range(count)], dtype=float), arm)


def _shares(found: np.ndarray, arm: str) -> list[float]:
    exact = _precise(arm, len(found))
    return [float(np.abs((found - exact)[:, k]).max() / np.abs(exact[:, k]).max()) for k in range(ORDER + 1)]


@cache
def _precise(arm: str, count: int) -> np.ndarray:
    """Q, Qd, Q2d of states in 50 digits, rounded to doubles: the program of the closed form, (count, orders, n)."""
    rules: dict[str, Callable[..., Any]] = {
        "mul": operator.mul, "add": operator.add, "sub": operator.sub, "neg": operator.neg,
        "sin": mpmath.sin, "cos": mpmath.cos,
    }  # fmt: skip
    closed_form = program("jounce, `closed_form`: Section 2 over series, dense", arm, ORDER)
    found = []
    with mpmath.workdps(DIGITS):
        for state in np.concatenate(states(7, count, ORDER), axis=-1):
            values: list[Any] = []
            for step in closed_form.steps:
                if step.kind in ("input", "constant"):
                    values.append(mpmath.mpf(float(state[int(step.value)] if step.kind == "input" else step.value)))
                else:
                    values.append(rules[step.kind](*(values[i] for i in step.operands)))
            found.append([float(values[i]) for i in closed_form.outputs])
    return np.array(found).reshape(count, ORDER + 1, -1)


def row(form: str) -> list[str]:
    """A row of the table."""
    traced = [program(form, ARMS[0], order).operations for order in range(ORDER + 1)]
    counts = [written(form), *traced, program(form, GENERAL, ORDER).operations]
    return [form, *(f"{count:,}" for count in counts), *(share(max(errors(form, arm))) for arm in ARMS)]


def factored_counts() -> list[str]:
    """The operations of the programs that native code runs: of the iiwa to each order, and of the general arm."""
    asked = [*((ARMS[0], order) for order in range(ORDER + 1)), (GENERAL, ORDER)]
    return [
        f"{code_forms.trace_program(load(arm).mechanism, Computation('inverse_dynamics', order)).operations:,}"
        for arm, order in asked
    ]


def factored() -> list[str]:
    """The row of these programs."""
    given = states(7, STATES, ORDER)
    found = [np.stack(load(arm).inverse_dynamics(*given, method="kernel"), axis=1) for arm in ARMS]
    kernels = [share(max(_shares(forces, arm))) for forces, arm in zip(found, ARMS, strict=True)]
    return ["jounce, `kernel`: factored", "-", *factored_counts(), *kernels]


def page() -> str:
    """The page of results."""
    lines = ["# Forms of the literature", "", *paragraph(TEXT.format(states=STATES, digits=DIGITS))]
    return "\n".join([*lines, *table(HEAD, [*map(row, FORMS), factored()])]).rstrip() + "\n"


@click.command()
@click.option("-o", "--output", default=Path(__file__).parent / "LITERATURE.md", type=click.Path(path_type=Path))
def main(output: Path) -> None:
    """Count and compare the forms of the literature, and write LITERATURE.md."""
    with files.write_whole(output) as part:
        part.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
