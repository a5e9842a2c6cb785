"""What the files around the package say agrees with the package, and with one another."""

import re
import tomllib
from importlib.metadata import distribution
from pathlib import Path

from ruamel.yaml import YAML

import jounce
from jounce.io.bundled import BUNDLED

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def yaml(path):
    return YAML(typ="safe").load((ROOT / path).read_text(encoding="utf-8"))


def test_the_citation_is_of_this_version_and_of_the_paper():
    citation = yaml("CITATION.cff")
    assert str(citation["version"]) == jounce.__version__ == distribution("jounce").version
    assert {"name": citation["authors"][0]["name"]} == PROJECT["project"]["authors"][0]
    [paper] = citation["references"]
    assert PROJECT["project"]["urls"]["Paper"] == f"https://doi.org/{paper['doi']}"


def test_a_package_index_shows_no_broken_picture_and_no_dead_link():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for substitution in PROJECT["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]["substitutions"]:
        text = re.sub(substitution["pattern"], substitution["replacement"], text)
    assert "![" not in text
    assert re.findall(r"\]\((?!https?:|#)", text) == []
    assert re.findall(r"^\|[-|]+\|\n(?!\|)", text, re.MULTILINE) == []  # no head of a table without rows


def test_ci_runs_on_every_python_and_system_that_the_package_names():
    classifiers = PROJECT["project"]["classifiers"]
    named = {c.rpartition(" ")[2] for c in classifiers if re.fullmatch(r"Programming Language :: Python :: 3\.\d+", c)}
    jobs = yaml(".github/workflows/ci.yml")["jobs"]
    for job in ("tests", "windows"):
        assert {*jobs[job]["strategy"]["matrix"]["python"]} == named
    assert PROJECT["project"]["requires-python"] == f">={min(named, key=lambda v: int(v[2:]))}"


def test_a_bundled_robot_that_has_a_file_has_a_licence_that_the_package_names():
    licences = set(PROJECT["project"]["license"].split(" AND "))
    for robot in BUNDLED.values():
        assert robot.licence in licences
        folder = ROOT / "src" / "jounce" / "io" / "robots" / robot.name
        assert (folder / "LICENSE").is_file() == (robot.urdf is not None)
