"""Convert the state that a caller gives to checked arrays.

The state is q, qd, q2d, ... or q, qd, Q, Qd, ...

`convert_rates` is the door. It takes arrays and entries by joint name, and wants every rate up to the last one given.
The position of a ball, planar or free joint by name is the numbers of its kind, a rotation matrix or a pose; its
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


def find_rates(value: object) -> tuple[Any, ...] | None:
    """Return the tuple (value, rate, ...) of a caller, if any.

    Return None for one array; a tuple of scalars and nested lists are one array.
    """
    if not isinstance(value, tuple):
        return None
    is_array = len(value) > 0 and all(map(scalars.is_scalar, value))
    return None if is_array else value


def trim_rates(mechanism: Mechanism, rates: Sequence[Any], row: Quantity, more: int = 0) -> list[Any]:
    """Return q, qd, ..., Q, Qd, ... without None at the end.

    They are no fewer than the quantity takes. Its row takes `more` rates for the springs and motors of the robot than
    for other robots.

    Raises
    ------
    JounceError : if rates are too few or too many, or one is skipped.
    """
    terms, least = list(rates), row.takes.rates
    while len(terms) > least - more and terms[-1] is None:
        terms.pop()
    labels = row.takes.names(len(terms))
    if len(terms) > least + MAX_ORDER:
        came = f"{labels[-1]} is given, for order {len(terms) - least}"
        raise JounceError(f"{came}; expected rates for order 0 to {MAX_ORDER}")
    if len(terms) < least:
        given_labels = [label for label, term in zip(labels, terms, strict=True) if term is not None]
        last_label = given_labels[-1] if len(given_labels) > 0 else labels[-1]
        takes = f"the springs and motors of {mechanism.name!r} take {row.takes.names(least)[-1]} too"
        raise JounceError(f"{last_label} is the last rate given; {takes}")
    # By type, since arrays compare element by element.
    if NoneType in map(type, terms):
        k = next(k for k, term in enumerate(terms) if term is None)
        later_labels = [label for label, term in zip(labels[k:], terms[k:], strict=True) if term is not None]
        skipped = f", yet {later_labels[0]} is given" if len(later_labels) > 0 else ""
        raise JounceError(f"{labels[k]} is None{skipped}; expected every rate up to the last")
    return terms


def convert_rates(mechanism: Mechanism, rates: Sequence[Any], row: Quantity, more: int = 0) -> list[Array]:
    """Return the arrays q, ..., Q, ... that a quantity takes.

    For their number see `trim_rates`.
    """
    terms = trim_rates(mechanism, rates, row, more)
    # First come q and its rates, `count` terms; then forces, at motors where joints have two of them.
    labels, count = row.takes.names(len(terms)), row.takes.coordinates(len(terms))
    arrays = [convert_position(mechanism, term) for term in terms[: min(count, 1)]]
    for term, label in zip(terms[1:count], labels[1:], strict=False):
        arrays.append(convert_coordinates(mechanism, term, label, mechanism.n))
    e = mechanism.elasticity if row.takes.motors else None
    driven = mechanism
    if e is not None and e.pairs:
        driven = replace(mechanism, coordinates=motor_names(e, mechanism.coordinates))
    for term, label in zip(terms[count:], labels[count:], strict=True):
        arrays.append(convert_coordinates(driven, term, label, driven.nv))
    return arrays


def is_unbatched(q: Sequence[Array]) -> bool:
    """Return whether all terms are one state without batch axes."""
    return all(term.ndim == 1 for term in q)


def convert_position(mechanism: Mechanism, term: Any) -> Array:
    """Return q, (..., nq), from an array or by joint name."""
    if not positions.multiscrew_joints(mechanism):
        return convert_coordinates(mechanism, term, "q", mechanism.n)
    joints = positions.names(mechanism)
    if named_entries.entry_names(term) is not None:
        with locate_errors("q"):
            numbers = _stack_coordinates(numbers_by_name(mechanism, term), mechanism, joints)
        return check_positions(mechanism, numbers)
    array = asarray(term, "q")
    cure = "" if array.shape[-1:] != (mechanism.n,) else f"; {mechanism.n} are velocities, which q has no numbers of"
    return check_positions(mechanism, array_of_shape(array, (len(joints),), "q", f": {', '.join(joints)}{cure}"))


def convert_coordinates(mechanism: Mechanism, term: Any, label: str, size: int) -> Array:
    """Return coordinates, their rates or forces from an array or by name.

    Coordinates and rates are (..., n), forces (..., nv), as `size` says.
    """
    # Most calls give such arrays, some a thousand times a second.
    if type(term) is np.ndarray and term.dtype is FLOAT and term.shape[-1:] == (size,):
        return term
    # Forces of a robot that floats begin with the wrench on its base, which has no joint's name.
    has_base, joints = size > mechanism.n, mechanism.coordinates
    if named_entries.entry_names(term) is not None and not has_base:
        with locate_errors(label):
            return _stack_coordinates(velocities_by_name(mechanism, term), mechanism, joints)
    array = asarray(term, label)
    if array.shape[-1:] == (size,):
        return array
    cure = "" if has_base else _shape_cure(array.shape, label, mechanism)
    rows = ("moment (3) and force (3) on the base", *joints) if has_base else joints
    return array_of_shape(array, (size,), label, f": {', '.join(rows)}{cure}")


def _shape_cure(shape: tuple[int, ...], label: str, mechanism: Mechanism) -> str:
    """Return the cure for coordinates of a wrong shape, or "".

    It is the end of a sentence.
    """
    n, count = mechanism.n, shape[-1] if len(shape) > 0 else 0
    if len(shape) > 1 and shape[-2] == n:
        return f"; transpose it: {label}.swapaxes(-1, -2) has the coordinates last"
    if 0 < count < n:
        return f"; {names.LOCK_CURE}"
    if mechanism.closure is not None and label == "q":
        return f"; or all {mechanism.tree.n} of the tree: {join_names(mechanism.tree.coordinates)}"
    followers = [name for name in mechanism.joints if name not in mechanism.coordinates]
    if len(followers) > 0 and count == len(mechanism.joints):
        return f"; leave out joints that follow others: {join_names(followers)}"
    return ""


def _stack_coordinates(term: Any, mechanism: Mechanism, joints: Sequence[str]) -> Array:
    """Return an array (..., n) of coordinates (...) by joint name.

    They are broadcast.
    """
    given_names = named_entries.entry_names(term)
    given_count = 0 if given_names is None else len(given_names)
    expected = f"{join_names(joints)}; {names.LOCK_CURE}" if given_count < len(joints) else ""
    return names.stack_entries(term, joints, names.find_followers(mechanism), expected)


# Of a quaternion, or of a cosine and a sine: a shorter one has lost too many digits to be a rotation.
MIN_ROTATION_NORM = 1e-6


def numbers_by_name(mechanism: Mechanism, position: Any) -> Any:
    """Return a position by joint name, one number under each name.

    A joint of several screws, given as a whole, is split into its numbers under their own names.
    """
    return _split_joints(mechanism, position, lambda x: x.names, _position_numbers)


def velocities_by_name(mechanism: Mechanism, velocity: Any) -> Any:
    """Return a rate of the position by joint name, one number each.

    A joint of several screws, given as a whole, is split into its velocities.
    """
    return _split_joints(mechanism, velocity, lambda x: mechanism.coordinates[x.coordinates], _velocity_numbers)


def _split_joints(
    mechanism: Mechanism,
    values: Any,
    names_of: Callable[[Position], Sequence[str]],
    numbers_of: Callable[[Position, Any], Array],
) -> Any:
    """Return entries by name, with joints of several screws split into numbers."""
    joints = {x.name: x for x in positions.multiscrew_joints(mechanism).values()}
    if len(joints) == 0:
        return values
    entries: dict[Any, Any] = {}
    for name, value in named_entries.read_entries(values).items():
        joint = joints.get(name)
        if joint is None:
            entries[name] = value
        else:
            # (..., k) of the joint -> k entries (...).
            numbers = numbers_of(joint, value)
            entries |= {label: numbers[..., k] for k, label in enumerate(names_of(joint))}
    return entries


def _position_numbers(joint: Position, value: Any) -> Array:
    """Return the numbers (..., k) of a joint.

    The value is these numbers, a rotation matrix (..., 3, 3) or a pose (..., 4, 4).
    """
    x, group = asarray(value, repr(joint.name)), joint.group
    if x.shape[-2:] in ((3, 3), (4, 4)):
        C = pose(x, np.zeros((*x.shape[:-2], 3, 1))) if x.shape[-1] == 3 else x
        check_pose(C, f"joint {joint.name!r}")
        # The joint may not reach the pose: a ball has no displacement, for example.
        numbers = group.numbers(np.asarray(C, dtype=float))
        error = np.abs(group.pose(numbers) - C).max(initial=0.0)
        if error > POSE_TOLERANCE:
            raise JounceError(f"joint {joint.name!r} is a {group.name} joint, which the pose misses by {error:.2g}")
        return numbers
    if x.shape[-1:] != (len(group.positions),):
        expected = f"(..., {len(group.positions)}): {', '.join(group.positions)}; or a pose (..., 4, 4)"
        raise JounceError(f"joint {joint.name!r} has shape {x.shape}; expected {expected}")
    return x


def _velocity_numbers(joint: Position, value: Any) -> Array:
    """Return the velocities (..., k) of a joint."""
    x, labels = asarray(value, repr(joint.name)), joint.group.velocities
    if x.shape[-1:] != (len(labels),):
        raise JounceError(
            f"joint {joint.name!r} has shape {x.shape}; expected (..., {len(labels)}): {', '.join(labels)}"
        )
    return x


def check_positions(mechanism: Mechanism, q: Array) -> Array:
    """Return q, checked.

    Raises `JounceError` where a quaternion, or a cosine and a sine, is too short to state a rotation.
    """
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
    state: Sequence[Any],
    base: Any,
    row: Quantity,
    pose_of_base: Callable[[Array], Array] = groups.FREE.pose,
) -> tuple[Sequence[Any], tuple[Any, ...] | None]:
    """Return the state of the joints, and the motion of the base.

    The motion is (C, V, ...), or what is given. They are separated where q, v, ... are of a whole floating robot: q has
    nq numbers, and the motion of the base is not given. `pose_of_base` takes the seven numbers with which q begins.

    """
    if not mechanism.floats or base is not None or len(state) == 0 or isinstance(state[0], Mapping):
        return state, base
    whole, base_count = positions.whole_count(mechanism), len(groups.FREE.positions)
    count = row.takes.coordinates(len(state))
    q = asarray(state[0], "q")
    if q.shape[-1:] != (whole,):
        return state, base
    # Forces behind the rates of q stay as they are: Q of a robot that floats has its base already.
    rates = [x if x is None else asarray(x, "a rate of q") for x in state[1:count]]
    for k, x in enumerate(rates, 1):
        if x is not None and x.shape[-1:] != (mechanism.nv,):
            expected = f"({mechanism.nv},), as q has all {whole} numbers"
            raise JounceError(f"rate {k} of q has shape {x.shape}; expected {expected}")
    # q (..., 7 + m) -> C (..., 4, 4) and (..., m); a rate (..., 6 + n) -> V (..., 6) and (..., n).
    base_motion = (pose_of_base(q[..., :base_count]), *(x[..., :6] for x in rates if x is not None))
    joint_rates = [x if x is None else x[..., 6:] for x in rates]
    return [q[..., base_count:], *joint_rates, *state[count:]], base_motion


def split_positions(mechanism: Mechanism, q: Any) -> tuple[Any, Any]:
    """Return the independent coordinates, and all of the tree.

    All are (..., N), or None: a q of N entries, or one that names all coordinates of the tree, has the dependent ones
    too.
    """
    closure, given_names = closure_of(mechanism), named_entries.entry_names(q)
    if given_names is None:
        whole = asarray(q, "q")
        if whole.shape[-1:] != (len(closure.coordinates),) or len(closure.dependent) == 0:
            return q, None
    elif set(closure.coordinates) <= set(given_names):
        whole = convert_coordinates(mechanism.tree, q, "q", len(closure.coordinates))
    else:
        return q, None
    return whole[..., list(closure.independent)], whole


def split_rates(mechanism: Mechanism, rates: Sequence[Any]) -> tuple[Sequence[Any], Any]:
    """Return the rates of the coordinates, and all coordinates of a tree.

    Those of the tree are of a closed robot whose q states them; otherwise they are None.
    """
    if mechanism.closure is None or len(rates) == 0:
        return rates, None
    first, whole = split_positions(mechanism, rates[0])
    return [first, *rates[1:]], whole


def dependent_coordinates(mechanism: Mechanism, u: Array, whole: Array | None, step: NewtonStep | None = None) -> Array:
    """Return the dependent coordinates (..., N - n), with loops closed.

    Newton's method begins at those that `whole` has, or at the start of the closure. Symbols are taken as they are.
    `step` is one of `loop_closure.close_loops`.
    """
    closure = closure_of(mechanism)
    dependent = list(closure.dependent)
    if whole is not None and not is_numeric(whole):
        return whole[..., dependent]
    # Without constraints to solve the followers are linear in u: symbols and arrays of JAX pass, too.
    if whole is None and not closure.solved:
        return closure.ratios.positions(u)
    if whole is None and not is_numeric(u):
        raise JounceError(
            f"q holds {mechanism.n} symbols, or an array of JAX; expected all {len(closure.coordinates)} coordinates of"
            f" the tree, as loops are closed on numbers of NumPy: {join_names(closure.coordinates)}"
        )
    # Loops are closed for all states at once: (..., n) -> (k, n), and back.
    flat = np.asarray(u, dtype=float).reshape(-1, mechanism.n)
    start = None if whole is None else np.asarray(whole, dtype=float).reshape(-1, len(closure.coordinates))
    closed = loop_closure.close_loops(mechanism, flat, start, step)
    d = closed[:, dependent].reshape(*u.shape[:-1], len(dependent))
    # From the precision of doubles two steps of Newton's method reach that of extended numbers.
    if u.dtype == np.longdouble:
        model = cast_model(mechanism, [u])
        for _ in range(2):
            d = loop_assembly.newton_step(model, all_coordinates(closure, u, d), 0 * u)[0]
    return d


def dependent_arrays(mechanism: Mechanism, q: Array, whole: Any, step: NewtonStep | None = None) -> list[Array]:
    """Return the last arrays of a computation: dependent coordinates, if any."""
    if mechanism.closure is None:
        return []
    # Coordinates that a caller gives are checked, also where no computation takes them.
    d = dependent_coordinates(mechanism, q, whole, step)
    return [d] if mechanism.takes_dependent else []
