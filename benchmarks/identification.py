"""``python -m benchmarks.identification``: `robot.identify` on a simulated Panda, whose parameters are known.

Bodies and drives are drawn at random, and forces along an exciting motion get white noise. What is found is compared
with what was drawn: estimates by their own covariance, bodies by the audit, and forces along another motion.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from warnings import catch_warnings, simplefilter

import numpy as np
from scipy.stats import chi2

import jounce
from benchmarks import machine
from benchmarks.tables import paragraph, table
from jounce.checks.audit import check_inertias
from jounce.core.typing import DriveTerm
from jounce.io import files
from jounce.spatial import inertia

TERMS: tuple[DriveTerm, ...] = ("damping", "friction", "offset")
NOISE = 0.02  # of the standard deviation of each force along the motion
RATE = 1000  # Hz
SEEDS = 20


@dataclass(frozen=True)
class Truth:
    """A drawn robot, and the offsets of its joints, which robots do not state."""

    robot: jounce.Robot
    offsets: np.ndarray

    def forces(self, motion: jounce.Motion, t: np.ndarray) -> np.ndarray:
        """The forces along a motion."""
        return self.robot.forces_along(motion, t, order=0).forces[0] + self.offsets


def drawn(robot: jounce.Robot, far: float, rng: np.random.Generator) -> Truth:
    """A robot of bodies that can exist: triangular factors of their pseudo-inertias are off by `far`, relatively."""
    m, n = robot.mechanism, robot.n
    T = np.linalg.cholesky(inertia.moment_matrix(m.M))
    root = T @ (np.eye(4) + far * np.tril(rng.normal(size=(len(T), 4, 4))))
    p = inertia.parameters(inertia.from_moment_matrix(root @ root.mT)).ravel()
    drives = replace(m.drives, damping=rng.uniform(0.05, 0.5, n), friction=rng.uniform(0.1, 0.6, n))
    true = jounce.Robot(replace(robot.with_inertial_parameters(p).mechanism, drives=drives))
    return Truth(true.with_drives(TERMS[:2]), rng.normal(size=n) * 0.2)


def other_motion(robot: jounce.Robot) -> jounce.Motion:
    """A Fourier series that the fit does not use."""
    lower, upper = robot.limits.bounds("position")
    cosines, sines = np.random.default_rng(1).uniform(-1, 1, (2, 4, robot.n)) * (upper - lower) / 16
    return jounce.Motion.fourier((lower + upper) / 2, cosines, sines, 0.9, 7.0)


def compared(robot: jounce.Robot, motion: jounce.Motion, far: float, prior: float, known: bool) -> list[str]:
    """A row: what is found of SEEDS drawn robots."""
    t, test = np.arange(0, motion.duration, 1 / RATE), other_motion(robot)
    times = np.linspace(0, test.duration, 500)
    base = robot.base_parameters()
    Y = robot.regressor(*test(times, 2), drives=TERMS)
    Y = np.concatenate([Y[..., base.columns], Y[..., len(base.parameters) :]], axis=-1)
    chi, beyond, forces, broken, seconds = [], [], [], 0, []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        truth = drawn(robot, far, rng)
        Q = truth.forces(motion, t)
        deviations = NOISE * Q.std(axis=0)
        Q = Q + deviations * rng.normal(size=Q.shape)
        start = process_time()
        with catch_warnings():
            simplefilter("ignore", jounce.JounceWarning)  # of parameters that the data do not see
            given = deviations if known else None
            found = robot.identify(motion, Q, t=t, drives=TERMS, prior=prior, deviations=given)
        seconds.append(process_time() - start)
        true = _values(truth.robot, truth.offsets)
        data, bodies = np.array([row.value for row in found.table]), _values(found.robot, found.robot.drives.offset)
        chi.append([(z - true) @ np.linalg.solve(found.covariance, z - true) for z in (data, bodies)])
        beyond.append(np.abs(data - true) > 2 * np.sqrt(np.diag(found.covariance)))
        model = _values(robot, np.zeros(robot.n))
        forces.append([np.sqrt(np.mean((Y @ (z - true) / deviations) ** 2)) for z in (model, data, bodies)])
        broken += bool(check_inertias(found.robot.mechanism))
    size = len(found.table)
    (of_data, of_bodies), of_forces = np.mean(chi, axis=0) / size, np.mean(forces, axis=0)
    inside = np.mean(chi2.cdf(np.array(chi)[:, 0], size) < 0.95)
    return [
        f"{far:.0%}",
        f"{prior:g}",
        "known" if known else "estimated",
        *(f"{x:.2f}" for x in (of_data, of_bodies)),
        *(f"{x:.0%}" for x in (inside, np.mean(beyond))),
        *(f"{x:.3g}" for x in of_forces),
        f"{broken}",
        f"{np.median(seconds):.1f}",
    ]


def _values(robot: jounce.Robot, offsets: np.ndarray) -> np.ndarray:
    """Base parameters, damping, friction and offsets."""
    beta = robot.base_parameters().matrix @ robot.inertial_parameters
    return np.concatenate([beta, robot.drives.damping, robot.drives.friction, offsets])


def main() -> None:
    """Identify, and write IDENTIFICATION.md."""
    robot = jounce.load("panda", lock={"panda_finger_joint1": 0.0})
    excited = robot.excite(drives=TERMS)
    rows = []
    size = robot.base_parameters().count + len(TERMS) * len(robot.mechanism.joints)
    cases = [(*case, known) for case in ((0.1, 0.1), (0.3, 0.3), (0.3, 10.0)) for known in (True, False)]
    for case in cases:
        rows.append(compared(robot, excited.motion, *case))
        print(*rows[-1], sep="  ", flush=True)
    head = (
        "off", "prior", "noise", "chi2, data", "chi2, bodies", "in 95 %", "beyond 2", "forces, model", "forces, data",
        "forces, bodies", "impossible", "s",
    )  # fmt: skip
    text = [
        "# Identification", "",
        *paragraph(
            f"""`robot.identify` on {SEEDS} Pandas in each row, whose bodies and drives are drawn: factors of the
            pseudo-inertias are off from the model's by the share in the first column. The second is the prior that
            `identify` got. The motion is that of `robot.excite`, {excited.motion.duration:g} s at {RATE} Hz; forces
            have white noise of {NOISE:.0%} of their standard deviation, which `identify` is told or not."""
        ),
        *paragraph(
            f"""chi2: the squared error over the stated covariance and the number of parameters, {size}: of the
            least-squares estimate it is 1 on average if the stated deviations are right; 95 % of the robots are then
            below the quantile of its distribution, and 4.6 % of all errors beyond two deviations. Where the noise is
            estimated, from the residuals at the few frequencies of the motion, it is uncertain itself, and the spread
            larger. chi2 of the bodies is that of the physically consistent parameters."""
        ),
        *paragraph(
            """Forces along another motion are off by so much, over the deviation of the noise: those of the model, of
            the least-squares estimate, and of the bodies. The last columns count robots with bodies that the audit
            calls impossible, and have the median processor time of one identification."""
        ),
        *table(head, rows),
        *[f"* {name}: {value}" for name, value in machine.described()],
    ]  # fmt: skip
    with files.write_whole(Path(__file__).parent / "IDENTIFICATION.md") as part:
        part.write_text("\n".join(text).rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
