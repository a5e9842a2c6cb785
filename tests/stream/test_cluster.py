"""On a cluster of processes: results are those of one process to the last bit, and no worker that dies loses any."""

import faulthandler
import json
import os
import signal
import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier, Lock
from time import sleep
from types import SimpleNamespace
from unittest.mock import Mock

import cloudpickle
import dask
import dask.array as da
import dask.dataframe as dd
import numpy as np
import pandas as pd
import pytest
from distributed import Client, KilledWorker
from distributed.client import FuturesCancelledError
from test_stream import ROBOT, bytes_of, call, complaint, joined, stored, summary, swings

import jounce
import jounce.dask
from jounce.core.code_digest import UNKNOWN_CODE
from jounce.core.errors import collect_warnings, warn
from jounce.dask import pickle_object
from jounce.dynamics.computation import Computation
from jounce.io.motions import table_parts
from jounce.io.motions.table_parts import Reading, divide_tables
from jounce.native import kernel
from jounce.stream import cluster
from jounce.stream.cluster import start_local_cluster
from jounce.stream.jobs import ForceJob
from support.refusals import expect_refusal, refusal

LONGEST = 300  # s, after which the process of the tests ends instead of hanging
cloudpickle.register_pickle_by_value(sys.modules[__name__])


@pytest.fixture(autouse=True, scope="module")
def _limited():
    faulthandler.dump_traceback_later(LONGEST, exit=True)
    yield
    faulthandler.cancel_dump_traceback_later()


@pytest.fixture(scope="module")
def workers(tmp_path_factory):
    """A client of two workers, each a process: the cluster that a command starts on a machine of two cores."""
    folder = tmp_path_factory.mktemp("of_system")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("dask.system.CPU_COUNT", 2)
        patch.setattr("tempfile.tempdir", str(folder))
        with start_local_cluster(9) as found, Client(found, set_as_default=False) as client:
            yield client
    assert list(folder.iterdir()) == []


@pytest.fixture
def address(workers):
    return workers.scheduler.address


@pytest.fixture
def table_of_two(tmp_path, monkeypatch):
    """A table of two motions in many parts."""
    monkeypatch.setattr(table_parts, "MAX_PART_CELLS", 200)
    return stored(tmp_path / "states.csv", joined(swings(60), swings(40, 5), names=["a", "b"]))


def count_loads():
    """Count on a worker how often native code is loaded."""
    from jounce.native import jit, kernel

    def load(*given):
        jit.loads += 1
        return real(*given)

    real, jit.loads = jit.load_object, 0
    kernel.jit.load_object = load


def code_loader():
    from jounce.native import jit

    return jit.loads


def test_results_are_those_of_one_process(tmp_path, workers, address, table_of_two):
    """Rows, with bad ones among them, and limits; each worker loads a kernel once for all parts of a run."""
    lines = table_of_two.read_text().splitlines()
    table_of_two.write_text("\n".join([*lines[:20], lines[20].replace(",", ",x", 3), *lines[21:]]) + "\n")
    limits = tmp_path / "limits.yaml"
    limits.write_text("units: SI\njoints: {joint1: {velocity: 1.9}}")
    workers.run(count_loads)
    for name, *more in (("cluster", "--cluster", address), ("here",)):
        more += "--on-error", "skip"
        (tmp_path / name).mkdir()
        found = summary("run", "planar2r", table_of_two, "-o", tmp_path / name / "forces", *more)
        assert found["parts_computed"] == found["parts"] > 5
        assert set(workers.run(code_loader).values()) == {1}
    for name, *more in (("cluster", "--cluster", address), ("here",)):
        more += "--on-error", "skip"
        table_of = tmp_path / name / "limits.csv"
        assert call("check", "planar2r", table_of_two, "--limits", limits, "-o", table_of, *more).exit_code == 1
    for output in ("forces", "forces.skipped.csv", "limits.csv", "limits.csv.skipped.csv"):
        assert bytes_of(tmp_path / "cluster" / output) == bytes_of(tmp_path / "here" / output)


@pytest.mark.parametrize(("error", "message"), [
    (KilledWorker("part", SimpleNamespace(address="there"), 3), ":2: 4 workers died while they computed this part"),
    (FuturesCancelledError([]), "the connection to the cluster is lost"),
    (ConnectionResetError(), "the connection to the cluster is lost"),
])  # fmt: skip
def test_the_end_of_workers_and_of_clusters_is_told_in_one_line(tmp_path, table_of_two, error, message):
    """A part is given up that several workers do not survive."""
    job = ForceJob(ROBOT, Reading(), ".csv", 2)
    made = divide_tables(job, table_of_two)
    with expect_refusal(message, "finished parts are kept, and the same command continues after them$"):
        cluster._check_finished(job, made.parts[0], SimpleNamespace(result=Mock(side_effect=error)), tmp_path)


def test_a_run_that_is_stopped_keeps_its_finished_parts(tmp_path, address, table_of_two, monkeypatch):
    from jounce.stream import run

    real = run.run_tables

    def stopped(job, source, output, reduce, runner, show):
        def interrupt(*_):
            raise KeyboardInterrupt

        return real(job, source, output, reduce, runner, interrupt)

    with monkeypatch.context() as patch:
        patch.setattr(run, "run_tables", stopped)
        assert call("run", "planar2r", table_of_two, "-o", tmp_path / "out", "--cluster", address).exit_code == 130
    assert not (tmp_path / "out").exists()
    found = summary("run", "planar2r", table_of_two, "-o", tmp_path / "out", "--cluster", address)
    assert 0 < found["parts_computed"] < found["parts"]


def test_clusters_that_do_not_fit_are_refused_in_one_line(tmp_path, address, table_of_two, monkeypatch):
    run = "run", "planar2r", table_of_two, "-o", tmp_path / "out", "--cluster"
    with monkeypatch.context() as patch:
        patch.setattr(cluster, "__version__", "0.0.0")
        message = complaint(*run, address)
    assert f"has jounce {jounce.__version__} (code " in message
    assert "this process 0.0.0 (code " in message
    with monkeypatch.context() as patch:
        patch.setattr(cluster.code_digest, "code_digest", lambda *layers: None)
        assert complaint(*run, address).endswith(UNKNOWN_CODE)
    with monkeypatch.context() as patch:
        patch.setattr(cluster, "_identity", lambda path: (1, 2))
        message = complaint(*run, address)
    assert f"{table_of_two}: worker " in message
    assert message.endswith("another one; expected a file system that this process and all workers share")
    with monkeypatch.context() as patch:
        patch.setattr("jounce.stream.cluster.CONNECTION_TIMEOUT", 0.3)
        assert "cluster tcp://127.0.0.1:9: " in complaint(*run, "tcp://127.0.0.1:9")
    for wrong in ("there", "tcp://there", "no://there:1"):
        assert f"cluster {wrong!r}; expected local, or the address of a scheduler" in complaint(*run, wrong)
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "distributed.comm.addressing", None)
        assert "pip install 'jounce[cluster]'" in complaint(*run, "local")
    table_of_two.write_text(table_of_two.read_text().replace("0.31,", "x,"))
    assert complaint(*run, address) == complaint(*run[:-1])  # of a bad row


SPRING = jounce.SpringFunction.of(lambda x: 800 * x + 40 * x**3)
ARM = ROBOT.elastic(rotor=0.1, spring=SPRING)
X = np.random.default_rng(0).normal(size=(6, 30, 4, 2))
W = np.random.default_rng(1).normal(size=(30, 1, 2, 6))
C = np.eye(4), *np.random.default_rng(2).normal(size=(2, 30, 1, 6))
CALLS = {
    "rates": (ROBOT, "inverse_dynamics", X[:5], {}),
    "one rate": (ROBOT, "mass_matrix", X[:1], {}),
    "several results": (ROBOT, "forward_dynamics_partials", X[:3], {}),
    "a scalar": (ROBOT, "kinetic_energy", X[:2], {}),
    "a body": (ROBOT, "jacobian", X[:2], {"body": "body2", "frame": "world"}),
    "wrenches": (ROBOT, "inverse_dynamics", X[:4], {"wrench": (W, {"body1": W[..., 0, :]})}),
    "a base": (ROBOT, "inverse_dynamics", X[:3], {"base": C}),
    "names": (ROBOT, "gravity_forces", [{"joint2": X[0, ..., 1], "joint1": X[1, ..., 0]}], {}),
    "a method": (ROBOT, "inverse_dynamics", X[:3], {"method": "recursion"}),
    "elastic joints": (ARM, "motor_torques", X[:5], {}),
    "links and motors": (ARM, "elastic_forward_dynamics", X[:5], {}),
}


AFAR = ("rates", "elastic joints")  # in other processes


def lazy(given):
    """Arrays of Dask in place of those that have a batch, chunked in ways of their own, the last axes too."""
    if isinstance(given, dict):
        return {name: lazy(x) for name, x in given.items()}
    if isinstance(given, tuple | list):
        return type(given)(map(lazy, given))
    if not isinstance(given, np.ndarray) or given.ndim < 2 or len(given) != 30:
        return given
    return da.from_array(given, chunks=(7 if given.shape[-1] == 2 else 11, *(max(1, n // 2) for n in given.shape[1:])))


@pytest.mark.parametrize("name", CALLS)
def test_arrays_are_what_the_methods_compute(workers, monkeypatch, name):
    robot, quantity, rates, options = CALLS[name]
    plain = [tuple(x) if isinstance(x, tuple) else x for x in rates]
    expected = getattr(robot, quantity)(*plain, **options)
    with monkeypatch.context() as patch:
        patch.setattr("jounce.dask.compute", None)  # nothing is computed yet
        found = jounce.dask.apply(robot, quantity, *lazy(list(rates)), **lazy(options))
    assert isinstance(found, tuple) == isinstance(expected, tuple)
    both = [(x,) if not isinstance(x, tuple) else x for x in (found, expected)]
    computed = workers.gather(workers.compute(both[0])) if name in AFAR else dask.compute(*both[0], scheduler="sync")
    for x, y, z in zip(*both, computed, strict=True):
        assert (x.shape, x.dtype, x.npartitions > 1) == (y.shape, y.dtype, True)
        assert np.array_equal(z, y)
    again = jounce.dask.apply(robot, quantity, *lazy(list(rates)), **lazy(options))
    assert dask.base.tokenize(again) == dask.base.tokenize(found)


def test_data_frames_are_matched_by_joint_name():
    """The index stays, and lengths of partitions need not be known."""
    whole = [pd.DataFrame({"joint2": x[:, 1], "joint1": x[:, 0]}, index=3 * np.arange(30)) for x in X[:5, :, 0]]
    frames = [dd.from_pandas(frame, npartitions=4) for frame in whole]
    found = jounce.dask.apply(ROBOT, "inverse_dynamics", *frames)
    for x, y in zip(dask.compute(*found, scheduler="sync"), ROBOT.inverse_dynamics(*X[:5, :, 0]), strict=True):
        assert list(x.columns) == list(ROBOT.joint_names)
        assert np.array_equal(x.index, whole[0].index)
        assert np.array_equal(x.to_numpy(), y)
    named = {joint: frames[0][joint] for joint in reversed(ROBOT.joint_names)}
    for given in (named, whole[0]):  # columns of Dask, a data frame in memory
        forces = jounce.dask.apply(ROBOT, "gravity_forces", given)
        assert np.array_equal(forces.compute(scheduler="sync"), ROBOT.gravity_forces(X[0, :, 0]))
    energy = jounce.dask.apply(ROBOT, "kinetic_energy", *frames[:2])
    assert np.array_equal(energy.compute(scheduler="sync"), ROBOT.kinetic_energy(*X[:2, :, 0]))


def test_wrong_arguments_are_refused_before_anything_is_computed(monkeypatch):
    monkeypatch.setattr("jounce.dask.compute", None)
    q = da.zeros((10, 2), chunks=(5, 2))
    frame = dd.from_pandas(pd.DataFrame({"joint1": [0.0], "join2": [0.0]}), npartitions=1)
    for message, *given in (
        ("unknown quantity 'weight'", "weight", q),
        ("inverse_dynamics of 'planar2r' takes q, qd, q2d, and further rates; got 2 of them", "inverse_dynamics", q, q),
        ("q has shape (1, 3); expected (..., 2)", "mass_matrix", da.zeros((10, 3))),
        ("q holds complex numbers", "mass_matrix", q * 1j),
        ("batch axes of shapes (10,), (4,) do not broadcast", "kinetic_energy", q, q[:4]),
        ("data frame: missing 'joint2'; unknown 'join2'", "mass_matrix", frame),
    ):
        with expect_refusal(f"^{message}"):
            jounce.dask.apply(ROBOT, *given)
    refusal(lambda: jounce.dask.apply("planar2r", "mass_matrix", q), "expects a jounce.Robot, got str")
    monkeypatch.setitem(sys.modules, "dask.array", None)
    refusal(lambda: jounce.dask.apply(ROBOT, "mass_matrix", np.zeros(2)), "pip install 'jounce[cluster]'")


def test_warnings_of_threads_do_not_mix():
    """Parts that a worker computes side by side record their own."""
    both = Barrier(2)

    def part(name):
        with collect_warnings() as found:
            both.wait(10)
            warn(name)
            both.wait(10)
        return found

    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(part, ["one", "two"])) == [["one"], ["two"]]
    with pytest.warns(jounce.JounceWarning, match="three"):
        warn("three")


def test_threads_share_the_kernel_that_both_ask_for(monkeypatch):
    made = []

    class Slow(kernel.Kernel):
        def __init__(self, *given):
            made.append(given)
            sleep(0.05)

    monkeypatch.setattr(kernel, "Kernel", Slow)
    asked = ROBOT.mechanism, Computation("center_of_mass", 3)
    with ThreadPoolExecutor(2) as pool:
        one, two = pool.map(lambda _: kernel.compile_kernel(*asked), range(2))
    assert one is two
    assert len(made) == 1


def test_what_tasks_share_is_sent_with_its_closures_and_kept(workers):
    factor = np.arange(3)

    def scaled(x):
        return x * factor

    kept = pickle_object(scaled)
    assert workers.submit(lambda kept: kept.value(2).tolist(), kept).result() == [0, 2, 4]
    assert kept.value is pickle_object(scaled).value
    refusal(lambda: pickle_object(Lock()), "^lock cannot be sent to other processes: cannot pickle")


def die_after(count, told):
    """Let a worker die in the middle of a part, when it has computed some; it tells what was finished before."""
    from jounce.stream import cluster

    def compute(job, layout, part, folder):
        nonlocal count
        count -= 1
        if count < 0:
            finished = {path.name: path.stat().st_ino for path in (folder / "rows").glob("part-*.parquet")}
            told.write_text(json.dumps(finished))
            (folder / "rows" / f".jounce-00000000-1-{'0' * 12}.part").write_text("half a table")
            os.kill(os.getpid(), signal.SIGKILL)
        return real(job, layout, part, folder)

    real, cluster.compute_part = cluster.compute_part, compute


def test_a_worker_that_dies_costs_its_part_alone(tmp_path, workers, address, table_of_two):
    [first, _] = workers.nthreads()
    workers.run(die_after, 1, tmp_path / "told.json", workers=[first])
    summary("run", "planar2r", table_of_two, "-o", tmp_path / "out", "--cluster", address)
    finished = json.loads((tmp_path / "told.json").read_text())
    assert finished
    assert {name: (tmp_path / "out" / name).stat().st_ino for name in finished} == finished  # none computed twice
    summary("run", "planar2r", table_of_two, "-o", tmp_path / "whole")
    assert bytes_of(tmp_path / "out") == bytes_of(tmp_path / "whole")
