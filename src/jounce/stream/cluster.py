"""Runs parts of a job on the workers of a Dask cluster.

Workers read the input and write the results at the paths of this process: all share a file system. The runner of
`cluster_runner` submits orders (`compute_order`), a few more than workers can compute at once.
"""

import logging
import signal
from collections.abc import Collection, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from socket import gethostname
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from jounce.core import code_digest, cures, errors
from jounce.core.errors import JounceError, quote_value
from jounce.core.version import __version__
from jounce.dask import Pickled, pickle_object
from jounce.io import tables
from jounce.io.motions.table_parts import InputPart, TableLayout
from jounce.stream import finished_parts
from jounce.stream.finished_parts import FinishedPart
from jounce.stream.jobs import Job
from jounce.stream.run import Runner, compute_part

if TYPE_CHECKING:
    from distributed import Client, Future


PARTS_PER_THREAD = 2  # submitted at once: no thread waits for its next part, and few parts are lost if a run ends
SHARED_FILES = "expected a file system that this process and all workers share"


@dataclass(frozen=True)
class Order:
    """The data with which a worker computes a part.

    They are the job, the part, the work folder, and the version and the file that the worker must have. Messages are
    for the reader of the process that gives the order.
    """

    task: Pickled[tuple[Job, TableLayout]]
    part: InputPart
    folder: Path
    version: str
    file: tuple[int, int]
    reader: frozenset[str] | None


def cluster_runner(address: str) -> Runner:
    """Return the runner of a cluster, whose address is checked.

    The address is "local", or that of a scheduler.
    """
    check_address(address)
    return partial(_run, address)


def version() -> str:
    """Return the version of jounce with a digest of its code.

    Results depend on both.
    """
    code_version = code_digest.code_digest()
    if code_version is None:
        raise JounceError(f"a cluster needs the same jounce on all machines, and {code_digest.UNKNOWN_CODE}")
    return f"{__version__} (code {code_version[:12]})"


def compute_order(order: Order) -> FinishedPart:
    """Compute a part on a worker, unless it is finished already.

    A worker that died may have finished it.
    """
    # NumPy's warnings are silenced as in the command itself, since values that are not finite are refused.
    with cures.reader_of(order.reader), np.errstate(all="ignore"):
        _check_version(gethostname(), version(), order.version)
        _check_files(order)
        job, layout = order.task.value
        if finished_parts.is_finished(job, order.part, order.folder):
            finished = finished_parts.find_finished(order.folder, order.part, job)
            if finished is not None:
                return finished
        return compute_part(job, layout, order.part, order.folder)


def _check_version(worker: str, worker_version: str, own_version: str) -> None:
    """Raise `JounceError` unless a worker has the version of this process."""
    if worker_version != own_version:
        raise JounceError(
            f"worker {worker} has jounce {worker_version}, this process {own_version}; install one version on both"
        )


def _check_files(order: Order) -> None:
    """Raise `JounceError` unless this worker sees the folder and the input."""
    path, folder = order.part.path, finished_parts.rows_folder(order.folder)
    if not folder.is_dir():
        raise JounceError(f"{folder}: worker {gethostname()} sees no such folder; {SHARED_FILES}")
    if not path.is_file() or _identity(path) != order.file:
        raise JounceError(f"{path}: worker {gethostname()} sees no such file or another one; {SHARED_FILES}")


def _identity(path: Path) -> tuple[int, int]:
    """Return the size of a file and the time of its change.

    The time is in seconds: file systems of a network agree on these.
    """
    status = path.stat()
    return status.st_size, int(status.st_mtime)


def _run(
    address: str, job: Job, layout: TableLayout, parts: Sequence[InputPart], folder: Path
) -> Generator[FinishedPart]:
    """Compute parts on a cluster, if there are any."""
    if len(parts) > 0:
        with connect(address, len(parts)) as client:
            _check_workers(address, client)
            yield from _compute(client, (job, layout), parts, folder.absolute())


def _check_workers(address: str, client: "Client") -> None:
    """Raise `JounceError` if a worker has another jounce, or none.

    Workers that join later are checked with their first part.
    """
    if address == LOCAL_CLUSTER:
        client.run(_ignore_interrupts)
    own_version = version()
    for worker, answer in client.run(version, on_error="return").items():
        if isinstance(answer, Exception):
            cure = f"install jounce {__version__} there"
            raise JounceError(f"worker {worker} cannot import this jounce: {errors.one_line(answer)}; {cure}")
        _check_version(worker, answer, own_version)


def _ignore_interrupts() -> None:
    """Ignore Ctrl-C, which a terminal sends to all its processes.

    The process that started this worker handles it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _compute(
    client: "Client", task: tuple[Job, TableLayout], parts: Sequence[InputPart], folder: Path
) -> Iterator[FinishedPart]:
    """Submit parts, a few more than threads, until all are finished."""
    pickled_task, waiting_parts = pickle_object(task), iter(parts)
    running: dict[Future[FinishedPart], InputPart] = {}
    try:
        while True:
            # Workers come and go: the number of parts at once follows the threads, and is never 0.
            threads = count_threads(client, finished_parts.CONTINUATION)
            for part in islice(waiting_parts, max(1, PARTS_PER_THREAD * threads - len(running))):
                absolute_part = replace(part, path=part.path.absolute())
                order = Order(pickled_task, absolute_part, folder, version(), _identity(part.path), cures.get_reader())
                running[client.submit(compute_order, order, pure=False)] = part
            if len(running) == 0:
                return
            for future in wait_for_results(client, list(running), finished_parts.CONTINUATION):
                yield _check_finished(task[0], running.pop(future), future, folder)
    finally:
        client.cancel(list(running))


def _check_finished(job: Job, part: InputPart, future: "Future[FinishedPart]", folder: Path) -> FinishedPart:
    """Return a finished part whose files this process sees."""
    from distributed import KilledWorker

    try:
        with report_lost_connection(finished_parts.CONTINUATION):
            finished = future.result()
    except KilledWorker as error:
        cause = f"{error.allowed_failures + 1} workers died while they computed this part, perhaps for lack of memory"
        raise JounceError(
            f"{tables.describe_place(part.path, part.span.start)}: {cause}; {finished_parts.CONTINUATION}"
        ) from None
    if finished.checksum and job.form and not finished_parts.rows_path(folder, part, job.form).is_file():
        path = finished_parts.rows_path(folder, part, job.form)
        raise JounceError(f"{path}: a worker has written it elsewhere; {SHARED_FILES}")
    # File systems of a network may show the new file late: this process then writes it itself.
    if finished_parts.find_finished(folder, part, job) is None:
        finished_parts.write_finished(folder, part, finished)
    return finished


# The client of a cluster, and its loss.
LOCAL_CLUSTER = "local"  # a cluster of this machine, which lives as long as the run
CONNECTION_TIMEOUT = 10.0  # s to find the cluster and a worker of it
IDLE_TIMEOUT = 30.0  # s without a result, after which a cluster without workers is given up
T = TypeVar("T")


def check_address(address: str) -> None:
    """Raise `JounceError` unless an address is "local" or that of a scheduler."""
    with errors.optional_import("clusters need Dask", "cluster"):
        from distributed.comm.addressing import get_address_host_port
    if address != LOCAL_CLUSTER:
        try:
            get_address_host_port(address, strict=True)
        except ValueError:
            expected = "expected local, or the address of a scheduler: tcp://HOST:PORT"
            raise JounceError(f"cluster {quote_value(address)}; {expected}") from None


@contextmanager
def connect(address: str, most: int) -> Iterator["Client"]:
    """Connect to a cluster, and yield its client.

    A cluster of this machine has at most `most` workers, one per part.
    """
    from distributed import Client

    with ExitStack() as stack:
        stack.enter_context(_silence_dask())
        try:
            scheduler = stack.enter_context(start_local_cluster(most)) if address == LOCAL_CLUSTER else address
            client = stack.enter_context(Client(scheduler, timeout=CONNECTION_TIMEOUT, set_as_default=False))
            client.wait_for_workers(1, timeout=CONNECTION_TIMEOUT)
        except Exception as error:
            # The address is wrong, the network fails, or the server is not a scheduler.
            raise JounceError(f"cluster {address}: {errors.one_line(error)}") from None
        yield client


@contextmanager
def start_local_cluster(most: int) -> Iterator[str]:
    """Start a cluster of this machine, one process per core.

    No file or process outlives it.
    """
    import dask
    from dask.system import CPU_COUNT
    from distributed import LocalCluster

    with (
        TemporaryDirectory(prefix="jounce-", ignore_cleanup_errors=True) as folder,
        dask.config.set({"temporary-directory": folder}),
        LocalCluster(
            n_workers=min(CPU_COUNT, most),
            threads_per_worker=1,
            dashboard_address=":0",  # the server of Dask's metrics takes any port that is free
            scheduler_kwargs={"dashboard": False},
            memory_limit=0,  # none: parts are small
            silence_logs=logging.CRITICAL,
        ) as cluster,
    ):
        yield cluster.scheduler_address


@contextmanager
def _silence_dask() -> Iterator[None]:
    """Silence the logs of Dask within this context: errors become one line."""
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == "distributed"]
    levels = {log: log.level for log in map(logging.getLogger, names)}
    for log in levels:
        log.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for log, level in levels.items():
            log.setLevel(level)


@contextmanager
def report_lost_connection(cure: str) -> Iterator[None]:
    """Report the loss of the cluster in one line, with a cure."""
    from distributed import CancelledError

    try:
        yield
    except TimeoutError:
        raise
    except (OSError, CancelledError) as error:
        raise JounceError(f"the connection to the cluster is lost ({type(error).__name__}); {cure}") from None


def count_threads(client: "Client", cure: str) -> int:
    """Return the number of threads of all current workers."""
    with report_lost_connection(cure):
        return sum(client.nthreads().values())


def wait_for_results(client: "Client", running: "Sequence[Future[T]]", cure: str) -> "Collection[Future[T]]":
    """Return the finished futures as soon as there are some.

    A cluster without workers is given up after `IDLE_TIMEOUT`.
    """
    from distributed import wait

    while True:
        try:
            with report_lost_connection(cure), client.as_current():
                return wait(running, IDLE_TIMEOUT, "FIRST_COMPLETED").done
        except TimeoutError:
            if count_threads(client, cure) == 0:
                raise JounceError(f"no worker of the cluster is left; {cure}") from None
