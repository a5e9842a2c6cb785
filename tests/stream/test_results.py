"""What is kept of motions: the results of parts merge, and a part is only that of one job and one file."""

import os
from dataclasses import replace

import pytest
from test_stream import ROBOT, Reading, stored, swings

import jounce
from jounce.io.motions.table_parts import divide_tables
from jounce.limits.samples import Sample
from jounce.motion.extremes import Extremes, Peak
from jounce.motion.table_columns import ColumnOptions
from jounce.stream import finished_parts, run
from jounce.stream.jobs import CheckJob, ForceJob, MotionFacts, MotionResult, MotorJob, add_result
from support.refusals import refusal

FACTS = MotionFacts("samples", 0.1, ("a note",))
JOB = ForceJob(ROBOT, Reading(), ".csv", 2)


def peaks(value):
    return {"joint1": {"Q": Extremes(Peak(value, 0.0, 0.5), Peak(value / 2, 0.1, 0.2), value**2)}}


def merged(*results):
    known = {}
    for result in results:
        add_result(known, "lift", result)
    return known["lift"]


def test_parts_of_a_motion_have_its_rows_peaks_notes_and_worst_limit():
    first = MotionResult(3, (0.0, 1.0), FACTS, peaks(2.0), Sample(1.5, "velocity", 0, 0.3))
    second = MotionResult(4, (1.5, 2.0), replace(FACTS, notes=("another", "a note")), peaks(3.0))
    third = replace(second, span=(2.5, 3.0), broken=Sample(1.7, "effort", 1, 2.7))
    found = merged(first, second, third)
    assert (found.rows, found.span) == (11, (0.0, 3.0))
    assert found.facts == replace(FACTS, notes=("a note", "another"))
    assert found.peaks["joint1"]["Q"] == Extremes(Peak(3.0, 0.0, 0.5), Peak(1.5, 0.1, 0.2), 22.0)
    assert found.broken == third.broken
    assert merged(third).broken == merged(replace(third, broken=None), replace(third, span=(4.0, 5.0))).broken


@pytest.mark.parametrize("begins", [0.5, 1.0])
def test_rows_that_do_not_follow_are_refused(begins):
    """Rows share no time; stretches that are checked share the row between them, and no more."""
    first, second = MotionResult(3, (0.0, 1.0), FACTS), MotionResult(4, (begins, 2.0), FACTS)
    refusal(lambda: merged(first, second), f"motion 'lift' goes on at t = {begins:g}, and its rows before end at t = 1")
    robot = ROBOT.with_limits(velocity=1.0)
    motion = jounce.Motion.polynomial([[0, 0.5, 0], [0, 0.1, 0]], duration=1.0)
    checks = [replace(part, check=robot.check(motion.shifted(t)), span=(t, t + 1)) for t, part in
              ((0.0, first), (begins, second))]  # fmt: skip
    if begins < 1:
        refusal(lambda: merged(*checks), "motion 'lift' goes on at t = 0.5")
    else:
        assert merged(*checks).check.span == (0.0, 2.0)


OTHER_JOBS = {
    "robot": replace(JOB, robot=jounce.load("planar2r", g=1.6)),
    "reading": replace(JOB, reading=Reading(ColumnOptions(angles="deg"))),
    "step": replace(JOB, reading=Reading(step=0.1)),
    "form": replace(JOB, form=None),
    "order": replace(JOB, order=1),
    "method": replace(JOB, method="recursion"),
    "rates": replace(JOB, with_rates=True),
    "motors": MotorJob(ROBOT, Reading(), ".csv", 2),
    "limits": CheckJob(ROBOT, Reading(), ".csv", 2),
}


@pytest.mark.parametrize("what", OTHER_JOBS)
def test_another_job_has_another_key(what):
    assert OTHER_JOBS[what].key != JOB.key == replace(JOB).key


def test_drive_terms_that_act_are_in_the_key():
    keys = {replace(JOB, robot=jounce.load("xarm7", drives=terms)).key for terms in ("damping", "friction", False)}
    assert len(keys) == 3


def test_a_part_of_another_file_or_of_other_rows_has_another_key(tmp_path):
    path = stored(tmp_path / "states.csv", swings(9))
    [part] = divide_tables(JOB, path).parts
    others = [
        replace(part, written=(part.written[0] + 1, part.written[1])),
        replace(part, written=(part.written[0], part.written[1] + 1)),
        replace(part, span=part.span._replace(stop=part.span.stop - 1)),
        replace(part, path=tmp_path / "other.csv"),
        replace(part, motion="another"),
    ]
    keys = {JOB.part_key(x) for x in (part, replace(part), *others)}
    assert len(keys) == 1 + len(others)


WHOLE = {
    "samples at another step": replace(JOB, reading=Reading(step=0.1)),
    "blends over breaks": replace(JOB, reading=Reading(blend=0.1)),
    "turns that are counted": replace(JOB, reading=Reading(ColumnOptions(unwrap=True))),
    "dampers": MotorJob(ROBOT.elastic(1e3, rotor=0.1, damping=5.0), Reading(), ".csv"),
}


@pytest.mark.parametrize("why", WHOLE)
def test_rows_that_need_others_are_read_with_their_motion(tmp_path, why):
    path = stored(tmp_path / "states.csv", swings(9, order=5))
    assert divide_tables(JOB, path).layout.independent
    assert not divide_tables(WHOLE[why], path).layout.independent


def stop_before_the_output(monkeypatch, path, out):
    """A run that ends when all of its parts are finished."""

    def interrupt(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(finished_parts, "publish_file", interrupt)
        with pytest.raises(KeyboardInterrupt):
            run.run_tables(JOB, path, out)
    assert len([*run.work_folder(out).glob("part-*.json")]) == 1


def test_a_table_that_has_changed_since_is_computed_again(tmp_path, monkeypatch):
    """Its size is the same; another run that was stopped is continued."""
    path, out = stored(tmp_path / "states.csv", swings(9)), tmp_path / "out.csv"
    stop_before_the_output(monkeypatch, path, out)
    assert run.run_tables(JOB, path, out).computed == 0
    stop_before_the_output(monkeypatch, path, out)
    later = path.stat().st_mtime_ns + 10**9
    os.utime(path, ns=(later, later))
    assert run.run_tables(JOB, path, out).computed == 1
