"""skidy: the paper's closed form as SymPy expressions, of small robots, as C with shared subexpressions."""

import contextlib
import io
from typing import TYPE_CHECKING

from benchmarks.c import library, loop, over_states
from benchmarks.peers import Peer, Prepared
from jounce import Robot
from jounce.spatial.series import rate_name

if TYPE_CHECKING:
    import sympy


def expressions(robot: Robot, order: int) -> "tuple[list[sympy.Matrix], list[sympy.Matrix]]":
    """The symbols of q, qd, ..., and skidy's Q, Qd, ... of them."""
    import skidy
    import sympy

    m = robot.mechanism
    rates = [sympy.Matrix(sympy.symbols(f"{rate_name('q', k)}_:{robot.n}")) for k in range(order + 3)]
    with contextlib.redirect_stdout(io.StringIO()):
        model = skidy.SymbolicKinDyn(
            gravity_vector=sympy.Matrix(robot.gravity),
            ee=sympy.eye(4),
            body_ref_config=[sympy.Matrix(B) for B in m.B],
            joint_screw_coord=[sympy.Matrix(X) for X in m.X],
            config_representation="body_fixed",
            Mb=[sympy.Matrix(M) for M in m.M],
        )
        model.closed_form_inv_dyn_body_fixed(*rates, simplify=False, parallel=False)
    return rates, [model.Q, model.Qd, model.Q2d][: order + 1]


def _build(robot: Robot, order: int) -> Prepared:
    import sympy

    rates, forces = expressions(robot, order)
    shared, results = sympy.cse([x for Q in forces for x in Q])
    lines = [
        f"const double {x} = in[{k}][{robot.n} * i + {j}];" for k, rate in enumerate(rates) for j, x in enumerate(rate)
    ]
    lines += [f"const double {x} = {sympy.ccode(value)};" for x, value in shared]
    for j, value in enumerate(results):
        array, column = divmod(j, robot.n)
        lines.append(f"out[{array}][{robot.n} * i + {column}] = {sympy.ccode(value)};")
    return over_states(library([loop(lines)], "-ffast-math"))


PEERS = (Peer("skidy's expressions, cse, as scalar C, gcc -ffast-math", _build, orders=(2,), batches=(1_000,)),)
