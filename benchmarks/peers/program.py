"""jounce's traced program printed as scalar C: what a compiler makes of the same operations."""

from benchmarks.c import library, loop, over_states
from benchmarks.peers import Peer, Prepared
from jounce import Robot
from jounce.kernel import forms
from jounce.kernel.program import Program
from jounce.kernel.quantity import Quantity

SIGNS = {"add": "+", "sub": "-", "mul": "*"}


def printed(program: Program, n: int) -> str:
    """``run(states, in, out)``: the program for one state after the other, every array (states, n)."""
    lines = []
    for i, step in enumerate(program.steps):
        x = [f"v{j}" for j in step.operands]
        match step.kind:
            case "input":
                array, column = divmod(int(step.value), n)
                value = f"in[{array}][{n} * i + {column}]"
            case "constant":
                value = repr(step.value)
            case "neg":
                value = f"-{x[0]}"
            case "sin" | "cos":
                value = f"{step.kind}({x[0]})"
            case kind:
                value = f"{x[0]} {SIGNS[kind]} {x[1]}"
        lines.append(f"const double v{i} = {value};")
    for j, i in enumerate(program.outputs):
        array, column = divmod(j, n)
        lines.append(f"out[{array}][{n} * i + {column}] = v{i};")
    return loop(lines)


def _build(robot: Robot, order: int) -> Prepared:
    quantity = Quantity("inverse_dynamics", order, False, robot.n, robot.mechanism.nb)
    program = forms.program(robot.mechanism, quantity)
    return over_states(library([printed(program, robot.n)]))


PEERS = (Peer("jounce's program as scalar C, gcc", _build),)
