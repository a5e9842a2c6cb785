"""``python -m benchmarks.accelerations``: an arm identified from smoothed samples and from a spline.

The arm moves along random Fourier series for ten seconds. Its bodies have other masses than those of the model, its
joints have friction; positions and torques are measured at 500 Hz with noise. The arm is identified from
samples that are smoothed and from a spline through them. Errors are those of the torques along another motion.
"""

import warnings
from collections.abc import Iterator
from dataclasses import replace

import click
import numpy as np

import jounce

PERIOD, HARMONICS, RATE = 10.0, 5, 500.0
TORQUES = 0.02  # noise, relative to the standard deviation of each torque
POSITIONS = (2e-5, 3e-4)  # noise, rad
BAND = 3.0  # Hz; of a spline through noise the forces have no band


@click.command()
@click.option("--runs", default=5, show_default=True, help="Number of arms, models and motions.")
def main(runs: int) -> None:
    """Print the median and the largest error of the predicted torques, relative to the torques."""
    warnings.simplefilter("ignore", jounce.JounceWarning)
    arm = jounce.load("panda", lock={"panda_finger_joint1": 0.02}).with_limits(lower=-3, upper=3)  # series are random
    errors: dict[tuple[str, str], list[float]] = {}
    for seed in range(runs):
        for noise in POSITIONS:
            for case, error in of_log(arm, noise, np.random.default_rng(seed)):
                errors.setdefault((f"{noise:g} rad", case), []).append(error)
    for case, found in errors.items():
        numbers = f"{100 * np.median(found):8.2f} % {100 * max(found):8.2f} %"
        click.echo("".join(word.ljust(18) for word in case) + numbers)


def of_log(arm: jounce.Robot, noise: float, rng: np.random.Generator) -> Iterator[tuple[str, float]]:
    """The motions that are made of one log, with the error of each."""
    m = arm.mechanism
    friction = replace(m.drives, damping=rng.uniform(0.2, 1, m.nb), friction=rng.uniform(0.2, 1, m.nb))
    real = jounce.Robot(replace(m, drives=friction, acting=("damping", "friction")))
    p = arm.inertial_parameters.reshape(m.nb, -1)
    model = arm.with_inertial_parameters((p * rng.uniform(0.8, 1.25, (m.nb, 1))).ravel())
    motion, other = series(m.n, rng), series(m.n, rng)
    t = np.arange(0, PERIOD, 1 / RATE)
    Q, true = real.forces_along(motion, t, order=0).forces[0], real.forces_along(other, t, order=0).forces[0]
    Q = Q + rng.normal(size=Q.shape) * TORQUES * Q.std(axis=0)
    q = motion(t, 0)[0] + rng.normal(0, noise, Q.shape)
    for name, path in {"smoothed": jounce.Motion.fit(t, q), "spline through": jounce.Motion.through(t, q, 5)}.items():
        found = model.identify(path, Q, t=t, band=BAND)
        off = found.robot.forces_along(other, t, order=0).forces[0] - true
        yield name, float(np.sqrt((off**2).mean() / (true**2).mean()))


def series(n: int, rng: np.random.Generator) -> jounce.Motion:
    """A random Fourier series whose harmonics are equally fast."""
    a, b = rng.uniform(-0.5, 0.5, (2, HARMONICS, n)) / np.arange(1, HARMONICS + 1)[:, None]
    return jounce.Motion.fourier(np.full(n, 0.2), a, b, 2 * np.pi / PERIOD, PERIOD)


if __name__ == "__main__":
    main()
