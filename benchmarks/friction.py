"""``python -m benchmarks.friction``: `robot.identify` of simulated arms with friction of several laws.

Bodies and drives are drawn at random; positions are those of encoders and smoothed, torques have white noise. Errors
are those of the torques along a motion that was not fitted. Other torques act besides, which no term of the model is.
Writes FRICTION.md.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from unittest.mock import patch
from warnings import simplefilter

import click
import numpy as np

import jounce
from benchmarks import machine
from benchmarks.identification import Truth, drawn
from benchmarks.pendulum import double_pendulum
from benchmarks.tables import paragraph, table
from jounce.core.typing import DriveTerms
from jounce.identification import fits
from jounce.io import files
from jounce.model.drive_trains import DEFAULT_SMOOTHING_VELOCITY

SECONDS, RATE, BITS = 20.0, 500, 17
NOISE = 0.05  # N m
FAR = 0.1  # how far bodies are from the model's
MAX_POSITION = 2.0  # rad, from zero: joints that turn without end need a range too
LAWS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "own tanh": lambda v: np.tanh(v / DEFAULT_SMOOTHING_VELOCITY),
    "sharp tanh": lambda v: np.tanh(v / 0.01),
    "sign": np.sign,
    "Stribeck": lambda v: np.sign(v) * (1 + 0.6 * np.exp(-((v / 0.08) ** 2))),
}
ROBOTS: dict[str, Callable[[], jounce.Robot]] = {
    "Panda": lambda: jounce.load("panda", lock={"panda_finger_joint1": 0.0}),
    "UR5": lambda: jounce.load("ur5"),
    "double pendulum": double_pendulum,
}
WAYS = {  # of identification: what `identify` gets, and whether slow samples may count less
    "eps 0.05": ({"eps": DEFAULT_SMOOTHING_VELOCITY, "drives": ("damping", "friction", "offset")}, 0),
    "eps by data": ({"drives": ("damping", "friction", "offset")}, fits.WEIGHT_ROUNDS),
    "default": ({}, fits.WEIGHT_ROUNDS),
}


def series(robot: jounce.Robot, seed: int, frequency: float, seconds: float) -> jounce.Motion:
    """A random Fourier series of five harmonics within positions of all joints."""
    lower, upper = (x.clip(-MAX_POSITION, MAX_POSITION) for x in robot.limits.bounds("position"))
    terms = np.random.default_rng(seed).uniform(-1, 1, (2, 5, robot.n)) * (upper - lower) / 8
    return jounce.Motion.fourier((lower + upper) / 2, *terms, 2 * np.pi * frequency, seconds)


@dataclass(frozen=True)
class Acting:
    """Torques that act besides, and whether they are the robot's own, so that it has them along other motions too."""

    torques: Callable[[jounce.Robot, np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]  # t, q, qd, load
    own: bool = False
    drives: DriveTerms = ("damping", "friction", "stribeck", "offset")  # that are sought, without friction by the load


def hold(axis: int) -> Acting:
    """A force of 5 N on the last body, along an axis of the ground."""

    def torques(robot, t, q, qd, load):
        return -5 * robot.jacobian(q, body=robot.body_names[-1], frame="world")[:, 3 + axis]

    return Acting(torques)


def second_joint(robot: jounce.Robot) -> np.ndarray:
    """1 at the second joint."""
    return np.eye(robot.n)[1]


ACTS = {
    "nothing": Acting(lambda robot, t, q, qd, load: 0 * q),
    "friction of 0.05 of the load": Acting(
        lambda robot, t, q, qd, load: 0.05 * np.abs(load) * np.tanh(qd / 0.05), True
    ),
    "the same, with its term": Acting(
        lambda robot, t, q, qd, load: 0.05 * np.abs(load) * np.tanh(qd / 0.05),
        True,
        ("damping", "friction", "stribeck", "offset", "load_friction"),
    ),
    "5 N along x": hold(0),
    "5 N along z": hold(2),
    "0.5 N m/rad at joint 2": Acting(lambda robot, t, q, qd, load: 0.5 * q * second_joint(robot)),
    "10 N m at joint 2 for 0.5 s": Acting(
        lambda robot, t, q, qd, load: 10 * (abs(t - SECONDS / 2) < 0.25)[:, None] * second_joint(robot)
    ),
}


@dataclass(frozen=True)
class Trial:
    """A robot that was drawn, its log, and its torques at some times of another motion."""

    truth: Truth
    motion: jounce.Motion
    t: np.ndarray
    Q: np.ndarray
    other: jounce.Motion
    times: np.ndarray
    expected: np.ndarray

    def error(self, robot: jounce.Robot) -> float:
        """The root mean square of errors of the torques of a robot along the other motion."""
        off = robot.forces_along(self.other, self.times, order=0).forces[0] - self.expected
        return float(np.sqrt(np.mean(off**2)))


def simulate(robot: jounce.Robot, law: Callable[[np.ndarray], np.ndarray], seed: int, act: Acting) -> Trial:
    """Draw a robot and its log."""
    rng = np.random.default_rng(seed)
    truth = drawn(robot, FAR, rng)
    d, bodies = truth.robot.drives, truth.robot.with_drives(False)

    def forces(motion: jounce.Motion, t: np.ndarray, act: Acting) -> np.ndarray:
        (q, qd), load = motion(t, 1), bodies.forces_along(motion, t, order=0).forces[0]
        return load + d.damping * qd + d.friction * law(qd) + truth.offsets + act.torques(robot, t, q, qd, load)

    motion, other = series(robot, seed + 10, 0.1, SECONDS), series(robot, seed + 50, 0.13, SECONDS / 2)
    t, times = np.arange(0, SECONDS, 1 / RATE), np.linspace(0, SECONDS / 2, 1000)
    step = 2 * np.pi / 2**BITS
    q = np.floor(motion(t, 0)[0] / step + rng.uniform(size=robot.n)) * step
    Q = forces(motion, t, act) + NOISE * rng.normal(size=q.shape)
    smoothed, expected = (
        jounce.Motion.fit(t, q, allow_noise=True),
        forces(other, times, act if act.own else ACTS["nothing"]),
    )
    return Trial(truth, smoothed, t, Q, other, times, expected)


def measure_errors(
    robot: jounce.Robot, law: Callable[[np.ndarray], np.ndarray], seed: int
) -> list[tuple[float, float]]:
    """The error of the torques in N m, and seconds of the processor, of each way."""
    trial, found = simulate(robot, law, seed, ACTS["nothing"]), []
    for options, rounds in WAYS.values():
        start = process_time()
        with patch.object(fits, "WEIGHT_ROUNDS", rounds):
            arm = robot.identify(trial.motion, trial.Q, t=trial.t, **options).robot
        found.append((trial.error(arm), process_time() - start))
    return found


def measure_acting(robot: jounce.Robot, act: Acting, seed: int) -> tuple[float, float, float]:
    """Whether what acts is named, the errors of inertial parameters over their deviations, and that of torques."""
    trial = simulate(robot, LAWS["own tanh"], seed, act)
    found = robot.identify(trial.motion, trial.Q, t=trial.t, drives=act.drives)
    true = trial.truth.robot.base_parameters().values
    over = [(row.value - x) / row.deviation for row, x in zip(found.table, true, strict=False)]
    said = ("look like torques", "are unexplained", "does not explain")
    named = any(text in note for note in found.notes for text in said)
    return named, float(np.sqrt(np.mean(np.square(over)))), trial.error(found.robot)


@click.command()
@click.option("--seeds", default=5, show_default=True, help="Number of robots drawn for each row.")
def main(seeds: int) -> None:
    """Identify, and write FRICTION.md."""
    rows, acting = [], []
    simplefilter("ignore", jounce.JounceWarning)  # of parameters that the data do not see, and of what acts
    for label, build in ROBOTS.items():
        robot = build()
        for law, shape in LAWS.items():
            found = np.median([measure_errors(robot, shape, seed) for seed in range(seeds)], axis=0)
            rows.append(
                [label, law, *(f"{error:.4f}" for error in found[:, 0]), *(f"{s:.1f}" for s in found[[0, 2], 1])]
            )
            print(*rows[-1], sep="  ", flush=True)
        for what, act in ACTS.items():
            named, over, error = np.transpose([measure_acting(robot, act, seed) for seed in range(seeds)])
            acting.append(
                [label, what, f"{named.sum():.0f} of {seeds}", f"{np.median(over):.1f}", f"{np.median(error):.4f}"]
            )
            print(*acting[-1], sep="  ", flush=True)
    text = [
        "# Identification of friction", "",
        *paragraph(
            f"""Errors of the torques that identified arms predict, root mean squares in N m along a motion that was
            not fitted, medians of {seeds} arms in each row. Bodies are off from the model's by {FAR:.0%}, friction is
            0.1 to 0.6 N m, positions come from encoders of {BITS} bits, torques have white noise of {NOISE:g} N m;
            {SECONDS:g} s at {RATE} Hz. The laws are tanh(v / {DEFAULT_SMOOTHING_VELOCITY:g}), tanh(v / 0.01), sign(v)
            and sign(v) (1 + 0.6 exp(-(v / 0.08)^2))."""
        ),
        *paragraph(
            """With eps 0.05 all samples count alike. By data, eps of each joint is found, and slow samples whose
            friction the model does not have count less. By default there is a Stribeck term too where the data ask for
            one. The last columns are seconds of the processor, of the first way and of the default."""
        ),
        *table(("robot", "friction", *WAYS, "s, eps 0.05", "s, default"), rows),
        "## Torques that no term of the model is", "",
        *paragraph(
            """Friction is tanh(v / 0.05), and other torques act besides: friction that grows with the load, a force on
            the last body, a spring, a push. How often a warning names them, the root mean square of errors of inertial
            parameters over their deviations, and that of the torques along the other motion in N m, which has none of
            them but friction; medians."""
        ),
        *table(("robot", "acts", "named", "over deviations", "error"), acting),
        *[f"* {name}: {value}" for name, value in machine.described()],
    ]  # fmt: skip
    with files.write_whole(Path(__file__).parent / "FRICTION.md") as part:
        part.write_text("\n".join(text).rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
