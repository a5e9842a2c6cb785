"""Forces along a motion: those of `inverse_dynamics`, piece by piece, for the robot and the rates of the motion."""

from dataclasses import replace

import numpy as np
import pytest

import jounce
from jounce.engine import motion_states
from support.quantities import branched, rigid
from support.refusals import refusal
from support.robots import relative_error

ROBOT = rigid(branched())
T = np.linspace(0, 1, 50)


def loaded_waves(robot, order=2, wrench=True):
    columns = {"t": T} | {name: np.sin((j + 1) * T) for j, name in enumerate(robot.joint_names)}
    loads = {"tool.fx": np.cos(T), f"{robot.body_names[0]}.mz": T**2} if wrench else {}
    return jounce.load_motion(columns | loads, robot, order=order, degree=7)


MOTION = loaded_waves(ROBOT)


@pytest.fixture(params=[1, 7, 50, 1000])
def _piece(request, monkeypatch):
    monkeypatch.setattr(motion_states, "_STATES_PER_PIECE", request.param)


@pytest.mark.sweep(13)
@pytest.mark.usefixtures("_piece")
@pytest.mark.parametrize("method", [None, "recursion", "closed_form"])
@pytest.mark.parametrize("order", range(3))
def test_forces_are_those_of_inverse_dynamics(order, method):
    found = ROBOT.forces_along(MOTION, order=order, method=method)
    rates = MOTION(T, order + 2)
    forces = ROBOT.inverse_dynamics(*rates, wrench=MOTION.wrench(T, order), method=method)
    forces = forces if order else (forces,)
    assert np.array_equal(found.t, T)
    assert np.array_equal(found.rates, rates)
    assert found.breaks == ()
    assert found.deviations is None
    for ours, other in zip(found.forces, forces, strict=True):
        assert abs(ours - other).max() <= 1e-14 * abs(other).max()


def test_times_may_be_any_within_the_motion_in_any_order():
    which = [40, 3, 3, 0, 49]
    whole, some = ROBOT.forces_along(MOTION), ROBOT.forces_along(MOTION, T[which])
    assert np.array_equal(some.t, T[which])
    assert np.array_equal(some.rates, [q[which] for q in whole.rates])
    assert np.array_equal(some.forces, [Q[which] for Q in whole.forces])
    t = (T[1:] + T[:-1]) / 2
    h = 1e-3 * T[1]
    _, Qd, Q2d = ROBOT.forces_along(MOTION, t).forces
    (above, d_above), (below, d_below) = (ROBOT.forces_along(MOTION, t + s * h, order=1).forces for s in (1, -1))
    assert relative_error((above - below) / (2 * h), Qd) < 1e-6
    assert relative_error((d_above - d_below) / (2 * h), Q2d) < 1e-6


def test_joints_are_matched_by_name():
    motion = loaded_waves(OTHER, wrench=False)
    q, *rates = (rate[:, ::-1] for rate in motion(T))
    swapped = jounce.Motion.through(T, q, joint_names=("joint2", "joint1"))
    assert np.allclose(swapped(T)[4], rates[3], atol=1e-3)
    found, expected = OTHER.forces_along(swapped), OTHER.forces_along(motion)
    for ours, other in zip(found.forces, expected.forces, strict=True):
        assert relative_error(ours, other) < 1e-6


@pytest.mark.usefixtures("_piece")
def test_progress_counts_the_states_up_to_the_last():
    said = []
    ROBOT.forces_along(MOTION, progress=lambda *step: said.append(step))
    done = [done for done, _ in said]
    assert done == sorted(set(done))
    assert {total for _, total in said} == {len(T)} == {done[-1]}
    assert len(said) == -(-len(T) // motion_states._STATES_PER_PIECE)


def test_an_error_of_the_callback_ends_the_computation(monkeypatch):
    monkeypatch.setattr(motion_states, "_STATES_PER_PIECE", 10)
    said = []

    def stop(done, _):
        said.append(done)
        if done == 20:
            raise ZeroDivisionError("enough")

    with pytest.raises(ZeroDivisionError, match="enough"):
        ROBOT.forces_along(MOTION, progress=stop)
    assert said == [10, 20]


@pytest.mark.parametrize("way", ["through", "fourier", "piecewise"])
def test_a_motion_in_degrees_is_warned_of(way):
    robot, t = jounce.load("iiwa14"), np.linspace(0, 6, 50)
    amplitudes = np.full(7, 80.0)
    q = np.sin(t)[:, None] * amplitudes
    motions = {
        "through": lambda scale: jounce.Motion.through(t, scale * q),
        "fourier": lambda scale: jounce.Motion.fourier(
            0 * amplitudes, [0 * amplitudes], [scale * amplitudes], 1.0, 6.0
        ),
        "piecewise": lambda scale: jounce.Motion.piecewise([0, 6], scale * np.array([[amplitudes], [0 * amplitudes]])),
    }
    with pytest.warns(
        jounce.JounceWarning,
        match="^the motion: joint 'joint1' goes from .* within limits if they were degrees",
    ):
        robot.forces_along(motions[way](1.0), [0.5], order=0)
    robot.forces_along(motions[way](np.pi / 180), [0.5], order=0)


def log_of(amplitude):
    """A log of both joints that swing, by amplitude in rad or degrees."""
    t = np.linspace(0, 6, 301)
    q = amplitude * np.stack([np.sin(t), np.cos(1.3 * t)], axis=1)
    return t, q + amplitude * 1e-5 * np.random.default_rng(0).normal(size=q.shape)


BOUNDED = jounce.load("planar2r").with_limits(lower=-3, upper=3, velocity=5, acceleration=50, effort=1e4)
SPRUNG = BOUNDED.elastic([8e4, 6e4], rotor=0.1)
METHODS_OF_LOGS = {
    "forces_along": lambda motion: BOUNDED.forces_along(motion, order=0),
    "check": BOUNDED.check,
    "check at a rate": lambda motion: BOUNDED.check(motion, rate=100),
    "explain": lambda motion: BOUNDED.explain(motion, rate=100),
    "slowdown": BOUNDED.slowdown,
    "retime": BOUNDED.retime,
    "report": lambda motion: BOUNDED.report(motion, order=0),
    "guard": BOUNDED.guard,
    "motors_along": lambda motion: SPRUNG.motors_along(motion, order=0),
    "identify": lambda motion: BOUNDED.identify(motion, np.ones((301, 2)), drives=False),
    "payload": lambda motion: BOUNDED.payload(motion),
    "identify_stiffness": lambda motion: SPRUNG.identify_stiffness(motion, motion),
    "faster": lambda motion: BOUNDED.forces_along(motion.scaled(0.5), order=0),
    "joined": lambda motion: BOUNDED.check(motion + jounce.Motion.polynomial(motion(motion.stop, 0)[0][:, None], 1.0)),
}


@pytest.mark.parametrize("method", METHODS_OF_LOGS)
def test_a_log_in_degrees_is_refused_as_load_motion_does(method):
    """One rule for measured samples, whether they come with a robot or meet it later."""
    (t, q), said = log_of(100.0), "joint 'joint1' goes from -100 to "
    columns = {"t": t, "joint1": q[:, 0], "joint2": q[:, 1]}
    refusal(lambda: jounce.load_motion(columns, BOUNDED), f"the motion: {said}", "they were degrees; state the unit by")
    motion = jounce.Motion.fit(t, q)
    refusal(lambda: METHODS_OF_LOGS[method](motion), f"the motion: {said}", "degrees; numpy.deg2rad", "angles='rad'")


def test_a_log_whose_unit_is_stated_is_taken_as_it_is():
    t, q = log_of(100.0)
    stated = jounce.Motion.fit(t, q, angles="rad")
    assert np.abs(BOUNDED.inverse_dynamics(*stated(3.0, 2))).max() > 1e3
    assert not BOUNDED.check(stated).ok
    BOUNDED.check(jounce.Motion.fit(t, np.deg2rad(q)))
    refusal(lambda: jounce.Motion.fit(t, q, angles="deg"), "unknown unit of angles 'deg'", "rad")


def test_a_plan_that_breaks_limits_is_no_log_in_degrees():
    """`through` and formulas state plans, whose limits `check` judges."""
    t = np.linspace(0, 6, 41)
    assert not BOUNDED.check(jounce.Motion.through(t, 4 * np.stack([np.sin(t), np.cos(t)], axis=1))).ok


def test_turns_without_limits_that_fit_no_degrees_are_accepted():
    motion = jounce.Motion.polynomial([[0, 1e4], [0, 0]], 100.0)  # rad/s, or deg/s: none moves so
    jounce.load("planar2r").forces_along(motion, [0.5], order=0)


def test_a_motion_without_wrenches_has_none_in_its_forces():
    motion = loaded_waves(ROBOT, wrench=False)
    found = ROBOT.forces_along(motion).forces
    assert np.allclose(found, ROBOT.inverse_dynamics(*motion(T)), rtol=0, atol=1e-12)


OTHER = jounce.load("planar2r")
REFUSED = {
    **{
        f"{name} of a number": (
            lambda name=name: getattr(ROBOT, name)(3),
            ["motion is 3; expected a jounce.Motion, as jounce.load_motion makes one"],
        )
        for name in ("forces_along", "identify", "check", "slowdown", "retime")
    },
    "too few rates": (lambda: ROBOT.forces_along(jounce.Motion.through(T, np.outer(T, np.ones(ROBOT.n)), 5), order=4),
        ["q6d is not known along this motion (samples, rates from a spline of degree 5 (C^4)); it ends at q5d"]),
    "no order": (lambda: ROBOT.forces_along(MOTION, None, "two"), ["order is 'two'"]),
    "another robot": (lambda: OTHER.forces_along(MOTION),
        ["the motion: missing 'joint1', 'joint2'", "the joints of 'planar2r'", *ROBOT.joint_names]),
    "renamed joints": (
        lambda: OTHER.forces_along(replace(loaded_waves(OTHER, wrench=False), joint_names=("joint2", "jont1"))),
        ["the motion: missing 'joint1'; unknown 'jont1' (did you mean 'joint1'?)"]),
    "joints without names": (lambda: OTHER.forces_along(jounce.Motion.polynomial([[0, 1]] * 3, 1)),
        ["the motion: 3 joints without names; 'planar2r' has joint1, joint2"]),
    "one time": (lambda: ROBOT.forces_along(MOTION, 1), ["t is 1; expected an array (N,)"]),
    "order in place of times": (lambda: ROBOT.forces_along(MOTION, 2), ["t = 2 s is outside of the motion"]),
    "no times": (lambda: ROBOT.forces_along(MOTION, []), ["t is []"]),
    "a mask": (lambda: ROBOT.forces_along(MOTION, T > 0.5), ["expected times in s"]),
    "times outside": (lambda: ROBOT.forces_along(MOTION, [0.5, 2.0]), ["t = 2 s is outside", "from 0 to 1 s"]),
    "a time that is missing": (lambda: ROBOT.forces_along(MOTION, [np.nan]), ["t = nan s"]),
    "unknown method": (lambda: ROBOT.forces_along(MOTION, method="rnea"), ["'rnea'", "recursion"]),
    "no callback": (lambda: ROBOT.forces_along(MOTION, progress=True), ["progress is True", "(done, total)"]),
}  # fmt: skip


@pytest.mark.parametrize(("call", "words"), REFUSED.values(), ids=REFUSED)
def test_refuses(call, words):
    refusal(call, *words)
