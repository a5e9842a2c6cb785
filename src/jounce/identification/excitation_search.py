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

3. The room that limits leave (`LimitBarrier`): the barrier of a bound is -log z of its room z = share - ratio. Below
   z = delta a parabola with the same value, slope and curvature continues it, so that motions beyond limits have a
   value too, and are drawn inside (J. Hauser, A. Saccon, "A Barrier Function Method for the Optimization of Trajectory
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
from jounce.engine.drives import regressor
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
    """Series with `count` harmonics over some periods, linear in free amplitudes x (2 count - 3, n), means first."""

    period: float
    periods: int
    count: int

    @property
    def frequency(self) -> float:
        """Of the first harmonic, rad/s."""
        return 2 * np.pi / self.period

    @property
    def step(self) -> float:
        """Between the points at which the series are evaluated, s."""
        return self.period / (POINTS_PER_HIGHEST_PERIOD * self.count)

    @cached_property
    def cosines(self) -> np.ndarray:
        """The amplitudes of cosines (count, 2 count - 3) that belong to the free ones."""
        even = _rest_basis(self.count, (2, 4))
        return np.hstack([np.zeros((self.count, 1)), even, np.zeros_like(even)])

    @cached_property
    def sines(self) -> np.ndarray:
        """The amplitudes of sines (count, 2 count - 3) that belong to the free ones."""
        odd = _rest_basis(self.count, (1, 3))
        return np.hstack([np.zeros((self.count, 1)), np.zeros_like(odd), odd])

    def basis(self, order: int) -> np.ndarray:
        """The series of each free amplitude with its rates, (order + 1, points, 2 count - 3)."""
        points = POINTS_PER_HIGHEST_PERIOD * self.count
        k = np.arange(1, self.count + 1)
        angles = k * (2 * np.pi * np.arange(points) / points)[:, None]
        found = np.empty((order + 1, points, self.cosines.shape[1]))
        for rate in range(order + 1):
            size, turned = (self.frequency * k) ** rate, angles + rate * np.pi / 2
            found[rate] = (size * np.cos(turned)) @ self.cosines + (size * np.sin(turned)) @ self.sines
        found[0, :, 0] = 1
        return found

    def motion(self, x: np.ndarray, joint_names: tuple[str, ...]) -> Motion:
        """The motion over all periods."""
        a, b = self.cosines @ x, self.sines @ x
        found = Motion.fourier(x[0], a, b, self.frequency, self.period * self.periods, joint_names=joint_names)
        times = f"{self.periods} periods" if self.periods > 1 else "one period"
        source = f"Fourier series, {self.count} harmonics of {1 / self.period:.6g} Hz, {times} of {self.period:g} s"
        return replace(found, source=source)


def _rest_basis(count: int, powers: tuple[int, int]) -> np.ndarray:
    """An orthonormal basis (count, count - 2) of the amplitudes with sum_k k^p amplitude_k = 0 for both powers p."""
    k = np.arange(1, count + 1) / count
    return np.asarray(np.linalg.svd(np.stack([k**power for power in powers]))[2][2:].T)


@dataclass(frozen=True, eq=False)
class Information:
    """The parameters that forces of a robot determine, and the code of gradients of their regressor."""

    robot: Engine
    terms: tuple[DriveTerm, ...]  # the drive terms among the parameters
    roots: np.ndarray  # (n,) square roots of the weights of the forces
    names: tuple[str, ...]  # of the parameters
    unseen: tuple[str, ...]  # base parameters and drive terms that no motion separates from them
    places: np.ndarray  # (count,) the columns of the parameters in the regressor with those terms
    sizes: np.ndarray  # (count,) root mean squares over typical states of the lengths of these columns, weighted
    product: Kernel  # vector-Jacobian products of the regressor

    def log_det(self, rates: Rates) -> float:
        """The log determinant of the information matrix, of parameters in SI units."""
        sign, log = np.linalg.slogdet(_mean_square(self._columns(self._regressor(rates))))
        return float(log + 2 * np.log(self.sizes).sum()) if sign > 0 else -np.inf

    def condition(self, rates: Rates) -> float:
        """The condition number of the weighted regressor with columns of unit length."""
        A = self._columns(self._regressor(rates)).reshape(-1, len(self.names))
        lengths = np.linalg.norm(A, axis=0)
        return float(np.linalg.cond(A / lengths)) if lengths.all() else np.inf

    def loss(self, rates: Rates) -> tuple[float, list[np.ndarray]]:
        """Minus the log determinant up to a constant, and its gradients by q, qd and q2d.

        d log det H = 2 <A H^-1, dA> / M for the columns A with H = A^T A / M.
        """
        Y = self._regressor(rates)
        A = self._columns(Y)
        H = _mean_square(A) + INFORMATION_FLOOR * np.eye(len(self.names))
        pushes = np.zeros_like(Y)
        pushes[..., self.places] = A @ (np.linalg.inv(H) * (-2 / len(A)) / self.sizes)
        pushes *= self.roots[:, None]
        own = Y.shape[-1] - len(self.terms) * len(self.robot.mechanism.joints)
        gradients = list(self.product(*rates[:3], np.ascontiguousarray(pushes[..., :own])))
        if self.terms:
            self._add_drives(gradients, rates, pushes[..., own:])
        return -float(np.linalg.slogdet(H)[1]), gradients

    def _regressor(self, rates: Rates) -> np.ndarray:
        return _weighted_regressor(self.robot, self.terms, self.roots, rates)

    def _columns(self, Y: np.ndarray) -> np.ndarray:
        """The columns (M, n, count) of the parameters in a weighted regressor, each over its typical size."""
        return np.asarray(Y[..., self.places] / self.sizes)

    def _add_drives(self, gradients: list[np.ndarray], rates: Rates, pushes: np.ndarray) -> None:
        """Add the gradients through the columns of drive terms, from pushes (M, n, terms nc) on these."""
        m, nc = self.robot.mechanism, len(self.robot.mechanism.joints)
        theta = coordinates.joint_variables(m, column_series(list(rates)))
        units = {**drive_trains.coefficients(m.drives)} | dict.fromkeys(drive_trains.AMOUNTS.values(), np.ones((nc, 1)))
        for i, term in enumerate(self.terms):
            push = np.einsum("jc,mcj->mj", m.G, pushes[..., i * nc : (i + 1) * nc])
            for gradient, slope in zip(gradients, drive_trains.partials(units, (term,), theta), strict=True):
                gradient += (push * slope[0][..., 0]) @ m.G


def build_information(
    robot: Engine, terms: tuple[DriveTerm, ...], weights: np.ndarray, typical: Rates, load: int | None = None
) -> Information:
    """The information of motions whose states are like typical ones: the parameters that forces there determine.

    Those of the robot, or of a load on a body with a number.
    """
    m, base = robot.mechanism, base_parameters.base_parameters(robot.mechanism)
    sought = base.columns if load is None else 10 * load + np.arange(10)
    Y = _weighted_regressor(robot, terms, np.sqrt(weights), typical)
    own = Y.shape[-1] - len(terms) * len(m.joints)
    names = np.array(
        [*(base.parameters[k] for k in sought), *(f"{joint} {term}" for term in terms for joint in m.joints)]
    )
    places = np.concatenate([sought, np.arange(own, Y.shape[-1])])
    A = Y.reshape(-1, Y.shape[-1])[:, places]
    sizes = np.sqrt(np.mean(A**2, axis=0) * robot.n)
    R = np.linalg.qr(A / np.where(sizes > 0, sizes, 1) / np.sqrt(len(typical[0])), mode="r")
    seen = np.abs(np.diag(R)) > COLUMN_RANK_TOLERANCE  # of what columns before leave of each
    return Information(
        robot, terms, np.sqrt(weights), tuple(names[seen].tolist()), tuple(names[~seen].tolist()),
        places[seen], sizes[seen], backends.compile_ahead(robot, Computation("regressor", 0, product="vjp")),
    )  # fmt: skip


def _mean_square(A: np.ndarray) -> np.ndarray:
    """A^T A of columns (M, n, count), over M: by state, as BLAS makes threads for larger products that wait long."""
    return np.asarray((A.mT @ A).sum(axis=0) / len(A))


def _weighted_regressor(robot: Engine, terms: tuple[DriveTerm, ...], roots: np.ndarray, rates: Rates) -> np.ndarray:
    """The regressor (M, n, columns) with rows times the roots of the weights."""
    q, qd, q2d, *_ = rates
    return regressor(robot, "regressor", (q, qd, q2d), terms) * roots[:, None]


class BoundedForce(NamedTuple):
    """A force with its rates up to an order: native code of both, and of vector-Jacobian products."""

    order: int
    inputs: int
    kernel: Kernel
    product: Kernel

    def values(self, rates: Rates) -> Sequence[np.ndarray]:
        """The force and its rates, (M, n) each."""
        return tuple(generic_methods.as_tuple(self.kernel(*rates[: self.inputs])))

    def gradients(self, rates: Rates, pushes: Sequence[np.ndarray]) -> Sequence[np.ndarray]:
        """The gradients by the rates of q of the sum of its values and rates times pushes."""
        return tuple(generic_methods.as_tuple(self.product(*rates[: self.inputs], *pushes)))


@dataclass(frozen=True, eq=False)
class LimitBarrier:
    """The bounds of a robot's coordinates, and the forces Q and Qgrav with the rates that they bound, or None.

    `kinds` are those of the limits: what they bound has n columns each, in their order, with `scale`; `sides` are signs
    and the columns that have bounds of them. `order` is that of the highest rate of q that they take.
    """

    limits: Limits
    kinds: tuple[str, ...]
    scale: Scale
    sides: tuple[tuple[int, np.ndarray], ...]
    order: int
    Q: BoundedForce | None
    gravity: BoundedForce | None

    def worst(self, rates: Rates) -> tuple[float, str, int]:
        """The largest ratio at states, of which kind and coordinate."""
        values, found = self._stacked(self._values(rates)), []
        for sign, columns in self.sides:
            ratios = self.scale.ratio(values[:, columns], sign, columns).max(axis=0)
            kind, joint = divmod(int(columns[ratios.argmax()]), rates[0].shape[1])
            found.append((float(ratios.max()), self.kinds[kind], joint))
        return max(found)

    def loss(self, rates: Rates, share: float, delta: float) -> tuple[float, list[np.ndarray]]:
        """The barrier, a sum over bounds and a mean over states, and its gradients by q, qd, ..."""
        by_kind = self._values(rates)
        values, total = self._stacked(by_kind), 0.0
        pushes = np.zeros_like(values)
        for sign, columns in self.sides:
            z = share - self.scale.ratio(values[:, columns], sign, columns)
            beyond, y = z < delta, z / delta - 2
            inside = np.where(beyond, delta, z)
            total += float(np.where(beyond, (y * y - 1) / 2 - np.log(delta), -np.log(inside)).sum())
            reach = sign * self.scale.reach(sign)[columns]
            pushes[:, columns] -= np.where(beyond, y / delta, -1 / inside) / (reach * len(z))
        parts = np.split(pushes, len(self.kinds), axis=1)
        return total / len(rates[0]), self._gradients(rates, by_kind, dict(zip(self.kinds, parts, strict=True)))

    def _values(self, rates: Rates) -> dict[str, np.ndarray]:
        """What limits bound at states by kind, (M, n) each; Q itself as "Q"."""
        Q = self.Q.values(rates) if self.Q else ()
        found = limited_values(self.limits, rates, Q, self.gravity.values(rates) if self.gravity else ())
        return found | ({"Q": Q[0]} if Q else {})

    def _stacked(self, by_kind: Mapping[str, np.ndarray]) -> np.ndarray:
        return np.concatenate([by_kind[kind] for kind in self.kinds], axis=1)

    def _gradients(
        self, rates: Rates, values: Mapping[str, np.ndarray], pushes: Mapping[str, np.ndarray]
    ) -> list[np.ndarray]:
        """The gradients by q, qd, ... of the sum of what limits bound times pushes (M, n), by kind."""
        zero = np.zeros_like(rates[0])
        found = [pushes.get(kind, zero).copy() for kind in LIMIT_KINDS.motion[: len(rates)]]
        if self.Q is None:
            return found
        onto = [pushes.get(kind, zero) for kind in LIMIT_KINDS.effort[: self.Q.order + 1]]
        parts = []
        if self.gravity:
            off = [
                -x * (kind in self.limits.without_gravity) for kind, x in zip(LIMIT_KINDS.effort, onto, strict=False)
            ]
            parts.append(self.gravity.gradients(rates, off[: self.gravity.order + 1]))
        if "power" in pushes:
            found[1] += pushes["power"] * values["Q"]
            onto[0] = onto[0] + pushes["power"] * rates[1]
        if "stall_effort" in pushes:
            found[1] += pushes["stall_effort"] * self.limits.effort_slope
            onto[0] = onto[0] + pushes["stall_effort"]
        for part in (*parts, self.Q.gradients(rates, onto)):
            for gradient, more in zip(found, part, strict=False):
                gradient += more
        return found


def build_barrier(robot: Engine, limits: Limits, kinds: Sequence[str]) -> LimitBarrier:
    """The room within limits of some kinds of the coordinates of a robot, but bounds of 0 of what stands still."""
    joined = zip(*(vars(build_scale(limits.bounds(kind), kind)).values() for kind in kinds), strict=True)
    scale = Scale(*map(np.concatenate, joined))
    finite = {sign: np.isfinite(scale.bound(sign)) & (scale.reach(sign) != 0) for sign in reversed(SIGNS)}
    forces = [kind for kind in kinds if LIMIT_KINDS[kind].force]
    order = max((LIMIT_KINDS[kind].rate for kind in forces), default=0)
    bare = [LIMIT_KINDS[kind].rate for kind in forces if kind in limits.without_gravity]
    return LimitBarrier(
        limits,
        tuple(kinds),
        scale,
        tuple((sign, np.flatnonzero(on)) for sign, on in finite.items() if on.any()),
        max([along.Q_RATE_ORDER, *(motion_order(robot, kind) for kind in kinds)]),
        _compile_force(robot, "inverse_dynamics", order, along.Q_RATE_ORDER) if forces else None,
        _compile_force(robot, "gravity_forces", max(bare), 0) if bare else None,
    )


def _compile_force(robot: Engine, name: QuantityName, order: int, first: int) -> BoundedForce:
    kernels = (backends.compile_ahead(robot, Computation(name, order, product=product)) for product in (None, "vjp"))
    return BoundedForce(order, order + first + 1, *kernels)


@dataclass(frozen=True, eq=False)
class ExcitationSearch:
    """Series of a robot's coordinates, the information that they give and the room that limits leave them.

    `reaches` (order + 1, n) are the bounds of q and its rates, q about its `middle` (n,); where that of a rate is 0,
    the coordinate stands still. A `share` of each limit is used.
    """

    series: Harmonics
    information: Information
    room: LimitBarrier
    middle: np.ndarray
    reaches: np.ndarray
    share: float

    @cached_property
    def basis(self) -> np.ndarray:
        """The series of the free amplitudes at the points of a period."""
        return self.series.basis(self.room.order)

    @cached_property
    def units(self) -> np.ndarray:
        """The largest free amplitudes (free, n) that the limits of q and its rates allow if they are alone."""
        peaks = np.abs(self.basis).max(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):  # of means, whose rates are 0
            ways = self.reaches[:, None, :] / peaks[:, :, None]
        return np.vstack([self.reaches[:1], ways.min(axis=0)[1:]])

    def amplitudes(self, u: np.ndarray) -> np.ndarray:
        """The free amplitudes (free, n) of a vector in their units, about the middle of the range."""
        x = self.units * u.reshape(self.units.shape)
        x[0] += self.middle
        return x

    def rates(self, x: np.ndarray) -> tuple[np.ndarray, ...]:
        """q, qd, ... (points, n) of free amplitudes."""
        return tuple(self.basis @ x)

    def loss(self, u: np.ndarray, weight: float, delta: float) -> tuple[float, np.ndarray]:
        """-log det and the weighted barrier, and the gradient."""
        rates = self.rates(self.amplitudes(u))
        value, gradients = self.information.loss(rates)
        barrier, pushes = self.room.loss(rates, self.share, delta)
        # the chain rule: from the rates of q at points to the amplitudes, over which they are linear
        for k, push in enumerate(pushes):
            pushes[k] = weight * push + (gradients[k] if k < len(gradients) else 0)
        by_amplitude = sum(rate.T @ push for rate, push in zip(self.basis, pushes, strict=True))
        return value + weight * barrier, (self.units * by_amplitude).ravel()

    def find_best(self, starts: int, rng: np.random.Generator, progress: Progress | None) -> np.ndarray:
        """The free amplitudes of the best series from some random ones."""
        found, count = [], len(self.information.names)
        for i in range(starts):
            u = self.random_start(rng)
            for weight, delta in BARRIER_STAGES:
                u = _minimise(self.loss, u, count * weight, delta)
            x = self.amplitudes(u)
            found.append((self.information.log_det(self.rates(x)), i, x))
            if progress is not None:
                progress(i + 1, starts)
        return max(found)[2]

    def random_start(self, rng: np.random.Generator) -> np.ndarray:
        """A random series about a random pose, in the units of amplitudes."""
        u = MAX_START_AMPLITUDE * rng.uniform(-1, 1, self.units.shape)
        u[0] = rng.uniform(-0.5, 0.5, len(self.middle))
        return u.ravel()

    def find_rest(self, rng: np.random.Generator) -> np.ndarray:
        """A pose (n,) in which all limits leave room at rest; raise `JounceError` if none is found."""
        zero = np.zeros((self.room.order, 1, len(self.middle)))

        def rates(u: np.ndarray) -> tuple[np.ndarray, ...]:
            return (self.middle + self.reaches[:1] * u, *zero)

        def barrier(u: np.ndarray) -> tuple[float, np.ndarray]:
            value, gradients = self.room.loss(rates(u), self.share, BARRIER_STAGES[1][1])
            return value, gradients[0][0] * self.reaches[0]

        worst = []
        for i in range(MAX_REST_STARTS):
            u = rng.uniform(-0.8, 0.8, len(self.middle)) if i else np.zeros(len(self.middle))
            u = _minimise(barrier, u)
            worst.append(self.room.worst(rates(u)))  # the barrier's minimum may be beyond a limit
            if worst[-1][0] < self.share:
                return rates(u)[0][0]
        ratio, kind, joint = min(worst)
        what = f"{kind.replace('_', ' ')} of joint {quote_value(self.information.robot.joint_names[joint])}"
        came = f"the {what} takes {ratio:.3g} times its limit at rest, or more"
        cure = f"raise it with {Remedy(f'robot.with_limits({kind}=...)', '--limits FILE')}"
        raise JounceError(f"no pose is found that the limits let the robot hold: {came}; {cure}")


def _minimise(loss: Callable[..., tuple[float, np.ndarray]], u: np.ndarray, *arguments: float) -> np.ndarray:
    """A local minimum of a loss with its gradient, by BFGS: L-BFGS takes half as many steps again."""
    found = minimize(loss, u, arguments, "BFGS", jac=True, options={"maxiter": MAX_BFGS_STEPS, "gtol": MAX_LOSS_SLOPE})
    return np.asarray(found.x)


def motion_reaches(limits: Limits, series: Harmonics, order: int) -> np.ndarray:
    """How far q and its rates may go, (order + 1, n): as limits say, and no rate further than series of such q do.

    A coordinate stands still, with rates 0, if any limit of it leaves no way.
    """
    lower, upper = limits.bounds(LIMIT_KINDS.motion[0])
    found = [(upper - lower) / 2]
    for k, kind in enumerate(LIMIT_KINDS.motion[1 : order + 1], 1):
        common = found[0] * (series.frequency * (series.count + 1) / 2) ** k
        found.append(np.minimum(common, np.abs(limits.bounds(kind)).min(axis=0)))
    return np.stack([found[0], *(np.array(found[1:]) * np.all(found, axis=0))])
