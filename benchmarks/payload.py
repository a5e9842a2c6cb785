"""``python -m benchmarks.payload``: `robot.payload` on a simulated Panda with a known load, and without one.

The robot's bodies are 10 % heavier than the model says, its friction differs from log to log, torques have white noise,
and encoders of 17 bits report the positions, which are smoothed.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from warnings import catch_warnings, simplefilter

import numpy as np

import jounce
from benchmarks import machine
from benchmarks.tables import paragraph, table
from jounce.io.files import write_whole
from jounce.spatial import inertia

SEEDS = 20
NOISE = 0.02  # of the standard deviation of each torque along the motion
RATE, BITS = 1000, 17  # Hz
FRAME = "panda_link8"  # the flange
LOAD = jounce.inertia_matrix(2.0, [0.02, -0.01, 0.06], np.diag([0.004, 0.005, 0.003]))
TERMS = ("damping", "friction", "offset")


@dataclass(frozen=True)
class Bench:
    """A robot, the motion of its logs, and what a load adds to its parameters."""

    robot: jounce.Robot
    t: np.ndarray
    rates: tuple[np.ndarray, ...]
    added: np.ndarray

    def log(self, rng: np.random.Generator, loaded: bool) -> jounce.Motion:
        """A log with friction of its own."""
        arm = self.robot.with_inertial_parameters(1.1 * self.robot.inertial_parameters + loaded * self.added)
        n, velocity = arm.n, self.rates[1]
        friction = rng.uniform(0.1, 0.6, n) * np.tanh(velocity / arm.drives.eps[:n]) + 0.2 * rng.normal(size=n)
        Q = arm.inverse_dynamics(*self.rates) + rng.uniform(0.05, 0.5, n) * velocity + friction
        Q = Q + NOISE * Q.std(axis=0) * rng.normal(size=Q.shape)
        step = 2 * np.pi / 2**BITS
        q = np.floor(self.rates[0] / step + rng.uniform(size=n)) * step
        return replace(jounce.Motion.fit(self.t, q), torques=(self.t, Q))


def built() -> Bench:
    """The Panda with its hand, along the motion that determines a load best."""
    robot = jounce.load("panda", lock={"panda_finger_joint1": 0.0})
    motion = robot.excite(payload=FRAME, drives=TERMS).motion
    t, frame = np.arange(0, motion.duration, 1 / RATE), robot.mechanism.frame(FRAME)
    M = np.zeros_like(robot.mechanism.M)
    M[frame.body] = inertia.shift_inertia(LOAD, frame.T)
    return Bench(robot, t, motion(t, 2), inertia.parameters(M).ravel())


def main() -> None:
    """Identify the load, and no load, and write PAYLOAD.md."""
    bench, true = built(), inertia.parameters(LOAD)
    over, errors, nulls, halves, mismatch, seconds = [], [], [], [], [], []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        without, loaded, again = (bench.log(rng, of) for of in (False, True, False))
        with catch_warnings():
            simplefilter("ignore", jounce.JounceWarning)  # of no load
            start = perf_counter()
            found = bench.robot.payload(loaded, without, body=FRAME)
            seconds.append(perf_counter() - start)
            null = bench.robot.payload(again, without, body=FRAME)
        errors.append(found.parameters - true)
        over.append(errors[-1] / np.sqrt(np.diag(found.covariance)))
        nulls.append(null.parameters[0] / np.sqrt(null.covariance[0, 0]))
        (a, s), (b, r) = found.halves
        halves.append((a - b) / np.hypot(s, r))
        mismatch.append(found.mismatch)
        print(seed, np.round(over[-1], 2), f"{nulls[-1]:.2f} {halves[-1]:.2f} {mismatch[-1]:.2f}", flush=True)
    each, sizes = np.sqrt(np.mean(np.square(over), axis=0)), np.sqrt(np.mean(np.square(errors), axis=0))
    rows = [
        [name, f"{x:.4g}", f"{size:.2g}", f"{z:.2f}"]
        for name, x, size, z in zip(inertia.INERTIAL_PARAMETERS, true, sizes, each, strict=True)
    ]
    rows.append(["all", "", "", f"{np.sqrt(np.mean(np.square(over))):.2f}"])
    text = [
        "# Payload", "",
        *paragraph(
            f"""`robot.payload` on a simulated Panda whose bodies are 10 % heavier than its model's: {SEEDS} pairs of
            logs of {bench.t[-1]:.0f} s at {RATE} Hz, with a load and without it, along the motion of
            `robot.excite(payload={FRAME!r})`. Encoders have {BITS} bits, torques white noise of {NOISE:.0%} of their
            standard deviation, and friction differs from log to log. Parameters are those in the frame of the flange;
            the last column is the root mean square of errors over stated deviations."""
        ),
        *table(("parameter", "true", "rms error", "over deviations"), rows),
        *paragraph(
            f"""Of two logs without a load the mass is within two deviations of 0 {np.sum(np.abs(nulls) < 2)} times of
            {SEEDS}; masses of the halves of a log differ by {np.sqrt(np.mean(np.square(halves))):.2f} deviations as a
            root mean square. chi^2 of what the load does not explain is {np.mean(mismatch):.2f} per degree of freedom
            on average, {np.max(mismatch):.2f} at most. One identification takes {np.median(seconds):.1f} s."""
        ),
        *[f"* {name}: {value}" for name, value in machine.described()],
    ]  # fmt: skip
    with write_whole(Path(__file__).parent / "PAYLOAD.md") as part:
        part.write_text("\n".join(text).rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
