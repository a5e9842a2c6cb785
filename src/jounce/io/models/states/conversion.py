"""States and forces of a robot from and to the vectors of other libraries."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jounce.arguments.base import base_of, terms_of
from jounce.arguments.rates import column, position, rates_of
from jounce.core.errors import JounceError, listed, one_of, quoted
from jounce.core.scalars import is_numeric, shaped
from jounce.dynamics.quantities import QUANTITIES
from jounce.io.models.states import mujoco, pinocchio
from jounce.io.models.states.free_joint import check_unit, motion_from, put_motion, turned
from jounce.io.models.states.layout import FreeJoint, Layout, Place, match
from jounce.model.mechanism import Mechanism
from jounce.model.positions import position_count, single_positions
from jounce.spatial.lie import Ad, inverse

LAYOUTS = {"pinocchio": pinocchio.layout, "mujoco": mujoco.layout}  # of a model, by library
APART = 1e-2  # rad or m: how far a joint may be from what it follows; MuJoCo's constraints are soft


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


def layout_of(library: str, model: Any) -> Layout:
    """Where a model of a library, by its name, has its joints."""
    return LAYOUTS[one_of("library", library, LAYOUTS)](model)


def state_from(mechanism: Mechanism, layout: Layout, given: Sequence[object], tau: object = None) -> RobotState:
    """The state of a robot from q, v, a of a library, and its forces where tau is given."""
    found, labels = match(mechanism, layout), layout.labels
    count = max(k for k, term in enumerate(given) if term is not None or k == 0) + 1
    sizes = (layout.nq, layout.nv, layout.nv)
    terms = [_vector(layout, *item) for item in zip(given[:count], labels[:count], sizes[:count], strict=True)]
    if found.several:
        batch = _common([x.shape[:-1] for x in terms])
        terms = [np.broadcast_to(x, (*batch, x.shape[-1])) for x in terms]
    theta = {i: _position(terms[0], place, mechanism.joints[i], labels[0]) for i, place in found.joints.items()}
    own = {j: mechanism.joints.index(name) for j, name in enumerate(mechanism.coordinates)}
    own = {j: i for j, i in own.items() if i in theta}
    sizes = (position_count(mechanism), mechanism.n, mechanism.n)
    q, *rates = (np.zeros((*x.shape[:-1], n)) for x, n in zip(terms, sizes, strict=False))
    at = single_positions(mechanism).argmax(axis=1)  # where the position of each coordinate of one screw is
    for j, i in own.items():
        q[..., at[j]] = theta[i]
        for x, rate in zip(terms[1:], rates, strict=True):
            rate[..., j] = x[..., found.joints[i].v]
    for i, place in found.joints.items():
        _check_follower(mechanism, i, place, theta[i], q, labels[0])
    for here, joint in found.several:
        q[..., here.numbers], *moved = motion_from(joint, terms, f"{labels[0]} of {quoted(here.name)}")
        for rate, nu in zip(rates, moved, strict=True):
            rate[..., here.coordinates] = nu
    qd, q2d = [*rates, None, None][:2]
    Q = None if tau is None else forces_from(mechanism, layout, tau, terms[0])
    base = None if found.base is None else _base_from(mechanism, found.base, terms, labels[0])
    return RobotState(q, qd, q2d, base, Q)


def _base_from(
    mechanism: Mechanism, joint: FreeJoint, terms: Sequence[np.ndarray], label: str
) -> tuple[np.ndarray, ...]:
    """C, V, Vd of the base, as many as there are of q, v and a."""
    T = joint.moved[mechanism.bodies[0]]
    p, *twists = motion_from(joint, terms, label)
    return joint.ground @ joint.group.pose(p) @ T, *(V @ Ad(inverse(T)).T for V in twists)


def _numbers_of_base(mechanism: Mechanism, joint: FreeJoint, C: np.ndarray) -> np.ndarray:
    """The numbers of the joint that carries the base at a pose C."""
    return joint.group.numbers(inverse(joint.ground) @ C @ inverse(joint.moved[mechanism.bodies[0]]))


def state_to(
    mechanism: Mechanism, layout: Layout, given: Sequence[object], base: object, Q: object = None
) -> tuple[np.ndarray, ...]:
    """The vectors q, v, a of a library, as many as rates of q are given, and its forces where Q is given."""
    alone = Q is not None and all(x is None for x in given)
    vectors = () if alone else _motion_to(mechanism, layout, given, base)
    q = given[0] if given else None
    return vectors if Q is None else (*vectors, forces_to(mechanism, layout, Q, terms_of(base)[:1] or None, q))


def _motion_to(mechanism: Mechanism, layout: Layout, given: Sequence[object], base: object) -> tuple[np.ndarray, ...]:
    """The vectors q, v, a of a library; joints that the robot lacks are at rest."""
    found = match(mechanism, layout)
    rates = [_numbers(x, "q") for x in rates_of(mechanism, given, QUANTITIES["poses"])]
    motion = _base(mechanism, base, len(rates))
    batches = [*(x.shape[:-1] for x in rates), *(x.shape[: -1 if k else -2] for k, x in enumerate(motion))]
    batch = _common(batches)
    out = [np.tile(layout.rest, (*batch, 1)), *(np.zeros((*batch, layout.nv)) for _ in rates[1:])]
    for i, place in found.joints.items():
        angle = rates[0] @ (single_positions(mechanism).T @ mechanism.G[i]) + mechanism.g[i]
        others = [x @ mechanism.G[i] for x in rates[1:]]
        out[0][..., place.q] = np.cos(angle) if place.turns else angle
        if place.turns:
            out[0][..., place.q + 1] = np.sin(angle)
        for x, rate in zip(out[1:], others, strict=True):
            x[..., place.v] = rate
    for here, joint in found.several:
        p = here.group.numbers(here.group.pose(rates[0][..., here.numbers]))
        put_motion(joint, [p, *(rate[..., here.coordinates] for rate in rates[1:])], out)
    if found.base is not None:
        p, T = _numbers_of_base(mechanism, found.base, motion[0]), found.base.moved[mechanism.bodies[0]]
        put_motion(found.base, [p, *(V @ Ad(T).T for V in motion[1:])], out)
    return tuple(out)


def forces_from(mechanism: Mechanism, layout: Layout, tau: object, q: object = None) -> np.ndarray:
    """The forces Q of a robot from those of a library; its q, where they are in world axes."""
    found, x = match(mechanism, layout), _vector(layout, tau, layout.labels[3], layout.nv)
    at = [_vector(layout, q, layout.labels[0], layout.nq)] if found.in_world else None
    Q = x[..., [place.v for place in found.joints.values()]] @ mechanism.G[list(found.joints)]
    Q = np.broadcast_to(Q, (*_common([Q.shape[:-1], at[0].shape[:-1] if at else ()]), mechanism.n)).copy()

    def own(joint: FreeJoint) -> np.ndarray:
        return turned(joint, motion_from(joint, at, layout.labels[0])[0] if at else None, x[..., joint.v], back=True)

    for here, joint in found.several:
        Q[..., here.coordinates] = own(joint)
    if found.base is None:
        return Q
    W = own(found.base) @ Ad(found.base.moved[mechanism.bodies[0]])
    return np.concatenate([np.broadcast_to(W, (*Q.shape[:-1], 6)), Q], axis=-1)


def forces_to(mechanism: Mechanism, layout: Layout, Q: object, base: object = None, q: object = None) -> np.ndarray:
    """The forces of a library from those of a robot; the pose of the base, or q, where they are in world axes."""
    found = match(mechanism, layout)
    forces = _numbers(column(mechanism, Q, "Q", mechanism.nv), "Q")
    free = found.base is not None and found.base.in_world
    motion = _base(mechanism, base, 1) if free or base is not None else []
    at = []
    for here, _ in [(here, joint) for here, joint in found.several if joint.in_world][:1]:
        if q is None:
            raise JounceError(
                f"q is None; expected it, as {layout.what} has forces on {quoted(here.name)} in world axes"
            )
        at = [_numbers(position(mechanism, q), "q")]
    batch = _common([forces.shape[:-1], *(C.shape[:-2] for C in motion), *(p.shape[:-1] for p in at)])
    tau = np.zeros((*batch, layout.nv))
    first = mechanism.nv - mechanism.n
    for name in set(mechanism.coordinates) & {mechanism.joints[i] for i in found.joints}:
        j = mechanism.coordinates.index(name)
        tau[..., found.joints[mechanism.joints.index(name)].v] = forces[..., first + j]
    for x, joint in found.several:
        p = at[0][..., x.numbers] if joint.in_world else None
        tau[..., joint.v] = turned(joint, p, forces[..., first:][..., x.coordinates])
    if found.base is not None:
        W = forces[..., :6] @ Ad(inverse(found.base.moved[mechanism.bodies[0]]))
        p = _numbers_of_base(mechanism, found.base, motion[0]) if motion else None
        tau[..., found.base.v] = turned(found.base, p, W)
    return tau


def _vector(layout: Layout, given: object, label: str, size: int) -> np.ndarray:
    if given is None:
        raise JounceError(f"{label} is None; expected an array (..., {size}) of {layout.what}")
    return _numbers(shaped(given, (size,), label, f", as {layout.what} has it"), label)


def _numbers(x: object, label: str) -> np.ndarray:
    if not is_numeric(x):
        raise JounceError(f"{label} is of type {type(x).__name__} or holds symbols; expected NumPy arrays of numbers")
    return np.asarray(x, dtype=float)


def _position(q: np.ndarray, place: Place, name: str, label: str) -> np.ndarray:
    """The joint variable that stands in q, or of its cosine and sine the angle from -pi to pi."""
    if not place.turns:
        return q[..., place.q]
    x = check_unit(q[..., place.q : place.q + 2], f"{label}: cosine and sine of joint {quoted(name)}")
    return np.arctan2(x[..., 1], x[..., 0])


def _check_follower(mechanism: Mechanism, i: int, place: Place, theta: np.ndarray, q: np.ndarray, label: str) -> None:
    """Raise `JounceError` if a joint is not where those that it follows place it."""
    expected = q @ (single_positions(mechanism).T @ mechanism.G[i]) + mechanism.g[i]
    off = np.abs(theta - expected)
    if place.turns:
        off = np.minimum(off % (2 * np.pi), -off % (2 * np.pi))
    if (off > APART).any():
        at = np.unravel_index(np.nanargmax(off), off.shape)
        leaders = listed(mechanism.coordinates[j] for j in np.flatnonzero(mechanism.G[i]))
        came = f"{label} has joint {quoted(mechanism.joints[i])} at {theta[at]:.6g}"
        raise JounceError(f"{came}; it follows {leaders}, expected {expected[at]:.6g} within {APART:g} rad or m")


def _base(mechanism: Mechanism, base: object, count: int) -> list[np.ndarray]:
    """The motion C, V, Vd of the base, `count` of them; nothing of a robot that does not float."""
    if not mechanism.floats:
        if base is not None:
            raise JounceError(f"base is given, yet {mechanism.name!r} does not float; expected base=None")
        return []
    return [_numbers(x, "base") for x in base_of(mechanism, base, count, "this state")]


def _common(batches: Sequence[tuple[int, ...]]) -> tuple[int, ...]:
    try:
        return np.broadcast_shapes(*batches)
    except ValueError:
        shown = ", ".join(map(str, dict.fromkeys(batches)))
        raise JounceError(f"batch axes {shown} do not broadcast; expected the same, or 1") from None
