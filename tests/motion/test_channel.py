"""Channels: their rates, rows, columns and parts, what they print, and the frames of pandas and xarray they become."""

import re
from dataclasses import replace

import numpy as np
import pytest

import jounce
from jounce.core.display import MAX_LINES_PRINTED
from jounce.io.motions import writing
from jounce.motion.channel import Channel, divide_by_seconds
from jounce.motion.motion import Break
from support.refusals import expect_refusal, refusal

T = np.linspace(0, 2, 201)
W = np.array([1.0, 2.0])
RATES = tuple(W**k * np.sin(W * T[:, None] + k * np.pi / 2) for k in range(3))
BOUNDS = tuple(np.array([[-1.0, -np.inf], [1.0, 2.0 + k]]) for k in range(3))
Q = Channel(
    "Q", ("arm", "slide"), ("N m", "N"), T, RATES,
    deviations=tuple(0.1 * (k + 1) + 0 * x for k, x in enumerate(RATES)),
    windows=((0.0, 2.0), (0.1, 1.9), (0.2, 1.8)), breaks=(Break(0.5, "arm", 1, 1.0),), bounds=BOUNDS,
)  # fmt: skip
WRENCHES = Channel("Wc", ("foot", "hand"), ("N m and N",) * 2, T, (np.arange(201 * 12.0).reshape(201, 2, 6),))


def test_a_rate_is_a_channel_with_the_rates_that_follow():
    Qd = Q.rate(1)
    assert (Qd.symbol, Qd.units, Qd.rate_names) == ("Qd", ("N m/s", "N/s"), ("Qd", "Q2d"))
    np.testing.assert_array_equal(Qd.values, RATES[1])
    np.testing.assert_array_equal(Qd.deviations[1], Q.deviations[2])
    np.testing.assert_array_equal(Qd.bounds[0], BOUNDS[1])
    assert (Qd.windows, Qd.breaks, Qd.names) == (Q.windows[1:], Q.breaks, Q.names)
    assert Qd.rate(1).symbol == Q.rate(2).symbol == "Q2d"
    assert Qd.rate(1).units == Q.rate(2).units == ("N m/s^2", "N/s^2")
    assert Q.rate(0).units == Q.units
    q2d = Channel("q2d", ("a",), ("rad/s^2",), T, (T[:, None], T[:, None], T[:, None]))
    assert q2d.rate_names == ("q2d", "q3d", "q4d")


@pytest.mark.parametrize("order", [-1, 3])
def test_a_rate_that_is_not_there_is_refused(order):
    refusal(lambda: Q.rate(order), f"Q has no rate of order {order}; available: Q, Qd, Q2d")


def test_rates_up_to_an_order():
    low = Q.upto(1)
    assert low.rate_names == ("Q", "Qd")
    assert [len(x) for x in (low.rates, low.deviations, low.windows, low.bounds)] == [2] * 4
    assert low.units == Q.units
    assert Q.upto(9).rate_names == Q.rate_names
    refusal(lambda: Q.upto(-1), "order is -1; expected 0 or more")


@pytest.mark.parametrize("which", [slice(10, 20), np.array([3, 5, 200]), T > 1])
def test_rows_are_those_of_times(which):
    part = Q.rows(which)
    np.testing.assert_array_equal(part.times, T[which])
    for k in range(3):
        np.testing.assert_array_equal(part.rates[k], RATES[k][which])
        np.testing.assert_array_equal(part.deviations[k], Q.deviations[k][which])
        np.testing.assert_array_equal(part.bounds[k], BOUNDS[k])
    assert part.names == Q.names


def test_columns_are_in_the_order_asked_for():
    part = Q.columns([1, 0])
    assert (part.names, part.units) == (("slide", "arm"), ("N", "N m"))
    for k in range(3):
        np.testing.assert_array_equal(part.rates[k], RATES[k][:, ::-1])
        np.testing.assert_array_equal(part.deviations[k], Q.deviations[k][:, ::-1])
        np.testing.assert_array_equal(part.bounds[k], BOUNDS[k][:, ::-1])
    foot = WRENCHES.columns([0])
    np.testing.assert_array_equal(foot.values, WRENCHES.values[:, :1])


@pytest.mark.parametrize("whole", [Q, WRENCHES])
def test_parts_that_follow_each_other_are_joined(whole):
    joined = Channel.join([whole.rows(slice(0, 50)), whole.rows(slice(50, 51)), whole.rows(slice(51, None))])
    np.testing.assert_array_equal(joined.times, T)
    for k, x in enumerate(whole.rates):
        np.testing.assert_array_equal(joined.rates[k], x)
    if whole.deviations is None:
        assert joined.deviations is None
    else:
        np.testing.assert_array_equal(np.stack(joined.deviations), np.stack(whole.deviations))
    assert Channel.join([whole]) is whole


@pytest.mark.parametrize("other", [Q.rate(1), Q.columns([1, 0]), Q.columns([0]), Q.upto(1),
                                   replace(Q, deviations=None), replace(Q, units=("N", "N m"))])  # fmt: skip
def test_parts_of_something_else_are_refused(other):
    with expect_refusal("do not go on Q, Qd, Q2d of", "expected parts of one quantity of the same joints"):
        Channel.join([Q, other])


def test_shapes_that_do_not_fit_are_refused():
    def channel(rates, names=("a", "b"), units=("N", "N"), deviations=None):
        return Channel("Q", names, units, T, rates, deviations)

    refusal(lambda: channel((RATES[0][:9],)), "values of Q have shape (9, 2); expected (201, 2)")
    refusal(lambda: channel((RATES[0], RATES[1][:, :1])), "values of Q have shape (201, 1); expected (201, 2)")
    refusal(lambda: channel(RATES, deviations=(RATES[0].T,)), "values of Q have shape (2, 201); expected (201, 2)")
    refusal(lambda: channel(RATES, units=("N",)), "Q has 1 units; expected 2, one per name")


def test_changed_arrays_keep_names_and_times():
    doubled = Q.map(lambda x: 2 * x)
    np.testing.assert_array_equal(doubled.rates[2], 2 * RATES[2])
    np.testing.assert_array_equal(doubled.deviations[0], 2 * Q.deviations[0])
    assert (doubled.names, doubled.times is T, doubled.bounds) == (Q.names, True, Q.bounds)
    refusal(lambda: Q.map(lambda x: x[1:]), "values of Q have shape (200, 2); expected (201, 2)")


def test_columns_of_a_table_are_named_by_joint_and_rate():
    found = replace(Q, deviations=None).upto(1).to_columns()
    assert list(found) == ["arm.Q", "arm.Qd", "slide.Q", "slide.Qd"]
    np.testing.assert_array_equal(found["slide.Qd"], RATES[1][:, 1])
    assert list(Q.upto(0).to_columns()) == ["arm.Q", "arm.Q_sd", "slide.Q", "slide.Q_sd"]
    stems = Channel("", ("base.x", "break"), ("", ""), T, RATES[:2])
    assert list(stems.to_columns()) == ["base.x", "base.xd", "break", "breakd"]
    refusal(lambda: replace(Q, names=("arm", "arm")).to_columns(), "Q has several columns of arm; expected other names")


def test_channels_of_different_times_make_no_table():
    assert list(writing.table_columns([Q.upto(0), mark_at(T)])) == [
        "t",
        "arm.Q",
        "arm.Q_sd",
        "slide.Q",
        "slide.Q_sd",
        "mark",
    ]
    refusal(lambda: writing.table_columns([Q, mark_at(T + 1e-9)]), "expected the same times of all channels of a table")


def mark_at(t):
    return Channel("", ("mark",), ("",), t, (np.zeros((len(t), 1)),))


@pytest.mark.parametrize(
    ("unit", "rates"),
    [("N m", ["N m", "N m/s", "N m/s^2"]), ("rad/s", ["rad/s", "rad/s^2", "rad/s^3"]), ("1", ["1", "1/s", "1/s^2"]),
     ("m/s^2", ["m/s^2", "m/s^3", "m/s^4"]), ("", ["", "", ""]),
     ("N m or N", ["N m or N", "N m/s or N/s", "N m/s^2 or N/s^2"]),
     ("rad/s and m/s", ["rad/s and m/s", "rad/s^2 and m/s^2", "rad/s^3 and m/s^3"])],
)  # fmt: skip
def test_units_of_rates(unit, rates):
    assert [divide_by_seconds(unit, k) for k in range(3)] == rates


def test_peaks_stand_out_of_their_bands():
    """A wild end whose deviation is larger is no peak; where no deviation is known, the largest value is."""
    values = np.stack([np.where(T < 0.1, 99.0, T), np.where(T < 0.1, 99.0, T)], axis=1)
    off = np.stack([np.where(T < 0.1, 80.0, 0.01), np.full(len(T), np.nan)], axis=1)
    at, size = Channel("q", ("a", "b"), ("rad",) * 2, T, (values,), (off,)).surest_peaks()
    assert (at.tolist(), size.tolist()) == ([200, 0], [2.0, 99.0])


def test_a_frame_of_pandas_holds_values_deviations_and_units():
    frame = Q.to_pandas()
    names = [f"{joint}.{rate}{end}" for joint in Q.names for end in ("", "_sd") for rate in Q.rate_names]
    assert frame.columns.tolist() == names
    assert frame.index.name == "t"
    np.testing.assert_array_equal(frame.index, T)
    np.testing.assert_array_equal(frame["slide.Qd"], RATES[1][:, 1])
    np.testing.assert_array_equal(frame["arm.Q2d_sd"], Q.deviations[2][:, 0])
    assert frame.attrs["units"]["slide.Q2d"] == frame.attrs["units"]["slide.Q2d_sd"] == "N/s^2"
    entries = WRENCHES.to_pandas()
    assert entries.columns[7] == "hand[1].Wc"
    np.testing.assert_array_equal(entries["hand[1].Wc"], WRENCHES.values[:, 1, 1])


def test_a_dataset_of_xarray_holds_values_deviations_and_units():
    pytest.importorskip("xarray")
    found = Q.to_xarray()
    assert dict(found.sizes) == {"t": 201, "joint": 2}
    assert list(found.data_vars) == ["Q", "Q_sd", "Qd", "Qd_sd", "Q2d", "Q2d_sd"]
    np.testing.assert_array_equal(found["Qd"].sel(joint="slide"), RATES[1][:, 1])
    np.testing.assert_array_equal(found["Q2d_sd"].transpose("t", "joint"), Q.deviations[2])
    assert found["Qd"].attrs["units"] == "N m/s or N/s"
    assert found["t"].attrs["units"] == "s"
    assert dict(WRENCHES.to_xarray()["Wc"].sizes) == {"t": 201, "joint": 2, "axis1": 6}


@pytest.mark.parametrize("package", ["pandas", "xarray"])
def test_without_the_package_of_frames_the_extra_is_named(package, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, package, None)
    convert = getattr(Q, f"to_{package}")
    refusal(convert, f"to_{package}() needs {package}", "pip install 'jounce[frames]'")


def test_a_channel_prints_its_largest_values_and_when():
    head, titles, arm, slide = repr(Q).splitlines()
    assert head == "<Q, Qd, Q2d [N m or N] of 2 columns, 201 times, t = 0 .. 2 s, 1 break>"
    assert re.split(r" {2,}", titles.strip()) == [
        x for name in Q.rate_names for x in (f"largest |{name}|", "at t, s")
    ]  # fmt: skip
    at = [np.abs(x).argmax(axis=0) for x in RATES]
    for j, line in enumerate((arm, slide)):
        cells = re.split(r" {2,}", line)
        numbers = [x for k in range(3) for x in (f"{abs(RATES[k][at[k][j], j]):.5g} ± {0.1 * (k + 1):.2g}",
                                                 f"{T[at[k][j]]:.5g}")]  # fmt: skip
        assert cells == [Q.names[j], *numbers]
    assert len({len(titles), len(arm), len(slide)}) == 1, "columns are aligned"
    assert repr(WRENCHES) == "<Wc [N m and N] of 2 columns, 201 times, t = 0 .. 2 s>"
    assert repr(Q.rows(slice(0, 0))) == "<Q, Qd, Q2d [N m or N] of 2 columns, 0 times, no times, 1 break>"


@pytest.mark.parametrize("count", [9, 10, 11, 300])
def test_many_columns_are_counted(count):
    names = tuple(f"joint{j}" for j in range(count))
    lines = repr(Channel("q", names, ("rad",) * count, T, (np.tile(T[:, None], count),))).splitlines()
    assert len(lines) <= MAX_LINES_PRINTED
    shown = sum(line.startswith("joint") for line in lines)
    assert shown == count or lines[-1] == f"and {count - shown} more"


def test_values_that_are_not_known_are_dashes():
    values = np.stack([np.full(len(T), np.nan), T], axis=1)
    line = repr(Channel("i", ("a", "b"), ("A",) * 2, T, (values,))).splitlines()[2]
    assert line.split() == ["a", "-", "-"]


@pytest.fixture(scope="module")
def forces_of_g1():
    """The forces along a motion of a robot that floats, with many joints."""
    robot = jounce.load("g1", base="floating")
    t = np.linspace(0, 1, 41)
    motion = jounce.Motion.polynomial([[0.1, 0.01 * (j + 1)] for j in range(robot.n)], 1.0)
    return robot.forces_along(motion.with_base(None, np.eye(4)), t)


def test_forces_along_a_motion_print_the_largest_of_each_rate():
    robot = jounce.load("iiwa14")
    along = robot.forces_along(jounce.load_motion("paper", robot).with_step(0.01))
    head, titles, *lines = repr(along).splitlines()
    assert head == "<Along: 501 times, t = 0 .. 5 s>"
    assert titles.split() == ["largest", "unit", "of", "at", "t,", "s"]
    assert [line.split()[0] for line in lines] == ["q", "qd", "q2d", "q3d", "q4d", "Q", "Qd", "Q2d"]
    i, j = np.unravel_index(np.abs(along.forces[1]).argmax(), along.forces[1].shape)
    assert re.split(r" {2,}", lines[6]) == [
        "Qd", f"{abs(along.forces[1][i, j]):.5g}", "N m/s", f"joint{j + 1}", f"{along.t[i]:.5g}"
    ]  # fmt: skip


def test_a_large_robot_prints_twelve_lines(forces_of_g1):
    """Rates that find no place are named, and the largest are found in each unit."""
    lines = repr(forces_of_g1).splitlines()
    assert len(lines) <= MAX_LINES_PRINTED
    assert lines[-1] == "also: q3d, q4d; C of base; V, Vd, V2d, V3d of base"
    forces = forces_of_g1.forces[0]
    newtons = [j for j, unit in enumerate(forces_of_g1.efforts.units) if unit == "N"]
    [found] = [cells for line in lines if (cells := re.split(r" {2,}", line))[::2][:2] == ["Q", "N"]]
    assert float(found[1]) == pytest.approx(np.abs(forces[:, newtons]).max(), rel=1e-4)
    assert len(repr(forces_of_g1.efforts).splitlines()) == MAX_LINES_PRINTED


def test_motors_along_a_motion_print_theirs_and_notes():
    robot = jounce.load("iiwa14").elastic(1e4, rotor=0.4)
    along = robot.motors_along(jounce.load_motion("paper", robot).with_step(0.05))
    lines = repr(along).splitlines()
    assert len(lines) <= MAX_LINES_PRINTED
    [tau] = [line.split() for line in lines if line.startswith("tau ")]
    i, j = np.unravel_index(np.abs(along.torques[0]).argmax(), along.torques[0].shape)
    assert tau == ["tau", f"{abs(along.torques[0][i, j]):.5g}", "N", "m", f"joint{j + 1}", f"{along.t[i]:.5g}"]
    assert bool(along.notes) == ("would have to" in lines[-1])
