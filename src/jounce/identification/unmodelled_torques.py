"""Torques that act and that no parameter holds: friction that grows with the load, a cable, a hose, a push.

Problem: the residuals r of a fit, over their deviations, and rows U, orthonormal in the directions that parameters
take. Some torques that robots have are tried, one unit of each as a column a: |Q| tanh(v / eps) with the torque Q of
the bodies, a constant force on the last body, springs of joints. What parameters leave of a column, a' = a - U U^T a,
has the coefficient a'^T r / a'^T a', with a deviation by the spectrum of r, as parameters have.

Algorithm: orthogonal matching pursuit (Y. C. Pati, R. Rezaiifar and P. S. Krishnaprasad, 1993). The column that is
beyond zero by the most deviations joins U, until none has MAX_DEVIATIONS, which is more than Bayes' information
criterion asks of logs of any length. What is left of each force is then searched for a short time that holds most of
its squares.

Nothing is corrected: parameters adapt to such torques, and a column that they explain shows nothing.
"""

from dataclasses import dataclass

import numpy as np

from jounce.core.errors import join_names, shorten
from jounce.core.typing import Equations
from jounce.engine.dispatch import compute
from jounce.identification.averaging import number_cells, weighted_means
from jounce.identification.filtered_balances import FILTERED_METHODS
from jounce.identification.least_squares_problem import IdentificationProblem
from jounce.identification.noise_spectra import gradient, gram, leverages, noise_spectra, spectral_gram
from jounce.identification.regression import (
    MIN_RELATIVE_DEVIATION,
    NULL_SPACE_TOLERANCE,
    Regression,
    informed_directions,
)
from jounce.model.coordinates import force_names, force_units

MAX_DEVIATIONS = 4.0  # of a coefficient by chance: once in 1000 logs with some twenty columns
MIN_PUSH_CELLS = 40  # of a log, of which a tenth has not most of the squares by chance
PUSH_SHARE = 0.1  # of the time, within which pushes are looked for
MIN_PUSH_SQUARES = 2 / 3  # of a force's residuals in that time: they are four times as large there as elsewhere


@dataclass(frozen=True, eq=False)
class TorqueColumns:
    """Torques of one unit each, which may act."""

    rows: np.ndarray  # (C, nv, K)
    texts: tuple[str, ...]  # what acts, with {} for its amount
    least: np.ndarray  # (K,) the least amounts that there are: friction grows with the load, and springs pull back

    def __add__(self, other: "TorqueColumns") -> "TorqueColumns":
        rows, least = np.concatenate([self.rows, other.rows], axis=-1), np.append(self.least, other.least)
        return TorqueColumns(rows, self.texts + other.texts, least)


def unmodelled_warnings(posed: IdentificationProblem, solution: Regression, method: Equations) -> list[str]:
    """Return which torques that no parameter holds the residuals of a fit show, and when forces are off.

    Equations of momentum and power are integrals, of which residuals are no torques.
    """
    if method in FILTERED_METHODS:
        return []
    cells, roots = posed.cells, np.sqrt(solution.weights)
    Y = cells.Y[..., posed.columns]
    rest, Z = (cells.off - Y @ solution.x) * roots, Y * roots[..., None]
    least = MIN_RELATIVE_DEVIATION**2 * (((cells.off + cells.model) * roots) ** 2).mean(axis=0)
    tried = _load_friction(posed, solution) + _forces_and_springs(posed)
    tried = TorqueColumns(tried.rows * roots[..., None], tried.texts, tried.least)
    shown, rest = _pursue(tried, Z @ informed_directions(gram(Z, Z))[0], rest, least)
    found = []
    if shown:
        cost = "parameters adapt to these, and may be off by more than their deviations"
        found.append(f"residuals look like torques that no term of the model is: {join_names(shown)}; {cost}")
    return found + _push_notes(posed, rest, roots)


def _load_friction(posed: IdentificationProblem, solution: Regression) -> TorqueColumns:
    """Friction by the torque of the bodies, which the base parameters make."""
    joints, rows = posed.robot.mechanism.joints, posed.cells.Y
    if "friction" not in posed.terms:
        return TorqueColumns(rows[..., :0], (), np.zeros(0))
    base, first = posed.base, len(posed.base.parameters) + len(joints) * posed.terms.index("friction")
    values = base.values + solution.x[: base.count]
    load = np.abs(rows[..., base.columns] @ values)
    columns = load[..., None] * rows[..., first : first + len(joints)]
    texts = tuple(f"friction of {shorten(joint)} that grows by {{}} of its load" for joint in joints)
    return TorqueColumns(columns, texts, np.zeros(len(joints)))


def _forces_and_springs(posed: IdentificationProblem) -> TorqueColumns:
    """A constant force on the last body, in the axes of the ground, and springs of the joints."""
    m, samples = posed.robot.mechanism, posed.samples
    if m.nv != m.n or m.closure:
        return TorqueColumns(posed.cells.Y[..., :0], (), np.zeros(0))
    q = posed.motion(samples.t, 0)[0]
    body = m.bodies[-1]
    columns = [-np.asarray(compute(posed.robot, "jacobian", (q,), body=body, frame="world"))[:, 3:].mT]
    texts = [f"a force of {{}} N along {axis} on {shorten(body)}" for axis in "xyz"]
    if "spring" not in posed.terms:
        columns.append((q - q.mean(axis=0)) @ m.G.T)
        columns[-1] = columns[-1][:, None] * m.G.T
        units = ("N m/rad" if np.any(X[:3]) else "N/m" for X in m.X)
        texts += [f"a spring of {{}} {unit} at {shorten(joint)}" for unit, joint in zip(units, m.joints, strict=True)]
    rows = np.concatenate(columns, axis=-1)
    place = number_cells(samples.t, posed.width)
    means = [weighted_means(rows[..., k], samples.weights, place)[0] for k in range(rows.shape[-1])]
    least = np.append(np.full(3, -np.inf), np.zeros(len(texts) - 3))
    return TorqueColumns(np.stack(means, axis=-1), tuple(texts), least)


def _pursue(tried: TorqueColumns, U: np.ndarray, rest: np.ndarray, least: np.ndarray) -> tuple[list[str], np.ndarray]:
    """The texts of the columns that residuals (C, nv) show, beyond orthonormal U (C, nv, r), and what is left then."""
    rows, shown, sizes = tried.rows, list[str](), (tried.rows**2).sum(axis=(0, 1))
    spectra = noise_spectra(leverages(U), rest, least)
    while True:
        # what U leaves of the columns, and their coefficients
        rows = rows - U @ gram(U, rows)
        norms = np.sqrt((rows**2).sum(axis=(0, 1)))
        units = rows / np.where(norms**2 > NULL_SPACE_TOLERANCE * sizes, norms, np.inf)
        amounts, spreads = gradient(units, rest), np.sqrt(np.diag(spectral_gram(units, spectra)))
        over = np.abs(amounts) / np.maximum(spreads, np.finfo(float).tiny)
        over[amounts < tried.least] = 0.0
        # the one that is chance least, with the spectrum of what it leaves
        if not over.any():
            return shown, rest
        k = int(over.argmax())
        more, left = np.concatenate([U, units[..., [k]]], axis=-1), rest - units[..., k] * amounts[k]
        spectra = noise_spectra(leverages(more), left, least)
        spread = np.sqrt(spectral_gram(units[..., [k]], spectra)[0, 0])
        if np.abs(amounts[k]) < MAX_DEVIATIONS * spread:
            return shown, rest
        shown.append(tried.texts[k].format(f"{amounts[k] / norms[k]:.3g} +- {spread / norms[k]:.2g}"))
        U, rest = more, left


def _push_notes(posed: IdentificationProblem, rest: np.ndarray, roots: np.ndarray) -> list[str]:
    """What is said of forces of which a short time holds most of the squares of residuals (C, nv)."""
    m, length = posed.robot.mechanism, int(PUSH_SHARE * len(rest))
    if len(rest) < MIN_PUSH_CELLS:
        return []
    sums = np.cumsum(np.pad(rest**2, ((1, 0), (0, 0))), axis=0)
    within = sums[length:] - sums[:-length]
    odd = within.max(axis=0) > MIN_PUSH_SQUARES * sums[-1]
    if not odd.any():
        return []
    # when the worst of them is off by more than half of the most
    j = int(np.where(odd, within.max(axis=0), 0.0).argmax())
    off = np.abs(np.divide(rest[:, j], roots[:, j], out=np.zeros(len(rest)), where=roots[:, j] > 0))
    first = int(within[:, j].argmax())
    off[:first] = off[first + length :] = 0.0
    times = posed.samples.t[(off > off.max() / 2)[number_cells(posed.samples.t, posed.width)]]
    when = f"from {times[0]:.4g} to {times[-1]:.4g} s, by up to {off.max():.3g} {force_units(m)[j]}"
    cure = "expected no push, contact or wild sample; NaN or weights of 0 leave samples out"
    return [f"forces of {join_names(np.array(force_names(m))[odd])} are unexplained {when}: {cure}"]
