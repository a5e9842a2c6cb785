"""A retiming problem is a path with limits as rows.

The limits are those of a robot along it. `build_problem` is the door: it refuses what no time law can keep, such as a
limit of 0 of a joint that moves or a rate that jumps, and what rows do not hold. `RetimeProblem` places points along
the path, samples the path there, and makes `LimitRows`: each row is a sum of products of sigma's rates (`path_terms`)
between two bounds, at every point, in units of the limit. Rows are built once for each set of points (`build_rows`) and
evaluated in every step of a search for x = sigma'^2; `check_path` refuses paths that leave position limits, or on which
the robot cannot hold itself at rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.engine import along, closed_path
from jounce.engine.engine import Engine, with_mechanism
from jounce.limits import path_terms
from jounce.limits.drive_terms import (
    Friction,
    FrictionAlong,
    MotorTerms,
    PowerAlong,
    acting_friction,
    find_motor_obstacle,
)
from jounce.limits.joints import (
    column_owner,
    drives_coordinates,
    joint_limits,
    joint_names,
    joint_rates,
    joint_units,
    power_factors,
)
from jounce.limits.limited_motion import check_motor_data, known_kinds, motion_order
from jounce.limits.ratios import SIGNS, build_scale
from jounce.model import positions
from jounce.model.limits import LIMIT_KINDS, Limits
from jounce.motion import Motion, joint_matching
from jounce.spatial.series import rate_name

_MAX_BOUND_RATIO = 1e6  # of a bound that is infinite to the stated one: finite for the barrier, and never binding
# Of each product, the highest derivative of x that it takes.
_PRODUCT_JET_ORDERS = (0, 0, 0, 1, 0, 1, 2, 0, 1, 1, 2, 3)
RowBlock = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, tuple[str, ...]]  # factors, bounds, joints, kinds


@dataclass(frozen=True, eq=False)
class LimitRows:
    """R quantities at N points of a path: ``lower <= factors . products <= upper``.

    All are in units of their limits. The rows are built once for each set of points, and evaluated in every step of a
    search for x.

    Attributes
    ----------
    factors : (N, R, K)
        Factors of the K products that occur at all.
    used : (K,)
        The indices of these products.
    lower, upper : (R,)
        The bounds.
    kinds : (R,)
        Of each row the kind of the limit.
    joints : (N, R)
        Of each row and point the index of the coordinate.
    friction : FrictionAlong or None
        Adds products to those of the path, where Coulomb friction acts.
    power : PowerAlong or None
        Adds products after these, where the power of all motors behind springs is limited.
    """

    factors: np.ndarray
    used: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    kinds: tuple[str, ...]
    joints: np.ndarray
    friction: FrictionAlong | None = None
    power: PowerAlong | None = None

    @property
    def further(self) -> list[FrictionAlong | PowerAlong]:
        """Return what adds products to those of the path, in their order."""
        return [x for x in (self.friction, self.power) if x is not None]

    @property
    def jet(self) -> int:
        """Return how many of x, x', x'', x''' the rows take."""
        highest = sum((x.highest_jet for x in self.further), _PRODUCT_JET_ORDERS)
        return 1 + max((highest[k] for k in self.used), default=0)

    def values(self, jet: np.ndarray) -> np.ndarray:
        """Evaluate the rows (N, R) at jets (4, N)."""
        products = path_terms.products(jet)
        if len(self.further) > 0:
            products = np.concatenate([products, *(x.products(jet) for x in self.further)])
        # At each point (R, K) factors times the K products: (N, R, K) (N, K, 1) -> (N, R).
        return np.matmul(self.factors, products[self.used].T[:, :, None])[:, :, 0]

    def derivatives(self, jet: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Evaluate the derivatives of the products with respect to the jets.

        Returns gradients (K, J, N) and Hessians (K, J, J, N) for the J entries of jets that the rows take.
        """
        first, second = path_terms.derivatives(jet)
        for further in self.further:
            parts = zip((first, second), further.derivatives(jet), strict=True)
            first, second = (np.concatenate(pair) for pair in parts)
        return first[self.used, : self.jet], second[self.used, : self.jet, : self.jet]

    def uniform(self, speed: float) -> np.ndarray:
        """Evaluate the rows (N, R) at a uniform speed.

        A speed of 0 is rest.
        """
        jet = np.zeros((path_terms.JET_SIZE, len(self.factors)))
        jet[0] = speed**2
        return self.values(jet)

    def excess(self, jet: np.ndarray) -> np.ndarray:
        """Return by how much the rows leave their bounds.

        The excess (N, R) at jets (4, N) is negative within the bounds, and infinite where x <= 0.
        """
        possible = jet[0] > 0
        # Roots of x <= 0 do not exist: any x > 0 stands in for it.
        values = self.values(np.where(possible, jet, 1.0))
        return np.where(possible[:, None], np.maximum(values - self.upper, self.lower - values), np.inf)

    def select(self, points: np.ndarray | slice) -> "LimitRows":
        """Return the rows at some of the points."""
        friction = None if self.friction is None else self.friction.select(points)
        power = None if self.power is None else self.power.select(points)
        return replace(self, factors=self.factors[points], joints=self.joints[points], friction=friction, power=power)

    def widen(self, by: float) -> "LimitRows":
        """Return the rows with wider bounds."""
        return replace(self, lower=self.lower - by, upper=self.upper + by)

    def nearness(self, jet: np.ndarray) -> np.ndarray:
        """Return the rows (N, R) as shares of the bounds.

        A share is 1 on a bound; jets are (4, N).
        """
        return build_scale(np.stack([self.lower, self.upper])).largest(self.values(jet))


def build_rows(
    path: path_terms.Path,
    limits: Limits,
    share: float,
    fastest: float,
    friction: Friction | None = None,
    motors: MotorTerms | None = None,
) -> LimitRows:
    """Build the rows of all finite limits at points of a path.

    They are those of the coordinates. Each limit is taken to a share of itself. `friction` acts in addition to the
    forces of the path, or to those of `motors`, whose limits count where there are any.

    The velocity limits are one row, (q' / v)^2 x of the joint that is nearest to its own; x itself stays below the
    square of `fastest`, so that a rest of the motion does not make it infinite: that is of the joint -1.
    """
    kinds = [
        kind
        for kind in limits.kinds
        if kind not in ("position", "velocity") and (motors is not None or not LIMIT_KINDS[kind].takes)
    ]
    friction_along = _friction_along(path, kinds, friction, motors)
    # Products are those of the path, and after them those of friction, one for each kind and joint that rubs.
    products = len(path_terms.PRODUCT_POWERS)
    if friction_along is not None:
        products += len(friction_along.highest_jet)
    power = _motor_power(path, kinds, motors)
    of_motors, first_power = () if power is None else power.kinds, products
    products += len(of_motors)
    blocks: list[RowBlock] = [_velocity_row(path, limits.bounds("velocity") * share, fastest, products)]
    for kind in kinds:
        if kind in of_motors:
            # Each is one product by itself, in one column.
            terms = {first_power + of_motors.index(kind): np.ones((len(path.q[0]), 1))}
        else:
            terms = limit_terms(path, kind, limits, motors)
            if friction_along is not None:
                terms |= friction_along.terms(kind, _friction_shares(path, kind, motors))
            if LIMIT_KINDS[kind].is_total:
                terms = {k: term[:, path.driven].sum(axis=1, keepdims=True) for k, term in terms.items()}
        blocks.append(_scale_rows(kind, terms, limits.bounds(kind) * share, products))
    # Join the blocks, and leave out the products that no row takes.
    factors = np.concatenate([block[0] for block in blocks], axis=1)
    used = np.flatnonzero(np.any(factors, axis=(0, 1)))
    lower, upper = (np.concatenate([block[k] for block in blocks]) for k in (1, 2))
    joints = np.concatenate([block[3] for block in blocks], axis=1)
    kind_of_row = tuple(kind for block in blocks for kind in block[4])
    factors = np.ascontiguousarray(factors[:, :, used])
    return LimitRows(factors, used, lower, upper, kind_of_row, joints, friction_along, power)


def _friction_shares(path: path_terms.Path, kind: str, motors: MotorTerms | None) -> np.ndarray:
    """Return what a unit of friction adds to limited values.

    It adds to a force 1, to a power q', and to what limits of a motor bound its share of tau.
    """
    if LIMIT_KINDS[kind].of == "P":
        return path.q[1]
    if motors is not None and LIMIT_KINDS[kind].takes:
        return motors.shares(kind)[0]
    return np.ones(path.q[1].shape[1])


def _motor_power(path: path_terms.Path, kinds: Sequence[str], motors: MotorTerms | None) -> PowerAlong | None:
    """Return the powers of all motors behind springs that are limited."""
    totals = tuple(kind for kind in kinds if LIMIT_KINDS[kind].is_total)
    return None if motors is None or len(totals) == 0 else motors.power(path, totals)


def _friction_along(
    path: path_terms.Path, kinds: Sequence[str], friction: Friction | None, motors: MotorTerms | None
) -> FrictionAlong | None:
    """Return the friction that enters limits of some kinds.

    Where motors are limited, it is that of the motors.
    """
    with_friction = [kind for kind in kinds if LIMIT_KINDS[kind].force or kind == "total_power"]
    if motors is not None:
        with_friction = [kind for kind in kinds if "motor_torques" in LIMIT_KINDS[kind].takes]
    if friction is None or len(with_friction) == 0:
        return None
    # Friction, its rate and its second rate take qd, q2d and q3d, as far as the path has them; that of motors thetad.
    rates = [path.rate(k) for k in range(1, min(4, len(path.q)))]
    if motors is not None:
        rates = [motors.position(path, 1)]
    return friction.along(rates, tuple(with_friction))


def limit_terms(path: path_terms.Path, kind: str, limits: Limits, motors: MotorTerms | None) -> path_terms.Terms:
    """Return the terms of what limits of a kind bound, without friction.

    Of a sum over all joints they are those of each, which `build_rows` adds.
    """
    row = LIMIT_KINDS[kind]
    if row.takes and motors:
        return motors.terms(path, kind)
    if row.of == "q":
        return path.rate(row.rate)
    if row.of == "P":
        return path.power()
    force = path.force(row.rate, kind in limits.without_gravity)
    if row.line:
        # A limit that falls with speed bounds Q + slope qd, and qd = q' s1.
        return force | {path_terms.S1: force[path_terms.S1] + limits.effort_slope * path.q[1]}
    return force


def _scale_rows(kind: str, terms: path_terms.Terms, bounds: np.ndarray, products: int) -> RowBlock:
    """Build the rows of a kind of limit, in units of it."""
    # {product: (N, n)} -> (N, n, products)
    [points, n] = next(iter(terms.values())).shape
    factors = np.zeros((points, n, products))
    for k, term in terms.items():
        factors[:, :, k] = term
    # A joint with a limit of 0 does not move (`_check_zero`): its row would be 0 between two zeros.
    limited = np.flatnonzero(np.isfinite(bounds).any(axis=0) & bounds.any(axis=0))
    lower, upper = bounds[:, limited]
    # The unit is half the distance of two bounds, or the one bound that is finite.
    size = np.where(np.isfinite(upper), upper, 0) - np.where(np.isfinite(lower), lower, 0)
    scale = np.where(np.isfinite(upper) & np.isfinite(lower), size / 2, size)
    joints = np.broadcast_to(limited, (points, len(limited)))
    return (
        factors[:, limited] / scale[:, None],
        (lower / scale).clip(-_MAX_BOUND_RATIO),
        (upper / scale).clip(max=_MAX_BOUND_RATIO),
        joints,
        (kind,) * len(limited),
    )


def _velocity_row(path: path_terms.Path, bounds: np.ndarray, fastest: float, products: int) -> RowBlock:
    """Build the row of all velocity limits.

    The row is max (q' / v)^2 x <= 1, with 1 / fastest^2 as the least factor.
    """
    rate = path.q[1]
    ratio = build_scale(bounds, "velocity").largest(rate)
    factors = np.zeros((len(rate), 1, products))
    factors[:, 0, path_terms.S1_2] = np.maximum(ratio.max(axis=1), 1 / fastest) ** 2
    # Where every joint is so slow that x reaches the square of `fastest` first, no joint decides.
    joints = np.where(ratio.max(axis=1) * fastest < 1, -1, ratio.argmax(axis=1))
    one = np.ones(1)
    return factors, -_MAX_BOUND_RATIO * one, one, joints[:, None], ("velocity",)


# The problem, checked.
_REST_VELOCITY_SHARE = 1e-6  # of the largest velocity of the motion: slower than this, it rests
_MIN_UNIFORM_SPEED, MAX_UNIFORM_SPEED = 1e-9, 1e9  # times the speed of the motion: beyond them no limit decides
_PATH_ROUNDING = 1e-9  # of a position, or of the largest value of a rate that jumps: what computing them may leave


@dataclass(frozen=True, eq=False)
class RetimeProblem:
    """A motion to be retimed, with the limits of its coordinates.

    The limits are taken to `share` of themselves. `order` is that of the rates of Q that the limits take, `moving`
    whether the motion moves at its start and its end: its velocity and acceleration remain there. `robot` has no
    Coulomb friction, which is `friction`: that of `motors` where these are limited.
    """

    robot: Engine
    motion: Motion
    limits: Limits
    share: float
    order: int
    moving: tuple[bool, bool]
    friction: Friction | None
    motors: MotorTerms | None = None

    @cached_property
    def breaks(self) -> np.ndarray:
        """Return where a rate of q that limits take jumps.

        What limits bound has a kink there, and also where the next higher rate jumps.
        """
        return np.unique([motion_break.t for motion_break in self.motion.breaks_to(self.order + 3)])

    def points(self, count: int) -> tuple[np.ndarray, int]:
        """Return points of the path: even ones, turns and breaks.

        `count` points are even; more are near the turns of joints with friction. The breaks come last, once for the
        left side and once for the right. The number returned is that of the points without the breaks.
        """
        sigma = np.linspace(self.motion.start, self.motion.stop, count)
        if self.friction is not None:
            # Friction changes fastest where its joints turn round.
            closure = self.robot.mechanism.closure
            columns = list(range(self.robot.n)) if closure is None else list(closure.independent)
            sigma = np.union1d(sigma, self.friction.turns(self.motion, columns, count))
        return np.concatenate([sigma, self.breaks, self.breaks]), len(sigma)

    def path(self, sigma: np.ndarray, count: int) -> path_terms.Path:
        """Sample the path at `points`.

        The first `count` of them are no breaks.
        """
        path = path_terms.sample_path(self.robot, self.motion, sigma[:count], self.order)
        # In the order of `points`: what ends at the breaks, then what begins there.
        for left in (True, False):
            if self.breaks.size > 0:
                path = path.join_points(path_terms.sample_path(self.robot, self.motion, self.breaks, self.order, left))
        return path

    def rows_at(self, sigma: np.ndarray, fastest: float) -> LimitRows:
        """Return the limits at some points of the path, no breaks."""
        return self.rows(path_terms.sample_path(self.robot, self.motion, sigma, self.order), fastest)

    def rows(self, path: path_terms.Path, fastest: float) -> LimitRows:
        """Return the limits along a path.

        x stays below the square of `fastest`.
        """
        return build_rows(path, self.limits, self.share, fastest, self.friction, self.motors)

    def uniform_speed(self, path: path_terms.Path) -> float:
        """Find the largest speed of a uniform time law within all limits.

        Feasible speeds may be several intervals; the result ends the one that is found first from 1 on.
        """
        rows = self.rows(path, MAX_UNIFORM_SPEED)

        def feasible(speed: float) -> bool:
            values = rows.uniform(speed)
            return bool((values < rows.upper).all() and (values > rows.lower).all())

        # In steps of a tenth: fall until a speed is feasible, then rise as long as it stays so.
        speed = 1.0
        while not feasible(speed) and speed > _MIN_UNIFORM_SPEED:
            speed /= 1.1
        while feasible(1.1 * speed) and speed < MAX_UNIFORM_SPEED:
            speed *= 1.1
        if speed >= MAX_UNIFORM_SPEED:
            raise self.unbounded_error()
        if speed <= _MIN_UNIFORM_SPEED:
            raise self._stuck_error(rows)
        # Between this speed and the next one, which is not feasible, bisection finds the end.
        low, high = speed, 1.1 * speed
        for _ in range(40):
            middle = (low + high) / 2
            low, high = (middle, high) if feasible(middle) else (low, middle)
        return low

    def unbounded_error(self) -> JounceError:
        """Return the error of a path without any speed limit."""
        velocity = self.limits.bounds("velocity")
        free = [name for j, name in enumerate(joint_names(self.robot.mechanism)) if np.isinf(velocity[:, j]).all()]
        joints = [quote_value(name) for name in free if name in self.robot.joint_names]
        missing = f"; velocity limits are missing for {join_names(joints)}" if len(joints) > 0 else ""
        return JounceError(
            f"no limit bounds the speed along part of the path{missing}: state one with"
            f" {Remedy('robot.with_limits(velocity=...)', '--limits')}"
        )

    def _stuck_error(self, rows: LimitRows) -> JounceError:
        """Return the error where every uniform speed breaks a limit.

        The error names the limit that is exceeded most at rest.
        """
        values = rows.uniform(0.0)
        values = np.maximum(values - rows.upper, rows.lower - values)
        point, row = np.unravel_index(values.argmax(), values.shape)
        owner = column_owner(self.robot.mechanism, rows.kinds[row], int(rows.joints[point, row]))
        return JounceError(f"the {rows.kinds[row]} limit of {owner} leaves no room to move; raise it")


def build_problem(robot: Engine, motion: Motion, share: float) -> RetimeProblem:
    """Build the problem of a motion of a robot's joints.

    What no time law can keep is refused.
    """
    if motion.duration == 0:
        raise JounceError(
            f"the motion is one state at t = {motion.start:g} s; expected a path, a motion that lasts some time"
        )
    limits = joint_limits(robot.mechanism)
    kinds = [kind for kind in known_kinds(robot, limits) if kind != "position"]
    motors = _limited_motors(robot, kinds)
    forces = [kind for kind in kinds if LIMIT_KINDS[kind].force]
    # Forces along a path are those of the coordinates: motors elsewhere in loops are refused.
    if len(forces) > 0 and robot.mechanism.takes_dependent and not drives_coordinates(robot.mechanism):
        bounds, names = limits.bounds(forces[0]), joint_names(robot.mechanism)
        bounded = [name for j, name in enumerate(names) if np.isfinite(bounds[:, j]).any()]
        cure = _describe_removal(f"{forces[0]}=dict.fromkeys({bounded}, float('inf'))")
        raise JounceError(
            f"retime supports limits of {join_names(forces)} only where motors are at the coordinates,"
            f" {join_names(robot.joint_names)}; {cure}"
        )
    _check_zero(robot, motion, limits, kinds)
    if len(kinds) == 0:
        raise JounceError(
            f"{quote_value(robot.name)} has no limit of velocity, acceleration, ... or effort;"
            f" state them with {Remedy('robot.with_limits(velocity=..., effort=..., ...)', '--limits FILE|ARM')}"
        )
    # The limit that takes the highest rate of q says how smooth the motion must be, and how many rates of Q there are.
    needs = {kind: motion_order(robot, kind) for kind in kinds}
    highest = max(kinds, key=needs.__getitem__)
    _check_breaks(motion, robot.joint_names, needs[highest], highest)
    friction = _supported_friction(robot)
    if motors is not None:
        friction = motors.friction()
    order, moving = max(0, needs[highest] - along.Q_RATE_ORDER), _find_moving_ends(motion)
    return RetimeProblem(without_friction(robot), motion, limits, share, order, moving, friction, motors)


def _describe_removal(infinite: str) -> str:
    """Return the cure for unsupported limits, by the arguments that remove them."""
    keep = Remedy("robot.slowdown keeps them", "jounce slowdown keeps them")
    return f"remove them{Remedy(f', robot.with_limits({infinite})')}, and check the result with them: {keep}"


def _select_drives(*terms: str) -> Remedy:
    """Return the cure that keeps only some terms of the drives."""
    return Remedy(f"robot.with_drives({list(terms)})", f"--drives {','.join(terms)}")


def _limited_motors(robot: Engine, kinds: Sequence[str]) -> MotorTerms | None:
    """Return the motors of a robot whose limits count.

    Returns None where none of the kinds bounds them. Springs that are not linear are refused.
    """
    m, e = robot.mechanism, robot.mechanism.elasticity
    limited = [kind for kind in kinds if LIMIT_KINDS[kind].takes or LIMIT_KINDS[kind].is_total]
    if len(limited) == 0 or e is None:
        return None
    check_motor_data(robot, limited)
    obstacle = find_motor_obstacle(e, [*limited, *(factor for kind in limited for factor in power_factors(m, kind))])
    if obstacle is not None:
        cure = ", ".join(f"{kind}=float('inf')" for kind in limited)
        raise JounceError(
            f"retime does not support limits of motors ({join_names(limited)}) with {obstacle};"
            f" {_describe_removal(cure)}"
        )
    return MotorTerms(m, e)


def check_path(problem: RetimeProblem, sigma: np.ndarray, path: path_terms.Path) -> None:
    """Raise `JounceError` where no time law can keep the limits.

    The path does not move, leaves position limits, or rests beyond an effort limit.
    """
    if not np.any(path.q[1]):
        raise JounceError("the path does not move: every joint rests all the time; expected a motion of some joint")
    names = positions.extent_names(problem.robot.mechanism.tree)
    units = joint_units(problem.robot.mechanism)
    lower, upper = problem.limits.bounds("position")
    # Rounding of positions is not outside.
    slack = _PATH_ROUNDING * np.maximum(1, np.abs(path.q[0]).max(axis=0))
    outside = np.argwhere((path.q[0] < lower - slack) | (path.q[0] > upper + slack))
    if len(outside) > 0:
        i, j = outside[0]
        moment = joint_matching.describe_moment(problem.motion, sigma[i])
        raise JounceError(
            f"joint {quote_value(names[j])} leaves its position limits {moment}:"
            f" {path.q[0][i, j]:g} {units[j]} is outside of {lower[j]:g} to {upper[j]:g};"
            f" no time law changes that, expected another path{_lines_cure(problem.motion)}"
        )
    # At rest friction, damping and inertia are 0: gravity, springs and wrenches alone have to be held.
    for kind in known_kinds(problem.robot, problem.limits):
        if LIMIT_KINDS[kind].of != "q":
            _check_static(problem, kind, sigma, path)


def _lines_cure(motion: Motion) -> str:
    """Return the cure for a smooth path beyond its points."""
    if not joint_matching.is_along_points(motion):
        return ""
    return f"; straight lines stay within{Remedy(': tolerance=', ': --tolerance')}"


def _check_static(problem: RetimeProblem, kind: str, sigma: np.ndarray, path: path_terms.Path) -> None:
    """Raise `JounceError` where a joint at rest reaches a limit.

    The limit is one of its force or motor.
    """
    power = _motor_power(path, [kind], problem.motors)
    static = limit_terms(path, kind, problem.limits, problem.motors).get(path_terms.ONE)
    if LIMIT_KINDS[kind].is_total:
        # At rest only windings take power.
        static = None if power is None else power.static.T
    if static is None:
        return
    lower, upper = problem.limits.bounds(kind) * problem.share
    over = np.argwhere((static <= lower) | (static >= upper))
    if len(over) == 0:
        return
    i, j = over[0]
    unit = LIMIT_KINDS[kind].unit(joint_units(problem.robot.mechanism)[j])
    bound = problem.limits.bounds(kind)[int(static[i, j] > 0), j]
    share = f" ({problem.share:.0%} of it are used: margin)" if abs(static[i, j]) < abs(bound) else ""
    owner = column_owner(problem.robot.mechanism, kind, j)
    moment = joint_matching.describe_moment(problem.motion, sigma[i])
    raise JounceError(
        f"{owner} holds {static[i, j]:.6g} {unit} at rest {moment};"
        f" its {kind.replace('_', ' ')} limit is {bound:.6g} {unit}{share}, and a slower motion does not help"
    )


def _check_zero(robot: Engine, motion: Motion, limits: Limits, kinds: Sequence[str]) -> None:
    """Raise `JounceError` where a joint that moves has a limit of 0.

    A velocity limit of 0 on one side counts only where the joint moves that way.
    """
    t = np.linspace(motion.start, motion.stop, 101)
    velocity = joint_rates(robot, motion(t, 1), closed_path.continue_positions(robot, motion, t))[1]
    least = _REST_VELOCITY_SHARE * np.abs(velocity).max()
    # Which joints move forwards and backwards, and which bounds are 0, (2, n) each.
    moves = np.stack([(sign * velocity > least).any(axis=0) for sign in SIGNS])
    for kind in kinds:
        is_total, scale = LIMIT_KINDS[kind].is_total, build_scale(limits.bounds(kind), kind)
        zero = np.stack([scale.bound(sign) <= 0 for sign in SIGNS])
        # A velocity limit stops the joint on its side. From rest to rest a joint takes accelerations of both signs, so
        # that one of 0 is enough to stop it. Forces may be of one sign all the time: both bounds have to be 0.
        if kind == "velocity":
            stopped = (moves & zero).any(axis=0)
        elif kind == "acceleration" and not any(_find_moving_ends(motion)):
            stopped = moves.any(axis=0) & zero.any(axis=0)
        else:
            stopped = (moves.any() if is_total else moves.any(axis=0)) & zero.all(axis=0)
        for j in np.flatnonzero(stopped).tolist():
            way, owner = "" if zero[:, j].all() else " on one side", column_owner(robot.mechanism, kind, j)
            raise JounceError(f"the {kind} limit of {owner} is 0{way}, and {'it' if is_total else 'the joint'} moves")


def _find_moving_ends(motion: Motion) -> tuple[bool, bool]:
    """Whether a motion moves at its start and at its end."""
    sigma = np.linspace(motion.start, motion.stop, 101)
    speed = np.abs(motion(sigma, 1)[1]).max(axis=1)
    return bool(speed[0] > _REST_VELOCITY_SHARE * speed.max()), bool(speed[-1] > _REST_VELOCITY_SHARE * speed.max())


def _check_breaks(motion: Motion, names: Sequence[str], rate: int, kind: str) -> None:
    """Raise `JounceError` where a rate jumps that has to be smooth.

    A limit of a rate of q cannot be met where a lower rate jumps.
    """
    peaks = [np.abs(x).max() for x in motion(np.linspace(motion.start, motion.stop, 101), rate - 1)]
    # Jumps of q by rounding do not count; breaks of loads and bases count whatever their size.
    real = [
        motion_break
        for motion_break in motion.breaks_to(rate - 1)
        if motion_break.symbol != "q" or abs(motion_break.jump) > _PATH_ROUNDING * peaks[motion_break.order]
    ]
    if len(real) > 0:
        first = real[0]
        joint = quote_value(first.joint if isinstance(first.joint, str) else names[first.joint])
        what = (
            f"{rate_name('q', first.order)} of joint {joint}" if first.symbol == "q" else f"{joint}, or a rate of it,"
        )
        subject = LIMIT_KINDS[kind].symbol if kind in LIMIT_KINDS.effort else f"the {kind}"
        raise JounceError(
            f"{what} jumps at t = {first.t:g} s, where {subject}"
            f" of every time law is infinite;"
            f" {Remedy(f'retime motion.blended(time, continuity={rate})', 'use --blend S')} to meet {kind} limits"
        )


def without_friction(robot: Engine) -> Engine:
    """Return the robot without Coulomb friction, the same one where none acts.

    The same one has the kernels that were made for it already.
    """
    m = robot.mechanism
    if "friction" not in m.acting:
        return robot
    return with_mechanism(robot, replace(m, acting=tuple(term for term in m.acting if term != "friction")))


def _supported_friction(robot: Engine) -> Friction | None:
    """Return the Coulomb friction that acts, if it is supported.

    That of joints that follow others in closed loops is refused.
    """
    m = robot.mechanism
    friction = acting_friction(m)
    if friction is not None and friction.others:
        raise JounceError(
            "retime does not support Stribeck friction and load_friction; omit them,"
            f" {_select_drives('armature', 'damping', 'friction', 'spring', 'offset')}, and check the result with them"
        )
    if friction is None or m.closure is None:
        return friction
    # Columns of the tree that rub, but are no coordinates of the robot.
    columns = np.flatnonzero(friction.ratios.any(axis=0))
    passive = [joint_names(m)[j] for j in columns if joint_names(m)[j] not in m.coordinates]
    if len(passive) > 0:
        raise JounceError(
            "retime does not support Coulomb friction of joints that follow others in closed loops"
            f" ({join_names(passive)}); omit it,"
            f" {_select_drives('armature', 'damping', 'spring', 'offset')}, and check the result with it"
        )
    return friction
