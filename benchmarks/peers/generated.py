"""The C that `jounce codegen` writes: what a compiler makes of the same operations, one state after the other."""

from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.c import library, over_states
from benchmarks.peers import Peer, Prepared
from jounce import Robot

LOOP = """
#include "arm.h"
void run(long states, const double *const *in, double *const *out) {{
  for (long i = 0; i < states; i++) arm_inverse_dynamics({arguments});
}}
"""


def _build(robot: Robot, order: int) -> Prepared:
    n = robot.n
    taken, given = (
        [f"{name}[{k}] + {n} * i" for k in range(count)] for name, count in (("in", order + 3), ("out", order + 1))
    )
    with TemporaryDirectory() as folder:
        robot.codegen("c", order, folder, prefix="arm")
        return over_states(
            library([Path(folder, "arm.c"), LOOP.format(arguments=", ".join(taken + given))], f"-I{folder}")
        )


PEERS = (Peer("jounce codegen's C, gcc", _build),)
