"""Machine code of another release never runs, however the package is installed; unknown code keeps none."""

import compileall
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import jounce
from jounce.core import code_digest as module
from jounce.core.code_digest import BUILD_FILE, DIGEST_FILE, UNKNOWN_CODE, hash_modules
from jounce.native.cache import CODE_LAYERS, KERNEL_SUFFIX

SOURCES = Path(jounce.__file__).parent
FORCES, GRAVITY = Path("dynamics", "recursion", "forces.py"), "Series.constant(-gravity"
PROGRAM = """
import jounce
robot = jounce.load("planar2r")
print(jounce.__file__)
print(*(float(robot.gravity_forces([0.0, 0.0], method=method)[0]) for method in ("kernel", "recursion")))
"""


def write_digest(package):
    (package / DIGEST_FILE).write_text(hash_modules(package) + "\n")


@pytest.fixture(scope="module")
def releases(tmp_path_factory):
    """Two releases of the package, by whether their gravity is twice as large, compiled in place of their sources."""
    folder = tmp_path_factory.mktemp("releases")
    without = shutil.ignore_patterns("__pycache__", "robots", "_report", "_codegen", "cuda", "figures")
    old, new = folder / "old" / "jounce", folder / "new" / "jounce"
    shutil.copytree(SOURCES, old, ignore=without)
    assert compileall.compile_dir(old, quiet=2, legacy=True)
    shutil.copytree(old, new)
    text = (new / FORCES).read_text()
    assert GRAVITY in text
    (new / FORCES).write_text(text.replace(GRAVITY, "Series.constant(-2 * gravity"))
    assert compileall.compile_file(new / FORCES, quiet=2, legacy=True, force=True)
    return old, new


def install(release, folder, kind, digest):
    """What stands in the path of modules: a folder with sources or with bytecode alone, or an archive of sources.

    All times are equal, as package managers write them, so that nothing but the digest tells the releases apart.
    """
    left_out = {"bytecode": "*.py"}.get(kind, "*.pyc")
    package = folder / "jounce"
    shutil.copytree(release, package, ignore=shutil.ignore_patterns(left_out))
    if digest:
        (package / DIGEST_FILE).write_text(hash_modules(release) + "\n")
    for path in package.rglob("*"):
        os.utime(path, (1e9, 1e9))
    if kind != "archive":
        return folder
    with zipfile.ZipFile(folder / "jounce.zip", "w") as archive:
        for path in package.rglob("*"):
            archive.write(path, path.relative_to(folder))
    shutil.rmtree(package)
    return folder / "jounce.zip"


def forces_elsewhere(place, kernels):
    """The gravity force of the first joint by native code and by recursion, in a process of its own."""
    environment = os.environ | {
        "PYTHONPATH": str(place), "JOUNCE_CACHE_DIR": str(kernels), "PYTHONDONTWRITEBYTECODE": "1"
    }  # fmt: skip
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True)
    origin, numbers = done.stdout.splitlines()
    assert origin.startswith(str(place))
    return [float(x) for x in numbers.split()]


@pytest.mark.sweep(2)
@pytest.mark.parametrize("digest", [True, False], ids=["digest", "no digest"])
@pytest.mark.parametrize("kind", ["sources", "bytecode", "archive"])
def test_an_upgrade_runs_its_own_code(kind, digest, releases, tmp_path):
    kernels = tmp_path / "kernels"
    found = [
        forces_elsewhere(install(release, tmp_path / release.parts[-2], kind, digest), kernels) for release in releases
    ]
    assert found == [[pytest.approx(29.43)] * 2, [pytest.approx(58.86)] * 2]
    kept = len(list(kernels.glob(f"*{KERNEL_SUFFIX}")))
    assert kept == (2 if digest else 0)


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """An installed package of one module per layer, that of code_digest among them."""
    root = tmp_path / "src" / "jounce"
    for name in (*CODE_LAYERS, "io"):
        (root / name / "inner").mkdir(parents=True)
        (root / name / "inner" / "module.py").write_text(f"{name} = 0.5\n")
    monkeypatch.setattr(module, "PACKAGE_FILE", str(root / "core" / "code_digest.py"))
    monkeypatch.setattr(module, "get_data", lambda _, name: (root / name).read_bytes())
    return root


def digest(*layers):
    """The digest, whatever this process found before."""
    return module.code_digest.__wrapped__(*layers)


def make_checkout(package):
    (package.parents[1] / BUILD_FILE).touch()


@pytest.mark.parametrize("layer", CODE_LAYERS)
def test_it_changes_with_a_source_of_each_layer_that_makes_code(layer, installed):
    make_checkout(installed)
    before = digest(*CODE_LAYERS)
    (installed / "io" / "inner" / "module.py").write_text("io = 0.6\n")
    assert digest(*CODE_LAYERS) == before
    (installed / layer / "inner" / "module.py").write_text(f"{layer} = 0.6\n")
    assert digest(*CODE_LAYERS) != before


@pytest.mark.parametrize("suffix", [".py", ".pyc", ".so" if os.name == "posix" else ".pyd"])
def test_it_changes_with_whatever_python_imports(suffix, installed):
    make_checkout(installed)
    before = digest()
    (installed / "core" / f"more{suffix}").touch()
    assert digest() != before


def test_it_changes_where_text_moves_to_the_next_file(installed):
    make_checkout(installed)
    first, second = (installed / "core" / "inner" / name for name in ("a.py", "b.py"))
    first.write_text("a = 1\nb = 2\n")
    second.write_text("c = 3\n")
    before = digest()
    first.write_text("a = 1\n")
    second.write_text("b = 2\nc = 3\n")
    assert digest() != before


def test_a_wheel_brings_its_own_which_is_not_hashed_again(installed, monkeypatch):
    write_digest(installed)
    own = hash_modules(installed)
    monkeypatch.setattr(module, "hash_modules", lambda *_: pytest.fail("modules are hashed"))
    assert digest(*CODE_LAYERS) == digest() == own


def test_modules_that_are_edited_after_they_were_installed_are_hashed(installed):
    write_digest(installed)
    edited, written = installed / "dynamics" / "inner" / "module.py", (installed / DIGEST_FILE).stat().st_mtime_ns
    before = digest(*CODE_LAYERS)
    edited.write_text("dynamics = 0.6\n")
    os.utime(edited, ns=(written, written))
    assert digest(*CODE_LAYERS) == before  # as old as the digest
    os.utime(edited, ns=(written + 1, written + 1))
    assert digest(*CODE_LAYERS) == hash_modules(installed, *CODE_LAYERS) != before
    assert digest("dynamics") == hash_modules(installed, "dynamics")
    assert digest() == hash_modules(installed)
    assert digest("core") == before  # of which no module was edited


@pytest.mark.parametrize(
    "content", [b"", b"0" * 63 + b"\n", b"0" * 64, b"0" * 63 + b"g\n", b"\0" * 65, b"0" * 66 + b"\n"]
)
def test_a_digest_that_is_not_whole_is_none(content, installed):
    (installed / DIGEST_FILE).write_bytes(content)
    assert digest() is None
    make_checkout(installed)
    assert digest() == hash_modules(installed)


def test_a_program_in_memory_has_the_digest_that_its_loader_returns(installed, monkeypatch):
    monkeypatch.setattr(module, "PACKAGE_FILE", None)
    make_checkout(installed)
    for found in (None, b"0" * 64 + b"\n"):
        monkeypatch.setattr(module, "get_data", lambda *_, found=found: found)
        assert digest() == (found and found.decode().strip())
    assert "install jounce from a wheel" in UNKNOWN_CODE
