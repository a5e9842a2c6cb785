"""C made into calls: sources compiled by gcc, run over states that lie in arrays of rates."""

import ctypes
import subprocess
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory

from benchmarks.peers import Arrays, Call, MissingError, Prepared

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


def loop(statements: Sequence[str]) -> str:
    """``run(states, in, out)``: the statements for one state i after the other."""
    head = "#include <math.h>\nvoid run(long states, const double *const *in, double *const *out) {"
    body = "\n    ".join(statements)
    return f"{head}\n  for (long i = 0; i < states; i++) {{\n    {body}\n  }}\n}}\n"


def over_states(library: ctypes.CDLL) -> Prepared:
    """Calls of ``void run(long states, const double **in, double **out)`` on arrays of rates."""
    library.run.restype = None

    def prepared(rates: Arrays, out: Arrays) -> Call:
        taken, given = ((ctypes.c_void_p * len(x))(*(a.ctypes.data for a in x)) for x in (rates, out))
        call = partial(library.run, ctypes.c_long(len(rates[0])), taken, given)
        vars(call)["alive"] = rates, out
        return call

    return prepared
