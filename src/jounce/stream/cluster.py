"""Running a plan on a cluster of Dask: workers compute parts, and write them into the work folder themselves.

They read the input and write the results at the paths of this process: all share a file system.
"""

import signal
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from socket import gethostname
from typing import TYPE_CHECKING

import numpy as np

from jounce.core.code_digest import UNKNOWN_CODE, code_digest
from jounce.core.cures import get_reader, reader_of
from jounce.core.errors import JounceError, one_line
from jounce.core.version import __version__
from jounce.dask.pickled import Pickled, pickle_object
from jounce.dask.session import (
    LOCAL_CLUSTER,
    check_address,
    connect,
    count_threads,
    report_lost_connection,
    wait_for_results,
)
from jounce.io.motions.table_parts import InputPart, TableLayout
from jounce.io.tables import describe_place
from jounce.stream.job import Job
from jounce.stream.run import Runner, compute_part
from jounce.stream.work_folder import (
    CONTINUATION,
    FinishedPart,
    find_finished,
    is_finished,
    rows_folder,
    rows_path,
    write_finished,
)

if TYPE_CHECKING:
    from distributed import Client, Future

PARTS_PER_THREAD = 2  # submitted at once: no thread waits for its next part, few are lost where a run ends
SHARED_FILES = "expected a file system that this process and all workers share"


@dataclass(frozen=True)
class Order:
    """What a worker needs to compute a part: the job, the folder, the version and the file that it must have.

    Messages are for the reader of the process that gives the order.
    """

    task: Pickled[tuple[Job, TableLayout]]
    part: InputPart
    folder: Path
    version: str
    file: tuple[int, int]
    reader: frozenset[str] | None


def cluster_runner(address: str) -> Runner:
    """Return the runner of a cluster: "local", or that of the scheduler at an address, which is checked."""
    check_address(address)
    return partial(_run, address)


def version() -> str:
    """The version of jounce in this process, and a digest of its code, on which results depend."""
    found = code_digest()
    if found is None:
        raise JounceError(f"a cluster needs one and the same jounce on all machines, and {UNKNOWN_CODE}")
    return f"{__version__} (code {found[:12]})"


def compute_order(order: Order) -> FinishedPart:
    """Compute a part, on a worker; one that a worker finished before it died is not computed again."""
    with reader_of(order.reader):
        return _compute_part(order)


def _compute_part(order: Order) -> FinishedPart:
    _check_version(gethostname(), version(), order.version)
    _check_files(order)
    job, layout = order.task.value
    if is_finished(job, order.part, order.folder) and (found := find_finished(order.folder, order.part, job)):
        return found
    with np.errstate(all="ignore"):  # as the command does; what is not finite is refused
        return compute_part(job, layout, order.part, order.folder)


def _check_version(worker: str, theirs: str, ours: str) -> None:
    if theirs != ours:
        raise JounceError(f"worker {worker} has jounce {theirs}, this process {ours}; install one version on both")


def _check_files(order: Order) -> None:
    """Raise `JounceError` unless this worker sees the work folder and the very input."""
    path, folder = order.part.path, rows_folder(order.folder)
    if not folder.is_dir():
        raise JounceError(f"{folder}: worker {gethostname()} sees no such folder; {SHARED_FILES}")
    if not path.is_file() or _identity(path) != order.file:
        raise JounceError(f"{path}: worker {gethostname()} sees no such file or another one; {SHARED_FILES}")


def _identity(path: Path) -> tuple[int, int]:
    """The size of a file and the second of its last change: what file systems of a network agree upon."""
    about = path.stat()
    return about.st_size, int(about.st_mtime)


def _run(
    address: str, job: Job, layout: TableLayout, parts: Sequence[InputPart], folder: Path
) -> Generator[FinishedPart]:
    """Compute parts on a cluster, which is looked for if there are any."""
    if parts:
        with connect(address, len(parts)) as client:
            _check_workers(address, client)
            yield from _compute(client, (job, layout), parts, folder.absolute())


def _check_workers(address: str, client: "Client") -> None:
    """Raise `JounceError` if a worker has another jounce, or none; later ones are asked with their first part."""
    if address == LOCAL_CLUSTER:
        client.run(_ignore_interrupts)
    ours = version()
    for worker, found in client.run(version, on_error="return").items():
        if isinstance(found, Exception):
            cure = f"install jounce {__version__} there"
            raise JounceError(f"worker {worker} cannot import this jounce: {one_line(found)}; {cure}")
        _check_version(worker, found, ours)


def _ignore_interrupts() -> None:
    """Leave Ctrl-C, which a terminal sends to all its processes, to the one that started this worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _compute(
    client: "Client", task: tuple[Job, TableLayout], parts: Sequence[InputPart], folder: Path
) -> Iterator[FinishedPart]:
    """Give parts out, a few more than workers can compute at once, until all are finished."""
    kept, waiting = pickle_object(task), iter(parts)
    running: dict[Future[FinishedPart], InputPart] = {}
    try:
        while True:
            for part in islice(waiting, max(1, PARTS_PER_THREAD * count_threads(client, CONTINUATION) - len(running))):
                there = replace(part, path=part.path.absolute())
                order = Order(kept, there, folder, version(), _identity(part.path), get_reader())
                running[client.submit(compute_order, order, pure=False)] = part
            if not running:
                return
            for future in wait_for_results(client, list(running), CONTINUATION):
                yield _check_finished(task[0], running.pop(future), future, folder)
    finally:
        client.cancel(list(running))


def _check_finished(job: Job, part: InputPart, future: "Future[FinishedPart]", folder: Path) -> FinishedPart:
    """A finished part, whose files this process sees."""
    from distributed import KilledWorker

    try:
        with report_lost_connection(CONTINUATION):
            found = future.result()
    except KilledWorker as error:
        died = f"{error.allowed_failures + 1} workers died while they computed this part, for want of memory perhaps"
        raise JounceError(f"{describe_place(part.path, part.span.start)}: {died}; {CONTINUATION}") from None
    if found.checksum and job.form and not rows_path(folder, part, job.form).is_file():
        path = rows_path(folder, part, job.form)
        raise JounceError(f"{path}: a worker has written it elsewhere; {SHARED_FILES}")
    if find_finished(folder, part, job) is None:  # file systems of a network show new files late
        write_finished(folder, part, found)
    return found
