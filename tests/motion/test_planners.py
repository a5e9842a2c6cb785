"""What planners compute: exact pieces, one-sided rates and forces at their breaks, and the breaks themselves."""

from itertools import pairwise

import numpy as np
import pytest
import ruckig
from scipy.interpolate import PPoly

import jounce
from jounce import Motion
from support.refusals import refusal
from support.robots import relative_error

IIWA = jounce.load("iiwa14")
N, NAMES = IIWA.n, IIWA.joint_names
RNG = np.random.default_rng(2)


def planned(jerk=20.0, interface="Position", synchronization="Time", moving=True):
    """A motion of Ruckig from a state that it has to brake from."""
    asked, otg = ruckig.InputParameter(N), ruckig.Ruckig(N)
    asked.control_interface = getattr(ruckig.ControlInterface, interface)
    asked.synchronization = getattr(ruckig.Synchronization, synchronization)
    asked.current_position, asked.target_position = RNG.normal(size=(2, N)).tolist()
    if moving:
        asked.current_velocity, asked.target_velocity = RNG.uniform(-0.3, 0.3, (2, N)).tolist()
        asked.current_velocity = [2.5, *asked.current_velocity[1:]]  # faster than it may be
    asked.max_velocity, asked.max_acceleration, asked.max_jerk = [1.5] * N, [5.0] * N, [jerk] * N
    trajectory = ruckig.Trajectory(N)
    assert otg.calculate(asked, trajectory) in (ruckig.Result.Working, ruckig.Result.Finished)
    return trajectory


RUCKIG = {
    "position": {},
    "rest to rest": {"moving": False},
    "velocity": {"interface": "Velocity"},
    "no synchronization": {"synchronization": "No"},
    "no limit of jerk": {"jerk": np.inf},
}


@pytest.mark.parametrize("asked", RUCKIG.values(), ids=RUCKIG)
def test_pieces_of_ruckig_are_its_own_values(asked):
    trajectory = planned(**asked)
    motion = Motion.from_ruckig(trajectory, joint_names=NAMES)
    assert motion.duration == trajectory.duration
    t = np.linspace(0, trajectory.duration, 400)[:-1]
    exact = np.array([trajectory.at_time(x) for x in t])
    for k, rate in enumerate(motion(t, 2)):
        assert relative_error(rate, exact[:, k]) < 1e-11, k


@pytest.mark.parametrize("asked", RUCKIG.values(), ids=RUCKIG)
def test_one_sided_forces_of_ruckig_are_those_of_its_exact_rates(asked):
    """Between its breaks, and just at them: jerk is constant between, as far as acceleration tells."""
    trajectory = planned(**asked)
    motion = Motion.from_ruckig(trajectory, joint_names=NAMES)
    times = [0.0, *dict.fromkeys(found.t for found in motion.breaks), motion.duration]
    lowest = {cause.order for cause in motion.breaks}
    assert lowest == ({2} if "jerk" in asked else {3})
    states, exact_states, lengths = [], [], []
    for a, b in pairwise(times):
        if b - a < 1e-3:  # too short to tell its jerk from the accelerations at its ends
            continue
        inner = [a + (b - a) * s for s in (0.25, 0.75)]
        (p, v, acc), (_, _, later) = (np.array(trajectory.at_time(t)) for t in inner)
        jerk = (later - acc) / (inner[1] - inner[0])
        for t, side in ((a, "right"), ((a + b) / 2, "right"), (b, "left")):
            h = t - inner[0]
            exact = [
                p + h * v + h**2 / 2 * acc + h**3 / 6 * jerk, v + h * acc + h**2 / 2 * jerk,
                acc + h * jerk, jerk, 0 * jerk,
            ]  # fmt: skip
            states.append(motion(t, 4, side))
            exact_states.append(exact)
            lengths.append(b - a)
    rates, exact_rates = (np.stack(x, axis=1) for x in (states, exact_states))
    expected = IIWA.inverse_dynamics(*exact_rates, method="closed_form")
    for forces, exact_forces in zip(IIWA.inverse_dynamics(*rates), expected, strict=True):
        for Q, of, length in zip(forces, exact_forces, lengths, strict=True):
            assert np.abs(Q - of).max() < 1e-11 * max(1, np.abs(of).max()) * max(1, 1e-2 / length), length


def spline_path():
    toppra = pytest.importorskip("toppra")

    return toppra.SplineInterpolator(np.linspace(0, 1, 6), RNG.normal(size=(6, N)))


def toppra_motion(parametrizer, path=None, points=60):
    toppra = pytest.importorskip("toppra")

    velocity = toppra.constraint.JointVelocityConstraint(np.repeat([[-2.0, 2.0]], N, axis=0))
    acceleration = toppra.constraint.JointAccelerationConstraint(np.repeat([[-6.0, 6.0]], N, axis=0))
    path = path or spline_path()
    grid = np.linspace(*path.path_interval, points)
    solver = toppra.algorithm.TOPPRA([velocity, acceleration], path, gridpoints=grid, parametrizer=parametrizer)
    return solver.compute_trajectory()


def test_one_sided_forces_of_toppra_are_those_of_its_exact_rates():
    """By the chain rule: s is quadratic in time, q cubic in s."""
    path = toppra_motion("ParametrizeConstAccel")
    motion = Motion.from_toppra(path, joint_names=NAMES)
    spline = path._path.cspl
    assert motion.duration == pytest.approx(path.duration)
    assert {found.order for found in motion.breaks} <= {2, 3}
    t = np.sort(RNG.uniform(0, path.duration, 200))
    s, v, u = (x[:, None] for x in path._eval_params(t))
    q, q1, q2, q3 = (PPoly(spline.c, spline.x)(s[:, 0], nu=k) for k in range(4))
    exact = q, q1 * v, q2 * v**2 + q1 * u, q3 * v**3 + 3 * q2 * v * u, 6 * q3 * v**2 * u + 3 * q2 * u**2
    for k, (rate, of) in enumerate(zip(motion(t), exact, strict=True)):
        assert relative_error(rate, of) < 1e-11, k
    along = IIWA.forces_along(motion, t)
    for Q, of in zip(along.forces, IIWA.inverse_dynamics(*exact, method="closed_form"), strict=True):
        assert relative_error(Q, of) < 1e-11
    crossings = {found.t for found in motion.breaks} - set(path._ts)  # where the path's own polynomials change
    assert len(crossings) <= 2
    for i in (7, 30):  # from both sides of a grid point
        a, b = (IIWA.inverse_dynamics(*motion(path._ts[i], 2, side)) for side in ("left", "right"))
        q, q1, q2 = (PPoly(spline.c, spline.x)(path._ss[i], nu=k) for k in range(3))
        for Q, u in ((a, path._us[i - 1]), (b, path._us[i])):
            v = path._velocities[i]
            expected = IIWA.inverse_dynamics(q, q1 * v, q2 * v**2 + q1 * u, method="closed_form")
            assert relative_error(Q, expected) < 1e-11


def test_splines_and_polynomial_paths_of_toppra():
    toppra = pytest.importorskip("toppra")

    path = toppra_motion("ParametrizeSpline")
    motion = Motion.from_toppra(path)
    t = np.linspace(0, path.duration, 300)
    for k, rate in enumerate(motion(t, 2)):
        assert relative_error(rate, path(t, k)) < 1e-12
    assert {found.order for found in motion.breaks} == {3}
    others = (
        toppra.SimplePath(np.linspace(0, 2, 5), RNG.normal(size=(5, N)), RNG.normal(size=(5, N))),
        toppra.interpolator.PolynomialPath(RNG.normal(size=(N, 4)), 0.5, 2.0),
        toppra.interpolator.UnivariateSplineInterpolator(np.linspace(0, 2, 30), RNG.normal(size=(30, N))),
        OfOpenRave(np.linspace(0, 1, 4), RNG.normal(size=(4, 3, N))),
    )
    for other in others:
        path = toppra_motion("ParametrizeConstAccel", other)
        t = np.linspace(0, path.duration, 100)[1:-1]
        for k, rate in enumerate(Motion.from_toppra(path)(t, 1)):
            assert relative_error(rate, path(t, k)) < 1e-9
        path = toppra_motion("ParametrizeSpline", other)
        assert relative_error(Motion.from_toppra(path)(t, 1)[1], path(t, 1)) < 1e-9


class OfOpenRave:
    """What toppra makes of a trajectory of OpenRAVE holds."""

    def __init__(self, x, c):
        self.ppoly, self.path_interval, self.dof = PPoly(c, x), np.array([x[0], x[-1]]), c.shape[2]
        self.ss_waypoints = x

    def __call__(self, s, order=0):
        return self.ppoly(s, order)


class Waves(OfOpenRave):
    """A path of the user's own, which is no polynomial."""

    def __init__(self):
        super().__init__(np.array([0.0, 1.0]), np.zeros((1, 1, N)))
        del self.ppoly

    def __call__(self, s, order=0):
        return np.sin(np.asarray(s)[..., None] * np.arange(1, N + 1) + order * np.pi / 2) * np.arange(1, N + 1) ** order


def test_toppra_paths_without_polynomials_or_time_are_refused():
    along = toppra_motion("ParametrizeConstAccel", Waves())
    refusal(lambda: Motion.from_toppra(along), "along a spline or polynomials", "Motion.through(t, path(t))")
    assert Motion.from_toppra(toppra_motion("ParametrizeSpline", Waves())).duration > 0
    refusal(lambda: Motion.from_toppra(spline_path()), "got a path, which knows no time", "compute_trajectory()")


def test_trapezoids_keep_their_limits_and_one_joint_reaches_one():
    corners = np.array([[0, 0.3], [1.0, 0.1], [1.01, 0.1], [-2.0, 3.0]])
    motion = Motion.trapezoidal(corners, [1.0, 2.0], 4.0)
    t = np.linspace(0, motion.duration, 2001)
    q, qd, q2d = motion(t, 2)
    np.testing.assert_allclose([q[0], q[-1]], corners[[0, -1]], atol=1e-14)
    assert (np.abs(qd).max(axis=0) <= [1 + 1e-12, 2 + 1e-12]).all()
    assert np.abs(q2d).max() == pytest.approx(4.0)
    assert np.abs(qd[:, 0]).max() == pytest.approx(1.0)
    assert {found.order for found in motion.breaks} == {2}
    rests = t[np.abs(qd).max(axis=1) < 1e-9]
    assert len(rests) >= 2
    for corner in corners[1:3]:
        assert np.abs(q - corner).max(axis=1).min() < 2e-3


REFUSED = {
    "no trajectory": (lambda: Motion.from_ruckig({}), ["from_ruckig() expects a ruckig.Trajectory", "got dict"]),
    "not calculated": (lambda: Motion.from_ruckig(ruckig.Trajectory(2)), ["Motion.from_ruckig()"]),
    "no path": (lambda: Motion.from_toppra(3), ["from_toppra() expects", "compute_trajectory()", "int"]),
    "none found": (lambda: Motion.from_toppra(None), ["toppra found no trajectory; loosen the constraints"]),
    "no way": (lambda: Motion.trapezoidal([[0, 1], [0, 1]], 1, 1), ["positions has 2 rows", "unlike the one before"]),
    "no speed": (lambda: Motion.trapezoidal([[0.0], [1.0]], 0, 1), ["velocity is 0.0; expected one or 1 numbers > 0"]),
}  # fmt: skip


@pytest.mark.parametrize(("call", "words"), REFUSED.values(), ids=REFUSED)
def test_refuses(call, words):
    refusal(call, *words)


def test_a_trajectory_that_its_planner_evaluates_otherwise_is_refused():
    class Other:
        def __init__(self, real):
            self.real = real

        def __getattr__(self, name):
            return getattr(self.real, name)

        def at_time(self, t):
            return np.array(self.real.at_time(t)) + 0.1

    refusal(lambda: Motion.from_ruckig(Other(planned())), "differ by", "release of ruckig is not known")
