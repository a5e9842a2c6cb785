"""Limits that a robot's data leave undecided: joints without mass, limits of 0, inertias that no body can have."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_check import evaluations

import jounce
from jounce.limits.limited_motion import validate_limits
from jounce.limits.motion_polynomials import split_motion
from jounce.model.mechanism import INERTIAS
from jounce.spatial import inertia
from support.commands import call

NO_MASSES = Path(__file__).parent / "no_masses.urdf"  # a carries b, of 2 kg; c none; the effort limit of jb is 0
MOTION = jounce.Motion.polynomial([[0, 0.3], [0.2, 0.2], [0, -0.1]], 1.0).with_step(0.01)
COLUMNS = [f"{joint}.{rate}" for joint in ("ja", "jb", "jc") for rate in ("q", "qd", "q2d")]
VERBS = ("check", "run", "retime", "slowdown", "report")


def write_motion(folder):
    joints = {name: {"polynomial": x} for name, x in {"ja": [0, 0.3], "jb": [0.2, 0.2], "jc": [0, -0.1]}.items()}
    (folder / "m.yaml").write_text(json.dumps({"time": {"start": 0, "stop": 1, "count": 101}, "joints": joints}))
    return folder / "m.yaml"


def load_massless(**options):
    with pytest.warns(jounce.JounceWarning, match="bodies without mass") as warned:
        robot = jounce.load(NO_MASSES, **options)
    assert len(warned) == 1
    return robot


def efforts(found):
    return {row.joint: row for row in found.table if row.limit == "effort"}


@pytest.mark.parametrize(("meant", "jc"), [(False, "undecided"), (True, "kept")])
def test_missing_masses_keep_no_limit(meant, jc):
    rows = efforts(found := load_massless(massless_tips=meant).check(MOTION))
    assert {joint: row.verdict for joint, row in rows.items()} == {"ja": "kept", "jb": "undecided", "jc": jc}
    assert (found.verdict, found.ok) == ("undecided", False)
    assert "0 on both sides" in rows["jb"].cause
    assert ("moves no inertia" in (rows["jc"].cause or "")) == (not meant)
    assert all(row.verdict == "kept" for row in found.table if row.limit != "effort")
    assert sum("undecided: effort of" in note for note in found.notes) == 2 - meant
    assert found.judged["effort"] == 1  # of ja


@pytest.mark.parametrize("bound", [9.0, (-9.0, np.inf), (-np.inf, 9.0)])
def test_a_joint_without_mass_is_undecided_on_any_side(bound):
    found = load_massless().with_limits(effort={"jc": bound}).check(MOTION)
    assert efforts(found)["jc"].verdict == "undecided"


@pytest.mark.filterwarnings("always:.*bodies without mass")
@pytest.mark.parametrize(("words", "code"), [([], 3), (["--massless-tips"], 3)])
def test_words_json_and_exit_status_agree(tmp_path, words, code):
    table = write_motion(tmp_path)
    done = call("check", NO_MASSES, table, "--json", *words)
    said = json.loads(done.stdout)
    assert (done.exit_code, said["verdict"], said["ok"]) == (code, "undecided", False)
    causes = {row["joint"]: row["cause"] for row in said["limits"] if row["cause"]}
    assert sorted(causes) == (["jb"] if words else ["jb", "jc"])
    for verb in VERBS:
        out = [] if verb == "check" else ["-o", str(tmp_path / ("o.html" if verb == "report" else "o.csv"))]
        done = call(verb, NO_MASSES, table, *out, *words)
        assert done.output.count("without mass that carry mass: a") == 1, done.output
        assert done.output.count("carry none") == (not words), done.output


@pytest.mark.parametrize("kind", ["effort", "velocity", "acceleration"])
@pytest.mark.parametrize("zero", [0.0, -0.0])
@pytest.mark.parametrize("rates", [[0, 0, 0], [0, 1, 1]])
def test_a_limit_of_zero_is_neither_kept_nor_broken(kind, zero, rates):
    robot = jounce.load("planar2r").with_limits(**{kind: [zero, 1e9]})
    found = robot.check(jounce.Motion.polynomial([rates, [0, 1, 1]], 1.0))
    assert [row.verdict for row in found.table if row.limit == kind] == ["undecided", "kept"]


def test_a_motion_of_one_row_has_the_same_verdicts(tmp_path):
    (tmp_path / "one.csv").write_text(",".join(["t", *COLUMNS]) + "\n" + ",".join("0.1" for _ in ["t", *COLUMNS]))
    robot = load_massless()
    rows = efforts(robot.check(jounce.load_motion(tmp_path / "one.csv", robot, order=0)))
    assert [row.verdict for row in rows.values()] == ["kept", "undecided", "undecided"]


@pytest.mark.parametrize("limits", [{}, {"velocity": 0.01}, {"effort": [99, 99, 9]}, {"effort": [99, 0, np.inf]}])
@pytest.mark.parametrize("meant", [False, True])
def test_explain_has_the_verdict_of_check(limits, meant):
    robot = load_massless(massless_tips=meant).with_limits(**limits)
    found, known = robot.explain(MOTION, rate=100), robot.check(MOTION, rate=100)
    assert found.verdict == known.verdict == ("broken" if "velocity" in limits else known.verdict)
    assert bool(found.trips) == (known.verdict == "broken")
    assert found.trips or found.cures == ()
    assert {trip.limit for trip in found.trips} <= {row.limit for row in known.table if row.verdict == "broken"}
    assert set(known.notes) <= set(found.notes)
    assert ("every limit is kept" in found.words) == (known.verdict == "kept")


@pytest.mark.filterwarnings("always:.*bodies without mass")
@pytest.mark.parametrize(("stated", "code"), [({}, 3), ({"jb": 99}, 0), ({"jb": 1e-9}, 1)])
def test_the_exit_status_of_explain_is_that_of_check(tmp_path, stated, code):
    table, limits = write_motion(tmp_path), tmp_path / "l.yaml"
    limits.write_text(json.dumps({"joint_limits": {joint: {"max_effort": x} for joint, x in stated.items()}}))
    words = [str(NO_MASSES), str(table), "--rate", "100", "--massless-tips", "--json"]
    words += ["--limits", str(limits)] if stated else []
    for verb in ("check", "explain"):
        done = call(verb, *words)
        said = json.loads(done.stdout)
        assert (done.exit_code, said["ok"]) == (code, code == 0)
        assert {"kept": 0, "broken": 1, "undecided": 3}[said["verdict"]] == code


def thin_pendulum(spread, bound):
    """A pendulum of 1 kg at 1 m whose second moments about the COM are `spread`, with an effort limit."""
    h = np.array([[1.0], [0], [0]])
    M = inertia.from_moments(np.eye(1), h, np.diag(spread) + h @ h.T)
    turn = jounce.Robot.from_screws([np.eye(4)], [[0, 0, 1, 0, 0, 0]], [M], gravity=(0, 0, 0))
    return turn.with_limits(effort=bound)


@pytest.mark.parametrize(
    ("spread", "bound", "verdict"),
    [
        ([0.1, 0.1, 0.1], 1.21, "kept"),  # 1 + 0.1 + 0.1, of a body that can be
        ([0.1, -0.1, 0.1], 1.05, "undecided"),  # 1.0 as stated, 1.1 with the nearest one
        ([0.1, -0.1, 0.1], 1.11, "kept"),
        ([0.1, -0.1, 0.1], 0.99, "broken"),
    ],
)
def test_an_inertia_of_no_body_may_not_decide(spread, bound, verdict):
    found = thin_pendulum(spread, bound).check(jounce.Motion.polynomial([[0, 0, 0.5]], 1.0))
    assert found.verdict == verdict
    assert ("no body can have the inertias of" in (found.worst.cause or "")) == (verdict == "undecided")


def test_an_inertia_that_is_meant_decides():
    robot = thin_pendulum([0.1, -0.1, 0.1], 1.05)
    meant = jounce.Robot(replace(robot.mechanism, meant=(INERTIAS,)))
    motion = jounce.Motion.polynomial([[0, 0, 0.5]], 1.0)
    assert [x.check(motion).verdict for x in (robot, meant)] == ["undecided", "kept"]


@pytest.mark.parametrize(
    ("spread", "limits", "times"), [(0.1, {"effort": 1}, 1), (-0.1, {"effort": 1}, 2), (-0.1, {"velocity": 1}, 1)]
)
def test_what_no_inertia_changes_is_computed_once(monkeypatch, spread, limits, times):
    """With the nearest inertias again only where a body has others, and forces are limited."""
    robot = thin_pendulum([0.1, spread, 0.1], np.inf).with_limits(**limits)
    motion = jounce.Motion.polynomial([[0, 0, 0.5]], 1.0)
    _, alone = evaluations(monkeypatch, lambda: list(split_motion(validate_limits(robot, motion))))
    _, count = evaluations(monkeypatch, lambda: robot.check(motion))
    assert times <= count / alone < times + 0.5


@pytest.mark.parametrize(("negative", "consistent"), [(-1e-11, True), (-1e-8, False)])
def test_rounding_makes_no_inertia_of_no_body(negative, consistent):
    M = thin_pendulum([0.1, negative, 0.1], 1).mechanism.M[0]
    assert np.array_equal(inertia.nearest_consistent(M), M) == consistent


@pytest.mark.parametrize(("m", "P"), [(-1.0, [0.1, 0.2, 0.3]), (0.0, [0.1, -0.2, 0.3])])
def test_the_nearest_body_of_no_positive_mass_has_none(m, P):
    M = inertia.nearest_consistent(inertia.from_moments(np.full((1, 1), m), np.ones((3, 1)) * m, np.diag(P)))
    mass, first, second = inertia.moments(M)
    assert not mass.any()
    assert not first.any()
    assert (np.linalg.eigvalsh(second) >= -1e-15).all()


@pytest.mark.parametrize("name", ["iiwa14", "delta"])
def test_bundled_robots_are_decided(name):
    robot = jounce.load(name).with_limits(effort=1e6)
    assert "inertias" in robot.mechanism.meant
    changed = robot.with_inertial_parameters(robot.inertial_parameters)
    assert "inertias" not in changed.mechanism.meant
