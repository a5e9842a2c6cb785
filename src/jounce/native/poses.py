"""Poses of a base as native code: NumPy would take longer for them than kernels take for the forces."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jounce.arguments.poses import POSE_TOLERANCE, pose_residuals
from jounce.core.scalars import FLOAT, Array
from jounce.dynamics.computation import Port, Signature
from jounce.native import cache as kept
from jounce.native import jit
from jounce.native.jit import host
from jounce.spatial.groups import FREE

Law = Callable[[Array], Sequence[Any]]  # from a traced array to the scalars of the results

_POSE, _NUMBERS = Port("C", (4, 4), "base"), Port("p", (len(FREE.positions),), "base")
_CHECK = Signature((_POSE,), (Port("miss", (), "result"),))
_PLACEMENT = Signature((_NUMBERS,), (Port("C", (4, 4), "result"),))


def are_poses(C: np.ndarray) -> bool:
    """Whether all matrices (..., 4, 4) are within bounds for certain; False also of NaN, and of what is on the verge.

    It compares sums of squares, whose root is at least the largest part, which `check_pose` compares.
    """
    if C.dtype != FLOAT or C.shape[-2:] != _POSE.shape:
        return False
    missed = _function("poses", _CHECK, _sum_of_squares)[0](C)
    return bool((missed <= POSE_TOLERANCE**2).all())


def pose_of_numbers(p: Array) -> Array:
    """`FREE.pose`: the pose (..., 4, 4) of place and quaternion (..., 7)."""
    if type(p) is not np.ndarray or p.dtype != FLOAT:
        return FREE.pose(p)
    return _function("pose of numbers", _PLACEMENT, lambda x: FREE.pose(x).ravel())[0](p)


def _sum_of_squares(C: Array) -> list[Any]:
    return [sum(x * x for part in pose_residuals(C) for x in np.ravel(part))]


_made: dict[str, tuple[Callable[..., Any], Any]] = {}


def _function(name: str, signature: Signature, law: Law) -> tuple[Callable[..., Any], Any]:
    """The ufunc of a law of one array, and what must live as long as it does; made once."""
    if name not in _made:
        target = host()
        code = jit.load_object(
            kept.read_or_make(kept.code_key(name, target), lambda: _object_code(signature, law)), target
        )
        made, needed = jit.make_ufunc(code.address("states"), signature, name.replace(" ", "_"), None)
        _made[name] = made, (code, needed)
    return _made[name]


def _object_code(signature: Signature, law: Law) -> bytes:
    from jounce.native import calls, straight  # imported here, as a warm cache needs none of it
    from jounce.program.passes import factor, fuse
    from jounce.program.trace import Tape

    tape, target = Tape(), host()
    results = law(tape.variables(*signature.inputs[0].shape))
    block = straight.straight_block(fuse(factor(tape.program(results))), signature, target)
    return jit.assemble(calls.write_modules(block, signature, target), target)
