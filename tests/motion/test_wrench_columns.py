"""Wrenches in motion tables: by body or merged link, as samples or with all rates, in any component."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import jounce
from jounce.io import tables
from support.commands import call
from support.motion_tables import from_table
from support.refusals import refusal

PANDA = Path(__file__).parents[2] / "examples" / "panda.urdf"
IIWA = jounce.load("iiwa14").mechanism
T = np.linspace(0, 1, 40)
JOINTS = {"t": T} | {name: np.cos((i + 1) * T) for i, name in enumerate(IIWA.coordinates)}
RATES = {"t": T} | {
    f"{name}.{rate}": np.cos(T + i + k) for i, name in enumerate(IIWA.coordinates)
    for k, rate in enumerate(("q", "qd", "q2d", "q3d", "q4d"))
}  # fmt: skip


def wave_rate(k):
    return 10 * np.pi**k * np.sin(np.pi * T + k * np.pi / 2)


FULL = {f"link7.fz{rate}": wave_rate(k) for k, rate in enumerate(("", "d", "2d"))}


@pytest.mark.parametrize("motion", [JOINTS, RATES], ids=["samples", "rates"])
def test_samples_of_a_wrench_get_their_rates_from_a_spline(motion):
    W = from_table(motion | {"link7.fz": wave_rate(0), "link4.mx": 0 * T}, IIWA, 4, "m.csv").wrench(T)
    assert [sorted(rate) for rate in W] == [["link4", "link7"]] * 3
    for k, rate in enumerate(W):
        np.testing.assert_allclose(rate["link7"][:, 5], wave_rate(k), atol=1e-5 * 10 * np.pi**k)
        assert not rate["link7"][:, :5].any()


def test_a_body_may_be_called_as_a_joint_is():
    """And a joint as a component of a wrench is."""
    bodies, joints = ("arm", "hand"), ("arm", "elbow.fx")
    twins = replace(jounce.load("planar2r").mechanism, bodies=bodies, joints=joints, coordinates=joints)
    motion = from_table({"t": T, "arm": T, "elbow.fx": -T, "arm.fx": T}, twins, 2, "m.csv")
    np.testing.assert_allclose(motion(T, 0)[0], np.stack([T, -T], 1), atol=1e-15)
    [W] = motion.wrench(T, 0)
    assert list(W) == ["arm"]
    np.testing.assert_allclose(W["arm"][:, 3], T, atol=1e-15)


@pytest.mark.parametrize("motion", [JOINTS, RATES], ids=["samples", "rates"])
def test_rates_of_a_wrench_are_used_as_they_are(motion):
    for highest, count in ((2, 1), (3, 2), (4, 3)):
        W = from_table(motion | FULL, IIWA, highest, "m.csv").wrench(T, count - 1)
        assert all((rate["link7"][:, 5] == wave_rate(k)).all() for k, rate in enumerate(W))


def test_no_wrench_columns_no_wrench():
    assert from_table(JOINTS, IIWA, 4, "m.csv").wrench(T) is None


SECONDS = np.arange(1000) / 250
SMOOTH = {"t": SECONDS, "joint1": np.cos(SECONDS), "joint2": np.sin(2 * SECONDS)}
PLANAR = jounce.load("planar2r")


def push_rate(k):
    return 10 * 2.0**k * np.sin(2 * SECONDS + k * np.pi / 2)


def test_measured_wrenches_are_smoothed_and_have_deviations():
    """A force sensor's noise, and none of its components that rest."""
    noise = np.random.default_rng(0).normal(size=(2, len(SECONDS)))
    columns = SMOOTH | {"body2.fy": push_rate(0) + 0.05 * noise[0], "body2.mz": 0.1 + 0.01 * noise[1]}
    motion = jounce.load_motion(columns, PLANAR)
    inside = slice(150, -150)
    off = motion.wrench_deviations(SECONDS)
    for k, rate in enumerate(motion.wrench(SECONDS)):
        error = np.abs(rate["body2"][inside, 4] - push_rate(k)[inside])
        assert error.max() < 0.02 * 10 * 2.0**k
        assert (error < 1.96 * off[k]["body2"][inside, 4]).mean() >= 0.9
    assert np.ptp(motion.wrench(SECONDS)[0]["body2"][:, 2]) < 1e-12
    assert any(note.startswith("wrench of 'body2': samples, smoothed") for note in motion.notes)
    along = PLANAR.forces_along(motion)
    exact = PLANAR.forces_along(
        jounce.load_motion(SMOOTH | {"body2.fy": push_rate(0), "body2.mz": 0.1 + 0 * SECONDS}, PLANAR)
    )
    assert exact.deviations is None
    for k in range(3):
        error = np.abs(along.forces[k] - exact.forces[k])[inside]
        assert (error <= 1.96 * along.deviations[k][inside] + 1e-9).mean() >= 0.9


def test_a_wrench_whose_noise_drowns_its_rates_is_refused():
    columns = SMOOTH | {"body2.fy": 3 * np.sin(SECONDS) + np.random.default_rng(0).normal(size=len(SECONDS))}
    words = ("wrench of 'body2'", "do not carry W2d", "a lower bandwidth= smooths", "allow_noise=True accepts")
    refusal(lambda: jounce.load_motion(columns, PLANAR), *words)


def test_a_wrench_that_jumps_is_told():
    columns = SMOOTH | {"body2.fy": np.where(SECONDS < 2, 0, 1 + push_rate(0))}
    with pytest.warns(jounce.JounceWarning, match=r"wrench of 'body2': a wrench jumps at 1 knot: Q is discontinuous"):
        jounce.load_motion(columns, PLANAR, degree=7)


def test_wrenches_that_jump_are_breaks_and_are_blended():
    """Of two motions one after the other, one of which pushes."""
    robot = jounce.load("iiwa14")
    first = replace(jounce.load_motion("paper-wrench", robot), joint_names=None)
    still = jounce.Motion.polynomial(np.stack([first(first.stop, 0)[0]], axis=1), 1.0)
    motion = first + still
    at = first.stop
    jumps = [found for found in motion.breaks if found.symbol == "W"]
    [before], [after] = (motion.wrench(at, 0, side) for side in ("left", "right"))
    assert {found.t for found in jumps} == {at}
    [body] = motion.loads
    for found in jumps:
        component = ("mx", "my", "mz", "fx", "fy", "fz").index(found.joint.removeprefix(f"{body}."))
        if found.order == 0:
            assert found.jump == pytest.approx((after[body] - before[body])[component])
    [broken] = robot.forces_along(motion, t=[at - 0.1, at + 0.1]).breaks
    assert set(jumps) <= set(broken.causes)
    smooth = motion.blended(0.2)
    assert smooth.breaks == ()
    assert any("blended, at most" in note for note in smooth.notes)


def test_run_applies_them_also_on_merged_links(tmp_path):
    robot = jounce.load(PANDA)
    motion = {"t": T} | {name: -0.3 + 0.1 * np.cos((i + 1) * T) for i, name in enumerate(robot.joint_names)}
    motion["panda_joint6"], motion["panda_finger_joint1"] = 1 + 0.1 * np.cos(T), 0.02 + 0.01 * np.cos(T)
    wrench = {"panda_hand_tcp.fx": np.sin(T), "panda_link4.my": np.cos(2 * T)}
    tables.write(tmp_path / "m.npz", motion | wrench)
    asked = ["run", str(PANDA), str(tmp_path / "m.npz"), "-o", str(tmp_path / "f.npz")]
    assert call(*asked).exit_code == 0
    table = from_table(motion | wrench, robot.mechanism, 4, "m.npz")
    Q = robot.inverse_dynamics(*table(T), wrench=table.wrench(T))
    found = tables.read(tmp_path / "f.npz")
    assert (found["panda_joint2.Q2d"] == Q[2][:, 1]).all()
    assert np.abs(Q[0] - robot.inverse_dynamics(*table(T))[0]).max() > 0.1


@pytest.mark.parametrize(("columns", "words"), [
    ({"link8.fz": T}, ["unknown body 'link8'; did you mean 'link7'"]),
    ({k: v for k, v in FULL.items() if k != "link7.fzd"}, ["missing 'link7.fzd'"]),
    (FULL | {"link7.mx": T}, ["missing 'link7.mxd'"]),
    ({"link7.fw": T}, ["unknown 'link7.fw'"]),
    ({"link7.fzdd": T}, ["unknown 'link7.fzdd'"]),
])  # fmt: skip
def test_refuses_bad_wrench_columns(columns, words):
    refusal(lambda: from_table(JOINTS | columns, IIWA, 4, "m.csv"), "m.csv: ", *words)
