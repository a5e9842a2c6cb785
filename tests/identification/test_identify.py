"""Identification: parameters within their deviations, what data do not determine, refusals, loads, moving ground."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

import jounce
from identification.conftest import table_values
from jounce.identification.averaging import CellAverages
from jounce.identification.regression import fit_forces
from support.refusals import refusal

SECONDS, COUNT = 6.0, 1501
T = np.linspace(0, SECONDS, COUNT)
OFFSET = np.array([5.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def true(arm):
    """The same arm with other masses, and with friction."""
    p = arm.inertial_parameters.reshape(-1, 10) * np.array([0.8, 1.3, 1.1])[:, None]
    drives = replace(arm.drives, friction=np.array([3.0, 2.0, 1.0]), damping=np.array([4.0, 2.0, 3.0]))
    m = arm.with_inertial_parameters(p.ravel()).mechanism
    return jounce.Robot(replace(m, drives=drives, acting=("damping", "friction")))


@pytest.fixture(scope="module")
def Q(true, motion):
    """Its forces, without noise."""
    return true.forces_along(motion, T, order=0).forces[0]


def test_exact_forces_give_the_true_parameters(arm, true, motion, Q):
    found = arm.identify(motion, Q + OFFSET, t=T, prior=10.0)
    expected = [*true.base_parameters().values, *true.drives.damping, *true.drives.friction, *OFFSET]
    assert table_values(found) == pytest.approx(expected, abs=1e-6)
    assert (found.rank, found.unseen, found.notes) == (24, (), ())
    assert found.robot.drives.offset == pytest.approx(OFFSET, abs=1e-3)
    assert found.robot.drives.friction == pytest.approx([3, 2, 1], rel=1e-3)
    assert found.predicted == pytest.approx(Q + OFFSET, abs=1e-2)
    again = found.robot.forces_along(motion, T, order=0).forces[0]
    assert again == pytest.approx(found.predicted, abs=1e-9), "the robot holds all that was fitted"
    assert not [finding for finding in found.robot.audit() if finding.severity == "error"]


def correlated(rng, time):
    """Noise of standard deviation 1 whose correlation decays with a time in s."""
    from scipy.signal import lfilter

    a = np.exp(-T[1] / time)
    return lfilter([np.sqrt(1 - a * a)], [1, -a], rng.normal(size=(COUNT, 3)), axis=0)


@pytest.mark.parametrize(("time", "largest"), [(1e-9, 1.4), (0.1, 2.5)])
def test_errors_are_as_large_as_their_deviations(arm, motion, Q, time, largest):
    """Mean squares of errors over deviations; as if samples were independent, correlated ones would give 50."""
    rng, expected = np.random.default_rng(1), table_values(arm.identify(motion, Q, t=T))
    chi = []
    for _ in range(4):
        found = arm.identify(motion, Q + 0.2 * correlated(rng, time), t=T)
        chi.append(
            (table_values(found) - expected) @ np.linalg.solve(found.covariance, table_values(found) - expected) / 24
        )
    assert 0.6 < np.mean(chi) < largest


def test_known_deviations_are_taken_as_they_are(arm, motion, Q):
    sizes = np.array([1.0, 0.1, 0.3])
    found = arm.identify(motion, Q, t=T, deviations=sizes)
    twice = arm.identify(motion, Q, t=T, deviations=np.broadcast_to(2 * sizes, Q.shape))
    assert found.deviations == pytest.approx(sizes / np.sqrt(COUNT / found.cells))
    assert twice.covariance == pytest.approx(4 * found.covariance)


def test_samples_of_weight_zero_do_not_count(arm, motion, Q):
    wrong, weights = Q.copy(), np.ones_like(Q)
    wrong[100:200, 1], weights[100:200, 1] = 1000.0, 0.0
    missing = np.where(weights > 0, Q, np.nan)
    found = arm.identify(motion, wrong, t=T, weights=weights)
    other = arm.identify(motion, missing, t=T)
    assert table_values(found) == pytest.approx(table_values(other))
    assert np.isnan(found.measured[150, 1])


def test_a_force_that_is_not_measured_is_left_out(arm, motion, Q):
    with pytest.warns(jounce.JounceWarning, match="not measured|do not determine"):
        found = arm.identify(motion, Q, t=T, weights=[1, 0, 1])
    assert found.notes[0] == "forces of shoulder_lift_joint are not measured: no column, NaN or a weight of 0"
    assert [row.force for row in found.residuals] == [arm.joint_names[0], arm.joint_names[2]]
    assert np.isinf(found.deviations[1])
    assert {"shoulder_lift_joint friction", "shoulder_lift_joint offset"} <= set(found.unseen)


def test_what_the_data_do_not_see_is_named(arm):
    one = jounce.Motion.fourier([0, 0.5, 0.2], [[0.4, 0, 0]], [[0.1, 0, 0]], 2.0, SECONDS)
    with pytest.warns(jounce.JounceWarning, match=r"do not determine .*elbow_joint friction.*rank \d+ of 24"):
        found = arm.identify(one, arm.forces_along(one, T, order=0).forces[0], t=T)
    assert found.rank < 24
    unseen = {row.name: row for row in found.table if not row.seen}
    assert np.isinf(unseen["elbow_joint friction"].deviation)
    assert unseen["elbow_joint friction"].value == 0
    assert "shoulder_pan_joint friction" not in unseen
    assert "not seen" in str(found)


def test_the_model_decides_where_the_data_say_nothing(arm):
    still = jounce.Motion.polynomial([[0.1], [0.2], [0.3]], SECONDS)
    with pytest.warns(jounce.JounceWarning):
        found = arm.identify(still, arm.forces_along(still, T, order=0).forces[0], t=T)
    assert found.robot.inertial_parameters == pytest.approx(arm.inertial_parameters, abs=1e-6)


def test_a_part_of_the_samples_tests_the_rest(arm, motion, Q):
    noisy = Q + 0.1 * np.random.default_rng(2).normal(size=Q.shape)
    found = arm.identify(motion, noisy, t=T, span=(0.0, 4.0))
    assert found.samples == np.sum(T <= 4)
    assert [row.part for row in found.residuals] == ["used"] * 3 + ["rest"] * 3
    for row in found.residuals:
        assert row.identified < 0.05 * row.model
        assert row.identified_samples == pytest.approx(0.1, rel=0.1)


@pytest.mark.parametrize(
    ("factor", "words"),
    [(-1, "all joints seem to have the wrong sign"), (1000, "seem to have the wrong unit: they are 1")],
)
def test_a_wrong_sign_or_unit_is_suspected(arm, motion, factor, words):
    forces = arm.forces_along(motion, T, order=0).forces[0] + 0.1 * np.random.default_rng(6).normal(size=(COUNT, 3))
    with pytest.warns(jounce.JounceWarning, match=f"{words}|does not explain|read as given"):
        found = arm.identify(motion, factor * forces, t=T, drives=False, torques_as_given=True)
    assert words in found.notes[0]


def without_warnings():
    return warnings.catch_warnings(action="ignore", category=jounce.JounceWarning)


def delayed(forces, delay):
    return np.stack([np.interp(T - delay, T, column, np.nan, np.nan) for column in forces.T], axis=1)


def delay_in_note(found):
    """The delay and its deviation in ms, as the first note has them."""
    return tuple(map(float, re.match(r"measured forces come (\S+) \+- (\S+) ms", found.notes[0]).groups()))


@pytest.mark.parametrize(
    ("delay", "noise", "most"),
    [
        (0.05, 0.1, 1e-4),
        (0.013, 2.0, 1e-3),
        (0.005, 2.0, 1e-3),
        (0.002, 0.2, 2e-4),
        (7e-4, 0.2, 2e-4),
        (-0.03, 0.1, 1e-4),
    ],
)
def test_the_delay_of_forces_is_found_and_taken_out(arm, motion, Q, delay, noise, most):
    """Samples are 4 ms apart."""
    noisy = delayed(Q, delay) + noise * np.random.default_rng(3).normal(size=Q.shape)
    with pytest.warns(jounce.JounceWarning, match="measured forces come"):
        found = arm.identify(motion, noisy, t=T)
    assert found.delay == pytest.approx(delay, abs=most)
    late, deviation = delay_in_note(found)
    assert late == pytest.approx(1e3 * abs(found.delay), rel=5e-3)
    assert abs(found.delay - delay) < 4e-3 * deviation
    assert f"{'after' if delay > 0 else 'before'} the positions, which is taken out" in found.notes[0]
    in_time = arm.identify(motion, Q + noisy - delayed(Q, delay), t=T)
    values = {row.name: row.value for row in found.table}  # a law of friction more, where noise looks like one
    assert all(abs(values[row.name] - row.value) < 3 * row.deviation + 1e-3 for row in in_time.table)


def test_a_stated_delay_is_taken_as_it_is(arm, motion, Q):
    late = delayed(Q, 0.02) + 0.1 * np.random.default_rng(3).normal(size=Q.shape)
    found = arm.identify(motion, late, t=T, delay=0.02)
    assert (found.delay, found.notes) == (0.02, ())
    assert found.t[0] == pytest.approx(0.0)
    assert found.measured == pytest.approx(late[5:], nan_ok=True)
    with without_warnings():
        wrong = arm.identify(motion, late, t=T, delay=0)
    assert wrong.delay == 0
    named = [note for note in wrong.notes if note.startswith("measured forces come 20 +- ")]
    assert [note.endswith("after the positions, besides delay=0") for note in named] == [True]


@pytest.mark.parametrize("delay", ["1", np.nan, 4.0])
def test_refuses_delays(arm, motion, Q, delay):
    refusal(lambda: arm.identify(motion, Q, t=T, delay=delay), "expected seconds by which forces come after")


@pytest.mark.parametrize("seed", range(4))
def test_forces_in_time_raise_no_suspicion_of_a_delay(arm, motion, Q, seed):
    rng = np.random.default_rng(seed)
    ripple = 0.3 * np.sin(40 * motion(T, 0)[0] + rng.uniform(0, 6, Q.shape[1]))
    found = arm.identify(motion, Q + ripple + 0.2 * rng.normal(size=Q.shape), t=T)
    assert found.delay == 0


@pytest.mark.parametrize(("seed", "late"), [(0, 0.0), (1, 0.0), (4, 0.006), (5, -0.007)])
def test_noise_in_narrow_cells_makes_no_delay(seed, late):
    """Of cells of 2.5 samples, the derivative of measured forces by the delay is hardly more than noise."""
    M = jounce.inertia_matrix(1.0, [0.3, 0, 0], 0.01 * np.eye(3))
    rod = jounce.Robot.from_screws([np.eye(4)], [[0, 0, 1, 0, 0, 0]], [M], gravity=[0, -9.81, 0])
    motion = jounce.Motion.fourier([0.3], [[0.5], [-0.4]], [[0.2], [0.6]], 2.0, SECONDS).with_step(0.002)
    Q = rod.inverse_dynamics(*motion((motion.times - late).clip(0, SECONDS), 2))
    noisy = Q + 0.3 * np.random.default_rng(seed).normal(size=Q.shape)
    with without_warnings():
        found = rod.identify(motion, noisy, drives=False, band=100)
    if not late:
        assert (found.delay, found.notes) == (0, ())
        return
    deviation = delay_in_note(found)[1]
    assert abs(found.delay - late) < 4e-3 * deviation < 6e-3
    assert 90 < int(re.search(r"(\d+)% of what is unexplained remains", found.notes[0])[1]) < 100


@pytest.mark.parametrize("seed", range(2))
def test_forces_that_follow_no_motion_have_no_delay(arm, motion, seed):
    """Some delay explains slow forces a little better than others do, by many of its deviations."""
    slow = 50 * correlated(np.random.default_rng(seed), 0.1)
    with without_warnings():
        assert arm.identify(motion, slow, t=T).delay == 0


@pytest.mark.parametrize("size", [0.0, 1e-3])
def test_forces_that_are_zero_are_reported(arm, motion, Q, size):
    with pytest.warns(jounce.JounceWarning, match="are constant|does not explain|a free swing"):
        arm.identify(motion, size * np.random.default_rng(5).normal(size=Q.shape), t=T)


def test_forces_that_no_robot_of_this_kind_makes_are_reported(arm, motion, Q):
    """Torques of other joints, a wild sample, and a sensor that is dead.

    A sample of 1e6 spoils the fit of other joints too, by 0.3 to 0.9 of their forces, as the processor rounds.
    """
    wild, dead = Q.copy(), Q.copy()
    wild[100, 1], dead[:, 1] = 1e5, 3.0
    for forces, joints in ((Q[:, [1, 0, 2]], "shoulder_pan_joint, shoulder_lift_joint"), (wild, "shoulder_lift_joint")):
        with pytest.warns(jounce.JounceWarning):
            found = arm.identify(motion, forces, t=T)
        assert f"does not explain the forces of {joints}: it leaves" in found.notes[-1]
    wild[100, 1] = 1e6
    with pytest.warns(jounce.JounceWarning):
        found = arm.identify(motion, wild, t=T)
    assert re.search("does not explain the forces of .*shoulder_lift_joint.*: it leaves", found.notes[-1])
    with pytest.warns(jounce.JounceWarning):
        found = arm.identify(motion, dead, t=T)
    assert found.notes[0].startswith("forces of shoulder_lift_joint are constant, and those of the model are not")


def test_terms_that_act_and_loads_are_no_parameters(arm, motion):
    loaded = replace(motion, loads=jounce.load_motion("paper-wrench", jounce.load("iiwa14")).loads)
    body = arm.body_names[-1]
    loaded = replace(loaded, loads={body: next(iter(loaded.loads.values()))})
    held = jounce.Robot(
        replace(arm.mechanism, drives=replace(arm.drives, stiffness=np.full(3, 9.0)), acting=("spring",))
    )
    t = np.linspace(0, 4.9, 1000)
    found = held.identify(loaded, held.forces_along(loaded, t, order=0).forces[0], t=t)
    assert table_values(found) == pytest.approx([*arm.base_parameters().values, *np.zeros(9)], abs=1e-6)
    assert found.robot.mechanism.acting == ("damping", "friction", "spring", "offset")


def test_forces_count_less_where_accelerations_are_uncertain(arm, true, motion, Q):
    """At the ends of a log: weighed as all others, the samples there make errors ten times as large."""
    rng = np.random.default_rng(3)
    smoothed = jounce.Motion.fit(T, motion(T, 0)[0] + 1e-3 * rng.normal(size=Q.shape), joint_names=arm.joint_names)
    found = arm.identify(smoothed, Q + 0.1 * rng.normal(size=Q.shape), t=T)
    off = table_values(found) - [*true.base_parameters().values, *true.drives.damping, *true.drives.friction, 0, 0, 0]
    assert np.mean((off / np.sqrt(np.diag(found.covariance))) ** 2) < 4
    assert np.abs(off[:15]).max() < 0.05


def test_a_robot_on_moving_ground_feels_more(arm, motion):
    """The base moves: the mass of the first body enters, and where the base turns, so does its inertia."""
    C = np.broadcast_to(np.eye(4), (40, 4, 4)).copy()
    C[:, :3, 3] = 0.1 * np.sin(np.linspace(0, 6, 40))[:, None] * [1, 2, 3]
    moved = motion.with_base(np.linspace(0, SECONDS, 40), C, degree=7)
    forces = arm.forces_along(moved, T, order=0).forces[0]
    found = arm.identify(moved, forces, t=T)
    assert table_values(found)[:15] == pytest.approx(arm.base_parameters().values, abs=1e-6)


@pytest.mark.parametrize(("given", "words"), [
    ({"forces": None}, ("the motion has no measured forces", "named by torques='tau{number}', or an array")),
    ({"weights": [1, -1, 1]}, ("weights hold -1", "0, which leaves a force out, or more")),
    ({"deviations": 0.0}, ("deviations hold 0", "above 0")),
    ({"weights": [1, 1]}, ("weights have shape (2,)", "(3,), one per force")),
    ({"forces": np.ones((COUNT, 2))}, (f"forces have shape ({COUNT}, 2)", f"({COUNT}, 3)")),
    ({"forces": np.ones((5, 3)), "t": np.arange(5) * 0.01}, ("15 measured forces for 24 parameters",)),
    ({"forces": np.ones((3, 3)), "t": [0, 2, 1]}, ("t does not increase",)),
    ({"forces": np.full((COUNT, 3), -np.inf)}, ("forces hold -inf", "NaN for those not measured")),
    ({"t": 2 * T}, ("is outside of the motion", "from 0 to 6 s")),
    ({"forces": np.full((COUNT, 3), np.nan)}, ("no measured forces from 0 to 6 s",)),
    ({"span": (8, 9)}, ("span is (8, 9)", "0 to 6 s")),
    ({"span": 3}, ("span is 3", "two times")),
    ({"prior": 0}, ("prior is 0",)),
    ({"prior": 1e-200}, ("prior is 1e-200", "1e-09 or more")),
    ({"prior": 1e9}, ("no physically consistent parameters", "expected a smaller prior")),
    ({"deviations": 1e-200}, ("deviations hold 1e-200",)),
    ({"band": -1.0}, ("band is -1.0",)),
    ({"band": 1e6}, ("band is 1000000.0", "0.1666 Hz, one period", "to 125 Hz")),
    ({"band": 1e-6}, ("band is 1e-06",)),
    ({"drives": "stiction"}, ("unknown drive term 'stiction'",)),
    ({"drives": False, "eps": 0.1}, ("eps=0.1 is of friction",)),
])  # fmt: skip
def test_refuses(arm, motion, Q, given, words):
    kept = {"forces": Q, "t": None if given.get("forces", Q) is None else T} | given
    refusal(lambda: arm.identify(motion, kept.pop("forces"), **kept), *words)


def test_the_shortest_solution_of_what_is_not_determined():
    one, two = np.ones((4, 1)), np.full((4, 1), 2.0)
    cells = CellAverages(np.broadcast_to([1.0, 0.0], (4, 1, 2)), two, one, one, 0 * one)
    found = fit_forces(cells, np.arange(2), None, known=True)
    assert found.x.tolist() == [2, 0]
    assert np.diag(found.covariance).tolist() == [0.25, np.inf]
    assert (found.rank, found.condition) == (1, 1.0)
