"""Times of calls: each library in a process of its own, all in turn.

Of each robot, task and number of states: every library prepares its call and computes once; its results are compared
with those of jounce's recursion in NumPy, which shares no native code with its kernels; then the libraries are timed in
rounds, one sample of each in turn, so that whatever else the machine does falls on all alike. The least of the rounds
counts, which other programs disturb least.

A library that does not prepare its call within its `Rival.patience` is stopped and started again for the next task; the
same task is not tried again with batches or with more joints.
"""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from time import perf_counter
from typing import Any

import numpy as np

import jounce
from benchmarks.rivals import Rival
from benchmarks.rivals.arms import GRAVITY, STATES, Arm, states
from benchmarks.rivals.tasks import COMPARED, TASKS, error
from benchmarks.rivals.worker import FAILED, NOT_SERVED, SERVED, Request, serve

ROUNDS = 12
LONG = 1.0  # s that all samples of a library may take for one cell; slower calls have fewer rounds, but `FEWEST`
FEWEST = 3
ROUNDING = 1e-9  # of the largest entry: results that are further off have their error in the cell
NOT_TRIED = "not tried: compiles too long"
WRONG = 1e-2  # results that are further off are not those of the task

Row = dict[str, Any]


@dataclass
class Worker:
    """The process of a library, started when it is needed."""

    rival: Rival
    process: Any = None
    connection: Any = None
    missing: str = ""  # why it cannot be imported
    slow: set[str] = field(default_factory=set)  # tasks whose code took too long to compile

    def prepare(self, request: Request) -> tuple[str, Any]:
        """Let a call be compiled and run once; return results of its first states, or why there are none."""
        if request.task in self.slow or not self.rival.compiles(request.task, request.arm.n):
            return FAILED, NOT_TRIED
        if not self._start():
            return FAILED, self.missing
        self.connection.send(request)
        answer = self._answer(self.rival.patience)
        if answer is None:
            self.slow.add(request.task)
            return FAILED, f"over {self.rival.patience:.0f} s to compile"
        return answer

    def sample(self) -> float | None:
        """Return seconds of the call that was prepared last; None where it fails now."""
        self.connection.send(None)
        answer = self._answer(self.rival.patience)
        return answer[1] if answer is not None and answer[0] == SERVED else None

    def stop(self) -> None:
        """End the process."""
        if self.process is None:
            return
        self.connection.close()
        self.process.kill()
        self.process.join()
        self.process = None

    def _start(self) -> bool:
        """Start the process where it does not run; return whether the library is there."""
        if self.missing or self.process is not None:
            return not self.missing
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=serve, args=(self.rival, theirs), daemon=True)
        self.process.start()
        theirs.close()
        answer = self._answer(self.rival.patience)
        if answer is None or answer[0] == FAILED:
            self.missing = answer[1] if answer is not None else "not imported in time"
            self.stop()
        return not self.missing

    def _answer(self, limit: float) -> tuple[str, Any] | None:
        """Return the next answer; None where there is none in time, after which the process is stopped."""
        try:
            if self.connection.poll(limit):
                return self.connection.recv()
        except EOFError:
            self.stop()
            return FAILED, "its process ended"
        self.stop()
        return None


def measured(arms: Sequence[Arm], rivals: Sequence[Rival], report: Callable[[str], None]) -> list[Row]:
    """Return a row for each robot, task, number of states and library: seconds for a state, or a note."""
    workers = [Worker(rival) for rival in rivals]
    try:
        return [
            row
            for arm in arms
            for count in (None, STATES)
            for task in TASKS
            for row in _cells(workers, Request(arm, task, states(arm.n, count)[: TASKS[task].inputs]), report)
        ]
    finally:
        for worker in workers:
            worker.stop()


def _cells(workers: Sequence[Worker], request: Request, report: Callable[[str], None]) -> Iterator[Row]:
    """Measure one task with all libraries."""
    count = len(request.inputs[0]) if request.is_batch else 1
    report(f"{request.arm.name}: {request.task}, states: {count}")
    rows: dict[str, Row] = {}
    timed = []
    for worker in workers:
        begin = perf_counter()
        status, found = worker.prepare(request)
        prepared = perf_counter() - begin
        if status == NOT_SERVED:
            continue
        row = {"robot": request.arm.name, "task": request.task, "states": count, "rival": worker.rival.name}
        rows[worker.rival.name] = row
        row["prepared"] = prepared
        if status == FAILED:
            row["note"] = found
            continue
        judge(row, error(found, _reference(request)))
        if "note" not in row:
            timed.append(worker)
    for name, samples in _in_turn(timed).items():
        if samples:
            rows[name]["seconds"] = min(samples) / count
        else:
            rows[name]["note"] = "failed when it was timed"
    yield from rows.values()


def judge(row: Row, off: float) -> None:
    """Write the error of results into a row, or that they are wrong."""
    row["error"] = off if np.isfinite(off) else None
    if not off <= WRONG:
        row["note"] = f"other numbers: off by {off:.0e}" if np.isfinite(off) else "not the numbers of the task"


def _in_turn(workers: Sequence[Worker]) -> dict[str, list[float]]:
    """Return samples of each worker's call, taken in turn; slow calls have fewer."""
    samples: dict[str, list[float]] = {worker.rival.name: [] for worker in workers}
    rounds = dict.fromkeys(samples, ROUNDS)
    for k in range(ROUNDS):
        for worker in workers:
            if k >= rounds[worker.rival.name]:
                continue
            seconds = worker.sample()
            if seconds is None:
                rounds[worker.rival.name] = 0
                continue
            samples[worker.rival.name].append(seconds)
            rounds[worker.rival.name] = max(FEWEST, min(ROUNDS, int(LONG / (2 * seconds))))
    for worker in workers:
        if rounds[worker.rival.name] > 0:
            samples[worker.rival.name] += _further_samples(worker)
    return samples


def _further_samples(worker: Worker) -> list[float]:
    """Return samples of a worker for as long as its library needs."""
    samples: list[float] = []
    end = perf_counter() + worker.rival.span
    while perf_counter() < end:
        seconds = worker.sample()
        if seconds is None:
            break
        samples.append(seconds)
    return samples


@cache
def _robot(path: str) -> jounce.Robot:
    return jounce.load(path, gravity=(0, 0, GRAVITY))


def _reference(request: Request) -> tuple[np.ndarray, ...]:
    """Return the results of the first states by the recursion in NumPy."""
    first = [array[:COMPARED] for array in request.inputs] if request.is_batch else request.inputs
    return TASKS[request.task].reference(_robot(request.arm.path), request.arm.tip, first)
