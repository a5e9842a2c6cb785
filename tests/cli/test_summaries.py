"""The summaries of `run`, `motors` and `check`: one schema, the same by both ways from a table, documented."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import jounce
from jounce.io import tables
from jounce.io.motions import table_parts
from jounce.spatial.series import rate_name
from support.commands import call

PAGE = Path(__file__).parents[2] / "docs" / "summaries.md"
ROBOT = jounce.load("planar2r")
WAYS = {"output", "parts", "parts_computed"}  # keys that tell the ways apart
ELASTIC = ("--stiffness", "1000", "--rotor", "0.2")
T = np.arange(100) / 50  # less than a period: no two peaks are equal


def stated_rates():
    """All rates of both joints, with stamps since 1970."""
    found = {"t": 1.7e9 + T}
    for j, name in enumerate(ROBOT.joint_names):
        for k in range(5):
            found[f"{name}.{rate_name('q', k)}"] = (2 + j) ** k * np.cos((2 + j) * T + j + k * np.pi / 2)
    return found


def noisy_samples():
    """Noisy samples of both joints."""
    noise = np.random.default_rng(8).normal(0, 1e-4, (2, len(T)))
    return {"t": T, "joint1": np.sin(2 * T) + noise[0], "joint2": np.cos(3 * T) + noise[1]}


def verdict_and_summary(verb, robot, path, *words):
    result = call(verb, robot, path, *words, "--json")
    assert result.exit_code in (0, 1, 3), result.output
    return result.exit_code, json.loads(result.stdout)


def part_options(table):
    """What makes a table be read by parts that would not be for its size."""
    return ("--on-error", "skip") if table is noisy_samples else ()


@pytest.fixture
def limited_files(tmp_path):
    """Robot files whose limits the motions keep, break, and leave undecided."""
    limits = {"kept": {"velocity": 99.0}, "broken": {"velocity": 1.5, "effort": 30.0}, "undecided": {"snap": 120.0}}
    for name, stated in limits.items():
        jounce.save(ROBOT.with_limits(**stated), tmp_path / f"{name}.yaml")
    return {name: tmp_path / f"{name}.yaml" for name in limits}


def assert_same_documents(mine, other, place="summary", rel=0.0):
    """Two documents with the same keys and values, numbers to a relative difference."""
    assert type(mine) is type(other), place
    if isinstance(mine, dict):
        assert list(mine) == list(other), place
        for key in mine.keys() - WAYS:
            assert_same_documents(mine[key], other[key], f"{place}.{key}", rel)
    elif isinstance(mine, list):
        assert len(mine) == len(other), place
        for i, pair in enumerate(zip(mine, other, strict=True)):
            assert_same_documents(*pair, f"{place}[{i}]", rel)
    elif isinstance(mine, float):
        assert mine == pytest.approx(other, rel=rel, abs=rel), place
    else:
        assert mine == other, place


@pytest.mark.parametrize("verb", ["run", "motors"])
@pytest.mark.parametrize("table", [stated_rates, noisy_samples])
@pytest.mark.parametrize("limits", ["kept", "broken"])
def test_results_are_summed_up_alike_by_both_ways(tmp_path, monkeypatch, limited_files, verb, table, limits):
    tables.write(tmp_path / "log.csv", table())
    words = (limited_files[limits], tmp_path / "log.csv", *(ELASTIC if verb == "motors" else ()))
    _, whole = verdict_and_summary(verb, *words, "-o", tmp_path / "whole.npz")
    monkeypatch.setattr(table_parts, "MIN_LARGE_TABLE_BYTES", 0)
    monkeypatch.setattr(table_parts, "MAX_PART_CELLS", 200)
    _, found = verdict_and_summary(verb, *words, "-o", tmp_path / "parts.npz", *part_options(table))
    assert_same_documents(found, whole)
    assert (whole["parts"], found["parts"] > 1) == (1, table is stated_rates)
    assert whole["notes"]
    assert verb == "motors" or (whole["broken_limit"] is None) == (limits == "kept")
    assert any(whole["deviations"]["joint1"].values()) == (table is noisy_samples)


@pytest.mark.parametrize("table", [stated_rates, noisy_samples])
@pytest.mark.parametrize(("verdict", "code"), [("kept", 0), ("broken", 1), ("undecided", 3)])
def test_limits_are_summed_up_alike_by_both_ways(tmp_path, monkeypatch, limited_files, table, verdict, code):
    """Between rows a stretch of them tells a little less than all: digits of the ratio differ, and no more."""
    tables.write(tmp_path / "log.csv", table())
    (expected, whole) = verdict_and_summary("check", limited_files[verdict], tmp_path / "log.csv")
    monkeypatch.setattr(table_parts, "MIN_LARGE_TABLE_BYTES", 0)
    monkeypatch.setattr("jounce.io.motions.part_rows.MAX_STRETCH_ROWS", 50)
    found_code, found = verdict_and_summary("check", limited_files[verdict], tmp_path / "log.csv", *part_options(table))
    assert_same_documents(found, whole, rel=1e-6 if table is stated_rates else 0.0)
    assert found_code == expected
    if table is noisy_samples:
        assert (expected, whole["verdict"]) == (code, verdict)
        assert (min(whole["judged"].values()) < 1) == (verdict == "undecided")


def test_many_motions_have_the_keys_of_one(tmp_path, limited_files):
    (tmp_path / "in").mkdir()
    for name in "ab":
        tables.write(tmp_path / "in" / f"{name}.csv", stated_rates())
    for verb, words in (
        ("run", ("-o", tmp_path / "o.npz")),
        ("motors", (*ELASTIC, "-o", tmp_path / "p.npz")),
        ("check", ()),
    ):
        _, many = verdict_and_summary(verb, limited_files["broken"], tmp_path / "in", *words)
        _, one = verdict_and_summary(verb, limited_files["broken"], tmp_path / "in" / "a.csv", *words)
        assert (list(many), many["motions"], many["states"]) == (list(one), 2, 2 * one["states"])


def documented():
    """The keys of the tables of the page, by the headings above them."""
    found = {}
    for section in re.split(r"^#+ ", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)[2:]:
        heading, _, text = section.partition("\n")
        found[heading] = re.findall(r"^\| `(\w+)` \|", text, flags=re.MULTILINE)
    return found


def test_the_page_documents_every_key(tmp_path, limited_files):
    keys, log = documented(), tmp_path / "log.csv"
    tables.write(log, noisy_samples())
    _, run = verdict_and_summary("run", limited_files["broken"], log, "-o", tmp_path / "run.csv")
    _, motors = verdict_and_summary("motors", limited_files["broken"], log, *ELASTIC, "-o", tmp_path / "motors.csv")
    _, check = verdict_and_summary("check", limited_files["broken"], log)
    rows = keys["Every summary"] + keys["run and motors"]
    assert [sorted(of) for of in (run, motors, check)] == [
        sorted(of) for of in (rows + keys["run"], rows, keys["Every summary"] + keys["check"])
    ]
    assert sorted(run["broken_limit"]) == sorted(keys["A broken limit"])
    assert all(sorted(row) == sorted(keys["A limit"]) for row in check["limits"])
    assert sorted(run["skipped"]) == ["rows", "table"]
    assert f"This is schema {run['schema']}." in PAGE.read_text(encoding="utf-8")
