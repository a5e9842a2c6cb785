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
from collections.abc import Sequence
from dataclasses import dataclass

from jounce.program.operations import OPERATIONS
from jounce.program.program import Program, Step, prune
from jounce.program.trace import Node, Tape

SUMS = ("add", "sub")


@dataclass(frozen=True)
class _Term:
    """A signed product of nodes on the new tape."""

    sign: int
    factors: tuple[Node, ...]

    def divide(self, factor: Node) -> "_Term":
        """The product without one of its factors."""
        rest = list(self.factors)
        rest.remove(factor)
        return _Term(self.sign, tuple(rest))


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
    """The old program, how often its steps are used, and the new tape."""

    def __init__(self, program: Program) -> None:
        self.program, self.uses = program, program.uses()
        self.tape = Tape()
        self.tape.variables(program.inputs)
        self.made: dict[int, Node] = {}

    def result(self) -> Program:
        taken = {i for step in self.program.steps for i in self._inner(step)}
        for i, step in enumerate(self.program.steps):
            if i not in taken:
                self.made[i] = self._rebuild(i, step)
        return self.tape.program([self.made[i] for i in self.program.outputs])

    def _inner(self, step: Step) -> list[int]:
        """The operands that are taken apart with a step: used here alone, sums in sums and products in both."""
        apart = {"add": (*SUMS, "mul"), "sub": (*SUMS, "mul"), "mul": ("mul",)}.get(step.kind, ())
        return [i for i in step.operands if self.uses[i] == 1 and self.program.steps[i].kind in apart]

    def _rebuild(self, i: int, step: Step) -> Node:
        match step.kind:
            case "input":
                return self.tape.write("input", value=step.value)
            case "constant":
                return self.tape.node(step.value)
            case kind if OPERATIONS[kind].arity == 1:
                return self.tape.function(kind, self.made[step.operands[0]])
        return self._sum(self._terms(i, 1))

    def _terms(self, i: int, sign: int) -> list[_Term]:
        """The terms of a step taken apart."""
        step = self.program.steps[i]
        if i in self.made or step.kind not in (*SUMS, "mul"):
            return [self._term(sign, [self.made[i]])]
        if step.kind == "mul":
            return [self._term(sign, self._factors(i))]
        left, right = step.operands
        inner = self._inner(step)
        other = -sign if step.kind == "sub" else sign
        return [
            term
            for j, s in ((left, sign), (right, other))
            for term in (self._terms(j, s) if j in inner else [self._term(s, [self.made[j]])])
        ]

    def _factors(self, i: int) -> list[Node]:
        step = self.program.steps[i]
        inner = self._inner(step)
        return [node for j in step.operands for node in (self._factors(j) if j in inner else [self.made[j]])]

    def _term(self, sign: int, factors: Sequence[Node]) -> _Term:
        """A term with its sign outside."""
        plain = []
        for node in factors:
            if node.kind == "neg" or (node.kind == "constant" and node.value < 0):
                node, sign = -node, -sign
            plain.append(node)
        return _Term(sign, tuple(plain))

    def _sum(self, terms: Sequence[_Term]) -> Node:
        """The terms added up, those that share their most common factor first of all under it."""
        shared = Counter(node for term in terms for node in set(term.factors))
        often = max(shared.values(), default=0)
        if often > 1:  # group the terms under the factor, then go on with the group as one of the terms
            factor = next(node for term in terms for node in term.factors if shared[node] == often)
            under = [term.divide(factor) for term in terms if factor in term.factors]
            apart = [term for term in terms if factor not in term.factors]
            grouped = factor * self._sum(under)
            return self._sum([*apart, _Term(1, (grouped,))]) if apart else grouped
        total = self.tape.node(0)
        for term in sorted(terms, key=lambda term: -term.sign):  # what is added before what is subtracted
            product = self.tape.node(1)
            for node in term.factors:
                product = product * node
            total = total + product if term.sign > 0 else total - product
        return total
