"""Compiled kernels on disk, so that the next process need not compile: a private folder of object code.

Object code is executed, so only its owner may write to the folder, and an entry is verified before it is loaded: its
owner, its key and the hash of its content. An entry that fails is treated as missing and rewritten. The folder grows up
to a limit: the least recently used kernels are removed first. Keys hold a digest of the code that compiles; a copy of
jounce that has none neither reads nor writes, as it could run what another release has compiled.
"""

import hashlib
import os
import stat
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

from jounce.core.code_digest import UNKNOWN_CODE, code_digest
from jounce.core.errors import JounceError, quote_value
from jounce.core.foreign import parse_finite
from jounce.core.temporary_files import remove_abandoned, temporary_path
from jounce.dynamics import elastic
from jounce.dynamics.computation import Computation
from jounce.dynamics.quantities.row import ELASTIC
from jounce.model.mechanism import Mechanism
from jounce.native.jit import Target

KERNEL_SUFFIX = ".kernel"
CODE_LAYERS = "core", "spatial", "program", "model", "dynamics", "arguments", "native"  # which alone make native code
DEFAULT_CACHE_MIB = 256  # thousands of kernels, which take some 50 kB each


def folder() -> Path:
    """Return the folder of compiled kernels: ``$JOUNCE_CACHE_DIR``, or the user's cache folder."""
    path = os.environ.get("JOUNCE_CACHE_DIR", "")
    if path != "":
        return Path(path)
    from platformdirs import user_cache_path

    return user_cache_path("jounce")


def size_limit() -> int:
    """Return the limit of the size of all kernels in bytes.

    It is ``$JOUNCE_CACHE_SIZE`` in MiB, checked, or the default.
    """
    text = os.environ.get("JOUNCE_CACHE_SIZE", "")
    if text == "":
        text = str(DEFAULT_CACHE_MIB)
    size = parse_finite(text)
    if size is None or size < 0:
        raise JounceError(f"JOUNCE_CACHE_SIZE is {quote_value(text)}; expected a number of MiB from 0 on")
    return int(size * 2**20)


def key(mechanism: Mechanism, computation: Computation, target: Target) -> str:
    """Return the name of a kernel: a hash of everything that its code depends on."""
    # The computation, the processor, the versions of compilers, and the tree.
    digest = hashlib.sha256(code_key(str(computation), target).encode())
    digest.update(repr((mechanism.parent, mechanism.owners, mechanism.floats, mechanism.acting)).encode())
    # Numbers of the robot are constants of the code. Parts that the computation does not take are left out, so that
    # robots that differ in them alone share a kernel.
    arrays = mechanism.arrays | (vars(mechanism.drives) if mechanism.acting else {})
    if mechanism.elasticity and ELASTIC in computation.quantity.needs:
        e = mechanism.elasticity
        arrays |= {f"elastic {name}": array for name, array in e.arrays.items()}
        digest.update(repr((e.springs, e.motors, e.level)).encode())
        arrays |= {f"rotor {x.coordinate} on {x.body}": x.momentum for x in elastic.rotors(mechanism)}
    c = mechanism.closure
    if c is not None:
        arrays |= c.arrays
        arrays |= {
            f"loop {k} {i}": array for k, loop in enumerate(mechanism.loops) for i, array in enumerate(loop.arrays)
        }
        joints = [(loop.a.body, loop.b.body, loop.joint) for loop in mechanism.loops]
        digest.update(repr((joints, c.independent, c.actuated, c.ratios.places, c.passive)).encode())
    if mechanism.contacts and computation.quantity.on_contacts:
        links = [(mechanism.frame(contact.frame), contact) for contact in mechanism.contacts]
        digest.update(repr([(link.body, x.kind) for link, x in links]).encode())
        for k, (link, x) in enumerate(links):
            arrays |= {f"contact {k} link": link.T, f"contact {k} place": x.place, f"contact {k} weights": x.weights}
            if x.normal is not None:
                arrays |= {f"contact {k} normal": x.normal}
    if computation.body is not None:
        frame = mechanism.frame(computation.body)
        arrays |= {f"frame on {frame.body}": frame.T}
    # Names, shapes and types separate the arrays: equal bytes in different arrays have different hashes.
    for name, array in arrays.items():
        digest.update(f"{name} {array.shape} {array.dtype}".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def code_key(what: str, target: Target) -> str:
    """Return the name of code that depends on no robot."""
    import llvmlite

    text = f"{what} {target} llvmlite {llvmlite.__version__} {code_digest(*CODE_LAYERS)}"
    return hashlib.sha256(text.encode()).hexdigest()


def read(name: str) -> bytes | None:
    """Return the code under a key; None without a trusted entry."""
    if code_digest(*CODE_LAYERS) is None:
        return None
    try:
        path = folder() / (name + KERNEL_SUFFIX)
        content = path.read_bytes() if _is_private(folder()) and _is_private(path) else b""
    except OSError:
        return None
    # An entry is a hash of name and code, then the code: broken, foreign and renamed entries are not run.
    digest, code = content[:32], content[32:]
    if len(code) == 0 or digest != _hash(name, code):
        return None
    # The time of the file is that of its last use, by which old kernels are removed. The disk may be read-only.
    with suppress(OSError):
        os.utime(path)
    return code


def read_or_make(name: str, make: Callable[[], bytes]) -> bytes:
    """Return the code under a key; make and keep missing code."""
    code = read(name)
    if code is None:
        code = make()
        write(name, code)
    return code


def write(name: str, code: bytes) -> None:
    """Keep code under a key, whole or not at all.

    The least recently used kernels make room for it. Code larger than the limit is not kept, and a folder that cannot
    be written is left alone.
    """
    if code_digest(*CODE_LAYERS) is None:
        return
    content, most = _hash(name, code) + code, size_limit()
    part = temporary_path(folder())
    try:
        folder().mkdir(mode=0o700, parents=True, exist_ok=True)
        if not _is_private(folder()) or len(content) > most:
            return
        remove_abandoned(folder())
        _make_room(most - len(content), name)
        # Written under another name and renamed at once: other processes see the whole entry or none.
        try:
            part.touch(mode=0o600, exist_ok=False)
            part.write_bytes(content)
            part.replace(folder() / (name + KERNEL_SUFFIX))
        finally:
            part.unlink(missing_ok=True)
    except OSError:
        return


def _make_room(most: int, name: str) -> None:
    """Remove the least recently used kernels until the others fit.

    They fit if they take at most `most` bytes. The named kernel does not count: it is about to be replaced.
    """
    kernels = [(entry.stat(), entry.path) for entry in _list_kernels() if entry.name != name + KERNEL_SUFFIX]
    total = sum(stats.st_size for stats, _ in kernels)
    if total <= most:
        return
    for stats, path in sorted(kernels, key=lambda entry: entry[0].st_mtime_ns):
        Path(path).unlink(missing_ok=True)
        total -= stats.st_size
        if total <= most:
            break


def kernel_paths() -> Iterator[Path]:
    """Return the paths of the kernels in the folder."""
    return map(Path, _list_kernels())


def _list_kernels() -> list[os.DirEntry[str]]:
    """Return the kernels as the folder lists them.

    The list itself distinguishes files from links, without a system call for each.
    """
    try:
        with os.scandir(folder()) as entries:
            return [x for x in entries if x.name.endswith(KERNEL_SUFFIX) and x.is_file(follow_symlinks=False)]
    except OSError:
        return []


def obstacle() -> str | None:
    """Return why kernels are neither read nor written; None if they are."""
    return UNKNOWN_CODE if code_digest(*CODE_LAYERS) is None else folder_obstacle()


def folder_obstacle() -> str | None:
    """Return why the folder is not used, or None.

    None is for a private folder, and for one that does not exist yet.
    """
    try:
        stats = os.lstat(folder())
    except FileNotFoundError:
        return None
    # For one, a file may be in the place of a folder above it.
    except OSError as error:
        return f"the cache folder cannot be used: {error.strerror or error}; JOUNCE_CACHE_DIR selects another"
    if not stat.S_ISDIR(stats.st_mode):
        kind = "a link" if stat.S_ISLNK(stats.st_mode) else "a file"
        return f"it is {kind}, not a folder; JOUNCE_CACHE_DIR selects another"
    if _is_private(folder()):
        return None
    if stats.st_uid != os.getuid():
        return "the cache folder belongs to another user; JOUNCE_CACHE_DIR selects another"
    return "others may write into the cache folder; make it private (mode 0700)"


def clear() -> list[int]:
    """Remove all kernels; return their sizes in bytes.

    Files that killed writers have left are removed too, and nothing else. Raises `JounceError` where the folder is not
    its owner's alone, or a kernel cannot be removed.
    """
    reason = folder_obstacle()
    if reason is not None:
        raise JounceError(f"{folder()}: {reason}")
    remove_abandoned(folder())
    sizes = []
    for path in kernel_paths():
        try:
            size = path.stat().st_size
            path.unlink()
        # Another process was faster.
        except FileNotFoundError:
            continue
        except OSError as error:
            raise JounceError(f"{path}: cannot be removed: {error.strerror or error}") from None
        sizes.append(size)
    return sizes


def _hash(name: str, code: bytes) -> bytes:
    return hashlib.sha256(name.encode() + code).digest()


def _is_private(path: Path) -> bool:
    """Return whether only this user can write to a path."""
    stats = os.lstat(path)
    # Windows keeps the folders of users apart itself.
    if not hasattr(os, "getuid"):
        return True
    # A link could lead elsewhere.
    is_file = stat.S_ISDIR(stats.st_mode) or stat.S_ISREG(stats.st_mode)
    return is_file and stats.st_uid == os.getuid() and stats.st_mode & (stat.S_IWGRP | stat.S_IWOTH) == 0
