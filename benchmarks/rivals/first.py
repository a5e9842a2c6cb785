"""From the start of the interpreter to the first Q, and the memory of that process; caches are empty.

``python -m benchmarks.rivals.first NAME ARM`` is one such process: it imports the library, loads the file, and computes
Q of one state once. The parent reads its clock around it, and the largest memory that the system counted for it.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

from benchmarks.rivals import BOUND, JOUNCE, RIVALS, Rival
from benchmarks.rivals.arms import Arm, states

TASK = "forces"
REPEATED = 2  # times, of which the least counts
LONG = 8.0  # s: what takes longer is not repeated
LIMIT = 60.0  # s
CACHES = {"JOUNCE_CACHE_DIR": "jounce", "WARP_CACHE_PATH": "warp"}  # what keeps code on disk, and the folder it gets

Row = dict[str, Any]


def measured(arms: Sequence[Arm], rivals: Sequence[Rival], report: Callable[[str], None]) -> list[Row]:
    """Return a row for each robot and library: seconds and bytes, or a note."""
    rows = [
        {"robot": arm.name, "rival": rival.name, "kernels": "none"}
        for arm in arms
        for rival in rivals
        if rival.name != BOUND and rival.compiles(TASK, arm.n)
    ]
    # jounce keeps what it compiles: a second process of a user finds it there.
    rows += [{"robot": arm.name, "rival": JOUNCE, "kernels": "on disk"} for arm in arms]
    by_name = {arm.name: arm for arm in arms}
    with TemporaryDirectory() as kept:
        for _ in range(REPEATED):
            for row in rows:
                if "note" in row or row.get("seconds", 0) > LONG:
                    continue
                report(f"{row['robot']}: first result of {row['rival']}, kernels: {row['kernels']}")
                _measure(row, by_name[row["robot"]], Path(kept) if row["kernels"] == "on disk" else None)
    return rows


def _measure(row: Row, arm: Arm, kept: Path | None) -> None:
    """Start one process, and note its seconds and bytes where they are the least."""
    with TemporaryDirectory() as folder:
        caches = {name: str((kept or Path(folder)) / place) for name, place in CACHES.items()}
        command = [sys.executable, "-m", "benchmarks.rivals.first", row["rival"], json.dumps(asdict(arm))]
        environment = os.environ | dict(RIVALS[row["rival"]].settings) | caches
        begin = perf_counter()
        process = subprocess.Popen(
            command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        try:
            error = process.communicate(timeout=LIMIT)[1]
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            row["note"] = f"over {LIMIT:.0f} s"
            return
        seconds = perf_counter() - begin
    if process.returncode != 0:
        lines = error.strip().splitlines()
        row["note"] = lines[-1][:120] if lines else f"its process ended with {process.returncode}"
        return
    row["seconds"] = min(seconds, row.get("seconds", seconds))
    bytes_used = _bytes_used(error)
    row["bytes"] = min(bytes_used, row.get("bytes", bytes_used))


def _bytes_used(text: str) -> int:
    """Return what a process wrote last: its largest memory."""
    return int(text.strip().splitlines()[-1])


def compute_first(name: str, arm: Arm) -> None:
    """Compute Q of one state once, and write the largest memory of this process."""
    import importlib

    module = importlib.import_module(RIVALS[name].module)
    getattr(module.Library(arm), TASK)(states(arm.n, None)[:3]).results()
    print(largest_memory(), file=sys.stderr)


def largest_memory() -> int:
    """Return the largest memory of this process in bytes; `getrusage` counts that of the parent, which forked it."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    line = next(line for line in status.splitlines() if line.startswith("VmHWM:"))
    return int(line.split()[1]) * 1024


if __name__ == "__main__":
    given = json.loads(sys.argv[2])
    compute_first(
        sys.argv[1], Arm(given["name"], given["path"], tuple(given["joints"]), tuple(given["links"]), given["tip"])
    )
