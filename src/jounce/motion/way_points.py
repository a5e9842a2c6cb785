"""Make paths of way points, and motions from rest to rest.

Points are joint positions without times. Equal neighbours count once. The path is one of two:

* `path_through`: a spline of degree 5 through all points, C^4. Its parameter is centripetal [1]: two points are as far
  apart in it as the root of their distance, so that unequal gaps make no wild overshoot. The second and third
  derivatives vanish at both ends, which makes two points a straight line.
* `path_along_lines`: straight lines, whose corners are rounded within a tolerance. A corner P between directions d and
  e is ``P + a ((d + e) u + (e - d) g(u)) / 2`` for u from -1 to 1, with ``g = int int k (1 - u^2)^3``, which goes over
  into |u| with four continuous derivatives. It is symmetric about the corner and stays within the triangle of the
  corner and the two ends of its blend. Its distance from the lines is largest at u = 0, ``a |e - d| g(0) / 2``, which
  decides on a; blends end at half of the shorter neighbouring line at the latest.

Distances are the largest change of any joint, each in its own unit, rad or m. Small corners take a larger share of the
parameter than of the path (`_point_speeds`), so that time laws with even splines resolve them.

`RestToRestCurve` passes a path by a polynomial time law of degree 9, at rest to the fourth derivative at both ends.

[1] E. T. Y. Lee, Choosing nodes in parametric curve interpolation, Computer-Aided Design 21(6), 1989.
"""

from dataclasses import dataclass
from math import factorial
from typing import Any, NamedTuple

import numpy as np

from jounce.arguments.names import array_by_name
from jounce.core.cures import option_name
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.core.named_entries import entry_names
from jounce.core.scalars import is_finite
from jounce.motion import constructors, time_law
from jounce.motion.composite_curves import STEP_COEFFICIENTS
from jounce.motion.curves import DerivedCurve, Jump, Polynomials, evaluate_powers, keep_by_order

PATH_DEGREE = 5  # C^4: Q2d, which takes q4d, has no jump
CENTRIPETAL_POWER = 0.5  # of distances: of 0.5, 0.75 and 1 the one with the least overshoot between uneven points
STRAIGHT_END_ORDERS = (2, 3)  # of the derivatives that vanish at both ends: a path begins and ends straight
MERGE_DISTANCE = 1e-9  # rad or m: nearer neighbours are one point, which no encoder tells apart
STRAIGHT_CORNER = 1e-9  # of the change of direction at a corner: a smaller one is rounding of its points
TIMES_PER_PIECE = 64  # of a motion that is too short for a row per millisecond: peaks in each piece are seen
DEFAULT_STEP = 1e-3  # s, of the rows of motions without times of their own
# g of a rounded corner, highest power first, with k = 35 / 16: at u = 1 both g and g' are 1, and further rates 0.
CORNER_COEFFICIENTS = np.array([-5.0, 0, 28, 0, -70, 0, 140, 0, 35]) / 128
CORNER_HEIGHT = 35 / 128  # g(0)
SMALL_CORNER = 0.1  # half of a blend over its longer line, below which it takes more of the parameter than that
MIN_CORNER_SHARE = 4e-3  # of the parameter: ten points of the coarsest grid of `retime` are in the smallest corner
LINE_DEGREE = 10  # of a line whose speed goes from one value to another by a polynomial of degree 9
MIN_LINE_SHARE = 1e-12  # of the line between two points: less between two blends is rounding


class WayPath(NamedTuple):
    """A path: polynomials of a parameter, and its description.

    `distance` (n,) is how far joints are from the lines at most, rad or m.
    """

    curve: Polynomials
    source: str
    distance: np.ndarray | None = None


def from_points(points: Any, duration: Any, tolerance: Any, joint_names: Any) -> constructors.MotionParts:
    """Return the motion from rest to rest along points (k, n).

    They are an array, columns by joint, or a list of positions that may be by joint.
    """
    q, joint_names = arrange_points(points, joint_names)
    if not is_finite(duration) or not duration > 0:
        raise JounceError(f"duration is {quote_value(duration)}; expected a number of seconds > 0")
    kept, notes = merge_neighbours(q)
    path = path_through(q[kept]) if tolerance is None else path_along_lines(q[kept], tolerance)
    curve = RestToRestCurve(path.curve, float(duration), tuple(kept) if tolerance is None else ())
    # Rows a millisecond apart are too few where all of the motion takes some milliseconds.
    count = TIMES_PER_PIECE * (len(path.curve.x) - 1)
    grid = np.linspace(0, curve.duration, count + 1) if curve.duration < count * DEFAULT_STEP else None
    names = constructors.check_joint_names(joint_names, q.shape[1])
    return constructors.MotionParts(curve, names, path.source, residual=path.distance, grid=grid, notes=notes)


def arrange_points(points: Any, joint_names: Any) -> tuple[np.ndarray, Any]:
    """Return points as an array (k, n), and the names of its columns."""
    # Of a list of positions by joint, the first one states the order, unless it is stated.
    if isinstance(points, list | tuple) and any(entry_names(point) is not None for point in points):
        order = entry_names(points[0]) if joint_names is None else constructors.check_joint_names(joint_names, None)
        if joint_names is None and any(entry_names(point) is None for point in points):
            raise JounceError("some points name their joints, and others do not; expected all or none with names")
        rows = [_position_by_name(point, order, f"point {i} from 0") for i, point in enumerate(points)]
        points, joint_names = np.array(rows), order
    if entry_names(points) == []:
        raise JounceError(f"points is {quote_value(points)}; expected columns of joints")
    (points,), joint_names = constructors.arrange_joints(joint_names, points=points)
    return constructors.as_finite_array(points, "points", 2), joint_names


def _position_by_name(point: Any, order: Any, what: str) -> np.ndarray:
    """Return a position (n,) that may be by joint."""
    if entry_names(point) is not None and len(order) > 0:
        point = array_by_name(point, order, what)
    position = constructors.as_finite_array(point, what, 1)
    if len(position) != len(order):
        raise JounceError(f"{what} has {len(position)} numbers; expected {len(order)}: {join_names(map(str, order))}")
    return position


def merge_neighbours(points: np.ndarray) -> tuple[list[int], tuple[str, ...]]:
    """Return which points are unlike the one before.

    Points are (k, n). A note names the others.
    """
    kept = [0] if len(points) > 0 else []
    for i in range(1, len(points)):
        if np.abs(points[i] - points[kept[-1]]).max() > MERGE_DISTANCE:
            kept.append(i)
    if len(kept) < 2:
        came = f"{len(points)} equal points" if len(points) > 1 else f"{len(points)} point{'s' * (len(points) == 0)}"
        raise JounceError(f"points: {came}; expected at least two different ones, between which a path leads")
    merged = [str(i) for i in range(len(points)) if i not in kept]
    if len(merged) == 0:
        return kept, ()
    plural = "s" if len(merged) > 1 else ""
    return kept, (f"point{plural} {join_names(merged, most=8)} from 0: equal to the one before; left out",)


def path_through(points: np.ndarray) -> WayPath:
    """Return the smooth path through distinct points (k, n)."""
    from scipy.interpolate import make_interp_spline  # a second to import

    lengths = np.abs(np.diff(points, axis=0)).max(axis=1)
    s = np.concatenate([[0.0], np.cumsum(lengths**CENTRIPETAL_POWER)])
    s /= s[-1]
    if len(points) == 2:
        # The spline is this line, but for rounding.
        line = np.stack([points[1:] - points[:1], points[:1]])
        return WayPath(Polynomials(s, line), "2 way points, a straight line")
    zero = np.zeros(points.shape[1])
    ends: Any = [(order, zero) for order in STRAIGHT_END_ORDERS]  # the stubs of scipy know no pairs
    knots = np.concatenate([[s[0]] * (PATH_DEGREE + 1), s[1:-1], [s[-1]] * (PATH_DEGREE + 1)])
    # Joints are moved to their first positions: large ones would lose digits of small changes.
    spline = make_interp_spline(s, points - points[0], k=PATH_DEGREE, t=knots, bc_type=(ends, ends))
    # Coefficients of powers of s - s_i, the highest first: derivatives over factorials.
    c = np.stack([spline(s[:-1], nu=k) / factorial(k) for k in range(PATH_DEGREE, -1, -1)])
    # The constants are the points themselves: each piece begins at one without rounding.
    c[-1] = points[:-1]
    return WayPath(Polynomials(s, c), f"{len(points)} way points, joined smoothly (C^{PATH_DEGREE - 1})")


def path_along_lines(points: np.ndarray, tolerance: Any) -> WayPath:
    """Return straight lines between distinct points with rounded corners."""
    if not is_finite(tolerance) or not tolerance > 0:
        raise JounceError(f"tolerance is {quote_value(tolerance)}; expected a distance > 0 in rad or m")
    steps = np.diff(points, axis=0)
    lengths = np.abs(steps).max(axis=1)
    directions = steps / lengths[:, None]
    turns = np.diff(directions, axis=0)  # (k - 2, n), e - d of each corner
    sizes = np.abs(turns).max(axis=1, initial=0)
    if not (sizes > STRAIGHT_CORNER).any():
        raise JounceError(
            f"{option_name('tolerance')} rounds the corners between straight lines, and the {len(points)} points lie on"
            " one line in their order; leave it out"
        )
    # Half of the parameter that each corner takes: what the tolerance asks for, within its lines.
    room = np.minimum(lengths[:-1], lengths[1:]) / 2
    with np.errstate(divide="ignore", over="ignore"):
        wanted = 2 * float(tolerance) / (CORNER_HEIGHT * sizes)
    half = np.where(sizes > STRAIGHT_CORNER, np.minimum(wanted, room), 0)
    # Of each point the half of its blend, 0 at both ends, and the speed at which the path passes it.
    blends = np.concatenate([[0.0], half, [0.0]])
    speeds = _point_speeds(lengths, half)
    pieces = []
    for i, direction in enumerate(directions):
        left, right = blends[i], blends[i + 1]
        ends = float(speeds[i]), float(speeds[i + 1])
        # Lines between blends that meet have no length.
        if lengths[i] - left - right > MIN_LINE_SHARE * lengths[i]:
            pieces.append(_line(points[i] + left * direction, direction, lengths[i] - left - right, ends))
        if right > 0:
            mean = (direction + directions[i + 1]) / 2
            pieces.append(_rounded_corner(points[i + 1], mean, turns[i] / 2, right, ends[1]))
    x = np.concatenate([[0.0], np.cumsum([length for length, _ in pieces])])
    curve = Polynomials(x, np.stack([c for _, c in pieces], axis=1))
    distance = (half[:, None] * np.abs(turns)).max(axis=0) * CORNER_HEIGHT / 2
    source = f"{len(points)} way points, straight lines with corners rounded within {float(tolerance):g} rad or m (C^4)"
    return WayPath(curve, source, distance)


def _point_speeds(lengths: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Return the speeds (k,) of the path at its points.

    They are along lines, by the parameter: 1 but for corners that are small compared to their lines. These take a
    larger share of the parameter, by which time laws resolve them.
    """
    longer = np.maximum(lengths[:-1], lengths[1:])
    slow = np.minimum(np.sqrt(half / (SMALL_CORNER * longer)), 2 * half / (MIN_CORNER_SHARE * lengths.sum()))
    speeds = np.concatenate([[1.0], np.where(half > 0, slow, 1.0).clip(max=1), [1.0]])
    # Where little of a line is left between two blends their speeds differ by little: the fourth derivative along the
    # line is their difference over the cube of that.
    blends = np.concatenate([[0.0], half, [0.0]])
    largest_change = (1 - (blends[:-1] + blends[1:]) / lengths).clip(0) ** 3
    for i in range(len(lengths)):
        speeds[i + 1] = min(speeds[i + 1], speeds[i] + largest_change[i])
    for i in reversed(range(len(lengths))):
        speeds[i] = min(speeds[i], speeds[i + 1] + largest_change[i])
    return speeds


def _line(
    start: np.ndarray, direction: np.ndarray, length: float, speeds: tuple[float, float]
) -> tuple[float, np.ndarray]:
    """Return the parameter that a line takes, and its coefficients (11, n).

    Its speed is 1 on the average. It goes from the first to the second with four derivatives that vanish at both ends.
    """
    first, change = speeds[0] * length, (speeds[1] - speeds[0]) * length
    # In shares u of the line: first u + change int h + (what is left) h, with h(u) from 0 to 1.
    along = np.zeros(LINE_DEGREE + 1)
    along[:-1] = change * STEP_COEFFICIENTS / np.arange(LINE_DEGREE, 0, -1)
    along[1:] += (length - first - change / 2) * STEP_COEFFICIENTS
    along[-2] += first
    c = along[:, None] * direction
    c[-1] += start
    return length, c / length ** np.arange(LINE_DEGREE, -1, -1)[:, None]


def _rounded_corner(
    corner: np.ndarray, mean: np.ndarray, half_turn: np.ndarray, a: float, speed: float
) -> tuple[float, np.ndarray]:
    """Return the parameter that a rounded corner takes, and its coefficients (11, n).

    It is corner + a (mean u + half_turn g(u)) for u from -1 to 1.
    """
    c = a * CORNER_COEFFICIENTS[:, None] * half_turn
    c[-2] += a * mean
    c[-1] += corner
    # Powers of u become those of s / a from the start on, then of the parameter s / speed.
    scale = (speed / a) ** np.arange(len(c) - 1, -1, -1)[:, None]
    padded = np.pad(constructors.shift_polynomials(c, np.array(-1.0)) * scale, ((LINE_DEGREE + 1 - len(c), 0), (0, 0)))
    return 2 * a / speed, padded


@dataclass(frozen=True, eq=False)
class RestToRestCurve(DerivedCurve):
    """A path from rest to rest in a time.

    Its parameter is s(t) = s_0 + (s_1 - s_0) h(t / duration). h is the polynomial of degree 9 from 0 to 1 whose first
    four derivatives vanish at both ends. `numbers` are those of the points at which the pieces of the path meet; none
    where pieces are lines and corners.
    """

    base: Polynomials
    duration: float
    numbers: tuple[int, ...] = ()

    def outer(self, t: np.ndarray) -> np.ndarray:
        """Return the times at which values of the parameter are passed."""
        from scipy.special import betaincinv  # h is the incomplete beta function I_u(5, 5)

        share = (t - self.base.start) / (self.base.stop - self.base.start)
        return self.duration * np.asarray(betaincinv(5.0, 5.0, np.clip(share, 0, 1)), dtype=float)

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        """Return the values and their derivatives, by the chain rule."""
        law = self.law_rates(t, order)
        sigma = self.inner_at_jumps(t, order)
        factors = time_law.chain_rule([sigma, *law[1:]], order)
        return time_law.apply_chain_rule(factors, self.base.rates(sigma, order, left))

    def law_rates(self, t: np.ndarray, order: int) -> list[np.ndarray]:
        """Return the parameter s and its derivatives, (N,) each."""
        u = t / self.duration
        # In the second half h(u) = 1 - h(1 - u), whose digits do not cancel.
        is_late = u > 0.5
        nearer = np.where(is_late, 1 - u, u)[:, None]
        h = [x[:, 0] for x in evaluate_powers(STEP_COEFFICIENTS[:, None, None], nearer, order)]
        start, stop = self.base.start, self.base.stop
        law = [np.where(is_late, stop - (stop - start) * h[0], start + (stop - start) * h[0])]
        for k in range(1, order + 1):
            sign = np.where(is_late, (-1.0) ** (k + 1), 1.0)
            law.append((stop - start) * sign * h[k] / self.duration**k)
        return law

    def inner(self, t: np.ndarray) -> np.ndarray:
        """Return the values of the parameter at times."""
        return self.law_rates(t, 0)[0].clip(self.base.start, self.base.stop)

    @keep_by_order
    def jumps(self, order: int) -> list[Jump]:
        """Return where a derivative up to `order` jumps, as along the path."""
        jumps = self.base.jumps(order)
        times = self.outer(np.array([jump.t for jump in jumps]))
        speeds = self.law_rates(times, 1)[1].tolist()
        # The time law is smooth: the lowest derivative that jumps is multiplied by s' as often as its order.
        pairs = zip(jumps, times.tolist(), speeds, strict=True)
        return [jump._replace(t=t, size=jump.size * speed**jump.order) for jump, t, speed in pairs]

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        """Return None: the path is exact."""
        return None
