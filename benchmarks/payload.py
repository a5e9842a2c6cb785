"""``python -m benchmarks.payload``: `robot.payload` on a simulated Panda with a known load, and without one.

The robot's bodies are 10 % heavier than the model says, its friction differs from log to log and follows one of two
laws, torques have white noise, and encoders of 17 bits report the positions, which are smoothed.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from warnings import catch_warnings, simplefilter

import numpy as np

import jounce
from benchmarks import machine
from benchmarks.friction import LAWS as FRICTION_LAWS
from benchmarks.tables import paragraph, table
from jounce.io import files
from jounce.spatial import inertia

SEEDS = 20
NOISE = 0.02  # of the standard deviation of each torque along the motion
RATE, BITS = 1000, 17  # Hz
FRAME = "panda_link8"  # the flange
LOAD = jounce.inertia_matrix(2.0, [0.02, -0.01, 0.06], np.diag([0.004, 0.005, 0.003]))
TERMS = ("damping", "friction", "offset")
LAWS = {"tanh": FRICTION_LAWS["own tanh"], "Stribeck": FRICTION_LAWS["Stribeck"]}


@dataclass(frozen=True)
class Bench:
    """A robot, the motion of its logs, and what a load adds to its parameters."""

    robot: jounce.Robot
    t: np.ndarray
    rates: tuple[np.ndarray, ...]
    added: np.ndarray

    def log(self, rng: np.random.Generator, loaded: bool, law: str) -> jounce.Motion:
        """A log with friction of its own, of a law."""
        arm = self.robot.with_inertial_parameters(1.1 * self.robot.inertial_parameters + loaded * self.added)
        n, velocity = arm.n, self.rates[1]
        friction = rng.uniform(0.1, 0.6, n) * LAWS[law](velocity) + 0.2 * rng.normal(size=n)
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


@dataclass(frozen=True)
class Outcome:
    """What is found with friction of one law: errors and deviations (SEEDS, 10), and numbers of each pair of logs."""

    errors: np.ndarray
    deviations: np.ndarray
    nulls: np.ndarray  # masses of no load, over their deviations
    halves: np.ndarray  # differences of masses of the halves of a log, over theirs
    mismatch: np.ndarray
    seconds: np.ndarray


def compare(bench: Bench, law: str) -> Outcome:
    """Identify the load, and no load."""
    rows = []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        without, loaded, again = (bench.log(rng, of, law) for of in (False, True, False))
        with catch_warnings():
            simplefilter("ignore", jounce.JounceWarning)  # of no load
            start = process_time()
            found = bench.robot.payload(loaded, without, body=FRAME)
            seconds = process_time() - start
            null = bench.robot.payload(again, without, body=FRAME)
        (a, s), (b, r) = found.halves
        none = null.parameters[0] / np.sqrt(null.covariance[0, 0])
        errors, deviations = found.parameters - inertia.parameters(LOAD), np.sqrt(np.diag(found.covariance))
        rows.append((errors, deviations, none, (a - b) / np.hypot(s, r), found.mismatch, seconds))
        print(law, seed, np.round(errors / deviations, 2), f"{none:.2f} {found.mismatch:.2f}", flush=True)
    return Outcome(*map(np.array, zip(*rows, strict=True)))


def rms(values: np.ndarray) -> np.ndarray:
    """Root mean squares over logs."""
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=0)))


def main() -> None:
    """Identify by logs with friction of each law, and write PAYLOAD.md."""
    bench, true = built(), inertia.parameters(LOAD)
    found = [compare(bench, law) for law in LAWS]
    pairs = [(rms(of.errors), rms(of.errors / of.deviations)) for of in found]
    rows = [
        [name, f"{x:.4g}", *(text for error, over in pairs for text in (f"{error[k]:.2g}", f"{over[k]:.2f}"))]
        for k, (name, x) in enumerate(zip(inertia.INERTIAL_PARAMETERS, true, strict=True))
    ]
    rows.append(["all", "", *(text for _, over in pairs for text in ("", f"{rms(over):.2f}"))])
    head = [f"{law}: {what}" for law in LAWS for what in ("rms error", "over deviations")]
    within, halves = ([*map(of, found)] for of in (lambda x: np.sum(np.abs(x.nulls) < 2), lambda x: rms(x.halves)))
    text = [
        "# Payload", "",
        *paragraph(
            f"""`robot.payload` on a simulated Panda whose bodies are 10 % heavier than its model's: {SEEDS} pairs of
            logs of {bench.t[-1]:.0f} s at {RATE} Hz, with a load and without it, along the motion of
            `robot.excite(payload={FRAME!r})`. Encoders have {BITS} bits, torques white noise of {NOISE:.0%} of their
            standard deviation, and friction differs from log to log; its laws are tanh(v / 0.05), which is the
            model's, and sign(v) (1 + 0.6 exp(-(v / 0.08)^2)). Parameters are those in the frame of the flange; root
            mean squares are those of errors, and of errors over stated deviations."""
        ),
        *table(("parameter", "true", *head), rows),
        *paragraph(
            f"""Of two logs without a load the mass is within two deviations of 0 {within[0]} and {within[1]} times of
            {SEEDS}; masses of the halves of a log differ by {halves[0]:.2f} and {halves[1]:.2f} deviations as a root
            mean square. chi^2 of what the load does not explain is {np.mean([x.mismatch for x in found]):.2f} per
            degree of freedom on average, {np.max([x.mismatch for x in found]):.2f} at most. One identification takes
            {np.median([x.seconds for x in found]):.1f} s of the processor."""
        ),
        *[f"* {name}: {value}" for name, value in machine.described()],
    ]  # fmt: skip
    with files.write_whole(Path(__file__).parent / "PAYLOAD.md") as part:
        part.write_text("\n".join(text).rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
