"""A retiming problem is the path of a motion with the limits of a robot along it as rows.

`build_problem` is the door: it refuses what no time law can keep, such as a limit of 0 of a joint that moves or a rate
that jumps, and what rows do not hold. `RetimeProblem` places points along the path, samples the path there, and makes
`LimitRows`: each row is a sum of products of sigma's rates (`path_terms`) between two bounds, at every point, in units
of the limit. Rows are built once for each set of points (`build_rows`) and evaluated in every step of a search for
x = sigma'^2; `check_path` refuses paths that leave position limits, or on which the robot cannot hold itself at rest.
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
from jounce.limits.drive_terms import Friction, FrictionAlong, MotorTerms, acting_friction, find_motor_obstacle
from jounce.limits.joints import drives_coordinates, joint_limits, joint_names, joint_rates, joint_units
from jounce.limits.limited_motion import check_motor_data, known_kinds, motion_order
from jounce.limits.ratios import SIGNS, build_scale
from jounce.model import positions
from jounce.model.limits import LIMIT_KINDS, Limits
from jounce.motion import Motion
from jounce.spatial.series import rate_name

_MAX_BOUND_RATIO = 1e6  # of a bound that is infinite to the stated one: finite for the barrier, and never binding
# Of each product, the highest derivative of x that it takes.
_PRODUCT_JET_ORDERS = (0, 0, 0, 1, 0, 1, 2, 0, 1, 1, 2, 3)
RowBlock = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, tuple[str, ...]]  # factors, bounds, joints, kinds


@dataclass(frozen=True, eq=False)
class LimitRows:
    """R quantities at N points of a path: ``lower <= factors . products <= upper``, all in units of their limits.

    Attributes
    ----------
    factors : (N, R, K)
        Of the K products that occur at all.
    used : (K,)
        The indices of these products.
    lower, upper : (R,)
        The bounds.
    kinds : (R,)
        Of each row the kind of the limit.
    joints : (N, R)
        Of each row and point the index of the coordinate.
    friction : FrictionAlong or None
        What adds products to those of the path, where Coulomb friction acts.
    """

    factors: np.ndarray
    used: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    kinds: tuple[str, ...]
    joints: np.ndarray
    friction: FrictionAlong | None = None

    @property
    def jet(self) -> int:
        """How many of x, x', x'', x''' the rows take."""
        highest = _PRODUCT_JET_ORDERS + (self.friction.highest_jet if self.friction else ())
        return 1 + max((highest[k] for k in self.used), default=0)

    def values(self, jet: np.ndarray) -> np.ndarray:
        """The rows (N, R) at jets (4, N)."""
        products = path_terms.products(jet)
        if self.friction:
            products = np.concatenate([products, self.friction.products(jet)])
        return np.matmul(self.factors, products[self.used].T[:, :, None])[:, :, 0]

    def derivatives(self, jet: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradients (K, J, N) and Hessians (K, J, J, N) of the products with respect to what the rows take of jets."""
        first, second = path_terms.derivatives(jet)
        if self.friction:
            parts = zip((first, second), self.friction.derivatives(jet), strict=True)
            first, second = (np.concatenate(pair) for pair in parts)
        return first[self.used, : self.jet], second[self.used, : self.jet, : self.jet]

    def uniform(self, speed: float) -> np.ndarray:
        """The rows (N, R) at a uniform speed, 0 for those at rest."""
        jet = np.zeros((path_terms.JET_SIZE, len(self.factors)))
        jet[0] = speed**2
        return self.values(jet)

    def excess(self, jet: np.ndarray) -> np.ndarray:
        """By how much the rows (N, R) leave their bounds at jets (4, N); negative within, infinite where x <= 0."""
        possible = jet[0] > 0
        values = self.values(np.where(possible, jet, 1.0))
        return np.where(possible[:, None], np.maximum(values - self.upper, self.lower - values), np.inf)

    def select(self, points: np.ndarray | slice) -> "LimitRows":
        """The rows at some of the points."""
        friction = self.friction and self.friction.select(points)
        return replace(self, factors=self.factors[points], joints=self.joints[points], friction=friction)

    def widen(self, by: float) -> "LimitRows":
        """The rows with wider bounds."""
        return replace(self, lower=self.lower - by, upper=self.upper + by)

    def nearness(self, jet: np.ndarray) -> np.ndarray:
        """The rows (N, R) at jets (4, N) as shares of the bounds: 1 on a bound."""
        return build_scale(np.stack([self.lower, self.upper])).largest(self.values(jet))


def build_rows(
    path: path_terms.Path,
    limits: Limits,
    share: float,
    fastest: float,
    friction: Friction | None = None,
    motors: MotorTerms | None = None,
) -> LimitRows:
    """The rows of all finite limits of the coordinates, each taken to a share of itself, at the points of a path.

    `friction` acts in addition to the forces of the path, or to those of `motors`, whose limits count where there are
    any.

    The velocity limits are one row, (q' / v)^2 x of the joint that is nearest to its own; x itself stays below the
    square of `fastest`, so that a rest of the motion does not make it infinite: that is of the joint -1.
    """
    kinds = [
        kind
        for kind in limits.kinds
        if kind not in ("position", "velocity") and (motors or not LIMIT_KINDS[kind].takes)
    ]
    rubbing = _friction_along(path, kinds, friction, motors)
    size = len(path_terms.PRODUCT_POWERS) + (len(rubbing.highest_jet) if rubbing else 0)
    found: list[RowBlock] = [_velocity_row(path, limits.bounds("velocity") * share, fastest, size)]
    for kind in kinds:
        terms = limit_terms(path, kind, limits, motors)
        if rubbing:
            shares = motors.shares(kind)[0] if motors and LIMIT_KINDS[kind].takes else np.ones(path.q[1].shape[1])
            terms |= rubbing.terms(kind, path.q[1] if kind == "power" else shares)
        found.append(_scale_rows(kind, terms, limits.bounds(kind) * share, size))
    factors = np.concatenate([rows[0] for rows in found], axis=1)
    used = np.flatnonzero(np.any(factors, axis=(0, 1)))
    lower, upper = (np.concatenate([rows[k] for rows in found]) for k in (1, 2))
    joints = np.concatenate([rows[3] for rows in found], axis=1)
    of = tuple(kind for rows in found for kind in rows[4])
    return LimitRows(np.ascontiguousarray(factors[:, :, used]), used, lower, upper, of, joints, rubbing)


def _friction_along(
    path: path_terms.Path, kinds: Sequence[str], friction: Friction | None, motors: MotorTerms | None
) -> FrictionAlong | None:
    """The friction that enters limits of some kinds: that of the motors, where these are limited."""
    rubbed = [k for k in kinds if ("motor_torques" in LIMIT_KINDS[k].takes if motors else LIMIT_KINDS[k].force)]
    if not friction or not rubbed:
        return None
    rates = [motors.position(path, 1)] if motors else [path.rate(k) for k in range(1, min(4, len(path.q)))]
    return friction.along(rates, tuple(rubbed))


def limit_terms(path: path_terms.Path, kind: str, limits: Limits, motors: MotorTerms | None) -> path_terms.Terms:
    """The terms of what limits of a kind bound, without friction."""
    row = LIMIT_KINDS[kind]
    if row.takes and motors:
        return motors.terms(path, kind)
    if row.of == "q":
        return path.rate(row.rate)
    if kind == "power":
        return path.power()
    force = path.force(row.rate, kind in limits.without_gravity)
    return force | {path_terms.S1: force[path_terms.S1] + limits.effort_slope * path.q[1]} if row.line else force


def _scale_rows(kind: str, terms: path_terms.Terms, bounds: np.ndarray, products: int) -> RowBlock:
    [points, n] = next(iter(terms.values())).shape
    factors = np.zeros((points, n, products))
    for k, term in terms.items():
        factors[:, :, k] = term
    limited = np.flatnonzero(np.isfinite(bounds).any(axis=0) & bounds.any(axis=0))  # a limit of 0: it does not move
    lower, upper = bounds[:, limited]
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
    rate = path.q[1]
    ratio = build_scale(bounds, "velocity").largest(rate)
    factors = np.zeros((len(rate), 1, products))
    factors[:, 0, path_terms.S1_2] = np.maximum(ratio.max(axis=1), 1 / fastest) ** 2
    joints = np.where(ratio.max(axis=1) * fastest < 1, -1, ratio.argmax(axis=1))
    one = np.ones(1)
    return factors, -_MAX_BOUND_RATIO * one, one, joints[:, None], ("velocity",)


# The problem, checked.
_REST_VELOCITY_SHARE = 1e-6  # of the largest velocity of the motion: slower than this, it rests
_MIN_UNIFORM_SPEED, MAX_UNIFORM_SPEED = 1e-9, 1e9  # times the speed of the motion: beyond them no limit decides
_PATH_ROUNDING = 1e-9  # of a position, or of the largest value of a rate that jumps: what computing them may leave


@dataclass(frozen=True, eq=False)
class RetimeProblem:
    """A motion whose path is retimed, the limits of its coordinates, and the share of them that may be used.

    `order` is that of the rates of Q that the limits take, `moving` whether the motion moves at its start and its end:
    its velocity and acceleration remain there. `robot` has no Coulomb friction, which is `friction`: that of `motors`
    where these are limited.
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
        """Where a rate of q that the limits take jumps, or the next one: what they bound has a kink there."""
        return np.unique([found.t for found in self.motion.breaks_to(self.order + 3)])

    def points(self, count: int) -> tuple[np.ndarray, int]:
        """`count` even points of the path and more where joints with friction turn round, then its breaks twice.

        The number returned is that of the points without the breaks, which stand for before and after each.
        """
        even = np.linspace(self.motion.start, self.motion.stop, count)
        if self.friction:
            own = self.robot.mechanism.closure
            columns = list(own.independent) if own else list(range(self.robot.n))
            even = np.union1d(even, self.friction.turns(self.motion, columns, count))
        return np.concatenate([even, self.breaks, self.breaks]), len(even)

    def path(self, sigma: np.ndarray, count: int) -> path_terms.Path:
        """The path at `points`, of which the first `count` are no breaks."""
        path = path_terms.sample_path(self.robot, self.motion, sigma[:count], self.order)
        for left in (True, False):
            if self.breaks.size:
                path = path.join_points(path_terms.sample_path(self.robot, self.motion, self.breaks, self.order, left))
        return path

    def rows_at(self, sigma: np.ndarray, fastest: float) -> LimitRows:
        """The limits at some points of the path, no breaks."""
        return self.rows(path_terms.sample_path(self.robot, self.motion, sigma, self.order), fastest)

    def rows(self, path: path_terms.Path, fastest: float) -> LimitRows:
        """The limits along a path, x below the square of `fastest`."""
        return build_rows(path, self.limits, self.share, fastest, self.friction, self.motors)

    def uniform_speed(self, path: path_terms.Path) -> float:
        """The speed of a uniform time law within all limits: of an interval of such speeds the fastest."""
        rows = self.rows(path, MAX_UNIFORM_SPEED)

        def feasible(speed: float) -> bool:
            values = rows.uniform(speed)
            return bool((values < rows.upper).all() and (values > rows.lower).all())

        speed = 1.0
        while not feasible(speed) and speed > _MIN_UNIFORM_SPEED:
            speed /= 1.1
        while feasible(1.1 * speed) and speed < MAX_UNIFORM_SPEED:
            speed *= 1.1
        if speed >= MAX_UNIFORM_SPEED or speed <= _MIN_UNIFORM_SPEED:
            raise self.unbounded_error() if speed >= MAX_UNIFORM_SPEED else self._stuck_error(rows)
        low, high = speed, 1.1 * speed
        for _ in range(40):
            middle = (low + high) / 2
            low, high = (middle, high) if feasible(middle) else (low, middle)
        return low

    def unbounded_error(self) -> JounceError:
        """The error where no limit keeps a path from being passed at any speed."""
        velocity = self.limits.bounds("velocity")
        free = [name for j, name in enumerate(joint_names(self.robot.mechanism)) if np.isinf(velocity[:, j]).all()]
        joints = [quote_value(name) for name in free if name in self.robot.joint_names]
        missing = f"; velocity limits are missing for {join_names(joints)}" if joints else ""
        return JounceError(
            f"no limit bounds the speed along part of the path{missing}: state one with"
            f" {Remedy('robot.with_limits(velocity=...)', '--limits')}"
        )

    def _stuck_error(self, rows: LimitRows) -> JounceError:
        values = rows.uniform(0.0)
        values = np.maximum(values - rows.upper, rows.lower - values)
        point, row = np.unravel_index(values.argmax(), values.shape)
        joint = joint_names(self.robot.mechanism)[rows.joints[point, row]]
        return JounceError(
            f"the {rows.kinds[row]} limit of joint {quote_value(joint)} leaves no room to move; raise it"
        )


def build_problem(robot: Engine, motion: Motion, share: float) -> RetimeProblem:
    """The problem of a motion of a robot's joints, checked."""
    if not motion.duration:
        raise JounceError(
            f"the motion is one state at t = {motion.start:g} s; expected a path, a motion that lasts some time"
        )
    limits = joint_limits(robot.mechanism)
    kinds = [kind for kind in known_kinds(robot, limits) if kind != "position"]
    motors = _limited_motors(robot, kinds)
    forces = [kind for kind in kinds if LIMIT_KINDS[kind].force]
    if forces and robot.mechanism.takes_dependent and not drives_coordinates(robot.mechanism):
        bounds, names = limits.bounds(forces[0]), joint_names(robot.mechanism)
        bounded = [name for j, name in enumerate(names) if np.isfinite(bounds[:, j]).any()]
        cure = _describe_removal(f"{forces[0]}=dict.fromkeys({bounded}, float('inf'))")
        raise JounceError(
            f"retime supports limits of {join_names(forces)} only where motors are at the coordinates,"
            f" {join_names(robot.joint_names)}; {cure}"
        )
    _check_zero(robot, motion, limits, kinds)
    if not kinds:
        raise JounceError(
            f"{quote_value(robot.name)} has no limit of velocity, acceleration, ... or effort;"
            f" state them with {Remedy('robot.with_limits(velocity=..., effort=..., ...)', '--limits FILE|ARM')}"
        )
    needs = {kind: motion_order(robot, kind) for kind in kinds}
    highest = max(kinds, key=needs.__getitem__)
    _check_breaks(motion, robot.joint_names, needs[highest], highest)
    friction, order = _supported_friction(robot), max(0, needs[highest] - along.Q_RATE_ORDER)
    friction, moving = motors.friction() if motors else friction, _find_moving_ends(motion)
    return RetimeProblem(without_friction(robot), motion, limits, share, order, moving, friction, motors)


def _describe_removal(infinite: str) -> str:
    """The cure for limits that retiming does not support, by the arguments that remove them."""
    keep = Remedy("robot.slowdown keeps them", "jounce slowdown keeps them")
    return f"remove them{Remedy(f', robot.with_limits({infinite})')}, and check the result with them: {keep}"


def _select_drives(*terms: str) -> Remedy:
    return Remedy(f"robot.with_drives({list(terms)})", f"--drives {','.join(terms)}")


def _limited_motors(robot: Engine, kinds: Sequence[str]) -> MotorTerms | None:
    """The motors of a robot, where one of the kinds of limits bounds them; springs that are not linear are refused."""
    limited, e = [kind for kind in kinds if LIMIT_KINDS[kind].takes], robot.mechanism.elasticity
    if not limited or e is None:
        return None
    check_motor_data(robot, limited)
    if obstacle := find_motor_obstacle(e, limited):
        cure = ", ".join(f"{kind}=float('inf')" for kind in limited)
        raise JounceError(
            f"retime does not support limits of motors ({join_names(limited)}) with {obstacle};"
            f" {_describe_removal(cure)}"
        )
    return MotorTerms(robot.mechanism, e)


def check_path(problem: RetimeProblem, sigma: np.ndarray, path: path_terms.Path) -> None:
    """Raise `JounceError` where a path does not move, leaves position limits, or rests beyond an effort limit."""
    if not any(np.any(rate) for rate in path.q[1:2]):
        raise JounceError("the path does not move: every joint rests all the time; expected a motion of some joint")
    names = positions.extent_names(problem.robot.mechanism.tree)
    units = joint_units(problem.robot.mechanism)
    lower, upper = problem.limits.bounds("position")
    slack = _PATH_ROUNDING * np.maximum(1, np.abs(path.q[0]).max(axis=0))
    outside = np.argwhere((path.q[0] < lower - slack) | (path.q[0] > upper + slack))
    if len(outside):
        i, j = outside[0]
        raise JounceError(
            f"joint {quote_value(names[j])} leaves its position limits at t = {sigma[i]:g} s:"
            f" {path.q[0][i, j]:g} {units[j]} is outside of {lower[j]:g} to {upper[j]:g};"
            " no time law changes that, expected another path"
        )
    for kind in known_kinds(problem.robot, problem.limits):
        if LIMIT_KINDS[kind].of != "q":
            _check_static(problem, kind, sigma, path)


def _check_static(problem: RetimeProblem, kind: str, sigma: np.ndarray, path: path_terms.Path) -> None:
    static = limit_terms(path, kind, problem.limits, problem.motors).get(path_terms.ONE)
    if static is None:
        return
    lower, upper = problem.limits.bounds(kind) * problem.share
    over = np.argwhere((static <= lower) | (static >= upper))
    if not len(over):
        return
    i, j = over[0]
    unit = LIMIT_KINDS[kind].unit(joint_units(problem.robot.mechanism)[j])
    bound = problem.limits.bounds(kind)[int(static[i, j] > 0), j]
    share = f" ({problem.share:.0%} of it are used: margin)" if abs(static[i, j]) < abs(bound) else ""
    joint = quote_value(joint_names(problem.robot.mechanism)[j])
    raise JounceError(
        f"joint {joint} holds {static[i, j]:.6g} {unit} at rest at t = {sigma[i]:g} s;"
        f" its {kind.replace('_', ' ')} limit is {bound:.6g} {unit}{share}, and a slower motion does not help"
    )


def _check_zero(robot: Engine, motion: Motion, limits: Limits, kinds: Sequence[str]) -> None:
    """Raise `JounceError` where a joint that moves has a limit of 0, or one of velocity in the way that it moves."""
    t = np.linspace(motion.start, motion.stop, 101)
    velocity = joint_rates(robot, motion(t, 1), closed_path.continue_positions(robot, motion, t))[1]
    least, names = _REST_VELOCITY_SHARE * np.abs(velocity).max(), joint_names(robot.mechanism)
    moves = np.stack([(sign * velocity > least).any(axis=0) for sign in SIGNS])
    for kind in kinds:
        scale = build_scale(limits.bounds(kind), kind)
        zero = np.stack([scale.bound(sign) <= 0 for sign in SIGNS])
        stopped = (moves & zero).any(axis=0)
        if kind == "acceleration":  # from rest to rest a joint takes those of both signs
            stopped = moves.any(axis=0) & (zero.all(axis=0) if any(_find_moving_ends(motion)) else zero.any(axis=0))
        if kind not in ("velocity", "acceleration"):
            stopped = moves.any(axis=0) & zero.all(axis=0)
        for j in np.flatnonzero(stopped).tolist():
            way = "" if zero[:, j].all() else " on one side"
            raise JounceError(f"the {kind} limit of joint {quote_value(names[j])} is 0{way}, and the joint moves")


def _find_moving_ends(motion: Motion) -> tuple[bool, bool]:
    """Whether a motion moves at its start and at its end."""
    sigma = np.linspace(motion.start, motion.stop, 101)
    speed = np.abs(motion(sigma, 1)[1]).max(axis=1)
    return bool(speed[0] > _REST_VELOCITY_SHARE * speed.max()), bool(speed[-1] > _REST_VELOCITY_SHARE * speed.max())


def _check_breaks(motion: Motion, names: Sequence[str], rate: int, kind: str) -> None:
    """Raise `JounceError` where a rate below that which a limit takes jumps: the limit cannot be met there."""
    peaks = [np.abs(x).max() for x in motion(np.linspace(motion.start, motion.stop, 101), rate - 1)]
    real = [
        found
        for found in motion.breaks_to(rate - 1)
        if found.symbol != "q" or abs(found.jump) > _PATH_ROUNDING * peaks[found.order]
    ]
    if real:
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
    """The robot without Coulomb friction: the same one where none acts, with the kernels that it has."""
    m = robot.mechanism
    if "friction" not in m.acting:
        return robot
    return with_mechanism(robot, replace(m, acting=tuple(term for term in m.acting if term != "friction")))


def _supported_friction(robot: Engine) -> Friction | None:
    """The Coulomb friction that acts in a robot; that of joints that follow others in closed loops is refused."""
    m = robot.mechanism
    friction = acting_friction(m)
    if friction is not None and friction.others:
        raise JounceError(
            "retime does not support Stribeck friction and load_friction; omit them,"
            f" {_select_drives('armature', 'damping', 'friction', 'spring', 'offset')}, and check the result with them"
        )
    if friction is None or m.closure is None:
        return friction
    rubs = np.flatnonzero(friction.ratios.any(axis=0))
    if passive := [joint_names(m)[j] for j in rubs if joint_names(m)[j] not in m.coordinates]:
        raise JounceError(
            "retime does not support Coulomb friction of joints that follow others in closed loops"
            f" ({join_names(passive)}); omit it,"
            f" {_select_drives('armature', 'damping', 'spring', 'offset')}, and check the result with it"
        )
    return friction
