"""Which code runs: a digest that changes with it, and None where that cannot be known.

Machine code on disk outlives the release that compiled it, and parts of a run go to workers with installations of their
own. Both compare digests: a wheel brings that of its code, which `hatch_build.py` computes by this very module, so it
imports nothing of jounce. Sources are hashed in a checkout alone, to which editable installations lead, and where an
installed module was edited.
"""

import hashlib
import os
import re
from collections.abc import Iterator
from functools import cache
from importlib.machinery import all_suffixes
from pathlib import Path
from pkgutil import get_data

DIGEST_FILE = "code.sha256"  # in the package of a wheel
BUILD_FILE = "hatch_build.py"  # of a checkout, whose package lies in src
PACKAGE_FILE = globals().get("__file__")  # a program that holds its modules in memory states none
UNKNOWN_CODE = "this copy of jounce has no digest of its code; install jounce from a wheel, or as an editable checkout"


@cache
def code_digest(*layers: str) -> str | None:
    """Return a digest of the code of some layers, or None.

    It is None where the code is not known. Without layers it is that of all of them. The digest of a wheel is of all
    code, whatever the layers.
    """
    built = _built_digest()
    package = None if PACKAGE_FILE is None else Path(PACKAGE_FILE).parents[1]
    if package is None or not package.is_dir():  # an archive, or memory
        return built
    # The digest of a wheel is right as long as none of its modules is newer.
    if built is not None and not _is_edited(package, layers):
        return built
    if built is not None or _is_checkout(package):
        return hash_modules(package, *layers)
    return None


def hash_modules(package: Path, *layers: str) -> str:
    """Return a hash of the modules of some layers.

    It is one of their names and contents. Without layers it is that of the whole package.
    """
    digest, start = hashlib.sha256(), len(str(package)) + len(os.sep)
    for layer in layers or ("",):
        for path in sorted(_modules(package / layer)):
            content = Path(path).read_bytes()
            digest.update(f"{path[start:].replace(os.sep, '/')} {len(content)} ".encode())
            digest.update(content)
    return digest.hexdigest()


def _modules(folder: Path) -> Iterator[str]:
    """Yield the files of a folder that Python imports: sources, bytecode and machine code.

    They are text: to order paths and to cut them takes longer than to read the files, in every process.
    """
    suffixes = tuple(all_suffixes())
    for place, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if name != "__pycache__"]  # which Python compares with the sources
        yield from (f"{place}{os.sep}{name}" for name in names if name.endswith(suffixes))


def _built_digest() -> str | None:
    """Return the digest that a wheel brought, or None.

    It is None if the digest is missing or not whole. It is in a folder or an archive.
    """
    try:
        content = get_data("jounce", DIGEST_FILE)
    except OSError:
        return None
    match = re.fullmatch(rb"[0-9a-f]{64}\n", content or b"")
    return None if match is None else match[0].decode().strip()


def _is_edited(package: Path, layers: tuple[str, ...]) -> bool:
    """Return whether a module is newer than the digest.

    Installers write the digest last of all files of the package.
    """
    digest_time = (package / DIGEST_FILE).stat().st_mtime_ns
    modules = (path for layer in layers or ("",) for path in _modules(package / layer))
    return any(Path(path).stat().st_mtime_ns > digest_time for path in modules)


def _is_checkout(package: Path) -> bool:
    return package.parent.name == "src" and (package.parents[1] / BUILD_FILE).is_file()
