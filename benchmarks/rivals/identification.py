"""Identification beside other libraries: logs of one arm whose parameters are known.

The bundled UR5 is the model. Bodies and frictions of the arm that is measured are drawn off it; it moves for ten
seconds along a motion of `Robot.excite`, and other noise disturbs each log. `identifiers` and `simulation_fits` call
those who identify it. The truth judges what they find, none of them sees it:

* Forces along another motion, of which all get q, qd and q2d: root mean square of the errors over the deviation of the
  noise of each force, where the joint is faster than `AT_REST`, as the friction of no model is right near rest.
* Base parameters, damping and friction: squared error over the stated covariance and the number of parameters, 1 on
  average where deviations are right, and the share of errors beyond two stated deviations, 0.046 where they are right.

Each identification is a process of its own, on one thread of its matrix library. One that fails, takes too long,
returns what is not finite, or predicts forces worse than the model it began with, has a note in place of figures.
Times are those of the processor, the least of some calls; short ones are made in turn.
"""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

import numpy as np
from scipy.signal import lfilter

import jounce
from benchmarks.identification import drawn
from benchmarks.rivals.identifiers import Estimate, Identify, Log, by_jounce, by_mujoco_sysid, by_pinocchio
from benchmarks.rivals.robots import write_urdf
from benchmarks.rivals.simulation_fits import by_simulation

RATE, DURATION = 500, 10.0  # Hz, s
TERMS = ("damping", "friction")
FAR = 0.2  # of the triangular factors of the pseudo-inertias, by which bodies are off
NOISE = 0.02  # of the standard deviation of each force
CORRELATED = 0.1  # s, of the slow noise
POSITIONS = 1e-4  # rad
AT_REST = 0.02  # rad/s
LIMIT = 90.0  # s of a process
ROUNDS = 2
SHORT = 5.0  # s: those that take longer are called once
LONGEST_NOTE = 120  # characters
# Threads of matrix libraries that wait for each other count as time of the processor.
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")

Row = dict[str, Any]

DOES_MORE = {
    "Pinocchio's regressor": "It is in C++ too, for floating bases and with regressors of energy; filter, solution and "
    "deviations are its user's.",
    "mujoco.sysid": "It identifies whatever a MuJoCo model has, contacts, actuators, and delays, gains and offsets of "
    "sensors included, from logs without torques too, and writes a report in HTML.",
    "mujoco_sysid": "Its regressors are there under JAX too, on GPUs, and its parametrizations keep bodies physical.",
}


@dataclass(frozen=True)
class Identifier:
    """Who identifies: the name in rows, and the function that does."""

    name: str
    identify: Identify
    limit: float = LIMIT


@dataclass(frozen=True)
class Truth:
    """The parameters of a log and forces along the other motion, those of the model, and the noise of each force."""

    values: np.ndarray
    forces: np.ndarray
    model: np.ndarray
    deviations: np.ndarray
    judged: np.ndarray  # where forces are compared


IDENTIFIERS = (
    Identifier("jounce", by_jounce),
    Identifier("Pinocchio's regressor, filter and least squares in NumPy", by_pinocchio),
    Identifier("mujoco_sysid's regressor, filter and least squares in NumPy", by_mujoco_sysid),
    Identifier("mujoco.sysid, 48 of 72 parameters, pieces of 0.5 s at 250 Hz, 20 steps", by_simulation),
)


def measured(report: Callable[[str], None]) -> list[Row]:
    """Return a row for each log and each that identifies: errors and time, or a note."""
    with TemporaryDirectory() as place:
        found = []
        for log, truth in logs(Path(place)):
            found += measured_log(log, truth, IDENTIFIERS, report)
        return found


def logs(place: Path) -> Iterator[tuple[Log, Truth]]:
    """Yield logs of the arm, with the truth."""
    model = jounce.load("ur5")
    arm = write_urdf(model, place / "ur5.urdf", model.body_names[-1])
    motion = model.excite(period=DURATION, drives=TERMS, starts=1).motion
    t = np.arange(0, DURATION, 1 / RATE)
    x, other = motion(t, 2), other_motion(model)(np.linspace(0, 7, 700), 2)
    true = drawn(model, FAR, np.random.default_rng(0)).robot
    forces = coulomb_forces(true, x)
    deviations = NOISE * forces.std(axis=0)
    judged = np.abs(other[1]) > AT_REST
    values = np.concatenate(
        [model.base_parameters().matrix @ true.inertial_parameters, true.drives.damping, true.drives.friction]
    )
    truth = Truth(values, coulomb_forces(true, other), model.inverse_dynamics(*other), deviations, judged)
    base = model.base_parameters().matrix
    excited = (model.regressor(*(array[::25] for array in x)) / deviations[:, None]).reshape(-1, base.shape[1])
    kinds = {
        f"white noise of {NOISE:.0%} on torques, {POSITIONS:g} rad on positions": (0.0, POSITIONS),
        f"noise of {NOISE:.0%} on torques correlated over {CORRELATED:g} s, {POSITIONS:g} rad on positions": (
            CORRELATED, POSITIONS,
        ),
    }  # fmt: skip
    for seed, (title, (correlated, of_positions)) in enumerate(kinds.items()):
        rng = np.random.default_rng(seed)
        Q = forces + deviations * noise(rng, len(t), model.n, correlated)
        q = x[0] + of_positions * rng.normal(size=x[0].shape)
        yield Log(title, arm, t, q, Q, other, base, excited), truth


def other_motion(model: jounce.Robot) -> jounce.Motion:
    """Return a Fourier series of 7 s, whose harmonics are equally fast."""
    cosines, sines = np.random.default_rng(1).uniform(-0.4, 0.4, (2, 5, model.n)) / np.arange(1, 6)[:, None]
    return jounce.Motion.fourier(np.array([0.0, -1.0, 1.0, 0.3, 0.5, 0.0]), cosines, sines, 2 * np.pi / 7, 7.0)


def coulomb_forces(true: jounce.Robot, x: Sequence[np.ndarray]) -> np.ndarray:
    """Return forces with friction that turns over where the velocity does, as textbooks have it."""
    rigid = jounce.Robot(replace(true.mechanism, acting=()))
    return rigid.inverse_dynamics(*x) + true.drives.damping * x[1] + true.drives.friction * np.sign(x[1])


def noise(rng: np.random.Generator, count: int, n: int, correlated: float) -> np.ndarray:
    """Return noise (count, n) of unit variance, white or correlated over so many seconds."""
    if not correlated:
        return rng.normal(size=(count, n))
    before = round(20 * correlated * RATE)  # samples after which the filter has forgotten that it began at 0
    keeps = np.exp(-1 / (correlated * RATE))
    filtered = lfilter([np.sqrt(1 - keeps**2)], [1, -keeps], rng.normal(size=(before + count, n)), axis=0)
    return filtered[before:]


def measured_log(log: Log, truth: Truth, identifiers: Sequence[Identifier], report: Callable[[str], None]) -> list[Row]:
    """Return the rows of a log."""
    rows = []
    for identifier in identifiers:
        report(f"{log.title}: {identifier.name}")
        estimate, seconds, note = identified(identifier, log)
        figures = judged(estimate, truth) if estimate is not None else without_figures(note)
        rows.append({"log": log.title, "rival": identifier.name, **figures, "seconds": seconds})
        if figures["note"]:
            rows[-1]["seconds"] = None
    for _ in range(1, ROUNDS):
        for row, identifier in zip(rows, identifiers, strict=True):
            if row["seconds"] is not None and row["seconds"] < SHORT:
                _, seconds, _ = identified(identifier, log)
                row["seconds"] = min(row["seconds"], seconds or np.inf)
    return rows


def judged(estimate: Estimate, truth: Truth) -> Row:
    """Return errors of an estimate, or why there are none."""
    shapes = (estimate.values.shape, estimate.forces.shape)
    if shapes != (truth.values.shape, truth.forces.shape):
        return without_figures(f"it returns shapes {shapes}")
    if not (np.isfinite(estimate.values).all() and np.isfinite(estimate.forces).all()):
        return without_figures("what it returns is not finite")
    force_error, of_model = (
        float(np.sqrt(np.mean(((forces - truth.forces) / truth.deviations)[truth.judged] ** 2)))
        for forces in (estimate.forces, truth.model)
    )
    if force_error > of_model:
        return without_figures(
            f"worse than the model: forces off by {force_error:.3g} deviations, {of_model:.3g} of it"
        )
    chi2, beyond_two = of_deviations(estimate.values - truth.values, estimate.covariance)
    return {"force_error": force_error, "chi2": chi2, "beyond_two": beyond_two, "note": ""}


def of_deviations(errors: np.ndarray, covariance: np.ndarray | None) -> tuple[float | None, float | None]:
    """Return squared errors over a covariance and their number, and the share beyond two deviations.

    None where no covariance is stated, or one that no errors have: infinite, or with a negative variance.
    """
    if covariance is None or not np.isfinite(covariance).all():
        return None, None
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0))
    if not deviations.all():
        return None, None
    # Over the deviations first: parameters are of units whose squares differ by many orders of magnitude.
    variances, axes = np.linalg.eigh(covariance / np.outer(deviations, deviations))
    if variances[0] <= 0:
        return None, None
    along = axes.T @ (errors / deviations)
    beyond = np.abs(errors) > 2 * deviations
    return float(np.mean(along**2 / variances)), float(np.mean(beyond))


def without_figures(note: str) -> Row:
    """Return the figures of a row that has a note in their place."""
    return {"force_error": None, "chi2": None, "beyond_two": None, "note": note[:LONGEST_NOTE]}


def identified(identifier: Identifier, log: Log) -> tuple[Estimate | None, float | None, str]:
    """Return the estimate of a process, its seconds, and why there is none."""
    context = multiprocessing.get_context("spawn")
    connection, theirs = context.Pipe()
    process = context.Process(target=serve, args=(identifier.identify, log, theirs), daemon=True)
    with _one_thread():
        process.start()
    theirs.close()
    try:
        if not connection.poll(identifier.limit):
            return None, None, f"stopped after {identifier.limit:g} s"
        return connection.recv()
    except EOFError:
        return None, None, "its process ended"
    finally:
        connection.close()
        process.kill()
        process.join()


def serve(identify: Identify, log: Log, connection: Connection) -> None:
    """Send the estimate and the time that it takes, of short ones the least of two."""
    try:
        estimate, seconds = timed(identify, log)
        if seconds < SHORT:
            # The first call loads and compiles what the second one finds.
            seconds = min(seconds, timed(identify, log)[1])
    except Exception as error:
        connection.send((None, None, said(error)))
        return
    connection.send((estimate, seconds, ""))


def timed(identify: Identify, log: Log) -> tuple[Estimate, float]:
    """Return an estimate and the seconds of the processor."""
    start = process_time()
    estimate = identify(log)
    return estimate, process_time() - start


def said(error: Exception) -> str:
    """Return the kind of an error and the first line of its text."""
    if isinstance(error, ImportError):
        return f"not installed: {error}"
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__


@contextmanager
def _one_thread() -> Iterator[None]:
    """Have processes that start within use one thread for matrices."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
