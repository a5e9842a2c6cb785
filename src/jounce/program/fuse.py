"""A pass over programs: a product that is used once, in a sum, is fused with it: x y + z is rounded once.

The choice is made here and not by a compiler, so that results are the same wherever a state stands in a batch.
"""

from jounce.program.program import Operation, Program, needed


def fused(program: Program) -> Program:
    """The same outputs with fused operations where the host has them."""
    uses, steps = program.uses(), list(program.steps)
    for i, step in enumerate(steps):
        if step.kind in ("add", "sub"):
            left, right = step.operands
            lone = [j for j in step.operands if steps[j].kind == "mul" and uses[j] == 1]
            if right in lone:
                steps[i] = Operation("fma" if step.kind == "add" else "fnma", (*steps[right].operands, left))
            elif left in lone:
                steps[i] = Operation("fma" if step.kind == "add" else "fms", (*steps[left].operands, right))
    return needed(steps, program.outputs, program.inputs)
