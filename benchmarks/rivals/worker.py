"""A library in a process of its own, which prepares and times calls when it is asked.

The process begins with the settings that the library wants, and imports nothing else of those compared. It answers each
request with a result or with the text of the error; a library that ends its process is noticed by the parent.
"""

import importlib
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import ceil
from multiprocessing.connection import Connection
from time import perf_counter

import numpy as np

from benchmarks.rivals import Rival
from benchmarks.rivals.arms import Arm
from benchmarks.rivals.tasks import COMPARED, Call

SAMPLE = 4e-3  # s, at least, between two readings of the clock
SERVED, NOT_SERVED, FAILED = "served", "not served", "failed"


@dataclass(frozen=True)
class Request:
    """A task of a robot, with its inputs: q, qd, ..., each (n,) of one state or (states, n)."""

    arm: Arm
    task: str
    inputs: tuple[np.ndarray, ...]

    @property
    def is_batch(self) -> bool:
        """Whether there are many states."""
        return self.inputs[0].ndim > 1


def serve(rival: Rival, connection: Connection) -> None:
    """Answer requests until the parent closes the connection: prepare a call, or time the last one prepared."""
    os.environ.update(dict(rival.settings))
    try:
        module = importlib.import_module(rival.module)
    except Exception as error:
        connection.send((FAILED, f"not imported: {_line(error)}"))
        return
    connection.send((SERVED, None))
    libraries: dict[str, object] = {}
    call: Call | None = None
    for request in _requests(connection):
        try:
            if request is None:
                assert call is not None
                connection.send((SERVED, sample(call.run)))
                continue
            if getattr(module.Library, request.task, None) is None:
                connection.send((NOT_SERVED, None))
                continue
            if request.arm.name not in libraries:
                libraries[request.arm.name] = module.Library(request.arm)
            make = getattr(libraries[request.arm.name], request.task)
            if make is None:  # of this robot
                connection.send((NOT_SERVED, None))
                continue
            call = make(request.inputs)
            call.run()  # compiles what is compiled at the first call
            connection.send((SERVED, first_results(call, request)))
        except Exception as error:
            connection.send((FAILED, _line(error)))


def _requests(connection: Connection) -> Iterator[Request | None]:
    """Yield requests, and None for one more sample."""
    while True:
        try:
            yield connection.recv()
        except EOFError:
            return


def first_results(call: Call, request: Request) -> list[np.ndarray]:
    """Return the results of the state, or of the first states of the batch."""
    found = [np.asarray(array) for array in call.results()]
    return [array[:COMPARED] for array in found] if request.is_batch else found


def sample(run: Callable[[], object]) -> float:
    """Return seconds of a call, the mean of as many in a row as last `SAMPLE`, after one that is not counted."""
    start = perf_counter()
    run()
    took = perf_counter() - start
    count = ceil(SAMPLE / max(took, 1e-9))
    start = perf_counter()
    for _ in range(count):
        run()
    return (perf_counter() - start) / count


def _line(error: Exception) -> str:
    """Return the first line of an error, with its kind."""
    text = str(error).strip().splitlines()
    return f"{type(error).__name__}: {text[0]}"[:120] if text else type(error).__name__
