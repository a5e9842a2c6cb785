"""A quick check of many poses, as native code: NumPy would take longer for it than kernels for the forces."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from jounce.arguments.poses import POSE_TOLERANCE, pose_residuals
from jounce.dynamics.computation import Port, Signature
from jounce.native import cache as kept
from jounce.native import jit
from jounce.native.jit import Target, host

_SIGNATURE = Signature((Port("C", (4, 4), "base"),), (Port("miss", (), "result"),))


def are_poses(C: Any) -> bool:
    """Whether all matrices (..., 4, 4) are within bounds for certain; False also of NaN, and of what is on the verge.

    It compares sums of squares, whose root is at least the largest part, which `check_pose` compares.
    """
    return bool((_function()[0](C) <= POSE_TOLERANCE**2).all())


def code_address() -> tuple[int, np.ndarray]:
    """The address of the code for the sum of squares, and the strides of the two arrays that it takes, for one pose."""
    strides = [0, 0, *np.empty((4, 4)).strides]
    return int(_function()[1][0].address("states")), np.array(strides, dtype=np.int64)


@cache
def _function() -> tuple[Callable[..., Any], Any]:
    """The ufunc of the sum of squares, and what must live as long as it does."""
    target = host()
    code = jit.load_object(kept.read_or_make(kept.code_key("poses", target), lambda: _object_code(target)), target)
    made, needed = jit.make_ufunc(code.address("states"), _SIGNATURE, "poses", None)
    return made, (code, needed)


def _object_code(target: Target) -> bytes:
    from jounce.native import calls, straight  # imported here, as a warm cache needs none of it
    from jounce.program.passes import factor, fuse
    from jounce.program.trace import Tape

    tape = Tape()
    total = sum(x * x for part in pose_residuals(tape.variables(4, 4)) for x in np.ravel(part))
    program = fuse(factor(tape.program([total])))
    return jit.assemble(
        calls.write_modules(straight.straight_block(program, _SIGNATURE, target), _SIGNATURE, target), target
    )
