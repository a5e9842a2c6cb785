"""Compiled kernels on disk: found again by the next process, never trusted when they are another's or not whole."""

import hashlib
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import jounce
from jounce.dynamics.computation import Computation
from jounce.native import cache, jit
from jounce.native import kernel as module
from jounce.native.jit import host
from jounce.native.kernel import Kernel
from support.abandoned import abandoned_part
from support.refusals import refusal
from support.robots import floating

ROBOT = jounce.load("planar2r")
QUANTITY = Computation("gravity_forces", 0)
CHANGES: list[dict[str, object]] = [{"order": 1}, {"wrench": True}, {"base": True}, {"name": "mass_matrix"}]
NAME = "0" * 64
posix = pytest.mark.skipif(not hasattr(os, "getuid"), reason="Windows keeps users' folders apart itself")


@pytest.fixture
def cache_folder(tmp_path, monkeypatch):
    path = tmp_path / "here" / "cache"
    monkeypatch.setenv("JOUNCE_CACHE_DIR", str(path))
    return path


@pytest.fixture
def compilations(monkeypatch):
    """A list that grows with every module that is compiled."""
    done = []
    assembled = jit.assemble
    monkeypatch.setattr(module.jit, "assemble", lambda *given: done.append(given) or assembled(*given))
    return done


def works():
    """A kernel made anew, whatever this process holds already, gives what the recursion gives."""
    q = np.array([0.3, -0.4])
    np.testing.assert_allclose(Kernel(ROBOT.mechanism, QUANTITY)(q), ROBOT.gravity_forces(q, method="recursion"))


def entry(folder):
    (path,) = folder.glob(f"*{cache.KERNEL_SUFFIX}")
    return path


def test_the_second_kernel_is_not_compiled(cache_folder, compilations):
    works()
    assert len(compilations) == 1
    works()
    assert len(compilations) == 1
    assert list(cache.kernel_paths()) == [entry(cache_folder)]


@posix
def test_folder_and_entries_are_the_users_alone(cache_folder):
    works()
    assert cache_folder.stat().st_mode & 0o777 == 0o700
    assert entry(cache_folder).stat().st_mode & 0o777 == 0o600
    assert [x.name for x in cache_folder.iterdir()] == [entry(cache_folder).name]  # no part is left


SPOILT = {
    "empty": lambda content: b"",
    "shorter than a hash": lambda content: content[:20],
    "a hash alone": lambda content: content[:32],
    "truncated": lambda content: content[:-1],
    "longer": lambda content: content + b"\0",
    "a bit turned": lambda content: content[:-100] + bytes([content[-100] ^ 1]) + content[-99:],
    "a hash turned": lambda content: bytes([content[0] ^ 1]) + content[1:],
    "of another key": lambda content: hashlib.sha256(NAME.encode() + content[32:]).digest() + content[32:],
}


@pytest.mark.parametrize("spoil", SPOILT.values(), ids=SPOILT)
def test_what_is_not_whole_is_compiled_and_written_anew(cache_folder, compilations, spoil):
    works()
    whole = entry(cache_folder).read_bytes()
    entry(cache_folder).write_bytes(spoil(whole))
    works()
    assert len(compilations) == 2
    works()
    assert len(compilations) == 2
    assert cache.read(entry(cache_folder).stem) is not None


def test_an_entry_renamed_to_another_key_is_not_read(cache_folder):
    cache.write(NAME, b"code")
    assert cache.read(NAME) == b"code"
    entry(cache_folder).rename(cache_folder / ("1" * 64 + cache.KERNEL_SUFFIX))
    assert cache.read("1" * 64) is None


@posix
@pytest.mark.parametrize("mode", [0o620, 0o602, 0o666])
def test_entries_that_others_may_write_are_not_read(cache_folder, compilations, mode):
    works()
    entry(cache_folder).chmod(mode)
    works()
    assert len(compilations) == 2
    assert entry(cache_folder).stat().st_mode & 0o777 == 0o600


@posix
@pytest.mark.parametrize("mode", [0o720, 0o702, 0o777])
def test_a_folder_that_others_may_write_is_neither_read_nor_written(cache_folder, compilations, mode):
    works()
    entry(cache_folder).chmod(0o600)
    cache_folder.chmod(mode)
    before = entry(cache_folder).stat()
    works()
    assert len(compilations) == 2
    assert entry(cache_folder).stat() == before


@posix
def test_what_another_user_owns_is_neither_read_nor_written(cache_folder, compilations, monkeypatch):
    works()
    before, user = entry(cache_folder).stat(), os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: user + 1)
    works()
    assert len(compilations) == 2
    assert entry(cache_folder).stat() == before


@posix
def test_an_entry_of_another_user_in_a_folder_of_ones_own_is_not_read(cache_folder, monkeypatch):
    cache.write(NAME, b"code")
    lstat = os.lstat

    def foreign(path):
        found = lstat(path)
        return found if str(path) == str(cache_folder) else os.stat_result([*found[:4], found.st_uid + 1, *found[5:10]])

    monkeypatch.setattr(os, "lstat", foreign)
    assert cache.read(NAME) is None


@posix
def test_links_are_not_followed(cache_folder, tmp_path, compilations):
    works()
    elsewhere = tmp_path / "elsewhere"
    entry(cache_folder).rename(elsewhere)
    link = cache_folder / (cache.key(ROBOT.mechanism, QUANTITY, host()) + cache.KERNEL_SUFFIX)
    link.symlink_to(elsewhere)
    before = elsewhere.read_bytes()
    works()
    assert len(compilations) == 2
    assert not link.is_symlink()  # an entry of its own took the place
    assert elsewhere.read_bytes() == before


@posix
def test_a_folder_that_is_a_link_is_left_alone(cache_folder, tmp_path, compilations):
    works()
    real = cache_folder.rename(tmp_path / "real")
    before = entry(real).stat()
    cache_folder.symlink_to(real)
    works()
    entry(real).rename(real / "another name")
    works()
    assert len(compilations) == 3
    (after,) = real.iterdir()
    assert (after.stat().st_ino, after.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)


@pytest.mark.parametrize("kind", ["a file", "below a file", "not to be made"])
def test_a_folder_that_cannot_be_is_no_harm(cache_folder, kind, monkeypatch):
    cache_folder.parent.mkdir()
    match kind:
        case "a file":
            cache_folder.touch()
        case "below a file":
            monkeypatch.setenv("JOUNCE_CACHE_DIR", str(cache_folder / "below"))
            cache_folder.touch()
        case _:
            monkeypatch.setattr(cache.Path, "mkdir", lambda *_, **__: (_ for _ in ()).throw(PermissionError()))
    works()


def test_a_disk_that_is_full_leaves_nothing_behind(cache_folder, monkeypatch):
    monkeypatch.setattr(cache.Path, "write_bytes", lambda *_: (_ for _ in ()).throw(OSError(28, "no space left")))
    works()
    assert list(cache_folder.iterdir()) == []


def test_an_interrupt_ends_a_write(cache_folder, monkeypatch):
    """Whatever it interrupts, when the entry is in place too."""
    for name in ("touch", "write_bytes", "replace"):
        real = getattr(cache.Path, name)

        def interrupted(*given, real=real, **options):
            real(*given, **options)
            raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr(cache.Path, name, interrupted)
            with pytest.raises(KeyboardInterrupt):
                cache.write(NAME, b"code")
        assert len(list(cache_folder.iterdir())) == (name == "replace")
    assert cache.read(NAME) == b"code"


def kernels_kept(folder):
    return {path.stem for path in folder.glob(f"*{cache.KERNEL_SUFFIX}")}


def fill(folder, names, size=1000):
    """Kernels of so many bytes each, used one after the other, a long time ago."""
    for i, name in enumerate(names):
        cache.write(name, bytes(size - 32))
        os.utime(folder / (name + cache.KERNEL_SUFFIX), (i, i))


def test_the_least_recently_used_make_room(cache_folder, monkeypatch):
    monkeypatch.setenv("JOUNCE_CACHE_SIZE", str(4000 / 2**20))
    fill(cache_folder, "abcd")
    assert cache.read("a") is not None  # which is a use
    cache.write("e", bytes(1500 - 32))
    assert kernels_kept(cache_folder) == set("ade")
    assert sum(path.stat().st_size for path in cache.kernel_paths()) <= 4000
    cache.write("d", bytes(1500 - 32))  # in place of its older self
    assert kernels_kept(cache_folder) == set("ade")


def test_no_more_kernels_are_removed_than_make_room(cache_folder, monkeypatch):
    monkeypatch.setenv("JOUNCE_CACHE_SIZE", str(4000 / 2**20))
    fill(cache_folder, "abcd")
    cache.write("e", bytes(1000 - 32))
    assert kernels_kept(cache_folder) == set("bcde")
    unlink = cache.Path.unlink

    def overtaken(path, missing_ok=False):  # by another process that makes room
        path.exists() and unlink(path)
        unlink(path, missing_ok=missing_ok)

    monkeypatch.setattr(cache.Path, "unlink", overtaken)
    cache.write("f", bytes(1000 - 32))
    assert kernels_kept(cache_folder) == set("cdef")


def test_what_stands_in_the_place_of_a_part_is_not_written_to(cache_folder, tmp_path, monkeypatch):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.write_text("mine")
    fill(cache_folder, "a")
    part = cache_folder / "a.part"
    part.symlink_to(elsewhere)
    monkeypatch.setattr(cache, "temporary_path", lambda _: part)
    cache.write("b", b"code")
    assert (elsewhere.read_text(), kernels_kept(cache_folder), part.is_symlink()) == ("mine", {"a"}, False)


def test_kernels_that_are_gone_are_not_counted_and_others_are_named(cache_folder, monkeypatch):
    fill(cache_folder, "ab")
    unlink = cache.Path.unlink

    def missing(path):
        unlink(path)
        if path.stem == "a":
            raise FileNotFoundError

    with monkeypatch.context() as patch:
        patch.setattr(cache.Path, "unlink", missing)
        assert cache.clear() == [1000]
    fill(cache_folder, "c")
    for error, words in ((PermissionError(13, "Permission denied"), "Permission denied"), (OSError("odd"), "odd")):
        monkeypatch.setattr(cache.Path, "unlink", lambda path, error=error: (_ for _ in ()).throw(error))
        refusal(cache.clear, f"{cache_folder / 'c'}{cache.KERNEL_SUFFIX}: cannot be removed: {words}")


def test_a_write_looks_at_each_kernel_once_at_most(cache_folder, monkeypatch):
    names = [f"{k:064x}" for k in range(20)]
    for name in names:
        cache.write(name, b"x" * 100)
    looks = []
    stat = os.stat
    monkeypatch.setattr(
        os, "stat", lambda path, *rest, **options: looks.append(str(path)) or stat(path, *rest, **options)
    )
    cache.write("f" * 64, b"x" * 100)
    assert [path for path in looks if any(name in path for name in names)] == []  # DirEntry.stat is none of os.stat
    assert len(list(cache.kernel_paths())) == 21


def test_a_kernel_larger_than_the_limit_drives_nothing_out(cache_folder, monkeypatch):
    fill(cache_folder, "ab")
    monkeypatch.setenv("JOUNCE_CACHE_SIZE", str(2000 / 2**20))
    cache.write("c", bytes(2000 - 31))
    assert kernels_kept(cache_folder) == set("ab")
    monkeypatch.setenv("JOUNCE_CACHE_SIZE", "0")
    works()
    assert kernels_kept(cache_folder) == set("ab")
    monkeypatch.setenv("JOUNCE_CACHE_SIZE", str(2000 / 2**20))
    cache.write("c", bytes(2000 - 32))  # as large as the limit
    assert kernels_kept(cache_folder) == set("c")


@posix
def test_the_next_kernel_removes_what_a_killed_writer_left(cache_folder):
    fill(cache_folder, "a")
    gone, live = abandoned_part(cache_folder), abandoned_part(cache_folder, os.getpid())
    fill(cache_folder, "b")
    assert (gone.exists(), live.exists()) == (False, True)


def test_where_no_user_has_a_number_folders_are_private(cache_folder, monkeypatch):
    monkeypatch.delattr(os, "getuid", raising=False)
    fill(cache_folder, "a")
    (cache_folder / f"a{cache.KERNEL_SUFFIX}").chmod(0o666)
    assert cache.read("a") is not None
    assert cache.obstacle() is None


def test_an_entry_that_cannot_be_touched_is_read(cache_folder, monkeypatch):
    fill(cache_folder, "a")
    monkeypatch.setattr(os, "utime", lambda *_: (_ for _ in ()).throw(PermissionError()))
    assert cache.read("a") is not None


def test_the_key_tells_apart_whatever_the_code_depends_on():
    m, what = ROBOT.mechanism, QUANTITY
    turned = np.array([[0.0, -1.0], [1.0, 0.0]])
    others = [
        *(replace(m, **{name: getattr(m, name) * (1 + 2**-52)}) for name in ("B", "X", "M", "gravity")),
        *(replace(m, G=turned), replace(m, g=np.array([0.0, 1.0])), replace(m, parent=(-1, -1))),
        *(floating(m, np.random.default_rng(0), mass) for mass in (1.0, 2.0)),
    ]
    quantities = [replace(QUANTITY, **x) for x in CHANGES]
    targets = [replace(host(), **x) for x in ({"cpu": "other"}, {"features": "other"}, {"lanes": 1}, {"fma": None})]
    keys = [
        cache.key(m, what, host()),
        *(cache.key(other, what, host()) for other in others),
        *(cache.key(m, quantity, host()) for quantity in quantities),
        *(cache.key(m, what, target) for target in targets),
    ]
    assert len(set(keys)) == len(keys) == 1 + 9 + 4 + 4
    assert cache.key(replace(m, name="another name"), what, host()) == keys[0]
    assert cache.key(jounce.load("planar2r").mechanism, what, host()) == keys[0]


def test_the_key_holds_drives_that_act():
    m = ROBOT.mechanism
    damped = [replace(m, drives=replace(m.drives, damping=np.full(2, x))) for x in (1.0, 2.0)]
    assert len({cache.key(x, QUANTITY, host()) for x in (m, *damped)}) == 1
    acting = [replace(x, acting=("damping",)) for x in damped]
    assert len({cache.key(x, QUANTITY, host()) for x in (m, *acting)}) == 3


def test_the_key_holds_springs_and_contacts_for_what_takes_them():
    def keys(robots, name):
        return [cache.key(robot.mechanism, Computation(name, 0), host()) for robot in robots]

    elastic = [ROBOT.elastic(K, rotor=rotor) for K, rotor in ((800.0, 0.1), (801.0, 0.1), (800.0, 0.2))]
    assert len({*keys(elastic, "motor_torques")}) == 3
    assert {*keys(elastic, "inverse_dynamics")} == {*keys([ROBOT], "inverse_dynamics")}
    walker, Contact = jounce.Robot(floating(ROBOT.mechanism, np.random.default_rng(0))), jounce.Contact
    inner, foot = walker.body_names[-2:]
    firm = Contact(inner, "plane")
    contacts = [
        Contact(foot, "plane"),
        Contact(inner, "plane", place=(1, 0, 0)),
        Contact(foot, "plane", place=(0.1, 0, 0)),
        Contact(foot, "plane", sole=(0.1, 0.2)),
        Contact(foot, "line"),
        *(Contact(foot, "point", normal=normal) for normal in (None, (0, 0, 1), (0, 1, 0))),
    ]
    standing = [walker.contacts([firm, x]) for x in contacts]
    assert len({*keys([walker, *standing], "inverse_dynamics")}) == 9
    assert len({*keys(standing, "contact_wrenches")}) == 8
    assert {*keys(standing, "mass_matrix")} == {*keys([walker], "mass_matrix")}


@pytest.mark.filterwarnings("ignore:.*nothing but inertia moves:jounce.JounceWarning")
def test_which_coordinates_are_passive_is_in_the_key(cache_folder):
    """One motor, and the same coordinates: either of them may be the one that the motor does not move."""
    q = jounce.load("fivebar").mechanism.closure.start[[0, 2]]
    keys = set()
    for passive in ("left_shoulder", "right_shoulder"):
        own = {"coordinates": ["left_shoulder", "right_shoulder"], "actuated": ["left_elbow"], "passive": [passive]}
        robot = jounce.load("fivebar").closed(**own)
        found, expected = (robot.actuator_forces(q, 0.3 + q, -q, method=method) for method in ("kernel", "recursion"))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
        keys.add(cache.key(robot.mechanism, Computation("actuator_forces", 0), host()))
    assert len(keys) == 2


def test_the_key_changes_with_the_program_itself(monkeypatch):
    before = cache.key(ROBOT.mechanism, QUANTITY, host())
    monkeypatch.setattr(cache, "code_digest", lambda *layers: "another version")
    assert cache.key(ROBOT.mechanism, QUANTITY, host()) != before


def test_code_that_is_not_known_neither_reads_nor_writes(cache_folder, compilations, monkeypatch):
    works()
    before = entry(cache_folder).stat()
    unknown = {cache.key(ROBOT.mechanism, QUANTITY, host())}
    with monkeypatch.context() as patch:
        patch.setattr(cache, "code_digest", lambda *layers: None)
        for _ in range(2):
            works()
        assert cache.obstacle() == cache.UNKNOWN_CODE
    assert len(compilations) == 3
    assert (entry(cache_folder).stat().st_mtime_ns, entry(cache_folder).stem) == (before.st_mtime_ns, *unknown)
    assert cache.obstacle() is None


def test_the_users_cache_folder_is_the_default(monkeypatch, tmp_path):
    monkeypatch.delenv("JOUNCE_CACHE_DIR")
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name: tmp_path / name)
    assert cache.folder() == tmp_path / "jounce"
    monkeypatch.setenv("JOUNCE_CACHE_DIR", "")
    assert cache.folder() == tmp_path / "jounce"


PROCESS = """
import sys
import jounce
from jounce.native import jit
if sys.argv[1] == "warm":
    def assembled(*given): raise AssertionError("compiled in spite of the cache")
    jit.assemble = assembled
robot = jounce.load("planar2r")
print(*(x.hex() for Q in robot.inverse_dynamics(*[[0.1, 0.2]] * 5) for x in Q.tolist()))
writers = {f"jounce.native.{name}" for name in ("code_forms", "straight", "calls", "vector_functions")}
imported = sys.modules.keys() & writers
print("traced" if imported == writers else f"imported {imported}" if imported else "read")
"""


def process(kind):
    return subprocess.Popen([sys.executable, "-c", PROCESS, kind], stdout=subprocess.PIPE, text=True)


def test_two_processes_at_once_and_a_third_that_compiles_nothing(cache_folder):
    both = [process("cold"), process("cold")]
    outputs = [p.communicate(timeout=60)[0] for p in both]
    last = process("warm")
    outputs.append(last.communicate(timeout=60)[0])
    assert [p.returncode for p in (*both, last)] == [0, 0, 0]
    forces, ways = zip(*(text.splitlines() for text in outputs), strict=True)
    assert len(set(forces)) == 1
    assert len(forces[0].split()) == 6
    assert "traced" in ways[:2]  # both, unless one of them is done when the other looks
    assert ways[2] == "read"
    assert [x.suffix for x in cache_folder.iterdir()] == [cache.KERNEL_SUFFIX]
