"""The benchmark beside other libraries: its pages are those of its figures, and a library with a fault has a cell."""

import json
import re
from pathlib import Path

import pytest
from benchmarks.rivals import BOUND, JOUNCE, RIVALS, Rival, calls, losses, page, repetition
from benchmarks.rivals.robots import TITLES, write_urdf
from benchmarks.rivals.tasks import TASKS
from benchmarks.robots import chain

ROOT = Path(__file__).parents[2]
FOUND = json.loads((ROOT / "benchmarks/RIVALS.json").read_text(encoding="utf-8"))
ABOUT = {"robot": "xarm7", "task": "forces", "states": 1}


def test_the_page_is_made_of_the_figures():
    assert (ROOT / "benchmarks/RIVALS.md").read_text(encoding="utf-8") == page.page(FOUND)


def test_the_table_of_the_readme_is_made_of_the_figures():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert page.with_table(readme, FOUND) == readme


def test_every_library_has_a_cell_for_what_it_serves():
    cells = {(row["robot"], row["task"], row["states"]) for row in FOUND["calls"] if row["rival"] == JOUNCE}
    assert cells == {(robot, task, states) for robot in TITLES for task in TASKS for states in (1, 1000)}
    assert {row["rival"] for row in FOUND["calls"]} == set(RIVALS)


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return write_urdf(chain(2), tmp_path_factory.mktemp("arm") / "two.urdf", "body2")


def fake(kind):
    return Rival(kind, "support.fake_rival", "rival", "a fake", settings=(("FAKE_RIVAL", kind),), patience=4.0)


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("missing", "not imported: ModuleNotFoundError: No module named 'rival'"),
        ("crashes", "its process ended"),
        ("hangs", "over 4 s to compile"),
        ("raises", "ValueError: it wants"),
        ("wrong", "other numbers: off by 5e-01"),
        ("not finite", "not the numbers of the task"),
    ],
)
def test_a_library_with_a_fault_has_a_cell_that_says_so(monkeypatch, arm, kind, words):
    rows = rows_with(monkeypatch, arm, kind)
    assert {(row["rival"], row["states"]) for row in rows} == {(name, n) for name in (JOUNCE, kind) for n in (1, 20)}
    for row in rows:
        if row["rival"] == JOUNCE:
            assert row["seconds"] > 0
            assert row["error"] < 1e-12
        elif (kind, row["states"]) == ("hangs", 20):
            assert row["note"] == calls.NOT_TRIED
        else:
            assert row["note"] == words
            assert "seconds" not in row


def test_less_precision_has_its_error_beside_the_time(monkeypatch, arm):
    rows = [row for row in rows_with(monkeypatch, arm, "single precision") if row["rival"] != JOUNCE]
    assert all(row["seconds"] > 0 and 0.5e-6 < row["error"] < 2e-6 for row in rows)
    assert re.search(r"off by 1e-06$", page._time(rows[0], None, 1e6))


def test_a_library_is_left_out_of_robots_with_more_joints(monkeypatch, arm):
    small = Rival(
        "small", "support.fake_rival", "rival", "a fake", settings=(("FAKE_RIVAL", "right"),), largest=(("forces", 1),)
    )
    rows = rows_with(monkeypatch, arm, small)
    assert {row["note"] for row in rows if row["rival"] == "small"} == {calls.NOT_TRIED}


def rows_with(monkeypatch, arm, rival):
    """Rows of jounce and of a fake for Q alone."""
    monkeypatch.setattr(calls, "TASKS", {"forces": TASKS["forces"]})
    monkeypatch.setattr(calls, "STATES", 20)
    monkeypatch.setattr(calls, "ROUNDS", 2)
    other = fake(rival) if isinstance(rival, str) else rival
    return calls.measured([arm], [RIVALS[JOUNCE], other], lambda text: None)


def test_what_is_faster_than_the_method_stands_in_bold():
    row = ABOUT | {"rival": "Pinocchio", "seconds": 1e-6, "error": 1e-16}
    assert page._time(row, 2e-6, 1e6) == "**1.00**"
    assert page._time(row, 0.5e-6, 1e6) == "1.00"
    assert page._time(row | {"rival": BOUND}, 2e-6, 1e6) == "1.00"
    assert page._time(None, 1e-6, 1e6) == "-"
    assert page._time(ABOUT | {"rival": "adam", "note": "over 20 s to compile"}, 1e-6, 1e6) == "over 20 s to compile"


def test_a_loss_is_counted_with_its_largest_factor():
    rows = [
        ABOUT | {"rival": JOUNCE, "seconds": 4e-6, "error": 0.0},
        ABOUT | {"rival": "dynibo", "seconds": 1e-6, "error": 0.0},
        ABOUT | {"rival": "MuJoCo", "seconds": 8e-6, "error": 0.0},
        ABOUT | {"rival": "frax", "note": "fails"},
    ]
    found = losses.losses({"calls": rows, "first": [], "retiming": [], "identification": []})
    assert [(loss.where, loss.often, loss.most) for loss in found] == [
        ("one plain call from Python", "1 of 2 cells", "4 (dynibo)")
    ]


@pytest.mark.parametrize(("factor", "apart"), [(1.14, False), (1.16, True), (1 / 1.14, False), (1 / 1.16, True)])
def test_two_runs_are_compared_by_their_ratios(factor, apart):
    def run_of(seconds):
        rows = [ABOUT | {"rival": JOUNCE, "seconds": 2.0}, ABOUT | {"rival": "frax", "seconds": seconds}]
        return {"calls": rows, "first": [], "retiming": [], "identification": []}

    def ratios_of(seconds):
        return repetition.ratios(run_of(seconds))

    (one,), (other,) = ratios_of(3.0).values(), ratios_of(3.0 * factor).values()
    assert one == 1.5
    assert repetition.is_apart(other / one) == apart
    (row,) = repetition.repeated(run_of(3.0), run_of(3.0 * factor))
    assert (row["rival"], row["ratios"], row["apart"]) == ("frax", 1, int(apart))
    assert row["largest"] == pytest.approx(max(factor, 1 / factor))
