"""C made into calls: sources compiled by gcc, run over states that lie in arrays of rates."""

import ctypes
import subprocess
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.peers import MissingError

OPTIMISED = ("-O3", "-march=native", "-shared", "-fPIC", "-w")


def library(sources: Sequence[Path | str], *flags: str) -> ctypes.CDLL:
    """A shared library of files and of texts."""
    if which("gcc") is None:
        raise MissingError("there is no gcc")
    with TemporaryDirectory() as folder:
        files = []
        for i, source in enumerate(sources):
            if isinstance(source, str):
                text, source = source, Path(folder) / f"text{i}.c"
                source.write_text(text)
            files.append(str(source))
        made = Path(folder) / "made.so"
        command = ["gcc", *OPTIMISED, *files, "-o", str(made), *flags, "-lm"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise MissingError(f"gcc: {next(iter(done.stderr.splitlines()), 'failed')}")
        return ctypes.CDLL(str(made))


def over_states(library: ctypes.CDLL, order: int) -> Callable[[Sequence[np.ndarray]], Callable[[], list[np.ndarray]]]:
    """Calls of ``run(long states, const double **in, double **out)`` on arrays of rates."""

    def prepared(rates: Sequence[np.ndarray]) -> Callable[[], list[np.ndarray]]:
        out = [np.empty_like(rates[0]) for _ in range(order + 1)]
        taken, given = ((ctypes.c_void_p * len(x))(*(a.ctypes.data for a in x)) for x in (rates, out))
        run = partial(library.run, ctypes.c_long(len(rates[0])), taken, given)

        def call() -> list[np.ndarray]:
            run()
            return out

        return call

    return prepared
