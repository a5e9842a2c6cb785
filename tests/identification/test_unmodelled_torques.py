"""Torques that no parameter holds: named with their size where residuals show them, and not where there are none."""

import re
from dataclasses import replace

import numpy as np
import pytest

import jounce

T = np.linspace(0, 6, 1501)
FRICTION, NOISE = np.array([3.0, 2.0, 1.0]), 0.05
LOOK = "residuals look like torques that no term of the model is: "
WITHOUT = ("damping", "friction", "stribeck", "offset")  # friction by the load is a torque that no term is
QUIET = pytest.mark.filterwarnings("ignore::jounce.JounceWarning")  # what notes hold


@pytest.fixture(scope="module")
def measure(arm, motion):
    """Torques of the arm with other masses, friction, noise and what acts besides: of the rates and rigid torques."""
    true = arm.with_inertial_parameters(1.2 * arm.inertial_parameters)

    def torques(act, seed=0):
        q, qd, q2d = motion(T, 2)
        rigid = true.inverse_dynamics(q, qd, q2d)
        noise = NOISE * np.random.default_rng(seed).normal(size=q.shape)
        return rigid + FRICTION * np.tanh(qd / 0.05) + 0.5 * qd + act(q, qd, rigid) + noise

    return torques


def of_load(share, joint=1):
    return lambda q, qd, rigid: share * np.abs(rigid) * np.tanh(qd / 0.05) * (np.arange(3) == joint)


def spring(stiffness, joint=1):
    return lambda q, qd, rigid: stiffness * q * (np.arange(3) == joint)


def tool_force(arm, f):
    """What a force (3,) on the last body adds to the torques of the drives."""
    return lambda q, qd, rigid: -(arm.jacobian(q, body=arm.body_names[-1], frame="world")[:, 3:].mT @ f)


def short_push(size, seconds):
    return lambda q, qd, rigid: size * (abs(T - 2 - seconds / 2) < seconds / 2)[:, None] * np.array([0, 1, 0])


def gain(share, joint=1):
    """Torques of a joint that are read too large."""
    return lambda q, qd, rigid: share * (rigid + FRICTION * np.tanh(qd / 0.05) + 0.5 * qd) * (np.arange(3) == joint)


def gripped(arm, motion, mass, since):
    """What a load on the forearm adds to the torques of the drives from some time on."""
    p = np.zeros_like(arm.inertial_parameters)
    p[-10] = mass
    added = arm.regressor(*motion(T, 2)) @ p
    return lambda q, qd, rigid: added * (since < T)[:, None]


def nothing(q, qd, rigid):
    return 0 * q


@QUIET
@pytest.mark.parametrize(
    ("act", "amount", "what"),
    [
        (of_load(0.05), 0.05, "friction of shoulder_lift_joint that grows by {} of its load"),
        (of_load(0.05, 2), 0.05, "friction of elbow_joint that grows by {} of its load"),
        (spring(2.0), 2.0, "a spring of {} N m/rad at shoulder_lift_joint"),
        ([5.0, 0, 0], 5.0, "a force of {} N along x on forearm_link"),
        ([0, -5.0, 0], -5.0, "a force of {} N along y on forearm_link"),
        (gain(0.07), 0.07, "torques of shoulder_lift_joint that are read too large by {} of them"),
        (gain(-0.05, 2), -0.05, "torques of elbow_joint that are read too large by {} of them"),
    ],
)
def test_what_acts_is_named_with_its_size(arm, motion, measure, act, amount, what):
    found = arm.identify(motion, measure(act if callable(act) else tool_force(arm, act)), t=T, drives=WITHOUT)
    number = r"(-?\d[\d.e-]*)"
    said = re.escape(LOOK + what).replace(r"\{\}", rf"{number} \+- {number}")
    (note,) = (note for note in found.notes if note.startswith(LOOK))
    value, deviation = map(float, re.match(rf"{said}; parameters adapt", note).groups())
    assert abs(value - amount) < 4 * deviation < abs(amount)


@QUIET
@pytest.mark.parametrize("amount", [2.0, -1.0])
def test_a_load_that_changes_is_named_with_its_time(arm, motion, measure, amount):
    """At one of fifteen times: 3.0 s is one of a log of 6 s."""
    found = arm.identify(motion, measure(gripped(arm, motion, amount, 3.0)), t=T, prior=10.0)
    (note,) = (note for note in found.notes if note.startswith(LOOK))
    said = re.search(r"a change of the load on forearm_link of (\S+) \+- (\S+) kg at (\S+) s", note)
    value, deviation, at = map(float, said.groups())
    assert abs(value - amount) < max(4 * deviation, 0.02)
    assert at == pytest.approx(3.0, abs=0.1)


@QUIET
def test_what_no_residual_determines_is_blamed_on_torques_that_act(arm, motion, measure):
    """And not on the motion."""
    found = arm.identify(motion, measure(gripped(arm, motion, 80.0, 3.0)), t=T, prior=10.0)
    (note,) = (note for note in found.notes if note.startswith("the data do not determine"))
    assert note.endswith("torques that no parameter holds make deviations large: see what residuals show")


@QUIET
@pytest.mark.parametrize(("share", "named"), [(0.3, True), (0.6, False), (-0.6, False)])
def test_a_factor_of_half_is_no_torque_constant(arm, motion, measure, share, named):
    notes = "".join(arm.identify(motion, measure(gain(share)), t=T, prior=10.0).notes)
    assert ("are read too large" in notes) == named
    assert ("factors of torques: a load of known mass calibrates them: robot.payload" in notes) == named


@QUIET
def test_a_joint_without_a_motor_has_no_factor(arm, motion, measure):
    """Its torques are noise, whatever those of the model are."""
    Q = measure(nothing)
    Q[:, 2] = NOISE * np.random.default_rng(1).normal(size=len(T))
    assert "elbow_joint that are read" not in "".join(arm.identify(motion, Q, t=T).notes)


def test_several_at_once(arm, motion, measure):
    both = [of_load(0.04, 1), of_load(0.06, 2)]
    with pytest.warns(jounce.JounceWarning, match="that grows by"):
        found = arm.identify(motion, measure(lambda *x: sum(act(*x) for act in both)), t=T, drives=WITHOUT)
    assert found.notes[-1].count("friction of ") == 2
    assert found.notes[-1].startswith(LOOK)


@pytest.mark.parametrize("seed", range(6))
def test_nothing_is_named_where_nothing_acts(arm, motion, measure, seed):
    """Of exact motions and of encoders."""
    Q, step = measure(nothing, seed), 2 * np.pi / 2**17
    assert arm.identify(motion, Q, t=T).notes == ()
    read = jounce.Motion.fit(T, np.round(motion(T, 0)[0] / step) * step, joint_names=arm.joint_names)
    assert arm.identify(read, Q, t=T).notes == ()


def test_what_is_smaller_than_chance_is_not_named(arm, motion, measure):
    """4e-5 N m per N m are about the deviation; see above for more of them."""
    assert arm.identify(motion, measure(of_load(4e-5)), t=T).notes == ()


@QUIET
@pytest.mark.parametrize("act", [of_load(-0.05), spring(-2.0)])
def test_friction_does_not_fall_with_the_load_and_springs_pull_back(arm, motion, measure, act):
    notes = "".join(arm.identify(motion, measure(act), t=T).notes)
    assert "of shoulder_lift_joint that grows by" not in notes
    assert "N m/rad at shoulder_lift_joint" not in notes


@QUIET
def test_terms_that_are_sought_are_not_named(arm, motion, measure):
    terms = ("damping", "friction", "offset", "spring")
    found = arm.identify(motion, measure(spring(2.0)), t=T, drives=terms)
    assert not any("a spring" in note for note in found.notes)
    assert found.robot.drives.stiffness[1] == pytest.approx(2.0, abs=0.5)


@pytest.mark.parametrize("size", [1.0, 10.0])
def test_a_push_is_named_with_its_time(arm, motion, measure, size):
    with pytest.warns(jounce.JounceWarning, match="forces of shoulder_lift_joint are unexplained from 2"):
        found = arm.identify(motion, measure(short_push(size, 0.5)), t=T)
    first, last, most = map(
        float, re.search(r"from ([\d.]+) to ([\d.]+) s, by up to ([\d.]+) N m", found.notes[-1]).groups()
    )
    assert (first, last, most) == (
        pytest.approx(2.0, abs=0.05),
        pytest.approx(2.5, abs=0.05),
        pytest.approx(size, rel=0.3),
    )


@QUIET
def test_a_payload_names_the_log(arm, motion, measure):
    logs = [
        replace(motion, torques=(T, measure(act, seed)))
        for seed, act in enumerate((short_push(10.0, 0.5), spring(2.0)))
    ]
    notes = arm.payload(*logs).notes
    assert notes[0].startswith("log with the load: forces of shoulder_lift_joint are unexplained from 2")
    assert notes[1].startswith(f"log without the load: {LOOK}a spring of ")


def test_what_parameters_explain_shows_nothing(arm, motion, measure):
    """A weight that hangs on the elbow is a mass, which the first moment of the upper arm takes up."""
    hung, clean = (arm.identify(motion, measure(act), t=T) for act in (tool_force(arm, [0, 0, -5.0]), nothing))
    assert hung.notes == ()
    row, other = (next(row for row in found.table if row.name == "upper_arm_link mcz") for found in (hung, clean))
    assert row.value - other.value == pytest.approx(5.0 / 9.81 * 0.425, rel=0.02)


ROTORS = np.array([0.3, 0.6, 0.4])  # kg m^2; those of the first two joints cannot be told from inertia of their bodies
ASKED = "residuals show what the model lacks, a rotor of "


def turned_rotors(arm, motion, measure, size):
    """Torques of the arm with rotors, and its encoders."""
    step, (q, _, q2d) = 2 * np.pi / 2**19, motion(T, 2)
    read = jounce.Motion.fit(T, np.round(q / step) * step, joint_names=arm.joint_names)
    return read, measure(nothing) + size * ROTORS * q2d


@QUIET
def test_rotors_are_found_where_residuals_show_them(arm, motion, measure):
    read, Q = turned_rotors(arm, motion, measure, 1.0)
    found = arm.identify(read, Q, t=T, prior=10.0)
    assert any(note.startswith(ASKED) for note in found.notes)
    rows = {row.name: row for row in found.table}
    elbow = rows["elbow_joint armature"]
    assert abs(elbow.value - ROTORS[2]) < 4 * elbow.deviation < ROTORS[2]
    assert not rows["shoulder_lift_joint armature"].seen
    left = [row.identified_samples for row in found.residuals if row.part == "used"]
    without = [row.identified_samples for row in arm.identify(read, measure(nothing), t=T, prior=10.0).residuals]
    assert left == pytest.approx(without, rel=0.05)


@QUIET
@pytest.mark.parametrize("size", [0.0, -0.5])
def test_no_rotor_is_invented(arm, motion, measure, size):
    """Nor one of negative inertia."""
    read, Q = turned_rotors(arm, motion, measure, size)
    found = arm.identify(read, Q, t=T)
    assert not any("rotor" in note for note in found.notes)
    assert not any(row.name.endswith("armature") for row in found.table)


@QUIET
def test_links_alone_get_no_rotors(arm, motion, measure):
    """Of which no drive terms are sought."""
    read, Q = turned_rotors(arm, motion, measure, 1.0)
    assert not any("armature" in row.name for row in arm.identify(read, Q, t=T, drives=False).table)
