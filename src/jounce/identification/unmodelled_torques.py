"""Torques that act and that no parameter holds: friction that grows with the load, a rotor, a cable, a hose, a push.

Problem: the residuals r of a fit, over their deviations, and rows U, orthonormal in the directions that parameters
take. Some torques that robots have are tried, one unit of each as a column a: |Q| tanh(v / eps) with the torque Q of
the bodies, a constant force on the last body, springs and rotors of joints. What parameters leave of a column, a' = a -
U U^T a, has the coefficient a'^T r / a'^T a', with a deviation by the spectrum of r, as parameters have.

Algorithm: orthogonal matching pursuit (Y. C. Pati, R. Rezaiifar and P. S. Krishnaprasad, 1993). The column that is
beyond zero by the most deviations joins U, until none has MAX_DEVIATIONS, which is more than Bayes' information
criterion asks of logs of any length; of rotors, MAX_ROTOR_DEVIATIONS. What is left of each force is then searched for a
short time that holds most of its squares. Nothing is corrected: parameters adapt to such torques, and a column that
they explain shows nothing.
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
from jounce.identification.regression import MIN_RELATIVE_DEVIATION, Regression, informed_directions
from jounce.model.coordinates import force_names, force_units

MAX_DEVIATIONS = 4.0  # of a coefficient by chance: once in 1000 logs with some twenty columns
MAX_ROTOR_DEVIATIONS = 6.0  # errors of accelerations look like rotors: by chance 4.2, and those of a real arm 6 to 20
MIN_FREE_SHARE = 1e-4  # of a column that parameters leave: below it they take its place
MIN_PUSH_CELLS = 40  # of a log, of which a tenth has not most of the squares by chance
ROTOR = "a rotor"  # what texts of rotors begin with
PUSH_SHARE = 0.1  # of the time, within which pushes are looked for
MIN_PUSH_SQUARES = 2 / 3  # of a force's residuals in that time: they are four times as large there as elsewhere


@dataclass(frozen=True, eq=False)
class ShownTorques:
    """Torques that no parameter holds, as residuals of a fit show them."""

    loaded: np.ndarray  # (nc,) joints whose friction grows with the load
    rotors: tuple[str, ...]  # joints with rotors, and their inertia
    notes: list[str]  # warnings of all of them, and of when forces are off


def find_torques(posed: IdentificationProblem, solution: Regression, method: Equations) -> ShownTorques:
    """Return which torques that no parameter holds residuals of a fit show.

    Residuals of momentum and power are no torques, and those of loops are of several joints.
    """
    m = posed.robot.mechanism
    if method in FILTERED_METHODS or m.closure:
        return ShownTorques(np.zeros(len(m.joints), dtype=bool), (), [])
    cells, roots = posed.cells, np.sqrt(solution.weights)
    Y = cells.Y[..., posed.columns]
    rest, Z = (cells.off - Y @ solution.x) * roots, Y * roots[..., None]
    least = MIN_RELATIVE_DEVIATION**2 * (((cells.off + cells.model) * roots) ** 2).mean(axis=0)
    rows, texts = _torque_columns(posed, solution)
    of_rotors, of_joints = _rotor_columns(posed)
    rows, first = np.concatenate([rows, of_rotors], axis=-1), len(texts)
    shown, rest = _pursue(
        rows * roots[..., None], texts + of_joints, Z @ informed_directions(gram(Z, Z))[0], rest, least
    )
    look, cost = ", ".join(shown.values()), "parameters adapt to these, and may be off by more than their deviations"
    found = [f"residuals look like torques that no term of the model is: {look}; {cost}"] if shown else []
    off = np.abs(np.divide(rest, roots, out=np.zeros_like(rest), where=roots > 0))
    loaded = np.isin(np.arange(len(m.joints)), [*shown]) & m.lone_joints & ("friction" in posed.terms)
    rotors = tuple(text for k, text in shown.items() if k >= first)
    return ShownTorques(loaded, rotors, found + _push_notes(posed, np.maximum(rest**2, least), off))


def _torque_columns(posed: IdentificationProblem, solution: Regression) -> tuple[np.ndarray, list[str]]:
    """Columns (C, nv, K) of torques that may act, and what they are, with {} for the amount."""
    m, base, Y, t = posed.robot.mechanism, posed.base, posed.cells.Y, posed.samples.t
    columns, texts = [Y[..., :0]], list[str]()
    if "friction" in posed.terms:
        first = len(base.parameters) + len(m.joints) * posed.terms.index("friction")
        load = np.abs(Y[..., base.columns] @ (base.values + solution.x[: base.count]))
        columns.append(load[..., None] * Y[..., first : first + len(m.joints)])
        texts += [f"friction of {shorten(joint)} that grows by {{}} of its load" for joint in m.joints]
    if posed.motion.base_curve is None:
        q = weighted_means(posed.motion(t, 0)[0], np.ones((len(t), 1)), number_cells(t, posed.width))[0]
        J = compute(posed.robot, "jacobian", (q,), body=m.bodies[-1], frame="world")
        columns.append(-np.asarray(J)[:, 3:].mT)
        texts += [f"a force of {{}} N along {axis} on {shorten(m.bodies[-1])}" for axis in "xyz"]
        columns.append(((q - q.mean(axis=0)) @ m.G.T)[:, None] * m.G.T)
        units = ["N m/rad" if np.any(X[:3]) else "N/m" for X in m.X]
        texts += [f"a spring of {{}} {unit} at {shorten(j)}" for unit, j in zip(units, m.joints, strict=True)]
    return np.concatenate(columns, axis=-1), texts


def _rotor_columns(posed: IdentificationProblem) -> tuple[np.ndarray, list[str]]:
    """Columns (C, nv, K) of rotors at joints, and texts with {} for their inertia; none where these are sought."""
    m, t = posed.robot.mechanism, posed.samples.t
    if "armature" in posed.terms or m.elasticity is not None or not posed.terms:
        return posed.cells.Y[..., :0], []
    theta = weighted_means(posed.motion(t, 2)[2] @ m.G.T, np.ones((len(t), 1)), number_cells(t, posed.width))[0]
    columns = np.pad(theta[:, None] * m.G.T, ((0, 0), (posed.cells.Y.shape[1] - m.n, 0), (0, 0)))
    units = ["kg m^2" if np.any(X[:3]) else "kg" for X in m.X]
    return columns, [f"{ROTOR} of {{}} {unit} at {shorten(joint)}" for unit, joint in zip(units, m.joints, strict=True)]


def _pursue(
    rows: np.ndarray, texts: list[str], U: np.ndarray, rest: np.ndarray, least: np.ndarray
) -> tuple[dict[int, str], np.ndarray]:
    """The texts of the columns that residuals (C, nv) show, beyond orthonormal U (C, nv, r), and what is left then."""
    shown, sizes = dict[int, str](), (rows**2).sum(axis=(0, 1))
    signed = np.array([text.startswith("a force") for text in texts])  # friction does not fall, springs pull back
    certain = np.array([MAX_ROTOR_DEVIATIONS if text.startswith(ROTOR) else MAX_DEVIATIONS for text in texts])
    spectra = noise_spectra(leverages(U), rest, least)
    while True:
        # what U leaves of the columns, and their coefficients
        rows = rows - U @ gram(U, rows)
        norms = np.sqrt((rows**2).sum(axis=(0, 1)))
        units = rows / np.where(norms**2 > MIN_FREE_SHARE * sizes, norms, np.inf)
        amounts, spreads = gradient(units, rest), np.sqrt(np.diag(spectral_gram(units, spectra)))
        over = np.where(signed, np.abs(amounts), amounts) / np.maximum(certain * spreads, np.finfo(float).tiny)
        if not (over > 0).any():
            return shown, rest
        # the one that is chance least, by the spectrum of what it leaves
        k = int(over.argmax())
        more, left = np.concatenate([U, units[..., [k]]], axis=-1), rest - units[..., k] * amounts[k]
        spectra = noise_spectra(leverages(more), left, least)
        spread = np.sqrt(spectral_gram(units[..., [k]], spectra)[0, 0])
        if np.abs(amounts[k]) < certain[k] * spread:
            return shown, rest
        shown[k] = texts[k].format(f"{amounts[k] / norms[k]:.3g} +- {spread / norms[k]:.2g}")
        U, rest = more, left


def _push_notes(posed: IdentificationProblem, squares: np.ndarray, off: np.ndarray) -> list[str]:
    """What is said of forces of which a short time holds most of the squares (C, nv) of residuals (C, nv), N m or N."""
    m, t, length = posed.robot.mechanism, posed.samples.t, max(1, int(PUSH_SHARE * len(off)))
    sums = np.cumsum(np.pad(squares, ((1, 0), (0, 0))), axis=0)
    within = sums[length:] - sums[:-length]
    odd = within.max(axis=0) > MIN_PUSH_SQUARES * sums[-1]
    if len(off) < MIN_PUSH_CELLS or not odd.any():
        return []
    # when the worst of them is off by more than half of the most
    j = int(np.where(odd, within.max(axis=0), 0.0).argmax())
    start = int(within[:, j].argmax())
    most = off[start : start + length, j].max()
    there = start + np.flatnonzero(off[start : start + length, j] > most / 2)
    times = t[np.isin(number_cells(t, posed.width), there)]
    where, when = join_names(np.array(force_names(m))[odd]), f"from {times[0]:.4g} to {times[-1]:.4g} s"
    cure = "expected no push, contact or wild sample; NaN or weights of 0 leave samples out"
    return [f"forces of {where} are unexplained {when}, by up to {most:.3g} {force_units(m)[j]}: {cure}"]
