"""Workers of a cluster of Dask compute parts, and write them into the work folder themselves.

They read the input and write the results at the paths of this process: all share a file system. `cluster_runner` is the
door; its runner gives out orders (`compute_order`), a few more than workers can compute at once.
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
    found = code_digest.code_digest()
    if found is None:
        raise JounceError(f"a cluster needs one and the same jounce on all machines, and {code_digest.UNKNOWN_CODE}")
    return f"{__version__} (code {found[:12]})"


def compute_order(order: Order) -> FinishedPart:
    """Compute a part, on a worker; one that a worker finished before it died is not computed again."""
    with cures.reader_of(order.reader), np.errstate(all="ignore"):  # as the command does; what is not finite is refused
        _check_version(gethostname(), version(), order.version)
        _check_files(order)
        job, layout = order.task.value
        if finished_parts.is_finished(job, order.part, order.folder) and (
            found := finished_parts.find_finished(order.folder, order.part, job)
        ):
            return found
        return compute_part(job, layout, order.part, order.folder)


def _check_version(worker: str, theirs: str, ours: str) -> None:
    if theirs != ours:
        raise JounceError(f"worker {worker} has jounce {theirs}, this process {ours}; install one version on both")


def _check_files(order: Order) -> None:
    """Raise `JounceError` unless this worker sees the work folder and the very input."""
    path, folder = order.part.path, finished_parts.rows_folder(order.folder)
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
            raise JounceError(f"worker {worker} cannot import this jounce: {errors.one_line(found)}; {cure}")
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
            for part in islice(
                waiting, max(1, PARTS_PER_THREAD * count_threads(client, finished_parts.CONTINUATION) - len(running))
            ):
                there = replace(part, path=part.path.absolute())
                order = Order(kept, there, folder, version(), _identity(part.path), cures.get_reader())
                running[client.submit(compute_order, order, pure=False)] = part
            if not running:
                return
            for future in wait_for_results(client, list(running), finished_parts.CONTINUATION):
                yield _check_finished(task[0], running.pop(future), future, folder)
    finally:
        client.cancel(list(running))


def _check_finished(job: Job, part: InputPart, future: "Future[FinishedPart]", folder: Path) -> FinishedPart:
    """A finished part, whose files this process sees."""
    from distributed import KilledWorker

    try:
        with report_lost_connection(finished_parts.CONTINUATION):
            found = future.result()
    except KilledWorker as error:
        died = f"{error.allowed_failures + 1} workers died while they computed this part, for want of memory perhaps"
        raise JounceError(
            f"{tables.describe_place(part.path, part.span.start)}: {died}; {finished_parts.CONTINUATION}"
        ) from None
    if found.checksum and job.form and not finished_parts.rows_path(folder, part, job.form).is_file():
        path = finished_parts.rows_path(folder, part, job.form)
        raise JounceError(f"{path}: a worker has written it elsewhere; {SHARED_FILES}")
    if finished_parts.find_finished(folder, part, job) is None:  # file systems of a network show new files late
        finished_parts.write_finished(folder, part, found)
    return found


# The client of a cluster, and its loss.
LOCAL_CLUSTER = "local"  # a cluster of this machine, which lives as long as the run
CONNECTION_TIMEOUT = 10.0  # s to find the cluster and a worker of it
IDLE_TIMEOUT = 30.0  # s without a result, after which a cluster without workers is given up
T = TypeVar("T")


def check_address(address: str) -> None:
    """Raise `JounceError` unless an address is that of a scheduler, or "local"."""
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
    """A client of a cluster; one of this machine has at most as many workers as there are parts."""
    from distributed import Client

    with ExitStack() as stack:
        stack.enter_context(_silence_dask())
        try:
            scheduler = stack.enter_context(start_local_cluster(most)) if address == LOCAL_CLUSTER else address
            client = stack.enter_context(Client(scheduler, timeout=CONNECTION_TIMEOUT, set_as_default=False))
            client.wait_for_workers(1, timeout=CONNECTION_TIMEOUT)
        except Exception as error:  # the address, the network, or a server that is no scheduler
            raise JounceError(f"cluster {address}: {errors.one_line(error)}") from None
        yield client


@contextmanager
def start_local_cluster(most: int) -> Iterator[str]:
    """A cluster of this machine, a process per core, without files or processes that outlive it."""
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
    """Within this context Dask logs nothing: errors become one line."""
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
    """Within this context, the loss of the cluster is reported in one line, which ends with the cure."""
    from distributed import CancelledError

    try:
        yield
    except TimeoutError:
        raise
    except (OSError, CancelledError) as error:
        raise JounceError(f"the connection to the cluster is lost ({type(error).__name__}); {cure}") from None


def count_threads(client: "Client", cure: str) -> int:
    """The number of threads of all workers that are there."""
    with report_lost_connection(cure):
        return sum(client.nthreads().values())


def wait_for_results(client: "Client", running: "Sequence[Future[T]]", cure: str) -> "Collection[Future[T]]":
    """The futures that are finished, as soon as some are; a cluster without workers is given up after a time."""
    from distributed import wait

    while True:
        try:
            with report_lost_connection(cure), client.as_current():
                return wait(running, IDLE_TIMEOUT, "FIRST_COMPLETED").done
        except TimeoutError:
            if not count_threads(client, cure):
                raise JounceError(f"no worker of the cluster is left; {cure}") from None
