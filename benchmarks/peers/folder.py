"""C that is not ours, in a folder that the environment variable JOUNCE_PEERS names, where it names one.

Kernels that CasADi generated from Pinocchio's recursion for the paper's iiwa, Q, Qd, Q2d of the 35 numbers q .. q4d,
and ``run(long states, const double *X, double *Y)`` in loop.c, which calls them.
"""

import ctypes
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.c import library
from benchmarks.peers import Arrays, Call, MissingError, Peer, Prepared
from jounce import Robot
from jounce.native.jit import host


def _built(file: str, *flags: str, lanes: int = 1) -> Callable[[Robot, int], Prepared]:
    def build(robot: Robot, order: int) -> Prepared:
        if host().lanes < lanes:
            raise MissingError(f"this processor has no vectors of {lanes} doubles")
        folder = os.environ.get("JOUNCE_PEERS")
        if not folder:
            raise MissingError("JOUNCE_PEERS names no folder")
        missing = [name for name in (file, "loop.c") if not (Path(folder) / name).is_file()]
        if missing:
            raise MissingError(f"there is no {missing[0]} in the folder that JOUNCE_PEERS names")
        made = library([Path(folder) / file, Path(folder) / "loop.c"], "-ffast-math", *flags)
        pointer = ctypes.POINTER(ctypes.c_double)

        def prepared(rates: Arrays, _: Arrays) -> Call:
            X, Y = np.concatenate(rates, axis=1), np.empty((len(rates[0]), 3 * robot.n))
            places = X.ctypes.data_as(pointer), Y.ctypes.data_as(pointer)
            states, results = ctypes.c_long(len(X)), np.split(Y, 3, axis=1)

            def call() -> Arrays:
                made.run(states, *places)
                return results

            return call

        return prepared

    return build


PEERS = (
    Peer("Pinocchio through CasADi as scalar C, gcc -ffast-math", _built("pinocchio_casadi_iiwa.c"), orders=(2,)),
    Peer(
        "Pinocchio through CasADi as C on 8 lanes, libmvec",
        _built("pinocchio_casadi_iiwa_lanes.c", "-DLANES", "-lmvec", lanes=8),
        orders=(2,),
        batches=(1_000, 100_000),  # whole vectors only
    ),
)
