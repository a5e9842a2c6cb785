"""What installers put on a machine: a wheel that holds the package and the digest of its code, whoever builds it."""

import shutil
import tarfile
import zipfile
from pathlib import Path

import pytest

import jounce
from jounce.core.code_digest import DIGEST_FILE, hash_modules

for needed in ("hatch_fancy_pypi_readme", "editables"):
    pytest.importorskip(needed)
build = pytest.importorskip("hatchling.build")
ROOT = Path(__file__).parents[1]
PACKAGE = Path(jounce.__file__).parent
DIGEST = f"jounce/{DIGEST_FILE}"


def built_archive(folder, root, monkeypatch, kind="build_wheel"):
    """The archive that a build makes of a folder."""
    monkeypatch.chdir(root)
    folder.mkdir(exist_ok=True)
    return folder / getattr(build, kind)(str(folder))


def archived_files(wheel):
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist() if ".dist-info/" not in name}


def test_a_wheel_holds_the_package_and_its_digest_as_the_last_file(tmp_path, monkeypatch):
    found = archived_files(built_archive(tmp_path, ROOT, monkeypatch))
    sources = (path for path in PACKAGE.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    assert sorted(found) == sorted([DIGEST, *(path.relative_to(PACKAGE.parent).as_posix() for path in sources)])
    assert list(found)[-1] == DIGEST  # installers write it last: a module that is newer was edited
    assert found[DIGEST].decode() == hash_modules(PACKAGE) + "\n"
    assert not (PACKAGE / DIGEST_FILE).exists()


def test_a_wheel_that_is_built_from_an_sdist_is_the_same(tmp_path, monkeypatch):
    sdist = built_archive(tmp_path, ROOT, monkeypatch, "build_sdist")
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path, filter="data")
    unpacked = tmp_path / sdist.name.removesuffix(".tar.gz")
    wheels = [built_archive(tmp_path / root.name, root, monkeypatch) for root in (ROOT, unpacked)]
    assert archived_files(wheels[0]) == archived_files(wheels[1])


def test_an_editable_installation_brings_no_digest(tmp_path, monkeypatch):
    assert DIGEST not in archived_files(built_archive(tmp_path, ROOT, monkeypatch, "build_editable"))


def test_another_release_has_another_digest(tmp_path, monkeypatch):
    copy = tmp_path / "copy"
    shutil.copytree(ROOT / "src", copy / "src", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "hatch_build.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    found = []
    for line in ("", "# a line more\n"):
        with (copy / "src" / "jounce" / "core" / "errors.py").open("a") as file:
            file.write(line)
        found.append(archived_files(built_archive(tmp_path / "wheels", copy, monkeypatch))[DIGEST])
    assert found[0] != found[1]
