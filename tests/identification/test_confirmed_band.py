"""Encoders that move as links do not: torques show it, and the motion is smoothed to what they confirm."""

import numpy as np
import pytest
from benchmarks.pendulum import DAMPING, double_pendulum

import jounce
from jounce.identification.fits import _is_off_where_it_turns, find_band, fit_logs
from jounce.identification.least_squares_problem import FitOptions
from jounce.identification.measurements import check_logs
from jounce.identification.regression import MAX_VARIANCE_FACTOR, MIN_NOISE_SHARE, Equations, _starts
from jounce.motion import resmoothing
from jounce.motion.resmoothing import BandErrors

ROBOT, PLAY, STEP = double_pendulum(), 4e-3, 2 * np.pi / 2**14
MODEL = ROBOT.with_inertial_parameters(1.3 * ROBOT.inertial_parameters)
TRUE = np.append(ROBOT.base_parameters().values, DAMPING)
TURNING = "; encoders of joint1, joint2 move as links do not where they turn back, as with play"
QUIET = pytest.mark.filterwarnings("ignore::jounce.JounceWarning")  # what notes hold
CONFIRMED = "torques confirm the positions up to "


def swung(seconds=6.0, seed=0, play=PLAY):
    """Times, positions of encoders at rotors that links drag through some play, and torques with noise."""
    rng, t = np.random.default_rng(seed), np.arange(0, seconds, 1 / 500)
    exact = jounce.Motion.fourier([-1.5, 0.0], *rng.uniform(-0.4, 0.4, (2, 4, 2)), 2.0, seconds)
    q, qd, q2d = exact(t, 2)
    rotor = q.copy()
    for k in range(1, len(t)):
        rotor[k] = np.clip(rotor[k - 1], q[k] - play / 2, q[k] + play / 2)
    Q = ROBOT.inverse_dynamics(q, qd, q2d) + DAMPING * qd + 0.02 * rng.normal(size=q.shape)
    return t, np.floor(rotor / STEP + rng.uniform(size=2)) * STEP, Q


def smoothed_log(t, q, **options):
    return jounce.Motion.fit(t, q, allow_noise=True, **options)


def identify_log(motion, Q, t, **options):
    return MODEL.identify(motion, Q, t=t, drives=("damping",), prior=10.0, **options)


def errors_over_deviations(found):
    return ([row.value for row in found.table] - TRUE) / np.sqrt(np.diag(found.covariance))


def posed_without_rounds(t, q, Q):
    measured = {"forces": Q, "t": t, "weights": None, "deviations": None}
    logs = check_logs(MODEL.mechanism, smoothed_log(t, q), measured, None, ())
    return fit_logs(FitOptions(MODEL, ("damping",)), logs)


@pytest.mark.parametrize(
    ("of", "lower"),
    [
        (BandErrors(7.9, 1.0, 1.01 * resmoothing.MIN_GAIN, 10.0), True),
        (BandErrors(7.9, 1.0, 0.99 * resmoothing.MIN_GAIN, 10.0), False),
        (BandErrors(10.1 * resmoothing.MAX_CONFIRMED_SHARE, 1.0, 2.0, 10.0), False),
        (BandErrors(0.0, 1.0, 2.0, 10.0), False),
    ],
)
def test_a_band_is_lower_by_gain_and_by_frequency(of, lower):
    assert of.is_lower == lower


@pytest.mark.parametrize("size", [0.3, 3.0])
def test_accelerations_that_no_torque_makes_end_the_band(size):
    """A motion up to 5 Hz, errors from 12 Hz on, and noise of torques."""
    rng, t = np.random.default_rng(1), np.arange(0, 10, 0.01)
    moved, false = (np.sin(2 * np.pi * f * t)[:, None] for f in (5.0, 12.0))
    noise = 0.01 * rng.normal(size=(len(t), 1))
    found = resmoothing.band_errors(t, moved + size * false, noise - size * false, 30.0)
    assert 5 < found.frequency < 12
    assert found.is_lower
    assert not resmoothing.band_errors(t, moved + size * false, noise, 30.0).is_lower, "torques make it"


@pytest.mark.parametrize(
    ("count", "lower"), [(resmoothing.MIN_CONFIRMED_CELLS - 1, False), (resmoothing.MIN_CONFIRMED_CELLS, True)]
)
def test_few_cells_have_no_band_of_their_own(count, lower):
    """False accelerations in every other cell."""
    t = np.arange(count) / 10
    moved, false = np.sin(np.pi * t)[:, None], (-1.0) ** np.arange(count)[:, None]
    found = resmoothing.band_errors(t, moved + false, -false, 30.0)
    assert found.is_lower == lower
    assert (found.least < found.total) == lower


def test_a_single_cell_says_nothing():
    one = np.ones((1, 1))
    assert resmoothing.band_errors(np.zeros(1), one, one, 30.0) is None


@QUIET
def test_play_is_smoothed_away():
    t, q, Q = swung()
    found = identify_log(smoothed_log(t, q), Q, t)
    (band,) = found.confirmed
    assert band < resmoothing.MAX_CONFIRMED_SHARE * resmoothing.chosen_bandwidth(smoothed_log(t, q))
    assert found.notes[0] == f"{CONFIRMED}{band:.3g} Hz; smoothed to that{TURNING}"
    assert np.abs(errors_over_deviations(found)).max() < 4.5


@pytest.mark.parametrize("seed", range(3))
def test_links_that_encoders_follow_are_left_alone(seed):
    t, q, Q = swung(seed=seed, play=0.0)
    found = identify_log(smoothed_log(t, q), Q, t)
    assert found.confirmed == (None,)
    assert all(note.startswith("half a step of the encoder of") for note in found.notes)


@QUIET
def test_a_stated_bandwidth_is_kept():
    t, q, Q = swung()
    stated = smoothed_log(t, q, bandwidth=30.0)
    assert resmoothing.chosen_bandwidth(stated) is None
    assert resmoothing.limited_bandwidth(stated) == 30.0
    assert identify_log(stated, Q, t).confirmed == (None,)


@QUIET
def test_splines_have_no_samples_to_smooth():
    t, q, Q = swung()
    through = jounce.Motion.fit(t, q, degree=7, intervals=200)
    found = identify_log(through, Q, t)
    assert (resmoothing.chosen_bandwidth(through), found.confirmed) == (None, (None,))


@QUIET
def test_torques_of_one_joint_confirm_nothing():
    t, q, Q = swung()
    Q[:, 1] = np.nan
    assert identify_log(smoothed_log(t, q), Q, t).confirmed == (None,)


@QUIET
def test_two_seconds_suffice_to_identify():
    t, q, Q = swung(2.0)
    assert np.isfinite(errors_over_deviations(identify_log(smoothed_log(t, q), Q, t))).any()


@QUIET
def test_masses_that_no_robot_has_confirm_nothing():
    """M of 0 is singular, and -M is no mass matrix."""
    fit = posed_without_rounds(*swung())
    (posed,) = fit.posed
    model = posed.model_parameters[posed.places]
    assert find_band(posed, fit.solution.x).is_lower
    assert find_band(posed, -model) is None
    assert find_band(posed, -2 * model) is None


@QUIET
def test_each_log_has_its_own_band():
    logs = {"play": swung(), "tight": swung(seed=1, play=0.0)}
    motions = {name: smoothed_log(t, q) for name, (t, q, _) in logs.items()}
    found = MODEL.identify(
        motions, [Q for *_, Q in logs.values()], t=[t for t, *_ in logs.values()], drives=("damping",), prior=10.0
    )
    assert found.confirmed[1] is None
    assert found.notes[0] == f"play: {CONFIRMED}{found.confirmed[0]:.3g} Hz; smoothed to that{TURNING}"


def test_motions_are_smoothed_once_more_from_their_samples():
    """Wild rows are found again; other columns and another pace stay."""
    t, q, _ = swung(3.0)
    q[700] += 0.1
    motion, expected = smoothed_log(t, q), smoothed_log(t, q, bandwidth=8.0)
    again = resmoothing.smooth_motion_to(motion, 8.0)
    assert np.array_equal(again(t, 2), expected(t, 2))
    assert np.array_equal(again.residual, expected.residual)
    slow = motion.scaled(2.0)
    assert resmoothing.chosen_bandwidth(slow) == pytest.approx(resmoothing.chosen_bandwidth(motion) / 2)
    assert np.allclose(resmoothing.smooth_motion_to(slow, 4.0)(2 * t, 0)[0], expected(t, 0)[0], atol=1e-9)
    assert resmoothing.limited_bandwidth(resmoothing.smooth_motion_to(slow, 4.0)) == pytest.approx(4.0)
    assert resmoothing.limited_bandwidth(motion) == np.inf


@QUIET
def test_residuals_do_not_count_uncertain_ends():
    t, q, Q = swung(4.0, play=0.0)
    motion = smoothed_log(t, q)
    first, last = resmoothing.trusted_span(motion)
    assert motion.start < first < last < motion.stop
    found = identify_log(motion, Q, t)
    inside = (found.t >= first) & (found.t <= last)
    left = np.sqrt(((found.measured - found.predicted)[inside] ** 2).mean(axis=0))
    assert [row.identified_samples for row in found.residuals] == pytest.approx(left)


def test_a_start_has_little_noise_and_large_errors_of_the_motion():
    posed = posed_without_rounds(*swung(2.0)).posed[0]
    cells, one = posed.cells, np.ones(2)
    given = Equations(
        cells.Y[..., posed.columns], cells.off, cells.model, cells.counts, cells.spread, posed.errors, False, 1e-9 * one
    )
    last = list(_starts(given))[-1]
    assert not last.x.any()
    assert last.noise == pytest.approx(MIN_NOISE_SHARE * given.usual_square(cells.off))
    assert (last.factors == MAX_VARIANCE_FACTOR).all()


def test_usual_squares_leave_out_uncertain_ends():
    off = np.random.default_rng(0).normal(size=(2000, 1))
    ones = np.ones_like(off)
    given = Equations(ones[..., None], off, 0 * ones, ones, 0 * ones, None, False, np.zeros(1))
    assert given.usual_square(off) == pytest.approx(given.mean_square(off), rel=0.1)
    ends = np.concatenate([1e4 * np.ones((5, 1)), off[10:], 1e4 * np.ones((5, 1))])
    assert given.usual_square(ends) == pytest.approx(given.usual_square(off), rel=0.05)
    sparse = np.where(np.arange(2000)[:, None] % 3, 0.0, off)
    assert given.usual_square(sparse) == given.mean_square(sparse)


@QUIET
@pytest.mark.parametrize(("share", "warned"), [(0.0, True), (0.2, False)])
def test_a_free_swing_does_not_set_the_scale(share, warned):
    """Torques of 0 but for noise, and of a fifth of those of a motion."""
    t, q, Q = swung(3.0, play=0.0)
    rng = np.random.default_rng(2)
    torques = share * Q + 1e-3 * rng.normal(size=Q.shape)
    notes = identify_log(smoothed_log(t, q), torques, t, torques_as_given=True).notes
    assert any("a free swing determines ratios" in note for note in notes) == warned


@pytest.mark.parametrize(
    ("of_all", "turns", "named"),
    [(0.6, 10, True), (0.4, 10, False), (0.0, 10, False), (0.6, 60, False)],
    ids=["most", "less than half", "none", "turns all the time"],
)
def test_play_has_its_errors_where_joints_turn_back(of_all, turns, named):
    """The share of squares in two cells before each reversal and the two after it; ends do not count."""
    v, e = np.cos(np.pi * (turns / 1000) * np.arange(1000) + 1e-3), np.zeros(1000)
    near = np.flatnonzero(v[1:] * v[:-1] < 0)[1:-1]
    e[near], e[near + 8] = np.sqrt(of_all), np.sqrt(1 - of_all)
    e[[0, -1]] = 1e3
    assert _is_off_where_it_turns(v, e) == named
