"""What must hold of every reader and command, whatever it is given; inputs with which it does not are kept."""

import faulthandler
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import jounce

KEPT = Path(__file__).parents[2] / "build" / "fuzz"
PATIENCE = 300  # s, after which a process is taken for hanging, and ends with a traceback
DEEPEST = 600  # calls
LONGEST = 4000  # characters of a message


@contextmanager
def workshop(attack: str) -> Iterator[Path]:
    """A folder to work in. What is in it outlives the process where that crashes or hangs, and is removed otherwise."""
    folder = KEPT / f"{attack}-{os.getpid()}"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    try:
        yield folder
    finally:
        faulthandler.cancel_dump_traceback_later()
        shutil.rmtree(folder)


@contextmanager
def kept(attack: str, *paths: Path) -> Iterator[None]:
    """Inside, a failure keeps these files, under a name that tells failures apart."""
    with (paths[0].parent / "traceback.txt").open("w") as trace:
        faulthandler.dump_traceback_later(PATIENCE, exit=True, file=trace)
        try:
            yield
        except Exception as error:
            place = KEPT / f"{attack}-{type(error).__name__}-{_line(error)}"
            shutil.rmtree(place, ignore_errors=True)
            place.mkdir()
            for path in paths:
                shutil.copy2(path, place)
            error.add_note(f"kept in {place}: {', '.join(path.name for path in paths)}")
            raise
        finally:
            faulthandler.cancel_dump_traceback_later()


@contextmanager
def shallow() -> Iterator[None]:
    """Inside, calls nest less deeply; hypothesis lets xacro follow a macro that calls itself for half a minute."""
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(DEEPEST)
    try:
        yield
    finally:
        sys.setrecursionlimit(limit)


def _line(error: BaseException) -> str:
    """Where jounce, or else the check, was last."""
    trace, found = error.__traceback__, ""
    while trace is not None:
        path = Path(trace.tb_frame.f_code.co_filename)
        if "jounce" in path.parts or not found:
            found = f"{path.stem}{trace.tb_lineno}"
        trace = trace.tb_next
    return found


def is_a_line(message: str) -> None:
    """A message is one line that a terminal shows as it is, and not endless."""
    assert message.isprintable(), f"not printable: {message!r}"
    assert len(message) <= LONGEST, f"{len(message)} characters: {message[:200]!r}"


def refusal_or(call, *given, **options):
    """What a call returns, or None where it refuses in one line."""
    try:
        return call(*given, **options)
    except jounce.JounceError as error:
        message = str(error)
    is_a_line(message)
    return None
