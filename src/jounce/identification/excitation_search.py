"""Search for the Fourier series within limits that excites parameters most.

Problem: maximise log det of the information matrix of the forces (a D-optimal experiment: V. V. Fedorov, Theory of
Optimal Experiments, 1972) over the free amplitudes of series that start and end at rest, within all limits.

Algorithm: minimise -log det plus the relaxed barrier of the limits, weighted less in each of three stages, by BFGS (J.
Nocedal, S. J. Wright, Numerical Optimization, chapter 6), each stage from the minimum of the last, the first from
several random series; the best counts. `ExcitationSearch.find_best` is the door; `loss` runs in each step of BFGS, and
adds what three parts say of one series. Gradients are exact, by vector-Jacobian products of native code.

1. The series (`Harmonics`), linear in free amplitudes, with rates to q4d that vanish where a period begins:

    q(t) = c + sum_k a_k cos(k w t) + b_k sin(k w t),   w = 2 pi / period,
    sum_k k b_k = sum_k k^2 a_k = sum_k k^3 b_k = sum_k k^4 a_k = 0.

   The conditions leave each joint 2 N - 4 free amplitudes of N harmonics, and its mean c.

2. The information (`Information`): the matrix is the time mean of Y^T W Y, Y the regressor of the parameters, W the
   weights of the forces. Where these are inverse variances, its inverse over the number of samples is the covariance of
   the parameters that weighted least squares finds. Parameters in other units add a constant to its log determinant.

3. The barrier of the limits (`LimitBarrier`): that of a bound is -log z of its room z = share - ratio. Below z = delta
   a parabola with the same value, slope and curvature continues it, so that motions beyond limits have a value too,
   and are drawn inside (J. Hauser, A. Saccon, "A Barrier Function Method for the Optimization of Trajectory
   Functionals with Constraints", IEEE Conference on Decision and Control, 2006). Gradients by q, qd, ... are those of
   the forces, and those of power and stall lines by hand.

Invariants: every series meets the conditions at its ends, whatever its amplitudes; a series beyond limits has a value
too, so that any series is a start. A minimum is a local one, and may exceed limits a little: `excite` shrinks it.
Failure: `find_rest` raises if effort limits let the robot hold no pose that it finds.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, quote_value
from jounce.core.typing import DriveTerm
from jounce.dynamics import base_parameters
from jounce.dynamics.computation import Computation
from jounce.dynamics.quantities.names import QuantityName
from jounce.engine import along, backends, generic_methods
from jounce.engine.drives import compute_regressor
from jounce.engine.engine import Engine
from jounce.limits.limited_motion import motion_order
from jounce.limits.ratios import SIGNS, Scale, build_scale
from jounce.limits.samples import limited_values
from jounce.model import coordinates, drive_trains
from jounce.model.limits import LIMIT_KINDS, Limits
from jounce.motion import Motion
from jounce.native.kernel import Kernel
from jounce.spatial.series import column_series

MIN_HARMONICS = 3  # with two of them, nothing moves that is at rest at the ends
POINTS_PER_HIGHEST_PERIOD = 32  # of the highest harmonic: between such points peaks are higher by 0.5 % at most
INFORMATION_FLOOR = 1e-12  # of typical states, added to the matrix: log det is finite even of motions that show less
COLUMN_RANK_TOLERANCE = 1e-7  # of its length: a column with less outside of the span of those before depends on them
BARRIER_STAGES = ((2.5, 0.15), (0.25, 0.015), (0.025, 0.0015))  # weight of the barrier per parameter, room that is kept
MAX_BFGS_STEPS = 300  # in each stage, a bound of the time that it takes
MAX_LOSS_SLOPE = 0.1  # per unit of amplitudes, ends a stage: the rest changes deviations by less than 1 %
MAX_START_AMPLITUDE = 0.3  # of random series, in units of the limits: several of them add up
MAX_REST_STARTS = 20  # poses from which one is sought that effort limits let the robot hold
Rates = Sequence[np.ndarray]  # q, qd, q2d, ..., (M, n) each
Progress = Callable[[int, int], object]  # of the number of starts done, and of all


@dataclass(frozen=True)
class Harmonics:
    """Series with `count` harmonics over some periods, at rest at their ends.

    They are linear in free amplitudes x (2 count - 3, n), of which the means are the first.
    """

    period: float
    periods: int
    count: int

    @property
    def frequency(self) -> float:
        """Frequency of the first harmonic, rad/s."""
        return 2 * np.pi / self.period

    @property
    def step(self) -> float:
        """Time between the points at which the series are evaluated, s."""
        return self.period / (POINTS_PER_HIGHEST_PERIOD * self.count)

    @cached_property
    def cosines(self) -> np.ndarray:
        """The amplitudes of cosines by the free amplitudes: (count, 2 count - 3)."""
        # Free amplitudes are the mean, then those of cosines, then those of sines.
        even = _rest_basis(self.count, (2, 4))
        return np.hstack([np.zeros((self.count, 1)), even, np.zeros_like(even)])

    @cached_property
    def sines(self) -> np.ndarray:
        """The amplitudes of sines by the free amplitudes: (count, 2 count - 3)."""
        odd = _rest_basis(self.count, (1, 3))
        return np.hstack([np.zeros((self.count, 1)), np.zeros_like(odd), odd])

    def basis(self, order: int) -> np.ndarray:
        """Return the series of the free amplitudes: (order + 1, points, 2 count - 3)."""
        points = POINTS_PER_HIGHEST_PERIOD * self.count
        k = np.arange(1, self.count + 1)
        angles = k * (2 * np.pi * np.arange(points) / points)[:, None]
        series = np.empty((order + 1, points, self.cosines.shape[1]))
        # Each rate multiplies by k w and turns by a quarter: d/dt cos(k w t) = k w cos(k w t + pi / 2).
        for rate in range(order + 1):
            size, turned_angles = (self.frequency * k) ** rate, angles + rate * np.pi / 2
            series[rate] = (size * np.cos(turned_angles)) @ self.cosines + (size * np.sin(turned_angles)) @ self.sines
        # The mean moves nothing but q.
        series[0, :, 0] = 1
        return series

    def motion(self, x: np.ndarray, joint_names: tuple[str, ...]) -> Motion:
        """Return the motion over all periods."""
        a, b = self.cosines @ x, self.sines @ x
        motion = Motion.fourier(x[0], a, b, self.frequency, self.period * self.periods, joint_names=joint_names)
        times = f"{self.periods} periods" if self.periods > 1 else "one period"
        source = f"Fourier series, {self.count} harmonics of {1 / self.period:.6g} Hz, {times} of {self.period:g} s"
        return replace(motion, source=source)


def _rest_basis(count: int, powers: tuple[int, int]) -> np.ndarray:
    """Return an orthonormal basis (count, count - 2) of amplitudes that rest.

    They have sum_k k^p amplitude_k = 0 for both powers p: the null space of two rows, by their singular vectors.
    """
    # Over the largest k, so that the rows have no large numbers; the null space is the same.
    k = np.arange(1, count + 1) / count
    return np.asarray(np.linalg.svd(np.stack([k**power for power in powers]))[2][2:].T)


@dataclass(frozen=True, eq=False)
class Information:
    """The parameters that forces determine, and how a motion determines them.

    `loss` runs in each step of BFGS; `log_det` and `condition` rate its results.
    """

    robot: Engine
    terms: tuple[DriveTerm, ...]  # the drive terms among the parameters
    roots: np.ndarray  # (n,) square roots of the weights of the forces
    names: tuple[str, ...]  # of the parameters
    unseen: tuple[str, ...]  # base parameters and drive terms that no motion separates from them
    places: np.ndarray  # (count,) the columns of the parameters in the regressor with those terms
    sizes: np.ndarray  # (count,) root mean squares over typical states of the lengths of these columns, weighted
    product: Kernel  # vector-Jacobian products of the regressor

    def log_det(self, rates: Rates) -> float:
        """Return the log determinant of the information matrix, in SI units."""
        # Columns over sizes: each size enters the determinant squared.
        sign, log = np.linalg.slogdet(_mean_square(self._columns(self._regressor(rates))))
        return float(log + 2 * np.log(self.sizes).sum()) if sign > 0 else -np.inf

    def condition(self, rates: Rates) -> float:
        """Return the condition number of the weighted regressor: of columns of unit length."""
        A = self._columns(self._regressor(rates)).reshape(-1, len(self.names))
        lengths = np.linalg.norm(A, axis=0)
        return float(np.linalg.cond(A / lengths)) if lengths.all() else np.inf

    def loss(self, rates: Rates) -> tuple[float, list[np.ndarray]]:
        """Return minus the log determinant and its gradients by q, qd, q2d.

        Up to a constant. d log det H = 2 <A H^-1, dA> / M for the columns A with H = A^T A / M.
        """
        # The weighted columns (M, n, count) over their typical sizes, and their information H (count, count).
        Y = self._regressor(rates)
        A = self._columns(Y)
        H = _mean_square(A) + INFORMATION_FLOOR * np.eye(len(self.names))
        # Pushes (M, n, columns) on the entries of the regressor: the gradient -2 A H^-1 / M by A, through the sizes and
        # the roots of the weights.
        pushes = np.zeros_like(Y)
        pushes[..., self.places] = A @ (np.linalg.inv(H) * (-2 / len(A)) / self.sizes)
        pushes *= self.roots[:, None]
        # From the regressor to q, qd, q2d (M, n): native code for the bodies' columns, by hand for those of drives.
        body_columns = Y.shape[-1] - len(self.terms) * len(self.robot.mechanism.joints)
        gradients = list(self.product(*rates[:3], np.ascontiguousarray(pushes[..., :body_columns])))
        if len(self.terms) > 0:
            self._add_drives(gradients, rates, pushes[..., body_columns:])
        return -float(np.linalg.slogdet(H)[1]), gradients

    def _regressor(self, rates: Rates) -> np.ndarray:
        return _weighted_regressor(self.robot, self.terms, self.roots, rates)

    def _columns(self, Y: np.ndarray) -> np.ndarray:
        """Return the columns of the parameters over their typical sizes: (M, n, count)."""
        return np.asarray(Y[..., self.places] / self.sizes)

    def _add_drives(self, gradients: list[np.ndarray], rates: Rates, pushes: np.ndarray) -> None:
        """Add the gradients through columns of drive terms: from pushes (M, n, terms nc)."""
        # Columns of unit amounts: their partial derivatives are those of the terms with all amounts 1.
        m, nc = self.robot.mechanism, len(self.robot.mechanism.joints)
        theta = coordinates.joint_variables(m, column_series(list(rates)))
        units = {**drive_trains.coefficients(m.drives)} | dict.fromkeys(drive_trains.AMOUNTS.values(), np.ones((nc, 1)))
        # A term of joint j depends on its own variable theta_j = (G q)_j alone, and acts along row j of G.
        for i, term in enumerate(self.terms):
            push = np.einsum("jc,mcj->mj", m.G, pushes[..., i * nc : (i + 1) * nc])
            for gradient, slope in zip(gradients, drive_trains.partials(units, (term,), theta), strict=True):
                gradient += (push * slope[0][..., 0]) @ m.G


def build_information(
    robot: Engine, terms: tuple[DriveTerm, ...], weights: np.ndarray, typical: Rates, load: int | None = None
) -> Information:
    """Build the information of motions whose states are like typical ones.

    The parameters are those that forces in these states determine: of the robot, or of a load on a body with a number.
    """
    m, base = robot.mechanism, base_parameters.base_parameters(robot.mechanism)
    body_columns = base.columns if load is None else 10 * load + np.arange(10)
    # Candidates: those columns, and all of drive terms, by typical states as rows (M n, count).
    Y = _weighted_regressor(robot, terms, np.sqrt(weights), typical)
    first_drive = Y.shape[-1] - len(terms) * len(m.joints)
    names = np.array(
        [*(base.parameters[k] for k in body_columns), *(f"{joint} {term}" for term in terms for joint in m.joints)]
    )
    places = np.concatenate([body_columns, np.arange(first_drive, Y.shape[-1])])
    A = Y.reshape(-1, Y.shape[-1])[:, places]
    # Columns of unit length: the diagonal of R is what the columns before a column leave of its length. A column of
    # which nothing is left depends on these, and its parameter is not separated from theirs.
    sizes = np.sqrt(np.mean(A**2, axis=0) * robot.n)
    R = np.linalg.qr(A / np.where(sizes > 0, sizes, 1) / np.sqrt(len(typical[0])), mode="r")
    separate = np.abs(np.diag(R)) > COLUMN_RANK_TOLERANCE
    return Information(
        robot, terms, np.sqrt(weights), tuple(names[separate].tolist()), tuple(names[~separate].tolist()),
        places[separate], sizes[separate], backends.compile_ahead(robot, Computation("regressor", 0, product="vjp")),
    )  # fmt: skip


def _mean_square(A: np.ndarray) -> np.ndarray:
    """Return A^T A of columns (M, n, count), over M."""
    # State by state: BLAS makes threads for larger products, which wait long for each other.
    return np.asarray((A.mT @ A).sum(axis=0) / len(A))


def _weighted_regressor(robot: Engine, terms: tuple[DriveTerm, ...], roots: np.ndarray, rates: Rates) -> np.ndarray:
    """Return the regressor times the roots of the weights: (M, n, columns)."""
    q, qd, q2d, *_ = rates
    return compute_regressor(robot, "regressor", (q, qd, q2d), terms) * roots[:, None]


class BoundedForce(NamedTuple):
    """A force with its rates up to an order: native code of both, and of vector-Jacobian products."""

    order: int
    inputs: int
    kernel: Kernel
    product: Kernel

    def values(self, rates: Rates) -> Sequence[np.ndarray]:
        """Return the force and its rates, (M, n) each."""
        return tuple(generic_methods.as_tuple(self.kernel(*rates[: self.inputs])))

    def gradients(self, rates: Rates, pushes: Sequence[np.ndarray]) -> Sequence[np.ndarray]:
        """Return gradients by q, qd, ... of values times pushes, summed."""
        return tuple(generic_methods.as_tuple(self.product(*rates[: self.inputs], *pushes)))


@dataclass(frozen=True, eq=False)
class LimitBarrier:
    """The barrier of the limits of a robot's coordinates.

    `kinds` are those of the limits: what they bound has n columns each, in their order, with `scale`; `sides` are signs
    and the columns that have bounds on that side. `order` is that of the highest rate of q that they take. `Q` and
    `gravity` are the forces Q and Qgrav with the rates that limits bound, or None. `loss` runs in each step of BFGS.
    """

    limits: Limits
    kinds: tuple[str, ...]
    scale: Scale
    sides: tuple[tuple[int, np.ndarray], ...]
    order: int
    Q: BoundedForce | None
    gravity: BoundedForce | None

    def worst(self, rates: Rates) -> tuple[float, str, int]:
        """Return the largest ratio at states, with its kind and coordinate."""
        values, worst_of_sides = self._stacked(self._values(rates)), []
        for sign, columns in self.sides:
            ratios = self.scale.ratio(values[:, columns], sign, columns).max(axis=0)
            kind, joint = divmod(int(columns[ratios.argmax()]), rates[0].shape[1])
            worst_of_sides.append((float(ratios.max()), self.kinds[kind], joint))
        return max(worst_of_sides)

    def loss(self, rates: Rates, share: float, delta: float) -> tuple[float, list[np.ndarray]]:
        """Return the barrier and its gradients by q, qd, ...

        It is a sum over bounds and a mean over states.
        """
        by_kind = self._values(rates)
        values, total = self._stacked(by_kind), 0.0  # (M, kinds n)
        pushes = np.zeros_like(values)
        for sign, columns in self.sides:
            # -log z inside; ((z / delta - 2)^2 - 1) / 2 - log delta below z = delta, where both have the same value,
            # slope -1 / delta and curvature.
            z = share - self.scale.ratio(values[:, columns], sign, columns)
            is_relaxed, y = z < delta, z / delta - 2
            inside = np.where(is_relaxed, delta, z)
            total += float(np.where(is_relaxed, (y * y - 1) / 2 - np.log(delta), -np.log(inside)).sum())
            # dz = -d value / reach.
            reach = sign * self.scale.reach(sign)[columns]
            pushes[:, columns] -= np.where(is_relaxed, y / delta, -1 / inside) / (reach * len(z))
        # From what limits bound to q, qd, ...: pushes of each kind, (M, n).
        parts = np.split(pushes, len(self.kinds), axis=1)
        return total / len(rates[0]), self._gradients(rates, by_kind, dict(zip(self.kinds, parts, strict=True)))

    def _values(self, rates: Rates) -> dict[str, np.ndarray]:
        """Return what limits bound at states: (M, n) by kind, with Q itself as "Q"."""
        Q = () if self.Q is None else self.Q.values(rates)
        gravity = () if self.gravity is None else self.gravity.values(rates)
        values = limited_values(self.limits, rates, Q, gravity)
        if self.Q is None:
            return values
        return values | {"Q": Q[0]}

    def _stacked(self, by_kind: Mapping[str, np.ndarray]) -> np.ndarray:
        return np.concatenate([by_kind[kind] for kind in self.kinds], axis=1)

    def _gradients(
        self, rates: Rates, values: Mapping[str, np.ndarray], pushes: Mapping[str, np.ndarray]
    ) -> list[np.ndarray]:
        """Return gradients by q, qd, ... of bounded values times pushes, summed."""
        zero = np.zeros_like(rates[0])
        # Limits of q, qd, ... themselves.
        gradients = [pushes.get(kind, zero).copy() for kind in LIMIT_KINDS.motion[: len(rates)]]
        if self.Q is None:
            return gradients
        # Limits of Q, Qd, Q2d; some of them bound the force without gravity, Q - Qgrav.
        force_pushes = [pushes.get(kind, zero) for kind in LIMIT_KINDS.effort[: self.Q.order + 1]]
        force_gradients = []
        if self.gravity is not None:
            gravity_pushes = [
                -push * (kind in self.limits.without_gravity)
                for kind, push in zip(LIMIT_KINDS.effort, force_pushes, strict=False)
            ]
            force_gradients.append(self.gravity.gradients(rates, gravity_pushes[: self.gravity.order + 1]))
        # Power Q qd, and stall lines Q + slope qd: both by Q and by qd.
        if "power" in pushes:
            gradients[1] += pushes["power"] * values["Q"]
            force_pushes[0] = force_pushes[0] + pushes["power"] * rates[1]
        if "stall_effort" in pushes:
            gradients[1] += pushes["stall_effort"] * self.limits.effort_slope
            force_pushes[0] = force_pushes[0] + pushes["stall_effort"]
        # Pushes on forces become gradients by q, qd, ... in native code.
        for parts in (*force_gradients, self.Q.gradients(rates, force_pushes)):
            for gradient, part in zip(gradients, parts, strict=False):
                gradient += part
        return gradients


def build_barrier(robot: Engine, limits: Limits, kinds: Sequence[str]) -> LimitBarrier:
    """Build the barrier of limits of some kinds.

    Bounds of 0 are left out: what they bound stands still.
    """
    # One scale of all kinds: (kinds n,) bounds.
    scale_fields = zip(*(vars(build_scale(limits.bounds(kind), kind)).values() for kind in kinds), strict=True)
    scale = Scale(*map(np.concatenate, scale_fields))
    finite = {sign: np.isfinite(scale.bound(sign)) & (scale.reach(sign) != 0) for sign in reversed(SIGNS)}
    sides = tuple((sign, np.flatnonzero(bounded)) for sign, bounded in finite.items() if bounded.any())
    # Native code of forces that are bounded, up to the highest of their rates.
    forces = [kind for kind in kinds if LIMIT_KINDS[kind].force]
    order = max((LIMIT_KINDS[kind].rate for kind in forces), default=0)
    gravity_orders = [LIMIT_KINDS[kind].rate for kind in forces if kind in limits.without_gravity]
    Q = gravity = None
    if len(forces) > 0:
        Q = _compile_force(robot, "inverse_dynamics", order, along.Q_RATE_ORDER)
    if len(gravity_orders) > 0:
        gravity = _compile_force(robot, "gravity_forces", max(gravity_orders), 0)
    highest = max([along.Q_RATE_ORDER, *(motion_order(robot, kind) for kind in kinds)])
    return LimitBarrier(limits, tuple(kinds), scale, sides, highest, Q, gravity)


def _compile_force(robot: Engine, name: QuantityName, order: int, first: int) -> BoundedForce:
    """Compile a force up to an order: without its rates it takes q to rate `first`."""
    kernels = (backends.compile_ahead(robot, Computation(name, order, product=product)) for product in (None, "vjp"))
    return BoundedForce(order, order + first + 1, *kernels)


@dataclass(frozen=True, eq=False)
class ExcitationSearch:
    """The search for series by the information that they give, within limits.

    `reaches` (order + 1, n) are the bounds of q and its rates, q about its `middle` (n,); where that of a rate is 0,
    the coordinate stands still. A `share` of each limit is used.
    """

    series: Harmonics
    information: Information
    barrier: LimitBarrier
    middle: np.ndarray
    reaches: np.ndarray
    share: float

    @cached_property
    def basis(self) -> np.ndarray:
        """The series of the free amplitudes at the points of a period."""
        return self.series.basis(self.barrier.order)

    @cached_property
    def units(self) -> np.ndarray:
        """The largest free amplitudes (free, n) that limits allow each alone.

        In these units all variables of BFGS are of one size.
        """
        # Reach over peak of q and of each of its rates, of which the least decides: (order + 1, free, n) -> (free, n).
        # Rates of means are 0, and their division is not used.
        peaks = np.abs(self.basis).max(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            allowed = self.reaches[:, None, :] / peaks[:, :, None]
        return np.vstack([self.reaches[:1], allowed.min(axis=0)[1:]])

    def amplitudes(self, u: np.ndarray) -> np.ndarray:
        """Return the free amplitudes of a vector in units, about the middle: (free, n)."""
        x = self.units * u.reshape(self.units.shape)
        x[0] += self.middle
        return x

    def rates(self, x: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return q, qd, ... (points, n) of free amplitudes."""
        return tuple(self.basis @ x)

    def loss(self, u: np.ndarray, weight: float, delta: float) -> tuple[float, np.ndarray]:
        """Return -log det plus the weighted barrier, and the gradient."""
        rates = self.rates(self.amplitudes(u))
        information_loss, gradients = self.information.loss(rates)
        barrier_loss, pushes = self.barrier.loss(rates, self.share, delta)
        # Gradients by q, qd, ... at the points; the information takes none of q3d and above.
        for k, push in enumerate(pushes):
            pushes[k] = weight * push + (gradients[k] if k < len(gradients) else 0)
        # The chain rule: from the rates of q at points to the amplitudes, over which they are linear.
        by_amplitude = sum(rate.T @ push for rate, push in zip(self.basis, pushes, strict=True))
        return information_loss + weight * barrier_loss, (self.units * by_amplitude).ravel()

    def find_best(self, starts: int, rng: np.random.Generator, progress: Progress | None) -> np.ndarray:
        """Find the free amplitudes of the best series from some random ones."""
        results, count = [], len(self.information.names)
        for i in range(starts):
            u = self.random_start(rng)
            # Each stage lets the series nearer to the limits than the one before.
            for weight, delta in BARRIER_STAGES:
                u = _minimise(self.loss, u, count * weight, delta)
            x = self.amplitudes(u)
            results.append((self.information.log_det(self.rates(x)), i, x))
            if progress is not None:
                progress(i + 1, starts)
        return max(results)[2]

    def random_start(self, rng: np.random.Generator) -> np.ndarray:
        """Return a random series about a random pose, in units of amplitudes."""
        u = MAX_START_AMPLITUDE * rng.uniform(-1, 1, self.units.shape)
        u[0] = rng.uniform(-0.5, 0.5, len(self.middle))
        return u.ravel()

    def find_rest(self, rng: np.random.Generator) -> np.ndarray:
        """Find a pose (n,) that all limits allow at rest, or raise."""
        # Poses in units of the ranges, with all rates 0: only q is free.
        zero = np.zeros((self.barrier.order, 1, len(self.middle)))

        def rates(u: np.ndarray) -> tuple[np.ndarray, ...]:
            return (self.middle + self.reaches[:1] * u, *zero)

        def loss_of_pose(u: np.ndarray) -> tuple[float, np.ndarray]:
            value, gradients = self.barrier.loss(rates(u), self.share, BARRIER_STAGES[1][1])
            return value, gradients[0][0] * self.reaches[0]

        # The first start is the middle of the range. The barrier's minimum may be beyond a limit: ratios decide.
        worst = []
        for i in range(MAX_REST_STARTS):
            start = np.zeros(len(self.middle)) if i == 0 else rng.uniform(-0.8, 0.8, len(self.middle))
            u = _minimise(loss_of_pose, start)
            worst.append(self.barrier.worst(rates(u)))
            if worst[-1][0] < self.share:
                return rates(u)[0][0]
        ratio, kind, joint = min(worst)
        what = f"{kind.replace('_', ' ')} of joint {quote_value(self.information.robot.joint_names[joint])}"
        came = f"the {what} takes {ratio:.3g} times its limit at rest, or more"
        cure = f"raise it with {Remedy(f'robot.with_limits({kind}=...)', '--limits FILE')}"
        raise JounceError(f"no pose is found that the limits let the robot hold: {came}; {cure}")


def _minimise(loss: Callable[..., tuple[float, np.ndarray]], u: np.ndarray, *arguments: float) -> np.ndarray:
    """Find a local minimum of a loss with its gradient, by BFGS."""
    # L-BFGS takes half as many steps again.
    result = minimize(loss, u, arguments, "BFGS", jac=True, options={"maxiter": MAX_BFGS_STEPS, "gtol": MAX_LOSS_SLOPE})
    return np.asarray(result.x)


def motion_reaches(limits: Limits, series: Harmonics, order: int) -> np.ndarray:
    """Return how far q and its rates may go: (order + 1, n).

    As far as limits let them, and no rate further than series of such q go. A coordinate stands still, with rates 0, if
    any of its limits is 0.
    """
    lower, upper = limits.bounds(LIMIT_KINDS.motion[0])
    reaches = [(upper - lower) / 2]
    # The k-th rate of a harmonic in the middle of the series is (k w)^k times q.
    for k, kind in enumerate(LIMIT_KINDS.motion[1 : order + 1], 1):
        usual = reaches[0] * (series.frequency * (series.count + 1) / 2) ** k
        reaches.append(np.minimum(usual, np.abs(limits.bounds(kind)).min(axis=0)))
    moves = np.all(reaches, axis=0)
    return np.stack([reaches[0], *(np.array(reaches[1:]) * moves)])
