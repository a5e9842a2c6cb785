"""From a robot to equations that a machine can evaluate: how long it takes, and how many operations come out.

``python -m benchmarks.making WAY JOINTS`` does one of them, in a process of its own that can be stopped.
"""

import json
import subprocess
import sys
from collections.abc import Iterator
from tempfile import TemporaryDirectory
from time import perf_counter

from benchmarks.peers.skidy import expressions
from benchmarks.robots import start_of_iiwa
from jounce import Robot

SIZES = (2, 3, 7)  # joints of the iiwa
LIMIT = 150.0  # s


def _skidy(robot: Robot) -> int:
    import sympy

    shared, results = sympy.cse([x for Q in expressions(robot, 2)[1] for x in Q])
    return int(sympy.count_ops([*(value for _, value in shared), *results], visual=False))


def _symbolic(robot: Robot) -> int:
    import sympy

    S = robot.symbolic()
    shared, results = sympy.cse([*S.Q, *S.Qd, *S.Q2d])
    return int(sympy.count_ops([*(value for _, value in shared), *results], visual=False))


def _codegen(robot: Robot) -> int:
    with TemporaryDirectory() as folder:
        return sum(robot.codegen("c", 2, folder, prefix="arm").operations.values())


WAYS = {"skidy's expressions, cse": _skidy, "robot.symbolic, cse": _symbolic, "jounce codegen, C": _codegen}


def made() -> Iterator[tuple[str, ...]]:
    """A row for each way: for each size the seconds and operations, or why there are none."""
    for way in WAYS:
        cells = []
        for n in SIZES:
            command = [sys.executable, "-m", "benchmarks.making", way, str(n)]
            try:
                done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT)
            except subprocess.TimeoutExpired:
                cells += [f"> {LIMIT:g} s", "-"]
                continue
            if done.returncode:
                cells += ["refused", "-"]
                continue
            seconds, operations = json.loads(done.stdout.splitlines()[-1])
            cells += [f"{seconds:.3g} s", f"{operations:,}"]
        yield way, *cells


if __name__ == "__main__":
    way, joints = sys.argv[1:]
    robot, start = start_of_iiwa(int(joints)), perf_counter()
    operations = WAYS[way](robot)
    print(json.dumps([perf_counter() - start, operations]))
