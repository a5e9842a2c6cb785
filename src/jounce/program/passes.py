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
    """Return a program of the same outputs with fewer products."""
    return _Pass(program).result()


def fuse(program: Program) -> Program:
    """Return a program of the same outputs with fused products and sums."""
    uses, steps = program.uses(), list(program.steps)
    for i, step in enumerate(steps):
        if step.kind in SUMS:
            left, right = step.operands
            # A product that other steps use too would be computed twice.
            lone_products = [j for j in step.operands if steps[j].kind == "mul" and uses[j] == 1]
            # z + x y or z - x y, and only else x y + z or x y - z: one product of a sum can be fused.
            if right in lone_products:
                steps[i] = Step("fma" if step.kind == "add" else "fnma", (*steps[right].operands, left))
            elif left in lone_products:
                steps[i] = Step("fma" if step.kind == "add" else "fms", (*steps[left].operands, right))
    # Products that were fused are used no more.
    return prune(steps, program.outputs, program.inputs)


class _Pass:
    """A rewriting of a program on a new tape.

    `inner` are the steps that are taken apart with the step that uses them, `made` the nodes of all others.
    """

    def __init__(self, program: Program) -> None:
        self.program, self.steps = program, program.steps
        uses = program.uses()
        # A step that is used twice stays whole: taken apart it would be computed twice.
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
        """Return the program, every step rebuilt once, operands first."""
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
        """Return the terms of a step taken apart, their signs outside."""
        step = self.steps[i]
        # A sum that is no node of its own yet belongs to the sum that uses it.
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
        """Return the factors of a product taken apart."""
        if i in self.made:
            return [self.made[i]]
        left, right = self.steps[i].operands
        return self._factors(left) + self._factors(right)

    def _sum(self, terms: Sequence[_Term]) -> Node:
        """Return the sum of terms, grouped by common factors."""
        # A factor counts once a term, so that a square is no common factor.
        nodes = [node for _, factors in terms for node in set(factors)]
        if len(set(nodes)) < len(nodes):
            return self._group(terms, Counter(nodes))
        # Terms without a common factor are added one by one; negative ones come last, and are subtracted.
        total = self.tape.zero
        for sign, factors in sorted(terms, key=itemgetter(0), reverse=True):
            product = reduce(mul, factors, self.tape.one)
            total = total + product if sign > 0 else total - product
        return total

    def _group(self, terms: Sequence[_Term], shared: Mapping[Node, int]) -> Node:
        """Return terms added up, grouped under their most common factor.

        a x + a y + ... becomes a (x + y + ...). The group is one term among the others then.
        """
        highest_count = max(shared.values())
        factor = next(node for _, factors in terms for node in factors if shared[node] == highest_count)
        quotients = [(sign, _divide(factors, factor)) for sign, factors in terms if factor in factors]
        other_terms = [term for term in terms if factor not in term[1]]
        group = factor * self._sum(quotients)
        return group if len(other_terms) == 0 else self._sum([*other_terms, (1, [group])])


def _divide(factors: list[Node], factor: Node) -> list[Node]:
    """Return a product without one of its factors."""
    i = factors.index(factor)
    return factors[:i] + factors[i + 1 :]
