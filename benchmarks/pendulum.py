"""``python -m benchmarks.pendulum``: `robot.identify` on logs of a double pendulum, whose accelerations are not exact.

Its motion under drives of its first joint or of both is simulated, and read by encoders of some bits; what is found is
compared with the truth.
"""

from itertools import product
from pathlib import Path
from time import process_time
from warnings import catch_warnings, simplefilter

import numpy as np
from scipy.integrate import solve_ivp

import jounce
from benchmarks import machine
from benchmarks.tables import paragraph, table
from jounce.io import files

DAMPING = np.array([0.02, 0.01])  # N m s/rad
RATE, SECONDS = 500, 10.0
SEEDS = 20
NOISES = 0.02, 0.1  # N m, of torques whose root mean square is 0.2 to 0.5 N m
WRONG = 1.3  # factor of the parameters of the model that the identification starts from


def double_pendulum() -> jounce.Robot:
    """Two links of 0.6 kg, which hang at q = (-pi/2, 0)."""
    elbow = np.eye(4)
    elbow[0, 3] = 0.2
    links = [(0.15, 4e-3), (0.26, 1.1e-2)]  # m from the joint, kg m^2 about the COM
    M = [jounce.inertia_matrix(0.6, [c, 0, 0], np.diag([1e-4, theta, theta])) for c, theta in links]
    joints = [[0, 0, 1, 0, 0, 0]] * 2
    return jounce.Robot.from_screws([np.eye(4), elbow], joints, M, gravity=[0, -9.81, 0], name="double pendulum")


def swing(
    robot: jounce.Robot, seed: int, bits: int, passive: bool, noise: float = 0.02
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, positions that encoders of some bits report, and torques with noise; `passive`: no motor at joint 2."""
    rng = np.random.default_rng(seed)
    frequencies, phases = rng.uniform(0.3, 1.6, (2, 5)), rng.uniform(0, 2 * np.pi, (2, 5))
    sizes = rng.normal(size=(2, 5)) * [[0.3], [0.0 if passive else 0.12]]

    def torques(t):
        return (sizes * np.sin(2 * np.pi * frequencies * np.asarray(t)[..., None, None] + phases)).sum(axis=-1)

    def rates(t, y):
        return np.append(y[2:], robot.forward_dynamics(y[:2], y[2:], torques(t) - DAMPING * y[2:]))

    t = np.arange(0, SECONDS, 1 / RATE)
    start = [-np.pi / 2, 0, 0, 0] + 0.3 * rng.normal(size=4) * [1, 1, 0, 0]
    q = solve_ivp(rates, (0, SECONDS), start, t_eval=t, rtol=1e-9, atol=1e-11, method="DOP853").y[:2].T
    step = 2 * np.pi / 2**bits
    reported = np.floor(q / step + rng.uniform(size=2)) * step
    return t, reported, torques(t) + noise * rng.normal(size=q.shape)


def compare(bits: int, passive: bool, noise: float) -> list[str]:
    """A row: errors and deviations of what is found of SEEDS logs."""
    robot = double_pendulum()
    true = np.append(robot.base_parameters().values, DAMPING)
    model = robot.with_inertial_parameters(WRONG * robot.inertial_parameters)
    errors, over, seconds = [], [], []
    for seed in range(SEEDS):
        t, q, Q = swing(robot, seed, bits, passive, noise)
        motion = jounce.Motion.fit(t, q, allow_noise=True)
        start = process_time()
        with catch_warnings():
            simplefilter("ignore", jounce.JounceWarning)
            found = model.identify(motion, Q, t=t, drives=("damping",), prior=10.0)
        seconds.append(process_time() - start)
        errors.append([row.value for row in found.table] - true)
        over.append(errors[-1] / np.sqrt(np.diag(found.covariance)))
    inertial = np.flatnonzero(np.abs(true[:-2]) > 1e-9)  # centres of mass are on the links' axes
    bias, scatter = (100 * of[inertial] / true[inertial] for of in (np.mean(errors, axis=0), np.std(errors, axis=0)))
    return [
        f"{bits} bits, {'joint 1' if passive else 'both joints'}, {noise:g} N m",
        f"{bias[np.abs(bias).argmax()]:+.2f} %",
        f"{np.abs(scatter).max():.2f} %",
        f"{np.mean(np.abs(over) < 2):.2f}",
        f"{np.sqrt(np.mean(np.square(over))):.2f}",
        f"{np.median(seconds):.1f}",
    ]


def main() -> None:
    """Simulate and identify, and write PENDULUM.md."""
    rows = []
    for noise, passive, bits in product(NOISES, (False, True), (12, 14, 17)):
        rows.append(compare(bits, passive, noise))
        print(*rows[-1], sep="  ", flush=True)
    head = (
        "encoders, motors, noise of torques",
        "largest bias",
        "largest scatter",
        "within 2 deviations",
        "rms over deviations",
        "s",
    )
    text = [
        "# Identification with errors in the motion", "",
        *paragraph(
            f"""A double pendulum that swings {SECONDS:g} s, sampled at {RATE} Hz, with noise of the torques;
            {SEEDS} simulated logs a row. Positions are smoothed as every log is. The model is wrong by a factor of
            {WRONG:g}, and has next to no say (`prior=10`). Bias and scatter are those of the inertial parameters, the
            largest of four; coverage and root mean square of errors over deviations are of all eight parameters.
            The last column is the median processor time of `identify`."""
        ),
        *table(head, rows),
        *[f"* {name}: {value}" for name, value in machine.described()],
    ]  # fmt: skip
    with files.write_whole(Path(__file__).parent / "PENDULUM.md") as part:
        part.write_text("\n".join(text).rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
