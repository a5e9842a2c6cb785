"""``python -m benchmarks.friction``: `robot.identify` of simulated arms with friction of several laws.

Bodies and drives are drawn at random; positions are those of encoders and smoothed, torques have white noise. Errors
are those of the torques along a motion that was not fitted. Writes FRICTION.md.
"""

from collections.abc import Callable
from pathlib import Path
from time import process_time
from unittest.mock import patch
from warnings import catch_warnings, simplefilter

import click
import numpy as np

import jounce
from benchmarks import machine
from benchmarks.identification import drawn
from benchmarks.tables import paragraph, table
from jounce.identification import friction_search
from jounce.io.files import write_whole
from jounce.model.drives import DEFAULT_SMOOTHING_VELOCITY

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
ROBOTS = {"Panda": ("panda", {"panda_finger_joint1": 0.0}), "UR5": ("ur5", {})}
WAYS = {  # of identification: what `identify` gets, and whether slow samples may count less
    "eps 0.05": ({"eps": DEFAULT_SMOOTHING_VELOCITY, "drives": ("damping", "friction", "offset")}, 0),
    "eps by data": ({"drives": ("damping", "friction", "offset")}, friction_search.WEIGHT_ROUNDS),
    "default": ({}, friction_search.WEIGHT_ROUNDS),
}


def series(robot: jounce.Robot, seed: int, frequency: float, seconds: float) -> jounce.Motion:
    """A random Fourier series of five harmonics within positions of all joints."""
    lower, upper = (x.clip(-MAX_POSITION, MAX_POSITION) for x in robot.limits.bounds("position"))
    terms = np.random.default_rng(seed).uniform(-1, 1, (2, 5, robot.n)) * (upper - lower) / 8
    return jounce.Motion.fourier((lower + upper) / 2, *terms, 2 * np.pi * frequency, seconds)


def measure_errors(
    robot: jounce.Robot, law: Callable[[np.ndarray], np.ndarray], seed: int
) -> list[tuple[float, float]]:
    """The error of the torques in N m, and seconds of the processor, of each way."""
    rng = np.random.default_rng(seed)
    truth = drawn(robot, FAR, rng)
    m, d = truth.robot.mechanism, truth.robot.drives
    rigid = jounce.Robot(m).with_drives("damping")

    def forces(motion: jounce.Motion, t: np.ndarray) -> np.ndarray:
        return rigid.forces_along(motion, t, order=0).forces[0] + d.friction * law(motion(t, 1)[1]) + truth.offsets

    motion, other = series(robot, seed + 10, 0.1, SECONDS), series(robot, seed + 50, 0.13, SECONDS / 2)
    t, times = np.arange(0, SECONDS, 1 / RATE), np.linspace(0, SECONDS / 2, 1000)
    step = 2 * np.pi / 2**BITS
    q = np.floor(motion(t, 0)[0] / step + rng.uniform(size=robot.n)) * step
    Q = forces(motion, t) + NOISE * rng.normal(size=q.shape)
    smoothed, found = jounce.Motion.fit(t, q, allow_noise=True), []
    for options, rounds in WAYS.values():
        start = process_time()
        with patch.object(friction_search, "WEIGHT_ROUNDS", rounds):
            arm = robot.identify(smoothed, Q, t=t, **options).robot
        off = arm.forces_along(other, times, order=0).forces[0] - forces(other, times)
        found.append((float(np.sqrt(np.mean(off**2))), process_time() - start))
    return found


@click.command()
@click.option("--seeds", default=5, show_default=True, help="Number of robots drawn for each row.")
def main(seeds: int) -> None:
    """Identify, and write FRICTION.md."""
    rows = []
    for label, (name, lock) in ROBOTS.items():
        robot = jounce.load(name, lock=lock)
        for law, shape in LAWS.items():
            with catch_warnings():
                simplefilter("ignore", jounce.JounceWarning)  # of parameters that the data do not see
                found = np.median([measure_errors(robot, shape, seed) for seed in range(seeds)], axis=0)
            rows.append(
                [label, law, *(f"{error:.4f}" for error in found[:, 0]), *(f"{s:.1f}" for s in found[[0, 2], 1])]
            )
            print(*rows[-1], sep="  ", flush=True)
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
        *[f"* {name}: {value}" for name, value in machine.described()],
    ]  # fmt: skip
    with write_whole(Path(__file__).parent / "FRICTION.md") as part:
        part.write_text("\n".join(text).rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
