"""Feasible factors of speed follow from roots of polynomials, or trial.

Limited values of q_c(t) = q(c t) are polynomials in the factor of speed c, at each time of the path:

    Q_c   = S + c V + c^2 D                    S: static (gravity, springs, wrenches), V: viscous, D: inertial
    Qd_c  = c S' + c^2 V' + c^3 D'             ' along the given motion
    Q2d_c = c^2 S'' + c^3 V'' + c^4 D''

Wrenches given over time go with the path: W stays, and its k-th rate is multiplied by c^k. The parts follow from
evaluating the inverse dynamics at c = 0, 1, -1, 2, -2. Positions, velocities and torques of motors behind linear
springs are polynomials of degree 2, 3 and 4, which as many values and one more determine. `Feasible` holds the roots of
these polynomials less their bounds: between them lie the intervals of factors at which a state breaks a limit.
`slowdown` adds states to it, until no limit is broken between them.

Coulomb friction is a tanh of a velocity, and bent springs are no polynomials either. There `bracket_factor` evaluates
the motion at factors c: the largest ratio to a limit of the whole motion, peaks between samples included. Factors rise
in steps until one breaks a limit; Brent's method (`scipy.optimize.brentq`) then finds where the ratio is 1, between
this factor and the last one that kept all limits. Limits that are broken only between two factors of the steps are not
noticed.

`JounceError` where a limit is broken at rest already (`refuse_static`), and where no factor down to 3e-11 keeps all.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.polynomial.polynomial import polyval

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError
from jounce.dynamics.quantities import DEFAULT_QUANTITY
from jounce.engine import closed_path
from jounce.engine.motion_states import MotionStates, Side
from jounce.limits.drive_terms import acting_friction, is_nonlinear
from jounce.limits.joints import (
    compute_at_speed,
    compute_gravity,
    has_motors,
    joint_rates,
    power_factors,
    scatter_columns,
)
from jounce.limits.limited_motion import LimitedMotion, required_quantities
from jounce.limits.motion_polynomials import split_motion, split_part, split_windows
from jounce.limits.ratios import SIGNS
from jounce.limits.worst_values import Worst
from jounce.model.limits import LIMIT_KINDS

_ZERO_BOUND_STAND_IN = 1e-300  # in the place of a bound of 0: roots divide by it
_NEAR_MISS_RATIO = 0.98  # to a limit: where samples come as near, values between them may break it
_NEAR_MISS_FACTORS = 128  # even factors of speed, among which the nearest approaches are sought
_FIRST_STATES = 400  # states whose roots bound the factor first, so that few of the others need roots
Polynomials = Mapping[str, np.ndarray]  # by kind


class Feasible:
    """States of a motion, and the factors at which they break limits.

    `start` and `stop` (M,) are open intervals of factors; `kind`, `joint` and `t` (M,) say which limit is broken, and
    when.
    """

    def __init__(self, b: LimitedMotion) -> None:
        self.b = b
        self.start = self.stop = self.t = np.empty(0)
        self.kind = np.empty(0, dtype=str)
        self.joint = np.empty(0, dtype=int)
        self.states: list[Polynomials] = []
        parts = sample_states(b)
        # Some states first: they bound the factors at which the others need roots.
        stride = max(1, sum(len(times) for times, _ in parts) // _FIRST_STATES)
        for is_turn in (np.equal, np.not_equal):
            for times, states in parts:
                rows = is_turn(np.arange(len(times)) % stride, 0)
                self._add_states({kind: c[:, rows] for kind, c in states.items()}, times[rows])

    def add(self, t: np.ndarray) -> None:
        """Add the states at some times, (N,)."""
        for part, (start, stop) in split_windows(self.b):
            inside = t[(start <= t) & (t <= stop)]
            if inside.size > 0:
                states = polynomials(part, inside)
                refuse_static(part, states, inside)
                self._add_states(states, inside)

    def _add_states(self, states: Polynomials, t: np.ndarray) -> None:
        """Add the polynomials of states at times (N,).

        The intervals at which the states break limits are added too.
        """
        self.states.append(states)
        # From this factor on some state breaks a limit: roots beyond it say nothing new.
        highest = float(self.start[np.isinf(self.stop)].min(initial=np.inf))
        for kind, c in states.items():
            # Positions do not depend on the speed.
            if kind == "position":
                continue
            for sign in SIGNS:
                self._add_roots(kind, sign, c, t, highest)

    @property
    def first(self) -> int:
        """Return the place of the interval that begins first."""
        return int(self.start.argmin())

    @property
    def factor(self) -> float:
        """Return the largest factor below which no state breaks a limit.

        It is infinite if none ever does.
        """
        return float(self.start.min(initial=np.inf))

    @property
    def largest(self) -> float:
        """Return the largest factor at which no state breaks a limit."""
        order = np.argsort(self.start)
        start, stop = self.start[order], self.stop[order]
        # The last gap between the intervals ends at the largest factor; beyond it they cover everything.
        covered = np.maximum.accumulate(stop)
        gaps = np.flatnonzero(start[1:] >= covered[:-1])
        return float(start[gaps[-1] + 1] if gaps.size > 0 else start[0])

    def near_misses(self, factor: float) -> np.ndarray:
        """Find the factors at which states come nearest to a limit.

        The factors are below a given one. Beyond a near miss the states recede from the limit again: values between
        samples may break it.
        """
        c = np.linspace(0, factor, _NEAR_MISS_FACTORS + 1)
        near_factors = []
        for kind in self.b.kinds:
            # Rates of q grow with the speed alone, and never recede.
            if LIMIT_KINDS[kind].of == "q":
                continue
            for sign in SIGNS:
                # The largest ratio of all states at each factor, (factors, n).
                scale = self.b.scales[kind]
                highest = np.full((len(c), len(self.b.names(kind))), -np.inf)
                for f in (state[kind] for state in self.states if kind in state):
                    # Only states whose terms may add up to a near miss are evaluated at all factors.
                    most = sum(np.abs(x) * factor**k for k, x in enumerate(f))
                    rows = np.flatnonzero((scale.ratio(sign * most, sign) > _NEAR_MISS_RATIO).any(axis=1))
                    if rows.size > 0:
                        # (factors, rows, n) -> (factors, n)
                        values = sum(x[rows] * c[:, None, None] ** k for k, x in enumerate(f))
                        highest = np.maximum(highest, scale.ratio(values, sign).max(axis=1))
                before, here, after = highest[:-2], highest[1:-1], highest[2:]
                is_peak = (here >= before) & (here > after) & (here > _NEAR_MISS_RATIO)
                near_factors.append(c[1:-1][is_peak.any(axis=1)])
        return np.unique(np.concatenate(near_factors)) if len(near_factors) > 0 else np.empty(0)

    def _add_roots(self, kind: str, sign: int, c: np.ndarray, t: np.ndarray, highest: float) -> None:
        """Add the intervals at which polynomials are beyond their bounds.

        The polynomials c are (degree + 1, N, n), those of one kind; `sign` is the side.
        """
        # f = signed value less its bound is below 0 at rest, and above 0 where the limit is broken.
        bound = self.b.scales[kind].bound(sign)
        finite = np.flatnonzero(np.isfinite(bound))
        f = sign * c[:, :, finite]
        f[0] -= bound[finite]
        # Only polynomials whose terms may add up to the bound below `highest` need roots.
        most = min(highest, 1e9)
        reach = sum(np.abs(x) * most**k for k, x in enumerate(f[1:], start=1))
        i, j = np.nonzero((reach > -f[0]) & (f[1:] != 0).any(axis=0))
        if i.size == 0:
            return
        # (degree + 1, N, n) -> (degree + 1, M); roots divide by f[0], which may be 0 at a bound of 0.
        most_f = np.where(np.arange(len(f)) > 0, np.inf, -_ZERO_BOUND_STAND_IN)[:, None]
        roots = positive_roots(np.minimum(f[:, i, j], most_f))
        # f passes 0 upwards and downwards in turn: intervals begin at the first, third, ... root and end at the others.
        degree = roots.shape[1]
        starts = roots[:, ::2]
        stops = np.concatenate([roots[:, 1::2], np.full((len(roots), degree % 2), np.inf)], axis=1)
        row, column = np.nonzero(np.isfinite(starts))
        self.start = np.append(self.start, starts[row, column])
        self.stop = np.append(self.stop, stops[row, column])
        self.t = np.append(self.t, t[i[row]])
        self.joint = np.append(self.joint, finite[j[row]])
        self.kind = np.append(self.kind, np.full(len(row), kind))


def refuse_static(b: LimitedMotion, states: Polynomials, t: np.ndarray) -> None:
    """Raise where a limit is broken at every speed.

    That is one of a position, or of the effort or a motor at rest, by the polynomials of states at times (N,).
    """
    for kind in b.kinds:
        scale, value = b.scales[kind], states[kind][0]
        for sign in SIGNS:
            beyond = sign * value - scale.tolerant(sign)
            i, j = np.unravel_index(beyond.argmax(), beyond.shape)
            if beyond[i, j] > 0:
                raise _static_error(
                    b, kind, int(j), float(value[i, j]), sign * float(scale.bound(sign)[j]), float(t[i])
                )


def _static_error(b: LimitedMotion, kind: str, j: int, value: float, bound: float, t: float) -> JounceError:
    """Return the error of a limit that a joint breaks at rest."""
    unit = b.unit(kind, j)
    joint, when = b.owner(kind, j), f"at t = {t:.6g} s"
    limit = Remedy(f"with_limits({kind}=...)", "its limit (--limits)")
    if kind == "position":
        limits = Remedy("with_limits(lower=..., upper=...)", "its limits (--limits)")
        return JounceError(
            f"{joint} is at {value:.6g} {unit} {when}, beyond its limit of {bound:.6g} {unit};"
            f" slowing down does not help: change the motion or {limits}"
        )
    if LIMIT_KINDS[kind].is_total:
        return JounceError(
            f"the motors take a {kind.replace('_', ' ')} of {value:.6g} {unit} at rest {when}, beyond the limit of"
            f" {bound:.6g} {unit}; slowing down does not help: change the pose, the load or {limit}"
        )
    if LIMIT_KINDS[kind].takes:
        what = kind.removeprefix("motor_")
        return JounceError(
            f"the motor of {joint} has a {what} of {value:.6g} {unit} at rest {when}, beyond its limit of {bound:.6g}"
            f" {unit}; slowing down does not help: change the pose, the load or {limit}"
        )
    force = " without gravity" if kind in b.limits.without_gravity else ""
    return JounceError(
        f"{joint} cannot hold itself up {when}: it takes {value:.6g} {unit}{force} at rest, and its limit is"
        f" {bound:.6g} {unit}; slowing down does not help: change the pose, the load or {limit}"
    )


def sample_states(b: LimitedMotion) -> list[tuple[np.ndarray, Polynomials]]:
    """Return the times of all pieces with the polynomials there, by window.

    At breaks, and at the end, they are those of the left side too.
    """
    breaks = [motion_break.t for motion_break in b.motion.breaks_to(b.rate_order)]
    states: list[tuple[np.ndarray, Polynomials]] = []
    for part, span in split_windows(b):
        pieces = list(split_part(part, span))
        starts, stops = (np.concatenate([getattr(block, side) for block in pieces]) for side in ("start", "stop"))
        # Each piece has its start; its stop is the next start, but at breaks and at the end.
        left = np.append(stops[np.isin(stops, breaks)], stops[-1])
        times, of_left = np.concatenate([starts, left]), polynomials(part, left, "left")
        of_part = {kind: np.concatenate([c, of_left[kind]], axis=1) for kind, c in polynomials(part, starts).items()}
        refuse_static(part, of_part, times)
        states.append((times, of_part))
    return states


# Limited values as polynomials in the factor of speed.
Parts = tuple[np.ndarray, np.ndarray, np.ndarray]  # (N, n) each: of c^0, c^1 and c^2


def polynomials(b: LimitedMotion, t: np.ndarray, side: Side = "right") -> Polynomials:
    """Return what limits bound as polynomials of the factor.

    The coefficients are (degree + 1, N, n) by kind, lowest power of c first, at times (N,).
    """
    with closed_path.name_errors_by_time(t):
        m, orders = b.robot.mechanism, b.needed_orders
        states = b.states(t, orders, b.motion_order, side)
        joints = joint_rates(b.robot, states.rates, states.near, b.follow)
        # The k-th rate of q is multiplied by c^k.
        by_kind = {kind: _monomial(joints[k], k) for k, kind in enumerate(LIMIT_KINDS.motion) if kind in b.kinds}
        by_kind |= {kind: _motor_polynomial(b, kind, states) for kind in LIMIT_KINDS.motor if kind in b.kinds}
        by_kind |= {kind: _total_polynomial(b, kind, states, joints) for kind in LIMIT_KINDS.totals if kind in b.kinds}
        if b.efforts.name not in orders:
            return by_kind
        # Forces: the k-th rate is c^k times the k-th derivatives of S, V and D along the motion.
        parts = _separate_powers(b, states, orders[b.efforts.name])
        for kind in (kind for kind in b.kinds if LIMIT_KINDS[kind].force):
            k = LIMIT_KINDS[kind].rate
            c = np.pad(np.stack(parts[k]), ((k, 0), (0, 0), (0, 0)))
            # The gravity forces are a part of S.
            if kind in b.limits.without_gravity:
                c[k] -= compute_gravity(b.robot, states, k)[k]
            [c] = scatter_columns(m, [c], b.efforts)
            # The line of an effort that falls with speed, and power, take qd, which is multiplied by c.
            if kind == "stall_effort":
                c[1] += b.limits.effort_slope * joints[1]
            by_kind[kind] = np.concatenate([0 * c[:1], joints[1] * c]) if kind == "power" else c
        return by_kind


def _monomial(rate: np.ndarray, k: int) -> np.ndarray:
    """Return the polynomial of a rate that is multiplied by c^k.

    It is (k + 1, N, n).
    """
    return np.concatenate([np.zeros((k, *rate.shape)), rate[None]])


def _separate_powers(b: LimitedMotion, states: MotionStates, order: int) -> list[Parts]:
    """Return S, V, D and their derivatives up to an order.

    The k-th rate of Q_c is c^k (S + c V + c^2 D), where S, V and D are derived k times along the motion. The rates at c
    = 0, 1, -1, 2 and -2 determine the three parts.
    """

    def rates_at(c: float) -> list[np.ndarray]:
        return compute_at_speed(b.robot, states, b.row(b.efforts.name), order, c)

    static, at_one, at_minus_one = rates_at(0.0)[0], rates_at(1.0), rates_at(-1.0)
    at_two, at_minus_two = (rates_at(2.0), rates_at(-2.0)) if order > 0 else ([], [])
    parts: list[Parts] = []
    for k in range(order + 1):
        # At -c the factor c^k has this sign. V is the odd part in c; the even part at c = 1 is S + D.
        sign = (-1) ** k
        V, even = (at_one[k] - sign * at_minus_one[k]) / 2, (at_one[k] + sign * at_minus_one[k]) / 2
        # S itself is known at rest, where its rates are zero; the even part at c = 2 is 2^k (S + 4 D).
        if k == 0:
            parts.append((static, V, even - static))
        else:
            D = ((at_two[k] + sign * at_minus_two[k]) / 2 / 2**k - even) / 3
            parts.append((even - D, V, D))
    return parts


def _motor_polynomial(b: LimitedMotion, kind: str, states: MotionStates) -> np.ndarray:
    """Return the polynomial of a motor.

    It follows from the values at c = 0, 1, -1, 2, -2, ...
    """
    orders = required_quantities(b.robot, kind)
    # A quantity that takes rates of q up to an order is a polynomial of that degree; one value more determines it.
    count = max(b.row(name).takes.rates + order for name, order in orders.items())
    c = [(-1) ** (i + 1) * ((i + 1) // 2) for i in range(count)]
    values = []
    for speed in c:
        quantities = {
            name: compute_at_speed(b.robot, states, b.row(name), k, float(speed)) for name, k in orders.items()
        }
        values.append(b.motor_values(kind, quantities)[LIMIT_KINDS[kind].rate])
    # Values = Vandermonde matrix times coefficients, which its inverse gives: (count, N, n).
    coefficients = np.tensordot(np.linalg.inv(np.vander(c, increasing=True)), np.stack(values), axes=1)
    return scatter_columns(b.robot.mechanism, [coefficients], DEFAULT_QUANTITY)[0]


def _total_polynomial(b: LimitedMotion, kind: str, states: MotionStates, joints: Sequence[np.ndarray]) -> np.ndarray:
    """Return the polynomial of a sum over all joints.

    It is the sum of the products of the polynomials of both factors, (degree + 1, N, 1).
    """
    first, second = (_factor_polynomial(b, factor, states, joints) for factor in power_factors(b.robot.mechanism, kind))
    total = np.zeros((len(first) + len(second) - 1, first.shape[1], 1))
    for i, x in enumerate(first):
        total[i : i + len(second)] += (x * second).sum(axis=2, keepdims=True)
    return total


def _factor_polynomial(b: LimitedMotion, kind: str, states: MotionStates, joints: Sequence[np.ndarray]) -> np.ndarray:
    """Return the polynomial of a factor of sums, of all joints."""
    if LIMIT_KINDS[kind].of == "q":
        return _monomial(joints[LIMIT_KINDS[kind].rate], LIMIT_KINDS[kind].rate)
    if LIMIT_KINDS[kind].takes:
        return _motor_polynomial(b, kind, states)
    [parts] = _separate_powers(b, states, 0)
    m = b.robot.mechanism
    return has_motors(m) * np.stack(scatter_columns(m, parts, b.efforts))


def positive_roots(f: np.ndarray) -> np.ndarray:
    """Return the positive roots of polynomials (M, degree).

    Roots are in order, then inf. The polynomials f are (degree + 1, M), lowest power first, with f[0] < 0. The roots
    are the inverses of eigenvalues of companion matrices, and one step of Newton's method.
    """
    degree, count = len(f) - 1, f.shape[1]
    # In z = 1 / c the polynomial is f[0] z^degree + f[1] z^(degree - 1) + ..., whose first coefficient is never 0.
    companion = np.zeros((count, degree, degree))
    companion[:, 0, :] = -(f[1:] / f[0]).T
    companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1
    z = np.linalg.eigvals(companion)
    with np.errstate(all="ignore"):
        real = (np.abs(z.imag) <= 1e-9 * np.abs(z)) & (z.real > 0)
        c = np.where(real, 1 / z.real, np.inf)
        # One Newton step removes the rounding of eigenvalues; a large one shows a double root, which it would spoil.
        slopes = f[1:] * np.arange(1, degree + 1)[:, None]
        value, slope = (polyval(c, x[..., None], tensor=False) for x in (f, slopes))
        step = value / slope
        c = np.where(np.isfinite(step) & (np.abs(step) < 1e-6 * c), c - step, c)
    return np.sort(c, axis=1)


# Factors by direct evaluation, where they enter no polynomial.
_SPEED_FACTOR_STEP = 1 / 32  # between the factors that are tried: limits broken only between two of them are missed
_SPEED_FACTOR_GROWTH = 1.05  # from one factor to the next above 1: steps in proportion, a twentieth each
_MAX_SPEED_FACTOR = 1000.0  # times the given speed: no motion is meant to be faster, so that no limit bounds it
_SPEED_FACTOR_TOLERANCE = 1e-13  # relative, close to the rounding of a check
_MAX_SPEED_FACTOR_HALVINGS = 30  # of the first step, to 3e-11: where no slower factor keeps the limits either
Place = tuple[str, int, float]  # of a limit: kind, joint, time in the given motion


def is_polynomial(b: LimitedMotion) -> bool:
    """Whether limited values are polynomials of the factor.

    They are with linear springs, and without friction of links or motors.
    """
    mechanism = b.robot.mechanism
    if b.forces and acting_friction(mechanism) is not None:
        return False
    motors = mechanism.elasticity if b.takes_motors else None
    return motors is None or not (motors.friction.any() or any(map(is_nonlinear, motors.springs)))


def bracket_factor(b: LimitedMotion) -> tuple[float, Place | None]:
    """Find the factor at which a limit is met, and which.

    The factor is infinite where none is met up to a thousand.
    """
    from scipy.optimize import brentq

    # This raises where a limit is broken at every speed.
    sample_states(b)
    # Rise until a limit is broken.
    low, high = 0.0, _SPEED_FACTOR_STEP
    while find_worst_limit(b, high)[0] <= 1:
        low, high = high, high + _SPEED_FACTOR_STEP if high < 1 else high * _SPEED_FACTOR_GROWTH
        if high > _MAX_SPEED_FACTOR:
            return np.inf, None
    # Where already the first factor breaks one, fall until none is broken.
    for _ in range(_MAX_SPEED_FACTOR_HALVINGS):
        if low > 0:
            break
        half = high / 2
        if find_worst_limit(b, half)[0] <= 1:
            low = half
        else:
            high = half
    if low == 0:
        raise JounceError(f"no factor of speed down to {high:.1g} keeps the limits; with_limits states others")

    def excess(c: float) -> float:
        return find_worst_limit(b, c)[0] - 1

    # Between the two factors the largest ratio passes 1.
    relative = _SPEED_FACTOR_TOLERANCE
    factor = float(brentq(excess, low, high, xtol=relative * low, rtol=relative))
    return factor, find_worst_limit(b, factor)[1]


def find_worst_limit(b: LimitedMotion, factor: float) -> tuple[float, Place]:
    """Find the largest ratio of the motion, and its place.

    `factor` is that of the motion's speed.
    """
    worst = compute_worst(b, factor)
    limits = []
    for (kind, sign), ratio in worst.ratios.items():
        j = int(np.argmax(ratio))
        limits.append((float(ratio[j]), (kind, j, float(b.given_times(worst.t[kind, sign][j], factor)))))
    return max(limits)


def compute_worst(b: LimitedMotion, factor: float) -> Worst:
    """Compute the worst values of the motion at a factor of speed."""
    scaled = b.scaled(1 / factor)
    worst = Worst(scaled)
    for pieces in split_motion(scaled):
        worst.take_worst(pieces)
    return worst
