"""States and forces of a robot from and to the vectors of other libraries."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jounce.arguments.base import base_of, terms_of
from jounce.arguments.rates import column, rates_of
from jounce.core.errors import JounceError, listed, one_of, quoted
from jounce.core.scalars import is_numeric, shaped
from jounce.dynamics.quantities import QUANTITIES
from jounce.io.models.states import mujoco, pinocchio
from jounce.io.models.states.free_joint import check_unit, motion_from, put_motion, wrench_from, wrench_to
from jounce.io.models.states.layout import Layout, Place, match
from jounce.model.mechanism import Mechanism

LAYOUTS = {"pinocchio": pinocchio.layout, "mujoco": mujoco.layout}  # of a model, by library
APART = 1e-2  # rad or m: how far a joint may be from what it follows; MuJoCo's constraints are soft


@dataclass(frozen=True, eq=False)
class RobotState:
    """A state of a robot, to use as ``robot.inverse_dynamics(*state.rates, base=state.base)``.

    Attributes
    ----------
    q, qd, q2d : (..., n), or None
        Coordinates, velocities and accelerations in the order of `joint_names`; None where they were not given.
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
    theta = {i: _position(terms[0], place, mechanism.joints[i], labels[0]) for i, place in found.joints.items()}
    own = [mechanism.joints.index(name) for name in mechanism.coordinates]
    q = np.stack([theta[i] for i in own], axis=-1)
    for i, place in found.joints.items():
        _check_follower(mechanism, i, place, theta[i], q, labels[0])
    qd, q2d = [*(x[..., [found.joints[i].v for i in own]] for x in terms[1:]), None, None][:2]
    Q = None if tau is None else forces_from(mechanism, layout, tau, terms[0])
    if found.base is None:
        return RobotState(q, qd, q2d, None, Q)
    return RobotState(q, qd, q2d, motion_from(layout, found.base, mechanism.bodies[0], terms, labels[0]), Q)


def state_to(
    mechanism: Mechanism, layout: Layout, given: Sequence[object], base: object, Q: object = None
) -> tuple[np.ndarray, ...]:
    """The vectors q, v, a of a library, as many as rates of q are given, and its forces where Q is given."""
    alone = Q is not None and all(x is None for x in given)
    vectors = () if alone else _motion_to(mechanism, layout, given, base)
    return vectors if Q is None else (*vectors, forces_to(mechanism, layout, Q, terms_of(base)[:1] or None))


def _motion_to(mechanism: Mechanism, layout: Layout, given: Sequence[object], base: object) -> tuple[np.ndarray, ...]:
    """The vectors q, v, a of a library; joints that the robot lacks are at rest."""
    found = match(mechanism, layout)
    rates = [_numbers(x, "q") for x in rates_of(mechanism, given, QUANTITIES["poses"])]
    motion = _base(mechanism, base, len(rates))
    batches = [*(x.shape[:-1] for x in rates), *(x.shape[: -1 if k else -2] for k, x in enumerate(motion))]
    batch = _common(batches)
    out = [np.tile(layout.rest, (*batch, 1)), *(np.zeros((*batch, layout.nv)) for _ in rates[1:])]
    for i, place in found.joints.items():
        theta, *others = (x @ mechanism.G[i] for x in rates)
        angle = theta + mechanism.g[i]
        out[0][..., place.q] = np.cos(angle) if place.turns else angle
        if place.turns:
            out[0][..., place.q + 1] = np.sin(angle)
        for x, rate in zip(out[1:], others, strict=True):
            x[..., place.v] = rate
    if found.base is not None:
        put_motion(layout, found.base, mechanism.bodies[0], motion, out)
    return tuple(out)


def forces_from(mechanism: Mechanism, layout: Layout, tau: object, q: object = None) -> np.ndarray:
    """The forces Q of a robot from those of a library; its q, where they are in world axes."""
    found, x = match(mechanism, layout), _vector(layout, tau, layout.labels[3], layout.nv)
    Q = x[..., [place.v for place in found.joints.values()]] @ mechanism.G[list(found.joints)]
    if found.base is None:
        return np.asarray(Q)
    at = _vector(layout, q, layout.labels[0], layout.nq) if layout.linear_in_world else None
    W = wrench_from(layout, found.base, mechanism.bodies[0], x, at, layout.labels[0])
    batch = _common([W.shape[:-1], Q.shape[:-1]])
    return np.concatenate([np.broadcast_to(part, (*batch, part.shape[-1])) for part in (W, Q)], axis=-1)


def forces_to(mechanism: Mechanism, layout: Layout, Q: object, base: object = None) -> np.ndarray:
    """The forces of a library from those of a robot; the pose of the base, where they are in world axes."""
    found = match(mechanism, layout)
    forces = _numbers(column(mechanism, Q, "Q", mechanism.nv), "Q")
    motion = _base(mechanism, base, 1) if layout.linear_in_world or base is not None else []
    C = motion[0] if motion else None
    batch = _common([forces.shape[:-1], () if C is None else C.shape[:-2]])
    tau = np.zeros((*batch, layout.nv))
    first = mechanism.nv - mechanism.n
    for j, name in enumerate(mechanism.coordinates):
        tau[..., found.joints[mechanism.joints.index(name)].v] = forces[..., first + j]
    if found.base is not None:
        k = found.base.v
        tau[..., k : k + 6] = wrench_to(layout, found.base, mechanism.bodies[0], forces[..., :6], C)
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
    expected = q @ mechanism.G[i] + mechanism.g[i]
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
