"""Section 2 of the paper, written once over time series.

Sections 3 and 4, and any higher order, follow by Leibniz. The system matrices are dense, 6nb rows: the form to read and
to prove with. `recursion` is the form to compute with. A is the spatial operator of A. Jain, Robot and Multibody
Dynamics, 2011; Leibniz' rule for any order is in S. Kumar, A. Müller, ICRA 2021.
"""

from dataclasses import dataclass, replace
from types import EllipsisType

import numpy as np

from jounce.core.scalars import Array, concatenate
from jounce.dynamics import system
from jounce.dynamics.state import BASE_AT_REST, JointMotion, State, add_moving_ground
from jounce.model.mechanism import Mechanism, reciprocal_mass
from jounce.spatial import inertia
from jounce.spatial.lie import ad, wedge
from jounce.spatial.series import Series, from_rate, join_series


@dataclass(frozen=True)
class ClosedForm:
    """The equations of motion along q(t).

    The terms of every series are computed on demand.
    """

    H: Series  # (..., nb, 4, 4) poses of the bodies
    A: Series  # (..., 6nb, 6nb)
    J: Series  # (..., 6nb, nv) system Jacobian
    V: Series  # (..., 6nb, 1) system twist, body-fixed
    b: Series  # (..., 6nb, 6nb)
    UG: Series  # (..., 6nb, 1) acceleration of the ground that replaces gravity, seen from the bodies
    gM: Series  # (..., nv, nv) generalized mass matrix
    gC: Series  # (..., nv, nv) generalized Coriolis matrix of the paper
    gCbar: Series  # (..., nv, nv) the one for which gM' - 2 gCbar is skew
    Qgrav: Series  # (..., nv, 1)
    Qext: Series  # (..., nv, 1), zero without wrenches
    Q: Series  # (..., nv, 1) generalized forces
    bias: Series  # (..., nv, 1) those that all accelerations zero require, but for a given one of the ground
    h: Series  # (..., 6, 1) spatial momentum about the inertial origin
    AG: Series  # (..., 6, nv) centroidal momentum matrix
    hG: Series  # (..., 6, 1) spatial momentum about the centre of mass
    c: Series  # (..., 3, 1) centre of mass
    F: Series  # (..., 6, 1) wrench that the ground exerts on the mechanism, about the inertial origin
    p: Series  # (..., nv, 1) generalized momentum
    T: Series  # (..., 1, 1) kinetic energy
    U: Series  # (..., 1, 1) potential energy


def closed_form(m: Mechanism, q: Series, W: Series | None = None, base: JointMotion | None = None) -> ClosedForm:
    """Return the equations of motion for coordinates q and wrenches W.

    q is a column (..., n, 1), W are wrenches on the bodies, (..., 6nb, 1).
    """
    # Velocities are those of a floating base, at rest if it is not given, and of the joints.
    if m.floats or base is None:
        velocities = join_series([(base or BASE_AT_REST).V, q.dot], axis=-2) if m.floats else q.dot
        return _closed_form(m, system.poses(m, q, base), velocities, W)
    # A fixed robot on a ground that moves is carried by a body without inertia, whose rows are removed again. The
    # acceleration of the ground is given, and its forces belong to `bias`.
    on_ground = add_moving_ground(m)
    W = None if W is None else join_series([0 * W.map(lambda W: W[..., :6, :]), W], axis=-2)
    velocities = join_series([base.V, q.dot], axis=-2)
    ground_acceleration = join_series([base.V.dot, 0 * q.dot], axis=-2)
    C0 = system.poses(on_ground, q, base)
    return _remove_base(_closed_form(on_ground, C0, velocities, W, ground_acceleration), m.n)


def evaluate_state(m: Mechanism, x: State) -> ClosedForm:
    """Return the equations of motion of a state."""
    return closed_form(m, x.q, x.W, x.base)


def _closed_form(
    m: Mechanism, C0: Array, qd: Series, W: Series | None, ground_acceleration: Series | None = None
) -> ClosedForm:
    """Return the equations of motion for poses C0 and velocities qd.

    The twist of a moving base belongs to qd. Of the accelerations, `bias` takes that of the ground alone. Where a X is
    not 0, as of a base that floats, J' has more terms than the printed -A a J, and C J with it:
    ``C J = M J' - b^T M J``.
    """
    bodies, g = system.build_system(m), system.system_gravity(m)
    X, M = bodies.X, bodies.M
    # Kinematics: A and U are series from their values and their rates; all else follows by products.
    a = qd.map(lambda v: system.system_a(X, v))  # (a)
    A = from_rate(system.system_A(bodies.carries, C0), lambda A: (Aa := A @ a) - Aa @ A)  # (Adot)
    J = A @ X  # (JbSys)
    V = J @ qd  # (Vsys)
    b = V.map(system.system_b)  # (b)
    U = from_rate(system.system_U(C0), lambda U: -(b @ U))  # (eq_U); the paper's -A a U where the base is at rest
    UG = U @ g
    # Forces: M and C of the system, projected by J^T. C J is computed as one, which is cheaper than C.
    JT, MJ = J.mT, M @ J
    CJ = M @ J.dot - b.mT @ MJ  # (Csys)
    gM = JT @ MJ  # (MC)
    gC = JT @ CJ  # (MC)
    gCbar = JT @ (CJ + M @ (b @ J))  # (Cbar)
    Qgrav = JT @ (M @ UG)  # (25)
    Qext = 0 * Qgrav if W is None else JT @ W  # (Qext)
    forces = gC @ qd + Qgrav + Qext
    Q = gM @ qd.dot + forces  # (EOM1)
    bias = forces if ground_acceleration is None else forces + gM @ ground_acceleration
    # Momentum and base wrench about the inertial origin: U^T adds up wrenches of the bodies there.
    UT = U.mT
    h = UT @ (M @ V)
    F = h.dot + UT @ (M @ UG)  # Newton and Euler: the momentum changes by the ground, by gravity and by loads -W
    F = F if W is None else F + UT @ W
    # Centre of mass, and the momentum shifted to it: h_G = h - (c x l; 0), in both h and its matrix A_G.
    H = from_rate(C0, lambda H: H @ split_bodies(V).map(lambda v: wedge(v[..., 0])))
    c = H.map(lambda H: system.first_moment(bodies.inertias, H) * reciprocal_mass(m))
    AG, to_centre = UT @ (M @ J), c.map(system.shift_to_point)
    hG, AG = h + to_centre @ h, AG + to_centre @ AG
    # Energies: the rate of the potential energy is the power of the forces of gravity.
    p = gM @ qd
    T = qd.mT @ p * 0.5
    power = qd.mT @ Qgrav
    energy = from_rate(system.potential_energy(bodies.inertias, C0, m.gravity), lambda _: power)
    return ClosedForm(
        H=H, A=A, J=J, V=V, b=b, UG=UG, gM=gM, gC=gC, gCbar=gCbar, Qgrav=Qgrav, Qext=Qext, Q=Q, bias=bias,
        h=h, AG=AG, hG=hG, c=c, F=F, p=p, T=T, U=energy,
    )  # fmt: skip


def split_bodies(x: Series) -> Series:
    """Split system rows into those of each body.

    (..., 6nb, k) becomes (..., nb, 6, k).
    """
    return x.map(lambda a: a.reshape((*a.shape[:-2], a.shape[-2] // 6, 6, a.shape[-1])))


def regressor(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """Return Y, (..., nv, 10 nb): the forces J^T (M (V' + U G) - b^T M V) of unit parameters.

    Each body has ten inertias M, one per parameter that is 1.
    """
    x, unit = closed_form(m, q, None, base), inertia.from_parameters(np.eye(10, dtype=int))
    # (..., 6nb, k) -> (..., nb, 1, 6, k), to be multiplied by the ten unit inertias (10, 6, 6).
    V, a, J = (split_bodies(s).map(lambda s: s[..., None, :, :]) for s in (x.V, x.V.dot + x.UG, x.J))
    W = unit @ a - V.map(lambda V: ad(V[..., 0]).mT) @ (unit @ V)  # (..., nb, 10, 6, 1)
    return (J.mT @ W).map(_join_columns)


def momentum_regressor(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """Return Yp, (..., nv, 10 nb): the momenta J^T M V of unit parameters."""
    x, unit = closed_form(m, q, None, base), inertia.from_parameters(np.eye(10, dtype=int))
    V, J = (split_bodies(s).map(lambda s: s[..., None, :, :]) for s in (x.V, x.J))
    return (J.mT @ (unit @ V)).map(_join_columns)


def energy_regressor(mechanism: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """Return YE, (..., 10 nb, 1): the energies 1/2 V . M V - m g . c of unit parameters."""
    x, unit = closed_form(mechanism, q, None, base), inertia.from_parameters(np.eye(10, dtype=int))
    V, H = split_bodies(x.V).map(lambda V: V[..., None, :, :]), x.H.map(lambda H: H[..., None, :3, :])
    m, h, _ = inertia.moments(unit)
    E = V.mT @ (unit @ V) * 0.5 - mechanism.gravity[None, :] @ (H @ concatenate([h, m], axis=-2))  # (..., nb, 10, 1, 1)
    return E.map(lambda E: _join_columns(E).mT)


def _join_columns(Y: Array) -> Array:
    """Join columns of bodies and parameters to one matrix.

    (..., nb, 10, nv, 1) becomes (..., nv, 10 nb).
    """
    *lead, nb, k, nv, _ = Y.shape
    return Y.reshape((*lead, nb * k, nv)).mT


def _remove_base(x: ClosedForm, n: int) -> ClosedForm:
    """Return the equations of a fixed robot without its moving ground.

    What belongs to its bodies and n coordinates is left. The ground is the first body, its six velocities come first.
    What has neither axis stays as it is.
    """
    bodies, joints = slice(6, None), slice(-n, None)
    of_joints, square, of_bodies = (..., joints, slice(None)), (..., joints, joints), (..., bodies, bodies)
    entries: dict[str, tuple[slice | EllipsisType, ...]] = {"gM": square, "gC": square, "gCbar": square}
    entries |= {"Qgrav": of_joints, "Qext": of_joints, "Q": of_joints, "bias": of_joints, "p": of_joints}
    entries |= {"A": of_bodies, "b": of_bodies, "J": (..., bodies, joints), "V": (..., bodies, slice(None))}
    entries |= {"AG": (..., joints), "UG": (..., bodies, slice(None))}
    entries |= {"H": (..., slice(1, None), slice(None), slice(None))}
    return replace(x, **{name: getattr(x, name).map(lambda a, rows=rows: a[rows]) for name, rows in entries.items()})


# The functions of bodies that `kinematics` takes. The twist of a base that floats is part of the mechanism.
def poses(m: Mechanism, q: Series, base: JointMotion, body: int | None) -> Series:
    """Return H of all bodies, or of one or the ground, -1.

    The shape is (..., nb, 4, 4) or (..., 4, 4).
    """
    return _select_body(closed_form(m, q, None, base).H, body, (BASE_AT_REST if m.floats else base).H)


def twists(m: Mechanism, q: Series, base: JointMotion, body: int | None) -> Series:
    """Return V of all bodies, or of one or the ground, -1.

    The shape is (..., nb, 6, 1) or (..., 6, 1).
    """
    return _select_body(split_bodies(closed_form(m, q, None, base).V), body, (BASE_AT_REST if m.floats else base).V)


def jacobians(m: Mechanism, q: Series, base: JointMotion, body: int | None) -> Series:
    """Return J of all bodies, or of one or the ground, -1.

    The shape is (..., nb, 6, nv) or (..., 6, nv).
    """
    still = Series.constant(np.zeros((6, m.nv), dtype=int))
    return _select_body(split_bodies(closed_form(m, q, None, base).J), body, still)


def _select_body(x: Series, body: int | None, ground: Series) -> Series:
    """Return the entries of one body, of all, or of the ground.

    Those of the ground get the batch shape of all.
    """
    if body is None:
        return x
    if body < 0:
        return 0 * x.map(lambda a: a[..., 0, :, :]) + ground
    return x.map(lambda a: a[..., body, :, :])
