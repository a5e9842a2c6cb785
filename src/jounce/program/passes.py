"""Passes over programs: `factor` groups products with a shared factor, `fuse` fuses products with sums.

`factor` flattens sums and builds them again by a x + a y = a (x + y), the most common factor first, which is
the greedy multivariate Horner scheme [1]: another order of factors could leave fewer products still. It takes apart
only what is used once, so that nothing shared is computed twice. Values change by rounding errors.

`fuse` rounds x y + z once, where x y is used once. The choice is made here and not by a compiler, so that results are
the same wherever a state stands in a batch.

[1] M. Ceberio, V. Kreinovich, Greedy algorithms for optimizing multivariate Horner schemes, ACM SIGSAM Bulletin 38
(1), 2004.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import reduce
from operator import itemgetter, mul

from jounce.program import operations
from jounce.program.program import Node, Program, Step, Tape, prune

SUMS = ("add", "sub")
TAKEN_APART = {"add": (*SUMS, "mul"), "sub": (*SUMS, "mul"), "mul": ("mul",)}  # sums in sums, and products in both

_Term = tuple[int, list[Node]]  # a sign, and the factors of a product on the new tape


def factor(program: Program) -> Program:
    """The same outputs by fewer products."""
    return _Pass(program).result()


def fuse(program: Program) -> Program:
    """The same outputs with fused operations where the host has them."""
    uses, steps = program.uses(), list(program.steps)
    for i, step in enumerate(steps):
        if step.kind in ("add", "sub"):
            left, right = step.operands
            lone = [j for j in step.operands if steps[j].kind == "mul" and uses[j] == 1]
            if right in lone:
                steps[i] = Step("fma" if step.kind == "add" else "fnma", (*steps[right].operands, left))
            elif left in lone:
                steps[i] = Step("fma" if step.kind == "add" else "fms", (*steps[left].operands, right))
    return prune(steps, program.outputs, program.inputs)


class _Pass:
    """The old program, which of its steps are taken apart with the one that uses them, and the new tape."""

    def __init__(self, program: Program) -> None:
        self.program, self.steps = program, program.steps
        uses = program.uses()
        self.inner = {
            j
            for step in self.steps
            if step.kind in TAKEN_APART
            for j in step.operands
            if uses[j] == 1 and self.steps[j].kind in TAKEN_APART[step.kind]
        }
        self.tape = Tape()
        self.tape.variables(program.inputs)
        self.made: dict[int, Node] = {}

    def result(self) -> Program:
        for i, step in enumerate(self.steps):
            if i not in self.inner:
                self.made[i] = self._rebuild(i, step)
        return self.tape.program([self.made[i] for i in self.program.outputs])

    def _rebuild(self, i: int, step: Step) -> Node:
        if step.kind in TAKEN_APART:
            return self._sum(self._terms(i, 1))
        if step.kind in operations.LEAVES:
            return self.tape.write(step.kind, value=step.value)
        return self.tape.function(step.kind, self.made[step.operands[0]])

    def _terms(self, i: int, sign: int) -> list[_Term]:
        """The terms of a step taken apart, their signs outside."""
        step = self.steps[i]
        if step.kind in SUMS and i not in self.made:
            left, right = step.operands
            return self._terms(left, sign) + self._terms(right, sign if step.kind == "add" else -sign)
        factors = []
        for node in self._factors(i):
            if node.kind == "neg" or (node.kind == "constant" and node.value < 0):
                node, sign = -node, -sign
            factors.append(node)
        return [(sign, factors)]

    def _factors(self, i: int) -> list[Node]:
        if i in self.made:
            return [self.made[i]]
        left, right = self.steps[i].operands
        return self._factors(left) + self._factors(right)

    def _sum(self, terms: Sequence[_Term]) -> Node:
        """The terms added up, those that share their most common factor first of all under it."""
        nodes = [node for _, factors in terms for node in set(factors)]
        if len(set(nodes)) < len(nodes):
            return self._group(terms, Counter(nodes))
        total = self.tape.zero
        for sign, factors in sorted(terms, key=itemgetter(0), reverse=True):  # what is subtracted comes last
            product = reduce(mul, factors, self.tape.one)
            total = total + product if sign > 0 else total - product
        return total

    def _group(self, terms: Sequence[_Term], shared: Mapping[Node, int]) -> Node:
        """The terms added up, first those under their most common factor, the group of which is one of the others."""
        often = max(shared.values())
        factor = next(node for _, factors in terms for node in factors if shared[node] == often)
        under = [(sign, _divide(factors, factor)) for sign, factors in terms if factor in factors]
        apart = [term for term in terms if factor not in term[1]]
        grouped = factor * self._sum(under)
        return self._sum([*apart, (1, [grouped])]) if apart else grouped


def _divide(factors: list[Node], factor: Node) -> list[Node]:
    """A product without one of its factors."""
    i = factors.index(factor)
    return factors[:i] + factors[i + 1 :]
