"""The command line, as `jounce` and as `python -m jounce`."""

import os
import signal
import sys


def main() -> None:
    """Run the command; Ctrl-C ends it in one line, with the exit code that shells give it, from the first import on."""
    signal.signal(signal.SIGINT, _stop)
    try:
        from jounce.cli import main as command

        command()
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is done; Python itself would end with a traceback


def _stop(*_: object) -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # a second one does not wait until what is half-written is removed
    if sys.__stderr__:  # else 2 may be another file
        os.write(2, b"\nAborted!\n")
    sys.exit(130)


if __name__ == "__main__":
    main()
