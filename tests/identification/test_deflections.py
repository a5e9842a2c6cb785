"""Deflections of springs, measured behind the gears: stiffness without positions of motors."""

from dataclasses import replace

import numpy as np
import pytest

import jounce
from identification.conftest import table_values
from support.commands import summary
from support.refusals import expect_refusal, refusal, refused

T = np.arange(1500) * 0.005
K = np.array([170.0, 70.0])  # N m/rad
ROBOT = jounce.load("planar2r")
QUIET = pytest.mark.filterwarnings("ignore::jounce.JounceWarning")  # what notes hold


def deflection_columns(seed=0, sign=1.0, share=0.0):
    """A log of positions, deflections link less gear with a share of the positions, and efforts, with noise."""
    rng = np.random.default_rng(seed)
    motion = jounce.Motion.fourier([0.4, 0.3], [[0.4, 0.1], [0.2, 0.3]], [[0.2, 0.1], [0.3, 0.2]], 2.0, T[-1])
    rates = motion(T, 2)
    Q, q = ROBOT.inverse_dynamics(*rates), rates[0]
    measured = -sign * Q / K + share * q + 1e-5 * rng.normal(size=q.shape)
    columns = {"t": T}
    for j, name in enumerate(ROBOT.joint_names):
        columns[name] = q[:, j] + 1e-5 * rng.normal(size=len(T))
        columns[f"{name}.deflection"] = measured[:, j]
        columns[f"{name}.effort"] = Q[:, j] + 0.02 * rng.normal(size=len(T))
    return columns


def spring_log(**changes):
    columns = deflection_columns(**changes)
    links = jounce.load_motion(columns, ROBOT, order=0)
    deflections = jounce.load_motion(
        columns, ROBOT, order=0, columns="{joint}.deflection", allow_noise=True, angles="rad"
    )
    return links, deflections


def by_deflections(log, **options):
    links, deflections = log
    return ROBOT.identify_stiffness(links, deflections=deflections, rotor=0.1, **options)


@pytest.mark.parametrize("seed", range(3))
def test_deflections_give_the_stiffness(seed):
    found = by_deflections(spring_log(seed=seed))
    stiffness, deviations = table_values(found, "stiffness"), [row.deviation for row in found.table[::3]]
    assert stiffness == pytest.approx(K, rel=0.01)
    assert (np.abs(stiffness - K) < 4 * np.array(deviations)).all()
    assert found.notes == ()
    assert found.robot.elasticity.stiffness == pytest.approx(K, rel=0.01)


def test_deflections_are_as_good_as_motors_at_these_places():
    links, deflections = spring_log()
    (t, q), (_, measured) = links.samples, deflections.samples
    motors = replace(links, samples=(t, q - measured), torques=None)
    by_motors = ROBOT.identify_stiffness(links, motors, rotor=0.1)
    found = by_deflections((links, deflections))
    values = [[row.value for row in x.table] for x in (by_motors, found)]
    np.testing.assert_allclose(*values, rtol=1e-9, atol=1e-12)


@QUIET
def test_what_is_no_deflection_is_refused_or_named():
    links, deflections = spring_log()
    with expect_refusal("deflections without measured torques say nothing of stiffness", "torques='tau{number}'"):
        by_deflections((replace(links, torques=None), deflections))
    refusal(
        lambda: by_deflections(spring_log(sign=-1.0)),
        "stiffness of joint1, joint2 is negative; expected deflections of",
    )
    refusal(lambda: ROBOT.identify_stiffness(links, rotor=0.1), "neither motors nor deflections are given")
    both = "both motors and deflections are given; expected one of motors and deflections"
    refusal(lambda: by_deflections((links, deflections), motors=links), both)
    refusal(
        lambda: by_deflections((links, deflections), gear=100.0),
        "gear is of positions of motors; leave",
    )
    short = replace(deflections, samples=(T[:9], deflections.samples[1][:9]))
    refusal(lambda: by_deflections((links, short)), "deflections and links share 9 times; expected 16")
    named = by_deflections(spring_log(share=0.02))
    expected = "deflections of joint1, joint2 move with their links; expected deflections, without a share of"
    assert any(note.startswith(expected) for note in named.notes), named.notes


@pytest.fixture
def deflection_table(tmp_path):
    columns = deflection_columns()
    path = tmp_path / "log.csv"
    np.savetxt(path, np.column_stack([*columns.values()]), "%.17g", ",", header=",".join(columns), comments="")
    return path


def test_the_command_takes_deflections(deflection_table, tmp_path):
    words = "stiffness", "planar2r", deflection_table, "--rotor", 0.1, "-o", tmp_path / "k.yaml"
    found = summary(*words, "--deflections", "{joint}.deflection")
    assert [row["value"] for row in found["parameters"][::3]] == pytest.approx(K, rel=0.01)
    assert jounce.load(tmp_path / "k.yaml").elasticity.stiffness == pytest.approx(K, rel=0.01)


@pytest.mark.parametrize(("options", "message"), [
    ("--deflections {joint}.bend", "--deflections '{joint}.bend': no column 'joint1.bend'"),
    ("--deflections {joint}.deflection --motors {joint}", "both --motors and --deflections are given; expected one"),
    ("--deflections {joint}.deflection --gear 100", "--gear is of positions of motors; leave it out with --defl"),
    ("--deflections {joint}.deflection --rename joint1.effort=a --rename joint2.effort=b",
     "deflections without measured torques say nothing of stiffness; expected columns such as tau_JOINT or JOINT"),
])  # fmt: skip
def test_the_command_refuses_what_does_not_fit(deflection_table, tmp_path, options, message):
    refused(tmp_path, f"stiffness planar2r log.csv --rotor 0.1 -o k.yaml {options}", message)
