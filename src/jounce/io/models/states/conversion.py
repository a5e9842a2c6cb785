"""States and forces of a robot from and to the vectors of other libraries."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jounce.arguments.base import convert_base_motion, split_terms
from jounce.arguments.rates import convert_coordinates, convert_position, convert_rates
from jounce.core.errors import JounceError, check_choice, join_names, quote_value
from jounce.core.scalars import array_of_shape, broadcast, common_batch_shape, concatenate, is_numeric
from jounce.dynamics.quantities import QUANTITIES
from jounce.io.models.states.free_joint import check_unit, force_from, force_to, motion_from, put_motion
from jounce.io.models.states.layout import (
    JointPlace,
    ModelLayout,
    match_joints,
    read_mujoco_layout,
    read_pinocchio_layout,
)
from jounce.model.mechanism import Mechanism
from jounce.model.positions import position_count, single_positions
from jounce.spatial.groups import FREE
from jounce.spatial.series import rate_name

LAYOUTS = {"pinocchio": read_pinocchio_layout, "mujoco": read_mujoco_layout}  # of a model, by library
FOLLOWER_TOLERANCE = 1e-2  # rad or m: MuJoCo's constraints are soft, so that a joint leaves what it follows


@dataclass(frozen=True, eq=False)
class RobotState:
    """A state of a robot, to use as ``robot.inverse_dynamics(*state.rates, base=state.base)``.

    Attributes
    ----------
    q, qd, q2d : (..., nq), (..., n), or None
        Coordinates, velocities and accelerations in the order of `joint_names`; None where they were not given. Of
        balls, planar and free joints q has the numbers, qd and q2d the velocities and their rates.
    base : tuple of arrays, or None
        Pose C (..., 4, 4) of the base, its twist V (..., 6), (angular; linear) in its own axes, and the rate Vd of
        these components, as many as there are of q, qd and q2d; None if the robot does not float.
    Q : (..., nv), or None
        Generalized forces, the wrench on the base first if the robot floats; None where they were not given.

    Examples
    --------
    >>> import jounce, pinocchio
    >>> model = pinocchio.buildSampleModelHumanoid()
    >>> robot = jounce.Robot.from_pinocchio(model, base="floating")
    >>> v = a = [0.0] * model.nv
    >>> state = robot.state_from("pinocchio", pinocchio.neutral(model), v, a, model=model)
    >>> Q = robot.inverse_dynamics(*state.rates, base=state.base)
    >>> float(Q[5].round(6)) == round(9.81 * sum(body.mass for body in model.inertias), 6)  # its weight
    True
    """

    q: np.ndarray
    qd: np.ndarray | None
    q2d: np.ndarray | None
    base: tuple[np.ndarray, ...] | None
    Q: np.ndarray | None = None

    @property
    def rates(self) -> tuple[np.ndarray, ...]:
        """Those of q, qd, q2d that were given."""
        return tuple(x for x in (self.q, self.qd, self.q2d) if x is not None)


def read_model_layout(library: str, model: Any) -> ModelLayout:
    """Where a model of a library, by its name, has its joints."""
    return LAYOUTS[check_choice("library", library, LAYOUTS)](model)


def state_from(mechanism: Mechanism, layout: ModelLayout, given: Sequence[object], tau: object = None) -> RobotState:
    """The state of a robot from q, v, a of a library, and its forces where tau is given."""
    found, labels = match_joints(mechanism, layout), layout.labels
    count = max(k for k, term in enumerate(given) if term is not None or k == 0) + 1
    sizes = (layout.nq, layout.nv, layout.nv)
    terms = [_check_vector(layout, *item) for item in zip(given[:count], labels[:count], sizes[:count], strict=True)]
    terms = broadcast(terms, [1] * count, labels[:count])
    batch = terms[0].shape[:-1]
    theta = {i: _joint_variable(terms[0], place, mechanism.joints[i], labels[0]) for i, place in found.joints.items()}
    alone = np.zeros((*batch, mechanism.n))
    q, *rates = (np.zeros((*batch, n)) for n in (found.nq, mechanism.nv, mechanism.nv)[:count])
    at = 7 * mechanism.floats + single_positions(mechanism).argmax(axis=1)
    for j, name in enumerate(mechanism.coordinates, first := mechanism.nv - mechanism.n):
        if name in layout.places:
            i = mechanism.joints.index(name)
            q[..., at[j - first]] = alone[..., j - first] = theta[i]
            for x, rate in zip(terms[1:], rates, strict=True):
                rate[..., j] = x[..., found.joints[i].v]
    for i, place in found.joints.items():
        _check_follower(mechanism, i, place, theta[i], alone, labels[0])
    for joint, own, coordinates in found.several:
        q[..., own], *moved = motion_from(joint, terms, labels[0])
        for rate, nu in zip(rates, moved, strict=True):
            rate[..., coordinates] = nu
    base = (FREE.pose(q[..., :7]), *(x[..., :6] for x in rates)) if mechanism.floats else None
    qd, q2d = [*(x[..., first:] for x in rates), None, None][:2]
    Q = None if tau is None else forces_from(mechanism, layout, tau, terms[0])
    return RobotState(q[..., 7 * mechanism.floats :], qd, q2d, base, Q)


def state_to(
    mechanism: Mechanism, layout: ModelLayout, given: Sequence[object], base: object, Q: object = None
) -> tuple[np.ndarray, ...]:
    """The vectors q, v, a of a library, as many as rates of q are given, and its forces where Q is given."""
    alone = Q is not None and all(x is None for x in given)
    vectors = () if alone else _motion_to(mechanism, layout, given, base)
    q = given[0] if given else None
    return vectors if Q is None else (*vectors, forces_to(mechanism, layout, Q, split_terms(base)[:1] or None, q))


def _motion_to(
    mechanism: Mechanism, layout: ModelLayout, given: Sequence[object], base: object
) -> tuple[np.ndarray, ...]:
    """The vectors q, v, a of a library; joints that the robot lacks are at rest."""
    found = match_joints(mechanism, layout)
    rates = [_check_numbers(x, "q") for x in convert_rates(mechanism, given, QUANTITIES["poses"])]
    motion = _base_motion(mechanism, base, len(rates))
    labels = [*(rate_name("q", k) for k in range(len(rates))), *("C", "V", "Vd")[: len(motion)]]
    batch = common_batch_shape([*rates, *motion], [*(1 for _ in rates), 2, 1, 1][: len(labels)], labels)
    out = [np.tile(layout.rest, (*batch, 1)), *(np.zeros((*batch, layout.nv)) for _ in rates[1:])]
    for i, place in found.joints.items():
        angle = rates[0] @ (single_positions(mechanism).T @ mechanism.G[i]) + mechanism.g[i]
        out[0][..., place.q] = np.cos(angle) if place.turns else angle
        if place.turns:
            out[0][..., place.q + 1] = np.sin(angle)
        for x, rate in zip(out[1:], rates[1:], strict=True):
            x[..., place.v] = rate @ mechanism.G[i]
    whole = _join_base(rates, motion)
    for joint, own, coordinates in found.several:
        put_motion(joint, [whole[0][..., own], *(rate[..., coordinates] for rate in whole[1:])], out)
    return tuple(out)


def _join_base(rates: Sequence[np.ndarray], motion: Sequence[np.ndarray]) -> list[np.ndarray]:
    """q, v, a with those of a base first, if it moves."""
    moved = [FREE.numbers(motion[0]), *motion[1:]] if motion else [x[..., :0] for x in rates]
    return [concatenate(both, axis=-1) for both in zip(moved, rates, strict=False)]


def forces_from(mechanism: Mechanism, layout: ModelLayout, tau: object, q: object = None) -> np.ndarray:
    """The forces Q of a robot from those of a library; its q, where they are in world axes."""
    found, x = match_joints(mechanism, layout), _check_vector(layout, tau, layout.labels[3], layout.nv)
    if found.in_world:
        labels = (layout.labels[0], layout.labels[3])
        at, x = broadcast([_check_vector(layout, q, labels[0], layout.nq), x], [1, 1], labels)
    Q = np.zeros((*x.shape[:-1], mechanism.nv))
    Q[..., mechanism.nv - mechanism.n :] = x[..., [p.v for p in found.joints.values()]] @ mechanism.G[[*found.joints]]
    for joint, _, coordinates in found.several:
        p = motion_from(joint, [at], layout.labels[0])[0] if joint.in_world else None
        Q[..., coordinates] = force_from(joint, p, x)
    return Q


def forces_to(
    mechanism: Mechanism, layout: ModelLayout, Q: object, base: object = None, q: object = None
) -> np.ndarray:
    """The forces of a library from those of a robot; the pose of the base, or q, where they are in world axes."""
    found = match_joints(mechanism, layout)
    forces = _check_numbers(convert_coordinates(mechanism, Q, "Q", mechanism.nv), "Q")
    first = mechanism.nv - mechanism.n
    of_base = mechanism.floats and found.in_world
    motion = _base_motion(mechanism, base, 1) if of_base or base is not None else []
    behind = [joint.name for joint, _, coordinates in found.several if joint.in_world and coordinates.start >= first]
    if behind and q is None:
        raise JounceError(
            f"q is None; expected it, as {layout.what} has forces on {quote_value(behind[0])} in world axes"
        )
    own = _check_numbers(convert_position(mechanism, q), "q") if behind else np.zeros(position_count(mechanism))
    whole, forces = broadcast([_join_base([own], motion)[0], forces], [1, 1], ["q", "Q"])
    tau = np.zeros((*forces.shape[:-1], layout.nv))
    for i, place in found.joints.items():
        if (name := mechanism.joints[i]) in mechanism.coordinates:
            tau[..., place.v] = forces[..., first + mechanism.coordinates.index(name)]
    for joint, numbers, coordinates in found.several:
        tau[..., joint.v] = force_to(joint, whole[..., numbers] if joint.in_world else None, forces[..., coordinates])
    return tau


def _check_vector(layout: ModelLayout, given: object, label: str, size: int) -> np.ndarray:
    if given is None:
        raise JounceError(f"{label} is None; expected an array (..., {size}) of {layout.what}")
    return _check_numbers(array_of_shape(given, (size,), label, f", as {layout.what} has it"), label)


def _check_numbers(x: object, label: str) -> np.ndarray:
    if not is_numeric(x):
        raise JounceError(f"{label} is of type {type(x).__name__} or holds symbols; expected NumPy arrays of numbers")
    return np.asarray(x, dtype=float)


def _joint_variable(q: np.ndarray, place: JointPlace, name: str, label: str) -> np.ndarray:
    """The joint variable that stands in q, or of its cosine and sine the angle from -pi to pi."""
    if not place.turns:
        return q[..., place.q]
    x = check_unit(q[..., place.q : place.q + 2], f"{label}: cosine and sine of joint {quote_value(name)}")
    return np.arctan2(x[..., 1], x[..., 0])


def _check_follower(
    mechanism: Mechanism, i: int, place: JointPlace, theta: np.ndarray, q: np.ndarray, label: str
) -> None:
    """Raise `JounceError` if a joint is not where those that it follows place it."""
    expected = q @ mechanism.G[i] + mechanism.g[i]
    off = np.abs(theta - expected)
    if place.turns:
        off = np.minimum(off % (2 * np.pi), -off % (2 * np.pi))
    if (off > FOLLOWER_TOLERANCE).any():
        at = np.unravel_index(np.nanargmax(off), off.shape)
        leaders = join_names(mechanism.coordinates[j] for j in np.flatnonzero(mechanism.G[i]))
        came = f"{label} has joint {quote_value(mechanism.joints[i])} at {theta[at]:.6g}; it follows {leaders}"
        raise JounceError(f"{came}, expected {expected[at]:.6g} within {FOLLOWER_TOLERANCE:g} rad or m")


def _base_motion(mechanism: Mechanism, base: object, count: int) -> list[np.ndarray]:
    """The motion C, V, Vd of the base, `count` of them; nothing of a robot that does not float."""
    if not mechanism.floats:
        if base is not None:
            raise JounceError(f"base is given, yet {mechanism.name!r} does not float; expected base=None")
        return []
    return [_check_numbers(x, "base") for x in convert_base_motion(mechanism, base, count, "this state")]
