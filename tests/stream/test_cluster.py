"""On a cluster of processes: results are those of one process to the last bit, and no worker that dies loses any."""

import faulthandler
import json
import os
import signal
import sys
from threading import Lock

import cloudpickle
import dask
import dask.array as da
import dask.dataframe as dd
import numpy as np
import pandas as pd
import pytest
from distributed import Client, LocalCluster
from test_stream import ROBOT, bytes_of, call, joined, refusal, summary, table, write

import jounce
import jounce.dask
from jounce.dask.kept import keep
from jounce.stream import cluster, plan, publish

LONGEST = 120  # s, after which the process of the tests ends instead of hanging
cloudpickle.register_pickle_by_value(sys.modules[__name__])


@pytest.fixture(autouse=True, scope="module")
def _limited():
    faulthandler.dump_traceback_later(LONGEST, exit=True)
    yield
    faulthandler.cancel_dump_traceback_later()


@pytest.fixture(scope="module")
def workers(tmp_path_factory):
    """A client of two workers, each a process."""
    folder = str(tmp_path_factory.mktemp("dask"))
    with (
        LocalCluster(
            n_workers=2, threads_per_worker=1, memory_limit=0, silence_logs=60, local_directory=folder,
            host="127.0.0.1", dashboard_address=":0", scheduler_kwargs={"dashboard": False},
        ) as found,
        Client(found, set_as_default=False) as client,
    ):  # fmt: skip
        yield client


@pytest.fixture
def address(workers):
    workers.wait_for_workers(2, timeout=60)
    return workers.scheduler.address


@pytest.fixture
def states(tmp_path, monkeypatch):
    """A table of two motions in many parts."""
    monkeypatch.setattr(plan, "CELLS", 200)
    return write(tmp_path / "states.csv", joined(table(60), table(40, 5), names=["a", "b"]))


def count_loads():
    """Count on a worker how often native code is loaded."""
    from jounce.native import jit, kernel

    def load(*given):
        jit.loads += 1
        return real(*given)

    real, jit.loads = jit.load_object, 0
    kernel.jit.load_object = load


def loads():
    from jounce.native import jit

    return jit.loads


def test_results_are_those_of_one_process(tmp_path, workers, address, states):
    """Rows, bad ones among them, aggregates, and limits; each worker loads a kernel once for all of its parts."""
    workers.run(count_loads)
    lines = states.read_text().splitlines()
    states.write_text("\n".join([*lines[:20], lines[20].replace(",", ",x", 3), *lines[21:]]) + "\n")
    for name, *more in (("cluster", "--cluster", address), ("here",)):
        folder = tmp_path / name
        folder.mkdir()
        for output in ("forces", "forces.csv"):
            found = summary("run", "planar2r", states, "-o", folder / output, "--on-error", "skip", *more)
            assert found["parts_computed"] == found["parts"] > 5
        assert name == "here" or max(workers.run(loads).values()) == 1
        summary(
            "run", "planar2r", states, "-o", folder / "peaks.csv", "--reduce", "peak,rms", "--on-error", "skip", *more
        )
        call("check", "planar2r", states, "--table", folder / "limits.csv", "--on-error", "skip", *more)
    for output in ("forces", "forces.csv", "forces.csv.skipped.csv", "peaks.csv"):
        assert bytes_of(tmp_path / "cluster" / output) == bytes_of(tmp_path / "here" / output)


def die_after(count, told):
    """Let a worker die in the middle of a part, when it has computed some; it tells what was finished before."""
    from jounce.stream import cluster

    def compute(task, part, folder):
        nonlocal count
        count -= 1
        if count < 0:
            finished = {path.name: path.stat().st_ino for path in (folder / "rows").glob("part-*.parquet")}
            told.write_text(json.dumps(finished))
            os.kill(os.getpid(), signal.SIGKILL)
        return real(task, part, folder)

    real, cluster.compute = cluster.compute, compute


def test_a_worker_that_dies_costs_its_part_alone(tmp_path, workers, address, states):
    [first, _] = workers.nthreads()
    workers.run(die_after, 2, tmp_path / "told.json", workers=[first])
    summary("run", "planar2r", states, "-o", tmp_path / "out", "--cluster", address)
    finished = json.loads((tmp_path / "told.json").read_text())
    assert len(finished) >= 2
    assert {name: (tmp_path / "out" / name).stat().st_ino for name in finished} == finished  # none computed twice
    summary("run", "planar2r", states, "-o", tmp_path / "whole")
    assert bytes_of(tmp_path / "out") == bytes_of(tmp_path / "whole")


def test_a_part_that_kills_workers_is_given_up(tmp_path, workers, address, states):
    def allow(count, dask_scheduler):
        dask_scheduler.allowed_failures = count

    workers.run_on_scheduler(allow, 0)
    workers.run(die_after, 1, tmp_path / "told.json", workers=list(workers.nthreads())[:1])
    message = refusal("run", "planar2r", states, "-o", tmp_path / "out", "--cluster", address)
    workers.run_on_scheduler(allow, 3)
    assert "1 workers died while they computed this part" in message
    assert message.endswith("finished parts are kept, and the same command continues after them")
    done = len(list(publish.work_folder(tmp_path / "out").glob("part-*.json")))
    found = summary("run", "planar2r", states, "-o", tmp_path / "out")
    assert found["parts"] - found["parts_computed"] == done > 0


def test_a_run_that_is_stopped_keeps_its_finished_parts(tmp_path, address, states, monkeypatch):
    from jounce.stream import results

    real = results.run

    def stopped(plan, work, runner, show):
        def interrupt(*_):
            raise KeyboardInterrupt

        return real(plan, work, runner, interrupt)

    with monkeypatch.context() as patch:
        patch.setattr(results, "run", stopped)
        assert call("run", "planar2r", states, "-o", tmp_path / "out", "--cluster", address).exit_code == 130
    assert not (tmp_path / "out").exists()
    found = summary("run", "planar2r", states, "-o", tmp_path / "out", "--cluster", address)
    assert 0 < found["parts_computed"] < found["parts"]


def test_a_cluster_of_this_machine_lives_as_long_as_the_run(tmp_path, monkeypatch):
    path = write(tmp_path / "states.csv", table(40))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr("tempfile.tempdir", None)
    summary("run", "planar2r", path, "-o", tmp_path / "out.csv", "--cluster", "local")
    summary("run", "planar2r", path, "-o", tmp_path / "here.csv")
    assert bytes_of(tmp_path / "out.csv") == bytes_of(tmp_path / "here.csv")
    assert list((tmp_path / "tmp").iterdir()) == []


def test_clusters_that_do_not_fit_are_refused_in_one_line(tmp_path, address, states, monkeypatch):
    run = "run", "planar2r", states, "-o", tmp_path / "out", "--cluster"
    with monkeypatch.context() as patch:
        patch.setattr(cluster, "__version__", "0.0.0")
        message = refusal(*run, address)
    assert f"has jounce {jounce.__version__} (sources " in message
    assert "this process 0.0.0 (sources " in message
    with monkeypatch.context() as patch:
        patch.setattr(cluster, "_identity", lambda path: (1, 2))
        message = refusal(*run, address)
    assert f"{states}: worker " in message
    assert message.endswith("another one; expected a file system that this process and all workers share")
    with monkeypatch.context() as patch:
        patch.setattr(cluster, "TIMEOUT", 0.3)
        assert "cluster tcp://127.0.0.1:9: " in refusal(*run, "tcp://127.0.0.1:9")
    for wrong in ("there", "tcp://there", "no://there:1"):
        assert f"cluster {wrong!r}; expected local, or the address of a scheduler" in refusal(*run, wrong)
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "distributed.comm.addressing", None)
        assert "pip install 'jounce[cluster]'" in refusal(*run, "local")
    states.write_text(states.read_text().replace("0.31,", "x,"))
    assert refusal(*run, address) == refusal(*run[:-1])  # of a bad row


SPRING = jounce.SpringFunction.of(lambda x: 800 * x + 40 * x**3)
ARM = ROBOT.elastic(rotor=0.1, spring=SPRING)
X = np.random.default_rng(0).normal(size=(6, 30, 4, 2))
W = np.random.default_rng(1).normal(size=(30, 1, 2, 6))
C = np.eye(4), *np.random.default_rng(2).normal(size=(3, 30, 1, 6))
CALLS = {
    "rates": (ROBOT, "inverse_dynamics", X[:5], {}),
    "one rate": (ROBOT, "mass_matrix", X[:1], {}),
    "several results": (ROBOT, "forward_dynamics_partials", X[:3], {}),
    "a scalar": (ROBOT, "kinetic_energy", X[:2], {}),
    "a body": (ROBOT, "jacobian", X[:2], {"body": "body2", "frame": "world"}),
    "wrenches": (ROBOT, "inverse_dynamics", X[:4], {"wrench": (W, {"body1": W[..., 0, :]})}),
    "a base": (ROBOT, "inverse_dynamics", X[:4], {"base": C}),
    "names": (ROBOT, "gravity_forces", [{"joint2": X[0, ..., 1], "joint1": X[1, ..., 0]}], {}),
    "a method": (ROBOT, "inverse_dynamics", X[:3], {"method": "recursion"}),
    "elastic joints": (ARM, "motor_torques", X[:5], {}),
}


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
    method = getattr(robot, quantity if quantity != "motor_torques" else "inverse_dynamics")
    expected = method(*plain, **options)
    with monkeypatch.context() as patch:
        patch.setattr("jounce.dask.arrays.compute", None)  # nothing is computed yet
        found = jounce.dask.apply(robot, quantity, *lazy(list(rates)), **lazy(options))
    assert isinstance(found, tuple) == isinstance(expected, tuple)
    both = [(x,) if not isinstance(x, tuple) else x for x in (found, expected)]
    computed = workers.gather(workers.compute(list(both[0])))
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
    energy = jounce.dask.apply(ROBOT, "kinetic_energy", *frames[:2])
    assert np.array_equal(energy.compute(scheduler="sync"), ROBOT.kinetic_energy(*X[:2, :, 0]))


def test_wrong_arguments_are_refused_before_anything_is_computed(monkeypatch):
    monkeypatch.setattr("jounce.dask.arrays.compute", None)
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
        with pytest.raises(jounce.JounceError) as caught:
            jounce.dask.apply(ROBOT, *given)
        assert str(caught.value).startswith(message)
    with pytest.raises(jounce.JounceError, match=r"expects a jounce\.Robot, got str"):
        jounce.dask.apply("planar2r", "mass_matrix", q)
    monkeypatch.setitem(sys.modules, "dask.array", None)
    with pytest.raises(jounce.JounceError, match=r"pip install 'jounce\[cluster\]'"):
        jounce.dask.apply(ROBOT, "mass_matrix", np.zeros(2))


def test_what_tasks_share_is_sent_with_its_closures_and_kept(workers):
    factor = np.arange(3)

    def scaled(x):
        return x * factor

    kept = keep(scaled)
    assert workers.submit(lambda kept: kept.value(2).tolist(), kept).result() == [0, 2, 4]
    assert kept.value is keep(scaled).value
    with pytest.raises(jounce.JounceError, match=r"^lock cannot be sent to other processes: cannot pickle"):
        keep(Lock())
