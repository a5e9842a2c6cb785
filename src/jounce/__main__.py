"""The command line, as `jounce` and as `python -m jounce`."""

import os
import signal
import sys

INTERRUPTED = 130  # 128 + SIGINT, as shells have it
FAILED = 2  # as of every error; Python's own 1 would be the verdict that a limit is broken


def main() -> None:
    """Run the command; Ctrl-C ends it in one line.

    The exit code is that of shells. It does so from the first import on.
    """
    stopped = False

    def stop(*_: object) -> None:
        nonlocal stopped
        stopped = True
        _print_aborted()
        sys.exit(INTERRUPTED)

    # Modules that are being imported drop exceptions: until the command is there, Ctrl-C ends the process at once.
    signal.signal(signal.SIGINT, _stop_at_once)
    try:
        from jounce.cli import main as command
    except Exception:  # an installation that is not whole
        sys.excepthook(*sys.exc_info())
        sys.exit(FAILED)

    signal.signal(signal.SIGINT, stop)
    try:
        command()
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is done; Python itself would end with a traceback
        if stopped:  # what `stop` raised may be lost in C code, or be a SystemError by now: NumPy's loops of objects
            sys.exit(INTERRUPTED)


def _stop_at_once(*_: object) -> None:
    """End the process while there is nothing to clean up."""
    _print_aborted()
    os._exit(INTERRUPTED)


def _print_aborted() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # a second one does not wait until what is half-written is removed
    if sys.__stderr__:  # else 2 may be another file
        os.write(2, b"\nAborted!\n")


if __name__ == "__main__":
    main()
