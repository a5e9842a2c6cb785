"""From the start of an interpreter to its first result, beside what it takes to import NumPy and llvmlite alone."""

import os
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from uuid import uuid4

from benchmarks.measure import Case

FIRST = """
import jounce, numpy as np
jounce.load("iiwa14").inverse_dynamics(*np.ones((5, 7)))
"""
RUNS = {
    "the interpreter alone": "",
    "import numpy": "import numpy",
    "import numpy, llvmlite.binding": "import numpy, llvmlite.binding",
    "import jounce": "from jounce import Robot, load",  # which imports what they need
    "first Q, Qd, Q2d, kernel in the cache": FIRST,
    "first Q, Qd, Q2d, cache empty": FIRST,
}


def cases(folder: Path) -> Iterator[Case]:
    """Keyed ("start", what); caches are made in a folder."""
    for name, text in RUNS.items():
        fresh = name.endswith("empty")
        call = partial(_run, text + "\nimport os; os._exit(0)", folder, fresh)  # leaving is not measured
        call()  # bytecode, and the kernel in the cache
        yield Case(("start", name), call, warm=False)


def _run(text: str, folder: Path, fresh: bool) -> None:
    kernels = folder / (uuid4().hex if fresh else "kernels")
    subprocess.run([sys.executable, "-c", text], check=True, env=os.environ | {"JOUNCE_CACHE_DIR": str(kernels)})
