"""``python -m benchmarks.stiffness``: `robot.identify_stiffness` and delays in `robot.identify`, on simulated logs.

An elastic Panda carries a load; encoders of motors and links are rounded, torques have white noise.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from warnings import simplefilter

import numpy as np

import jounce
from benchmarks import machine
from benchmarks.tables import paragraph, table
from jounce.io import files
from jounce.spatial import inertia

DELAY_SEEDS = 2
SECONDS, RATE = 10.0, 500  # s, Hz
NOISE = 0.02  # of the standard deviation of each torque along the motion
LOAD = jounce.inertia_matrix(
    3.0, [0.1, 0.0, 0.1], 0.02 * np.eye(3)
)  # at the flange, so that the last joint has one too
DELAYS = (0.0, 0.7, 2.0, 5.0, 13.0)  # ms


@dataclass(frozen=True)
class Case:
    """How a log is made."""

    name: str
    bits: int = 17
    stiffer: float = 1.0
    hysteresis: float = 0.0  # N m
    ripple: float = 0.0  # rad
    delay: float = 0.0  # of torques, s
    apart: float = 0.0  # by which encoders of motors are late, s
    logs: int = 6


CASES = (
    Case("14 bits", 14, logs=20),
    Case("15 bits", 15, logs=20),
    Case("17 bits", logs=20),
    Case("17 bits, ten times as stiff", stiffer=10.0, logs=20),
    Case("hysteresis of 3 N m", hysteresis=3.0),
    Case("ripple of 2e-5 rad", ripple=2e-5),
    Case("torques 13 ms late, motors 1.2 ms", delay=0.013, apart=0.0012),
)


def carry(robot: jounce.Robot) -> jounce.Robot:
    """The robot with the load at its flange."""
    frame, M = robot.mechanism.frame("panda_link8"), np.array(robot.mechanism.M)
    M[frame.body] += inertia.shift_inertia(LOAD, frame.T)
    return robot.with_inertial_parameters(inertia.parameters(M).ravel())


def sway(n: int) -> jounce.Motion:
    """Five harmonics of 0.1 Hz of every joint."""
    rng, sizes = np.random.default_rng(100), 0.25 / np.sqrt(np.arange(1, 6))[:, None]
    waves = [rng.uniform(-sizes, sizes, (5, n)) for _ in range(2)]
    return jounce.Motion.fourier([0, -0.3, 0, -1.8, 0, 1.8, 0], *waves, 2 * np.pi / SECONDS, SECONDS)


def quantize(x: np.ndarray, bits: int, rng: np.random.Generator) -> np.ndarray:
    """What encoders of some bits a turn make of positions."""
    step = 2 * np.pi / 2**bits
    return np.asarray(np.floor(x / step + rng.uniform(size=x.shape[1])) * step)


def noisy(Q: np.ndarray, t: np.ndarray, delay: float, rng: np.random.Generator) -> np.ndarray:
    """Torques that come late, with noise."""
    late = np.stack([np.interp(t - delay, t, x) for x in Q.T], axis=1)
    return np.asarray(late + NOISE * Q.std(axis=0) * rng.normal(size=Q.shape))


def identify_springs(arm: jounce.Robot, case: Case, seed: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Relative errors of the stiffnesses, their deviations, and the delay that is found."""
    rng, t = np.random.default_rng(seed), np.arange(0, SECONDS, 1 / RATE)
    along = arm.forces_along(sway(arm.n), t, order=0)
    (q, qd, _), Q = along.rates, along.forces[0]
    theta = q + (Q + case.hysteresis * np.tanh(qd / 0.005)) / arm.elasticity.stiffness - case.apart * qd
    theta = theta + case.ripple * np.sin(100 * theta + rng.uniform(0, 6, arm.n))
    links, motors = (jounce.Motion.fit(t, quantize(x, case.bits, rng), allow_noise=True) for x in (q, theta))
    found = arm.identify_stiffness(replace(links, torques=(t, noisy(Q, t, case.delay, rng))), motors)
    rows, K = found.table[::3], arm.elasticity.stiffness
    return np.array([row.value for row in rows]) / K - 1, np.array([row.deviation for row in rows]) / K, found.delay


def identify_delay(arm: jounce.Robot, delay: float, seed: int) -> float:
    """The delay that `identify` finds in a log of an arm whose links are 10 % heavier than the model says."""
    rng, t = np.random.default_rng(seed), np.arange(0, SECONDS, 1 / RATE)
    q, qd, q2d = sway(arm.n)(t, 2)
    true = arm.with_inertial_parameters(1.1 * arm.inertial_parameters)
    Q = true.inverse_dynamics(q, qd, q2d) + rng.uniform(0.1, 0.6, arm.n) * np.tanh(qd / 0.02) + 0.3 * qd
    log = replace(jounce.Motion.fit(t, quantize(q, 17, rng)), torques=(t, noisy(Q, t, delay, rng)))
    return float(arm.identify(log).delay)


def main() -> None:
    """Identify springs and delays, and write STIFFNESS.md."""
    simplefilter("ignore", jounce.JounceWarning)  # of delays
    bare, rows = carry(jounce.load("panda_elastic")), []
    for case in CASES:
        arm = bare.elastic(case.stiffer * np.array(bare.elasticity.stiffness))
        found = [identify_springs(arm, case, seed) for seed in range(case.logs)]
        errors, spreads = (np.array([x[k] for x in found]) for k in (0, 1))
        sizes, over = 100 * np.sqrt(np.mean(errors**2, axis=0)), np.sqrt(np.mean((errors / spreads) ** 2))
        late = 1e3 * np.array([x[2] for x in found])
        rows.append([
            case.name, str(case.logs), f"{np.sqrt(np.mean(sizes**2)):.3f}", f"{np.median(sizes):.3f}",
            f"{sizes.max():.3f}", f"{over:.2f}", f"{late.min():.2f} to {late.max():.2f}",
        ])  # fmt: skip
        print(*rows[-1], sep=" | ", flush=True)
    rigid = carry(jounce.load("panda", lock={"panda_finger_joint1": 0.0}))
    delays = []
    for delay in DELAYS:
        ms = 1e3 * np.array([identify_delay(rigid, delay / 1e3, seed) for seed in range(DELAY_SEEDS)])
        delays.append([f"{delay:g}", f"{ms.min():.2f} to {ms.max():.2f}"])
        print(*delays[-1], sep=" | ", flush=True)
    text = [
        "# Stiffness", "",
        *paragraph(
            f"""`robot.identify_stiffness` on a simulated Panda of elastic joints (1000 and 400 N m/rad, torques that
            vary by 1 to 11 N m rms) with 3 kg at its flange: logs of {SECONDS:.0f} s at {RATE} Hz.
            Encoders of links and motors, seen from the links, have 17 bits unless said otherwise; torques have
            white noise of {NOISE:.0%} of their standard deviation. Errors of the stiffness in %, rms: of all joints,
            of the median joint, of the worst; then the rms of errors over stated deviations, and the delays of
            torques that are found, 0 where none is certain."""
        ),
        *table(("log", "number", "all", "median", "worst", "over deviations", "delay, ms"), rows),
        *paragraph(
            f"""`robot.identify` on logs of the rigid Panda with that load, friction, and links 10 % heavier than the
            model's, {DELAY_SEEDS} logs of each delay of the torques:"""
        ),
        *table(("delay, ms", "found, ms"), delays),
        *[f"* {name}: {value}" for name, value in machine.described()],
    ]  # fmt: skip
    with files.write_whole(Path(__file__).parent / "STIFFNESS.md") as part:
        part.write_text("\n".join(text).rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
