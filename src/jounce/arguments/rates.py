"""Convert the state that a caller gives, q, qd, q2d, ... or q, qd, Q, Qd, ..., to checked arrays.

`convert_rates` is the door. It takes arrays and entries by joint name, and wants every rate up to the last one given.
Of balls, planar and free joints a position by name is the numbers of its kind, a rotation matrix or a pose, and a
velocity is one vector. The layout of a whole floating robot, its base first, is separated into the motion of the base
and the state of the joints behind it (`separate_base`).

Closed robots take the independent coordinates, or all of the tree, which determine the branch (`split_rates`). Their
computations take the dependent coordinates as a last array, for which loops are closed here (`dependent_arrays`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import NoneType
from typing import Any

import numpy as np

from jounce.arguments import names
from jounce.arguments.poses import POSE_TOLERANCE, check_pose
from jounce.core import named_entries, scalars
from jounce.core.errors import JounceError, join_names, locate_errors, quote_value
from jounce.core.scalars import FLOAT, Array, array_of_shape, asarray, is_numeric
from jounce.dynamics import loop_assembly, loop_closure
from jounce.dynamics.loop_assembly import NewtonStep
from jounce.dynamics.loops import closure_of
from jounce.dynamics.quantities import Quantity
from jounce.model import positions
from jounce.model.elasticity import motor_names
from jounce.model.loops import all_coordinates
from jounce.model.mechanism import Mechanism, cast_model
from jounce.model.positions import Position
from jounce.spatial import groups
from jounce.spatial.lie import pose

MAX_ORDER = 100  # rates: computing more takes minutes, and no data have the digits for them


def check_order(order: object, highest: int = MAX_ORDER) -> int:
    """Return a caller's order, checked."""
    if not isinstance(order, int | np.integer) or isinstance(order, bool) or not 0 <= order <= highest:
        raise JounceError(f"order is {quote_value(order)}; expected 0 to {highest}")
    return int(order)


def find_rates(given: object) -> tuple[Any, ...] | None:
    """Return (value, rate, ...) if a caller gives such a tuple; None for one array or a tuple of scalars.

    Nested lists are one array.
    """
    return given if isinstance(given, tuple) and not (given and all(map(scalars.is_scalar, given))) else None


def trim_rates(mechanism: Mechanism, given: Sequence[Any], row: Quantity, more: int = 0) -> list[Any]:
    """Return what a caller gives of q, qd, ..., Q, Qd, ..., without None at the end: no less than a quantity takes.

    Its row takes `more` rates for springs and motors of the robot than that of other robots.

    Raises
    ------
    JounceError : if rates are too few or too many, or one is skipped.
    """
    terms, least = list(given), row.takes.rates
    while len(terms) > least - more and terms[-1] is None:
        terms.pop()
    labels = row.takes.names(len(terms))
    if len(terms) > least + MAX_ORDER:
        came = f"{labels[-1]} is given, for order {len(terms) - least}"
        raise JounceError(f"{came}; expected rates for order 0 to {MAX_ORDER}")
    if len(terms) < least:
        have = [label for label, term in zip(labels, terms, strict=True) if term is not None] or labels
        takes = f"the springs and motors of {mechanism.name!r} take {row.takes.names(least)[-1]} too"
        raise JounceError(f"{have[-1]} is the last rate given; {takes}")
    if NoneType in map(type, terms):
        k = next(k for k, term in enumerate(terms) if term is None)
        after = [label for label, term in zip(labels[k:], terms[k:], strict=True) if term is not None]
        skipped = f", yet {after[0]} is given" if after else ""
        raise JounceError(f"{labels[k]} is None{skipped}; expected every rate up to the last")
    return terms


def convert_rates(mechanism: Mechanism, given: Sequence[Any], row: Quantity, more: int = 0) -> list[Array]:
    """Return what a quantity takes of a caller's q, qd, ..., Q, Qd, ... as arrays, see `trim_rates`."""
    terms = trim_rates(mechanism, given, row, more)
    labels, own = row.takes.names(len(terms)), row.takes.coordinates(len(terms))
    e = mechanism.elasticity if row.takes.motors else None
    others = replace(mechanism, coordinates=motor_names(e, mechanism.coordinates)) if e and e.pairs else mechanism
    q = [convert_position(mechanism, term) for term in terms[: min(own, 1)]]
    q += [convert_coordinates(mechanism, *both, mechanism.n) for both in zip(terms[1:own], labels[1:], strict=False)]
    return q + [convert_coordinates(others, *both, others.nv) for both in zip(terms[own:], labels[own:], strict=True)]


def is_unbatched(q: Sequence[Array]) -> bool:
    """Return whether the coordinates and their rates are one state without batch axes."""
    return all(term.ndim == 1 for term in q)


def convert_position(mechanism: Mechanism, term: Any) -> Array:
    """Return the numbers of q, (..., nq), from an array or by joint name."""
    if not positions.multiscrew_joints(mechanism):
        return convert_coordinates(mechanism, term, "q", mechanism.n)
    joints = positions.names(mechanism)
    if named_entries.entry_names(term) is not None:
        with locate_errors("q"):
            numbers = _stack_coordinates(numbers_by_name(mechanism, term), mechanism, joints)
        return check_positions(mechanism, numbers)
    array = asarray(term, "q")
    meant = "" if array.shape[-1:] != (mechanism.n,) else f"; {mechanism.n} are velocities, which q has no numbers of"
    return check_positions(mechanism, array_of_shape(array, (len(joints),), "q", f": {', '.join(joints)}{meant}"))


def convert_coordinates(mechanism: Mechanism, term: Any, label: str, size: int) -> Array:
    """Return coordinates, or a rate of them, (..., n), or forces (..., nv), from an array or by joint name."""
    if type(term) is np.ndarray and term.dtype is FLOAT and term.shape[-1:] == (size,):
        return term  # as most are, and some a thousand times a second
    of_base, joints = size > mechanism.n, mechanism.coordinates
    if named_entries.entry_names(term) is not None and not of_base:
        with locate_errors(label):
            return _stack_coordinates(velocities_by_name(mechanism, term), mechanism, joints)
    array = asarray(term, label)
    if array.shape[-1:] == (size,):
        return array
    cure = "" if of_base else _shape_cure(array.shape, label, mechanism)
    rows = ("moment (3) and force (3) on the base", *joints) if of_base else joints
    return array_of_shape(array, (size,), label, f": {', '.join(rows)}{cure}")


def _shape_cure(shape: tuple[int, ...], label: str, mechanism: Mechanism) -> str:
    """What makes coordinates of a wrong shape fit, as the end of a sentence, or nothing."""
    n, count = mechanism.n, shape[-1] if shape else 0
    if len(shape) > 1 and shape[-2] == n:
        return f"; transpose it: {label}.swapaxes(-1, -2) has the coordinates last"
    if 0 < count < n:
        return f"; {names.LOCK_CURE}"
    if mechanism.closure and label == "q":
        return f"; or all {mechanism.tree.n} of the tree: {join_names(mechanism.tree.coordinates)}"
    followers = [name for name in mechanism.joints if name not in mechanism.coordinates]
    if followers and count == len(mechanism.joints):
        return f"; leave out joints that follow others: {join_names(followers)}"
    return ""


def _stack_coordinates(term: Any, mechanism: Mechanism, joints: Sequence[str]) -> Array:
    """Return an array (..., n) of coordinates (...) given by joint name, broadcast."""
    lacking = len(named_entries.entry_names(term) or ()) < len(joints)
    cure = f"{join_names(joints)}; {names.LOCK_CURE}" if lacking else ""
    return names.stack_entries(term, joints, names.find_followers(mechanism), cure)


MIN_ROTATION_NORM = (
    1e-6  # of a quaternion, or of a cosine and a sine: a shorter one has lost too many digits to be a rotation
)


def numbers_by_name(mechanism: Mechanism, given: Any) -> Any:
    """A position by joint name, with the numbers of joints of several screws one by one under their own names."""
    return _split_joints(mechanism, given, lambda x: x.names, _position_numbers)


def velocities_by_name(mechanism: Mechanism, given: Any) -> Any:
    """A rate of the position by joint name, with the velocities of such joints one by one."""
    return _split_joints(mechanism, given, lambda x: mechanism.coordinates[x.coordinates], _velocity_numbers)


def _split_joints(
    mechanism: Mechanism,
    given: Any,
    names_of: Callable[[Position], Sequence[str]],
    numbers_of: Callable[[Position, Any], Array],
) -> Any:
    joints = {x.name: x for x in positions.multiscrew_joints(mechanism).values()}
    if not joints:
        return given
    found: dict[Any, Any] = {}
    for name, value in named_entries.read_entries(given).items():
        if (joint := joints.get(name)) is None:
            found[name] = value
        else:
            numbers = numbers_of(joint, value)
            found |= {label: numbers[..., k] for k, label in enumerate(names_of(joint))}
    return found


def _position_numbers(joint: Position, value: Any) -> Array:
    """The numbers of a joint, (..., k), from these, from a rotation matrix or from a pose."""
    x, own = asarray(value, repr(joint.name)), joint.group
    if x.shape[-2:] in ((3, 3), (4, 4)):
        C = pose(x, np.zeros((*x.shape[:-2], 3, 1))) if x.shape[-1] == 3 else x
        check_pose(C, f"joint {joint.name!r}")
        numbers = own.numbers(np.asarray(C, dtype=float))
        left = np.abs(own.pose(numbers) - C).max(initial=0.0)
        if left > POSE_TOLERANCE:
            raise JounceError(f"joint {joint.name!r} is a {own.name} joint, which the pose misses by {left:.2g}")
        return numbers
    if x.shape[-1:] != (len(own.positions),):
        expected = f"(..., {len(own.positions)}): {', '.join(own.positions)}; or a pose (..., 4, 4)"
        raise JounceError(f"joint {joint.name!r} has shape {x.shape}; expected {expected}")
    return x


def _velocity_numbers(joint: Position, value: Any) -> Array:
    x, names = asarray(value, repr(joint.name)), joint.group.velocities
    if x.shape[-1:] != (len(names),):
        raise JounceError(f"joint {joint.name!r} has shape {x.shape}; expected (..., {len(names)}): {', '.join(names)}")
    return x


def check_positions(mechanism: Mechanism, q: Array) -> Array:
    """q; raise `JounceError` where a quaternion, or a cosine and a sine, is too short to say a rotation."""
    if not is_numeric(q):
        return q
    for joint in positions.multiscrew_joints(mechanism).values():
        turn = q[..., joint.turn]
        norms = np.sqrt((turn * turn).sum(axis=-1))
        if (norms < MIN_ROTATION_NORM).any():
            what = ", ".join(joint.group.positions[len(joint.group.places) :])
            came = f"q: {what} of joint {joint.name!r} have the length {np.nanmin(norms):.2g}"
            raise JounceError(f"{came}; expected 1, as those of every rotation")
    return q


def separate_base(
    mechanism: Mechanism,
    given: Sequence[Any],
    base: Any,
    row: Quantity,
    pose_of_base: Callable[[Array], Array] = groups.FREE.pose,
) -> tuple[Sequence[Any], tuple[Any, ...] | None]:
    """The state behind the base, and the motion (C, V, ...) of the base, of a whole floating robot's q, v, ...

    A state is whole where q has nq numbers and the motion of the base is not given. `pose_of_base` takes the seven
    numbers with which q begins.
    """
    if not mechanism.floats or base is not None or not given or isinstance(given[0], Mapping):
        return given, base
    whole, of_base = positions.whole_count(mechanism), len(groups.FREE.positions)
    count = row.takes.coordinates(len(given))
    q = asarray(given[0], "q")
    if q.shape[-1:] != (whole,):
        return given, base
    rates = [x if x is None else asarray(x, "a rate of q") for x in given[1:count]]
    for k, x in enumerate(rates, 1):
        if x is not None and x.shape[-1:] != (mechanism.nv,):
            expected = f"({mechanism.nv},), as q has all {whole} numbers"
            raise JounceError(f"rate {k} of q has shape {x.shape}; expected {expected}")
    moved = (pose_of_base(q[..., :of_base]), *(x[..., :6] for x in rates if x is not None))
    return [q[..., of_base:], *(x if x is None else x[..., 6:] for x in rates), *given[count:]], moved


def split_positions(mechanism: Mechanism, q: Any) -> tuple[Any, Any]:
    """The independent coordinates and those (..., N) of the tree that a caller's q contains, or None.

    A q of N entries, or one that names all coordinates of the tree, has the dependent ones too.
    """
    closure, named = closure_of(mechanism), named_entries.entry_names(q)
    if named is None:
        whole = asarray(q, "q")
        if whole.shape[-1:] != (len(closure.coordinates),) or not closure.dependent:
            return q, None
    elif set(closure.coordinates) <= set(named):
        whole = convert_coordinates(mechanism.tree, q, "q", len(closure.coordinates))
    else:
        return q, None
    return whole[..., list(closure.independent)], whole


def split_rates(mechanism: Mechanism, given: Sequence[Any]) -> tuple[Sequence[Any], Any]:
    """The rates of the coordinates, and all coordinates of the tree of a closed robot where q states these."""
    if not mechanism.closure or not given:
        return given, None
    first, whole = split_positions(mechanism, given[0])
    return [first, *given[1:]], whole


def dependent_coordinates(mechanism: Mechanism, u: Array, whole: Array | None, step: NewtonStep | None = None) -> Array:
    """The dependent coordinates (..., N - n), with loops closed: from those given, if any, else from the start.

    Symbols are taken as they are. `step` is one of `loop_closure.close_loops`.
    """
    closure = closure_of(mechanism)
    others = list(closure.dependent)
    if whole is not None and not is_numeric(whole):
        return whole[..., others]
    if whole is None and not closure.solved:
        return closure.ratios.positions(u)
    if whole is None and not is_numeric(u):
        raise JounceError(
            f"q holds {mechanism.n} symbols, or an array of JAX; expected all {len(closure.coordinates)} coordinates of"
            f" the tree, as loops are closed on numbers of NumPy: {join_names(closure.coordinates)}"
        )
    flat = np.asarray(u, dtype=float).reshape(-1, mechanism.n)
    start = None if whole is None else np.asarray(whole, dtype=float).reshape(-1, len(closure.coordinates))
    found = loop_closure.close_loops(mechanism, flat, start, step)[:, others].reshape(*u.shape[:-1], len(others))
    if u.dtype == np.longdouble:  # closed to the precision of q
        model = cast_model(mechanism, [u])
        for _ in range(2):
            found = loop_assembly.newton_step(model, all_coordinates(closure, u, found), 0 * u)[0]
    return found


def dependent_arrays(mechanism: Mechanism, q: Array, whole: Any, step: NewtonStep | None = None) -> list[Array]:
    """The last array of all computations of closed robots: the dependent coordinates."""
    found = [dependent_coordinates(mechanism, q, whole, step)] if mechanism.closure else []  # checks those given
    return found if mechanism.takes_dependent else []
