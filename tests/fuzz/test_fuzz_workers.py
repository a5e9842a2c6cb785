"""Workers of a cluster that are killed at any moment: results are those of one process, and nothing is left over."""

import multiprocessing
import os
import signal
from contextlib import suppress
from threading import Event, Thread
from time import sleep

import numpy as np
from hypothesis import strategies as st

import jounce
from fuzz.contract import kept, workshop
from jounce.io import tables
from jounce.io.motions import table_parts
from jounce.spatial.series import rate_name
from jounce.stream import finished_parts
from support.commands import call

ROBOT = jounce.load("planar2r")
LIMITS = "units: SI\njoints: {joint1: {velocity: 1.9, effort: 60}, joint2: {effort_rate: 300}}"
COMMANDS = {
    "rows": ("run", "-o", "rows.csv"),
    "folder": ("run", "-o", "rows"),
    "aggregates": ("run", "--reduce", "peak,rms", "-o", "peaks.csv"),
    "limits": ("check", "--limits", "limits.yaml", "-o", "limits.csv"),
}
TIMES = 20  # that a command is given again at most
PATIENCE = 2.0  # s without any worker, after which a run ends


def written_states(rng, path):
    """A table of some motions."""
    parts = []
    for name in range(rng.integers(1, 4)):
        t = np.arange(rng.integers(100, 400)) / 100 + rng.uniform(0, 5)
        columns = {"motion": np.repeat(str(name), len(t)), "t": t}
        for j, joint in enumerate(ROBOT.joint_names):
            for k in range(5):
                columns[f"{joint}.{rate_name('q', k)}"] = (2 + j) ** k * np.cos((2 + j) * t + j + k * np.pi / 2)
        parts.append(columns)
    whole = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    tables.TABLE_WRITERS[path.suffix].write(path, [whole], None)


def killing(rng, folder):
    """A thread that kills one worker or all, when some parts are finished or the workers are there for a while."""
    over, kills = Event(), int(rng.integers(1, 4))

    def workers():
        return [child for child in multiprocessing.active_children() if "Nanny" in child.name]

    def wait(ready):
        while not ready() and not over.is_set():
            sleep(0.002)

    def kill():
        for _ in range(kills):
            wait(workers)
            if rng.random() < 0.7:
                least = rng.integers(20)
                wait(lambda least=least: len(list(folder.glob("*.unfinished/part-*"))) >= least)
            else:
                over.wait(rng.uniform(0, 3))
            for child in workers()[: int(rng.choice([1, 1, 2]))]:
                with suppress(ProcessLookupError):
                    os.kill(child.pid, signal.SIGKILL)

    return Thread(target=kill), over


def called(folder, name, source, *more):
    """The exit code of a command, which is given again where it says that it lost its workers."""
    command, *words = COMMANDS[name]
    words = [word if word.startswith("-") or "," in word else folder / word for word in words]
    for _ in range(TIMES):
        result = call(command, "planar2r", source, *words, *more)
        if result.exit_code != 2:
            return result.exit_code
        [line] = result.stderr.splitlines()
        assert line.endswith(finished_parts.CONTINUATION) or line.startswith("Error: cluster local: "), line
    raise AssertionError(line)


def files_left(folder):
    """All that a command leaves behind."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_kills(budget, monkeypatch):
    """One line may end a command that lost its workers; given again it goes on, and nothing is left over."""
    monkeypatch.setattr("jounce.stream.cluster.IDLE_TIMEOUT", PATIENCE)
    monkeypatch.setattr("dask.system.CPU_COUNT", 2)

    def check(seed, name, cells):
        rng = np.random.default_rng(seed)
        with workshop("workers") as folder:
            source, here, there = (folder / at for at in ("states.csv", "here", "there"))
            written_states(rng, source)
            monkeypatch.setattr(table_parts, "MAX_PART_CELLS", cells)
            for place in (here, there):
                place.mkdir()
                (place / "limits.yaml").write_text(LIMITS)
            with kept("workers", source):
                code = called(here, name, source)
                thread, over = killing(rng, there)
                thread.start()
                try:
                    assert called(there, name, source, "--cluster", "local") == code
                finally:
                    over.set()
                    thread.join()
                assert files_left(there) == files_left(here)

    names = st.sampled_from(sorted(COMMANDS))
    budget.attack(check, 1, seed=st.integers(0, 2**32 - 1), name=names, cells=st.integers(20, 200))
