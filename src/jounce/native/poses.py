"""Poses of a base as native code: NumPy would take longer for them than kernels take for the forces."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jounce.arguments.poses import POSE_TOLERANCE, pose_residuals
from jounce.core.scalars import FLOAT, Array
from jounce.dynamics.computation import Port, Signature, number_scalars
from jounce.native import cache as kept
from jounce.native import jit
from jounce.native.jit import host
from jounce.spatial.groups import FREE

Law = Callable[[Array], Sequence[Any]]  # from a traced array to the scalars of the results
MAX_MISSED = POSE_TOLERANCE**2
Missed = Any  # how far matrices are from poses: sums of squares (...), whose root is at least the largest part

_POSE, _NUMBERS = Port("C", (4, 4), "base"), Port("p", (len(FREE.positions),), "base")
_MISSED = Port("missed", (), "result")
_CHECK = Signature((_POSE,), (_MISSED,))
_PLACEMENT = Signature((_NUMBERS,), number_scalars((Port("C", (4, 4), "result"), _MISSED)))


def are_poses(C: np.ndarray) -> bool:
    """Whether all matrices (..., 4, 4) are poses for certain; False also of NaN, and of what is on the verge."""
    if C.dtype is not FLOAT and C.dtype != FLOAT:  # unpickled, it is another object
        return False
    if C.shape != (4, 4) and C.shape[-2:] != (4, 4):
        return False
    check = _made.get("poses") or _make_ufunc("poses", _CHECK, _sum_of_squares)
    return is_within_tolerance(check(C))


def is_within_tolerance(missed: Missed) -> bool:
    """Whether all matrices are poses to the tolerance of `check_pose`, which compares the largest part."""
    if type(missed) is np.ndarray:
        return bool((missed <= MAX_MISSED).all())
    return float(missed) <= MAX_MISSED  # of one pose: NumPy compares its scalars slowly


def place_base(p: np.ndarray) -> tuple[np.ndarray, Missed]:
    """The pose (..., 4, 4) of place and quaternion (..., 7), `FREE.pose`, and how far it is from one."""
    place = _made.get("placement") or _make_ufunc("placement", _PLACEMENT, _placement)
    found: tuple[np.ndarray, Missed] = place(p)
    return found


def pose_of_numbers(p: Array) -> Array:
    """`FREE.pose`, to the last bit that of `place_base` for arrays of float64."""
    if type(p) is np.ndarray and p.dtype == FLOAT:
        return place_base(p)[0]
    return FREE.pose(p)


def _sum_of_squares(C: Array) -> list[Any]:
    return [sum(x * x for part in pose_residuals(C) for x in np.ravel(part))]


def _placement(p: Array) -> list[Any]:
    C = FREE.pose(p)
    return [*C.ravel(), *_sum_of_squares(C)]


_made: dict[str, Callable[..., Any]] = {}
_alive: list[Any] = []  # what the ufuncs need


def _make_ufunc(name: str, signature: Signature, law: Law) -> Callable[..., Any]:
    """The ufunc of a law of one array, which is kept."""
    target = host()
    key = kept.code_key(name, target)
    code = jit.load_object(kept.read_or_make(key, lambda: _object_code(signature, law)), target)
    _made[name], needed = jit.make_ufunc(code.address("states"), signature, name, None)
    _alive.append((code, needed))
    return _made[name]


def _object_code(signature: Signature, law: Law) -> bytes:
    from jounce.native import calls, straight  # imported here, as a warm cache needs none of it
    from jounce.program.passes import factor, fuse
    from jounce.program.program import Tape

    tape, target = Tape(), host()
    results = law(tape.variables(*signature.inputs[0].shape))
    block = straight.straight_block(fuse(factor(tape.program(results))), signature, target)
    return jit.assemble(calls.write_modules(block, signature, target), target)
