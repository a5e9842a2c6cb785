"""A client of a cluster of Dask: of this machine, or of a scheduler elsewhere; its loss is reported in one line."""

import logging
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, TypeVar

from jounce.core.errors import JounceError, one_line, optional_import, quote_value

if TYPE_CHECKING:
    from distributed import Client, Future

LOCAL_CLUSTER = "local"  # a cluster of this machine, which lives as long as the run
CONNECTION_TIMEOUT = 10.0  # s to find the cluster and a worker of it
IDLE_TIMEOUT = 30.0  # s without a result, after which a cluster without workers is given up

T = TypeVar("T")


def check_address(address: str) -> None:
    """Raise `JounceError` unless an address is that of a scheduler, or "local"."""
    with optional_import("clusters need Dask", "cluster"):
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
            raise JounceError(f"cluster {address}: {one_line(error)}") from None
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
