"""What the files around the package say agrees with the package, and with one another."""

import ast
import re
import sys
import tomllib
from doctest import DocTestParser
from importlib.metadata import distribution
from pathlib import Path

import nbformat
import notebooks
import page_pictures
import pytest
from ruamel.yaml import YAML

import jounce
from jounce.io.bundled import BUNDLED

ROOT = Path(__file__).parents[1]
RIVALS = "rivals"  # a folder of the benchmarks, and its extra
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def yaml(path):
    return YAML(typ="safe").load((ROOT / path).read_text(encoding="utf-8"))


def test_the_citation_is_of_this_version_and_of_the_paper():
    citation = yaml("CITATION.cff")
    assert str(citation["version"]) == jounce.__version__ == distribution("jounce").version
    assert {"name": citation["authors"][0]["name"]} == PROJECT["project"]["authors"][0]
    [paper] = citation["references"]
    assert PROJECT["project"]["urls"]["Paper"] == f"https://doi.org/{paper['doi']}"


@pytest.mark.parametrize(("file", "mark"), [("pyproject.toml", "ADDRESS"), ("SECURITY.md", "CONTACT")])
def test_what_has_no_address_yet_has_one_marked_place_for_it(file, mark):
    text = (ROOT / file).read_text(encoding="utf-8")
    assert text.count(f"{mark}: ") == text.count(mark) == 1


def test_the_changelog_has_this_version_once_and_no_item_twice():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    versions = re.findall(r"^## \[([^]]+)\]", text, re.MULTILINE)
    assert versions[0] == jounce.__version__
    newest = text.split("\n## ")[1]
    for heading in ("### .*", "[^-#|].*:", "- .*"):
        found = re.findall(f"^{heading}$", newest, re.MULTILINE)
        assert len(found) == len(set(found)), heading
    assert len(versions) == len(set(versions))


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


def test_files_of_bundled_robots_have_licences_that_are_named():
    licences = set(PROJECT["project"]["license"].split(" AND "))
    for robot in BUNDLED.values():
        assert robot.licence in licences
        folder = ROOT / "src" / "jounce" / "io" / "robots" / robot.name
        assert (folder / "LICENSE").is_file() == (robot.urdf is not None)


def site_code():
    """The Python that runs when the site is built, of pages and notebooks."""
    for page in page_pictures.PAGES:
        for example in DocTestParser().get_examples((page_pictures.DOCS / page).read_text(encoding="utf-8")):
            yield example.source
    for path in notebooks.FOLDER.glob("*.ipynb"):
        yield from (cell.source for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code")


def benchmark_code():
    """The Python of the benchmarks, but for what has an extra of its own, CUDA and rivals, and plugins of pytest."""
    files = sorted((ROOT / "benchmarks").rglob("*.py"))
    others = ("cuda.py", "callers.py", "judges.py")
    return (
        path.read_text(encoding="utf-8") for path in files if path.name not in others and path.parent.name != RIVALS
    )


def rival_code():
    """The Python of the benchmark beside other libraries."""
    return (path.read_text(encoding="utf-8") for path in sorted((ROOT / "benchmarks" / RIVALS).glob("*.py")))


def imported_packages(sources):
    """The names of packages that code imports, without those of Python and of this repository."""
    nodes = [node for source in sources for node in ast.walk(ast.parse(source))]
    modules = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    modules += [node.module for node in nodes if isinstance(node, ast.ImportFrom)]
    return {module.partition(".")[0] for module in modules} - {*sys.stdlib_module_names, "jounce", "benchmarks"}


def installed_by(requirements):
    """The names of packages that requirements state, those of jounce's own extras included."""
    extras = PROJECT["project"]["optional-dependencies"]
    for requirement in requirements:
        name, chosen = re.match(r"([\w-]+)(?:\[([\w,-]+)\])?", requirement).groups()
        if name == "jounce":
            yield from installed_by(line for extra in chosen.split(",") for line in extras[extra])
        else:
            yield name


@pytest.mark.parametrize(("extra", "code"), [("docs", site_code), ("bench", benchmark_code), (RIVALS, rival_code)])
def test_an_extra_installs_what_its_code_imports(extra, code):
    """The tests' own packages would hide a missing one wherever the tests run."""
    stated = {*installed_by(PROJECT["project"]["dependencies"]), *installed_by([f"jounce[{extra}]"])}
    # packages of another name than their module
    packages = {"distributed": "dask", "pinocchio": "pin", "copp_py": "copp-py", "mujoco_sysid": "mujoco-sysid"}
    packages |= {"adam": "adam-robotics", "warp": "warp-lang"}
    modules = imported_packages(code())
    assert {"pinocchio", "numpy"} <= modules
    assert {packages.get(module, module) for module in modules} <= stated
