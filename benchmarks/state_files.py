"""Parquet files of states of the iiwa, whose forces are computed; and checksums of the files that come of it."""

from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

import numpy as np

import jounce
from jounce.io.table_format import Columns
from jounce.io.tables import PARQUET
from jounce.spatial.series import rate_name

ROBOT = jounce.load("iiwa14")
OF_FILE = 1_000_000  # rows
BLOCK = 1 << 16  # rows that are computed at a time
ORDER = 2
SEED = 20210


def generate(folder: Path, rows: int) -> None:
    """Write files of smooth motions of all joints, with all rates."""
    folder.mkdir()
    for number, first in enumerate(range(0, rows, OF_FILE)):
        PARQUET.write(folder / f"motion{number:04d}.parquet", states(number, min(OF_FILE, rows - first)))


def states(seed: int, rows: int) -> Iterator[Columns]:
    """The columns of a motion, some rows at a time."""
    random = np.random.default_rng([SEED, seed])
    amplitude, frequency, phase = random.uniform((0.1, 0.5, 0.0), (0.5, 2.0, 6.0), (ROBOT.n, 3)).T
    for first in range(0, rows, BLOCK):
        t = np.arange(first, min(first + BLOCK, rows)) * 1e-3
        columns = {"t": t}
        for j, name in enumerate(ROBOT.joint_names):
            for k in range(ORDER + 3):
                wave = np.cos(frequency[j] * t + phase[j] + k * np.pi / 2)
                columns[f"{name}.{rate_name('q', k)}"] = amplitude[j] * frequency[j] ** k * wave
        yield columns


def sums(folder: Path) -> dict[str, str]:
    """The checksums of the tables in a folder."""
    return {path.name: sha256(path.read_bytes()).hexdigest() for path in sorted(folder.glob("*.parquet"))}
