"""The time that a kernel cannot fall below: its instructions over the rates at which the processor was seen to do them.

Counted are the products, sums and fused ones of the program and of its sines and cosines. Left out are the integer
instructions of the sines, loads and stores, transposition, and the check for what is not finite, so that no kernel
reaches the bound.
"""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from jounce import Robot
from jounce.dynamics.computation import Computation
from jounce.dynamics.quantities import DEFAULT_QUANTITY
from jounce.model.mechanism import with_exact_integers
from jounce.native import code_forms, vector_functions
from jounce.native.ir import Writer
from jounce.native.jit import host
from jounce.program.passes import fuse
from jounce.program.program import Program, Tape

PRODUCTS, SUMS = ("mul", "fma", "fms", "fnma"), ("add", "sub")


@dataclass(frozen=True)
class Count:
    """Instructions of a vector of states: products, fused or not, and lone sums."""

    products: int
    sums: int

    def __add__(self, other: "Count") -> "Count":
        return Count(self.products + other.products, self.sums + other.sums)

    def seconds(self, peaks: Mapping[str, float]) -> float:
        """Per vector: products and sums each on their own pipes, and no more together than both were seen to go."""
        products, sums = self.products * peaks["fma"], self.sums * peaks["add"]
        return max(products, sums, (self.products + self.sums) * peaks["both"])


def of_program(program: Program) -> Count:
    """The arithmetic of a program, fused."""
    counts = fuse(program).counts()
    return Count(sum(counts[kind] for kind in PRODUCTS), sum(counts[kind] for kind in SUMS))


def of_circles(program: Program) -> Count:
    """The arithmetic of its sines and cosines, one polynomial pair an angle, as `functions` writes it."""
    angles = {step.operands for step in program.steps if step.kind in ("sin", "cos")}
    ir = Writer(host())
    vector_functions.define_sincos(ir)
    written = Counter(re.findall(r"@llvm\.(fma)|\b(fmul|fadd|fsub) ", ir.text().partition("@sincos(")[2]))
    kinds = Counter({a or b: count for (a, b), count in written.items()})
    return Count(len(angles) * (kinds["fma"] + kinds["fmul"]), len(angles) * (kinds["fadd"] + kinds["fsub"]))


def programs(robot: Robot, order: int) -> tuple[Program, Program]:
    """The program of a robot's forces as it is traced, and after its products are factored."""
    m, tape = robot.mechanism, Tape()
    forces = Computation(DEFAULT_QUANTITY.name, order)
    q = [tape.variables(m.n) for _ in range(forces.rates)]
    results = forces.series("recursion", with_exact_integers(m), q).upto(order)
    traced = tape.program([x for result in results for x in result.ravel()])
    return traced, code_forms.trace_program(m, forces)


def floor(program: Program, peaks: Mapping[str, float]) -> float:
    """The bound of a program, s per state."""
    return (of_program(program) + of_circles(program)).seconds(peaks) / host().lanes
