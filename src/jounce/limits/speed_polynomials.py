"""Limited values as polynomials in the factor of speed c, of q_c(t) = q(c t), at each time of the path.

    Q_c   = S + c V + c^2 D                    S: static (gravity, springs, wrenches), V: viscous, D: inertial
    Qd_c  = c S' + c^2 V' + c^3 D'             ' along the given motion
    Q2d_c = c^2 S'' + c^3 V'' + c^4 D''

Wrenches given over time go with the path: W stays, and its k-th rate is multiplied by c^k. The parts follow from
evaluating the inverse dynamics at c = 0, 1, -1, 2, -2. Positions, velocities and torques of motors behind linear
springs are polynomials of degree 2, 3 and 4, which as many values and one more determine.
"""

from collections.abc import Mapping

import numpy as np
from numpy.polynomial.polynomial import polyval

from jounce.dynamics.quantities import DEFAULT_QUANTITY
from jounce.engine.closed_path import name_errors_by_time
from jounce.engine.motion_states import MotionStates, Side
from jounce.limits.joints import joint_rates, scatter_columns
from jounce.limits.limited_motion import LimitedMotion, compute_at_speed, compute_gravity, required_quantities
from jounce.model.limit_kinds import LIMIT_KINDS, MOTION_KINDS, MOTOR_KINDS

Polynomials = Mapping[str, np.ndarray]  # by kind
Parts = tuple[np.ndarray, np.ndarray, np.ndarray]  # (N, n) each: of c^0, c^1 and c^2


def polynomials(b: LimitedMotion, t: np.ndarray, side: Side = "right") -> Polynomials:
    """Coefficients (degree + 1, N, n) of what limits bound, lowest power of c first, at times (N,) by kind."""
    with name_errors_by_time(t):
        m, orders = b.robot.mechanism, b.needed_orders
        states = b.states(t, orders, b.motion_order, side)
        joints = joint_rates(b.robot, states.rates, states.near, b.follow)
        found = {kind: _monomial(joints[k], k) for k, kind in enumerate(MOTION_KINDS) if kind in b.kinds}
        found |= {kind: _motor_polynomial(b, kind, states) for kind in MOTOR_KINDS if kind in b.kinds}
        if b.efforts.name not in orders:
            return found
        parts = _separate_powers(b, states, orders[b.efforts.name])
        for kind in (kind for kind in b.kinds if LIMIT_KINDS[kind].force):
            k = LIMIT_KINDS[kind].rate
            c = np.pad(np.stack(parts[k]), ((k, 0), (0, 0), (0, 0)))
            if kind in b.limits.without_gravity:
                c[k] -= compute_gravity(b.robot, states, k)[k]
            [c] = scatter_columns(m, [c], b.efforts)
            if kind == "stall_effort":
                c[1] += b.limits.effort_slope * joints[1]
            found[kind] = np.concatenate([0 * c[:1], joints[1] * c]) if kind == "power" else c
        return found


def _monomial(rate: np.ndarray, k: int) -> np.ndarray:
    return np.concatenate([np.zeros((k, *rate.shape)), rate[None]])


def _separate_powers(b: LimitedMotion, states: MotionStates, order: int) -> list[Parts]:
    """S, V, D and their derivatives along the motion up to an order."""

    def at(c: float) -> list[np.ndarray]:
        return compute_at_speed(b.robot, states, b.row(b.efforts.name), order, c)

    static, one, back = at(0.0)[0], at(1.0), at(-1.0)
    two, far_back = (at(2.0), at(-2.0)) if order else ([], [])
    parts: list[Parts] = []
    for k in range(order + 1):
        sign = (-1) ** k  # of the powers of c that S and D have
        V, near = (one[k] - sign * back[k]) / 2, (one[k] + sign * back[k]) / 2
        D = ((two[k] + sign * far_back[k]) / 2 / 2**k - near) / 3 if k else near - static
        parts.append((near - D if k else static, V, D))
    return parts


def _motor_polynomial(b: LimitedMotion, kind: str, states: MotionStates) -> np.ndarray:
    """The polynomial of a motor, from its values at c = 0, 1, -1, 2, -2, ..."""
    orders = required_quantities(b.robot, kind)
    count = max(b.row(name).takes.rates + order for name, order in orders.items())
    c = [(-1) ** (i + 1) * ((i + 1) // 2) for i in range(count)]
    values = []
    for speed in c:
        known = {name: compute_at_speed(b.robot, states, b.row(name), k, float(speed)) for name, k in orders.items()}
        values.append(b.motor_values(kind, known)[LIMIT_KINDS[kind].rate])
    found = np.tensordot(np.linalg.inv(np.vander(c, increasing=True)), np.stack(values), axes=1)
    return scatter_columns(b.robot.mechanism, [found], DEFAULT_QUANTITY)[0]


def positive_roots(f: np.ndarray) -> np.ndarray:
    """The positive roots (M, degree) of polynomials f (degree + 1, M), lowest power first, f[0] < 0; then inf.

    They are the inverses of eigenvalues of companion matrices, and one step of Newton's method.
    """
    degree, count = len(f) - 1, f.shape[1]
    companion = np.zeros((count, degree, degree))
    companion[:, 0, :] = -(f[1:] / f[0]).T
    companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1
    z = np.linalg.eigvals(companion)
    with np.errstate(all="ignore"):
        real = (np.abs(z.imag) <= 1e-9 * np.abs(z)) & (z.real > 0)
        c = np.where(real, 1 / z.real, np.inf)
        slopes = f[1:] * np.arange(1, degree + 1)[:, None]
        value, slope = (polyval(c, x[..., None], tensor=False) for x in (f, slopes))
        step = value / slope
        c = np.where(np.isfinite(step) & (np.abs(step) < 1e-6 * c), c - step, c)
    return np.sort(c, axis=1)
