"""The recursion traced by CasADi, generated as C."""

import numpy as np

from benchmarks.c import library, over_states
from benchmarks.peers import Peer, Prepared
from jounce import Robot
from jounce.spatial.series import rate_name

LOOP = """
void run(long states, const double *const *in, double *const *out) {{
  const double *arg[{arg}]; double *res[{res}]; long long iw[{iw}]; double w[{w}];
  for (long i = 0; i < states; i++) {{
    for (int k = 0; k < {rates}; k++) arg[k] = in[k] + {n} * i;
    for (int k = 0; k < {given}; k++) res[k] = out[k] + {n} * i;
    forces(arg, res, iw, w, 0);
  }}
}}
"""


def _build(robot: Robot, order: int) -> Prepared:
    import casadi

    symbols = [casadi.SX.sym(rate_name("q", k), robot.n) for k in range(order + 3)]
    found = robot.inverse_dynamics(*(np.array(casadi.vertsplit(s), dtype=object) for s in symbols))
    results = [casadi.vertcat(*x) for x in (found if order else (found,))]
    forces = casadi.Function("forces", symbols, casadi.cse(results))
    made = casadi.CodeGenerator("forces.c")
    made.add(forces)
    room = {name: 1 + getattr(forces, f"sz_{name}")() for name in ("arg", "res", "iw", "w")}
    text = made.dump() + LOOP.format(**room, rates=order + 3, given=order + 1, n=robot.n)
    return over_states(library([text], "-ffast-math"))


PEERS = (Peer("the recursion through CasADi as scalar C, gcc -ffast-math", _build, orders=range(3)),)
