"""Work in forked children of a process, on limits of processor time: a busy machine changes nothing that it finds."""

import os
import resource
import signal
import traceback
from collections.abc import Callable
from contextlib import suppress

PATIENCE = 5  # times as long as a test took before it counts as one that hangs
WALL_PATIENCE, LEAST_WALL_TIME = 100, 300  # the same on the clock, and s: for what waits and takes no processor time
OUT_OF_TIME = (-signal.SIGXCPU, -signal.SIGALRM)
FAILED = 255


def run_forked(work: Callable[[], int]) -> int:
    """The exit status that work in a child returns, FAILED if it raises, or the negative number of a signal."""
    pid = os.fork()
    if pid == 0:
        status = FAILED
        try:
            os.setpgid(0, 0)
            status = work()
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(status)
    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    with suppress(ProcessLookupError):  # what it has started and left
        os.killpg(pid, signal.SIGKILL)
    return status


def limit_time(seconds: float, more: float) -> None:
    """Let this process take `seconds` of processor time, with patience, and some more before a signal ends it."""
    most = int(used_time() + PATIENCE * seconds + more) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (most, resource.RLIM_INFINITY))
    signal.alarm(int(WALL_PATIENCE * seconds + LEAST_WALL_TIME))


def unlimit_time() -> None:
    """Let this process take any time."""
    resource.setrlimit(resource.RLIMIT_CPU, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    signal.alarm(0)


def used_time() -> float:
    """The processor time that this process and its children have taken, in seconds."""
    return sum(os.times()[:4])
