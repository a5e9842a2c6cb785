"""Torques that act and that no parameter holds: friction that grows with the load, a rotor, a cable, a hose, a push.

Problem: the residuals r of a fit, over their deviations, and rows U, orthonormal in the directions that parameters
take. Some torques that robots have are tried, one unit of each as a column a (`jounce.identification.torque_columns`).
What parameters leave of a column, a' = a - U U^T a, has the coefficient a'^T r / a'^T a', with a deviation by the
spectrum of r, as parameters have.

Algorithm: orthogonal matching pursuit (Y. C. Pati, R. Rezaiifar and P. S. Krishnaprasad, 1993). The column that is
beyond zero by the most deviations, over those that its kind needs, joins U, until none has as many, which is more than
Bayes' information criterion asks of logs of any length. What is left of each force is then searched for a short time
that holds most of its squares. Nothing is corrected: parameters adapt to such torques, and a column that they explain
shows nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jounce.core.errors import join_names
from jounce.identification.averaging import number_cells
from jounce.identification.least_squares_problem import IdentificationProblem
from jounce.identification.noise_spectra import gradient, gram, leverages, noise_spectra, spectral_gram
from jounce.identification.regression import MIN_RELATIVE_DEVIATION, Regression, informed_directions
from jounce.identification.torque_columns import (
    TorqueColumns,
    TorqueKind,
    force_columns,
    gain_columns,
    load_change_columns,
    load_friction_columns,
    mean_rates,
    rotor_columns,
    spring_columns,
)
from jounce.model.coordinates import force_names, force_units

MIN_FREE_SHARE = 1e-4  # of a column that parameters leave: below it they take its place
MIN_PUSH_CELLS = 40  # of a log, of which a tenth has not most of the squares by chance
PUSH_SHARE = 0.1  # of the time, within which pushes are looked for
MIN_PUSH_SQUARES = 2 / 3  # of a force's residuals in that time: they are four times as large there as elsewhere


@dataclass(frozen=True)
class ShownTorque:
    """A torque that residuals show."""

    kind: TorqueKind
    number: int  # of the column among those of its kind
    text: str  # what it is, with its amount


@dataclass(frozen=True, eq=False)
class ShownTorques:
    """Torques that no parameter holds, as residuals of a fit show them."""

    loaded: np.ndarray  # (nc,) joints whose friction grows with the load
    rotors: tuple[str, ...]  # joints with rotors, and their inertia
    gains: bool  # whether torques of a joint are read too large or too small
    notes: list[str]  # warnings of all of them, and of when forces are off


def find_torques(posed: IdentificationProblem, solution: Regression) -> ShownTorques:
    """Return which torques that no parameter holds residuals of a fit show.

    Residuals of loops are torques of several joints, and are not searched.
    """
    m = posed.robot.mechanism
    if m.closure:
        return ShownTorques(np.zeros(len(m.joints), dtype=bool), (), False, [])
    # residuals and the columns of parameters over the deviations of residuals
    cells, roots = posed.cells, np.sqrt(solution.weights)
    Y = cells.Y[..., posed.columns]
    rest, Z = (cells.off - Y @ solution.x) * roots, Y * roots[..., None]
    least = MIN_RELATIVE_DEVIATION**2 * (((cells.off + cells.model) * roots) ** 2).mean(axis=0)
    # what residuals show of each kind of torques
    q, _, q2d = mean_rates(posed)
    kinds = (
        load_friction_columns(posed, solution.x),
        force_columns(posed, q),
        spring_columns(posed, q),
        rotor_columns(posed, q2d),
        gain_columns(posed, solution.x),
        load_change_columns(posed),
    )
    U = Z @ informed_directions(gram(Z, Z))[0]
    shown, rest = _pursue([_whiten_columns(of, roots) for of in kinds], U, rest, least)
    notes = []
    if shown:
        look, cost = ", ".join(one.text for one in shown), "parameters adapt to these, and may be off by more than"
        notes.append(f"residuals look like torques that no term of the model is: {look}; {cost} their deviations")
    # friction by the load is sought where it is shown, of joints that are alone on their coordinate
    loaded = np.isin(np.arange(len(m.joints)), [one.number for one in shown if one.kind == "friction by the load"])
    loaded = loaded & m.lone_joints & ("friction" in posed.terms)
    off = np.abs(np.divide(rest, roots, out=np.zeros_like(rest), where=roots > 0))
    notes += _push_notes(posed, np.maximum(rest**2, least), off)
    rotors = tuple(one.text for one in shown if one.kind == "rotor")
    return ShownTorques(loaded, rotors, any(one.kind == "factor" for one in shown), notes)


def _whiten_columns(columns: TorqueColumns, roots: np.ndarray) -> TorqueColumns:
    return replace(columns, rows=columns.rows * roots[..., None])


def _pursue(
    kinds: Sequence[TorqueColumns], U: np.ndarray, rest: np.ndarray, least: np.ndarray
) -> tuple[list[ShownTorque], np.ndarray]:
    """The torques that residuals (C, nv) show beyond orthonormal U (C, nv, r), and what is left of residuals then."""
    counts = [len(of.texts) for of in kinds]
    rows, texts = np.concatenate([of.rows for of in kinds], axis=-1), [text for of in kinds for text in of.texts]
    places = [(of.kind, number) for of in kinds for number in range(len(of.texts))]
    signed, certain, most = np.repeat([(of.signed, of.certain, of.most) for of in kinds], counts, axis=0).T
    shown, sizes = list[ShownTorque](), (rows**2).sum(axis=(0, 1))
    spectra = noise_spectra(leverages(U), rest, least)
    while True:
        # what U leaves of the columns, and their coefficients
        rows = rows - U @ gram(U, rows)
        norms = np.sqrt((rows**2).sum(axis=(0, 1)))
        units = rows / np.where(norms**2 > MIN_FREE_SHARE * sizes, norms, np.inf)
        amounts, spreads = gradient(units, rest), np.sqrt(np.diag(spectral_gram(units, spectra)))
        over = np.where(signed > 0, np.abs(amounts), amounts) / np.maximum(certain * spreads, np.finfo(float).tiny)
        found = np.divide(np.abs(amounts), norms, out=np.zeros_like(norms), where=norms > 0)
        over[found > most] = 0
        if not (over > 0).any():
            return shown, rest
        # the one that is chance least, by the spectrum of what it leaves
        k = int(over.argmax())
        more, left = np.concatenate([U, units[..., [k]]], axis=-1), rest - units[..., k] * amounts[k]
        spectra = noise_spectra(leverages(more), left, least)
        spread = np.sqrt(spectral_gram(units[..., [k]], spectra)[0, 0])
        if np.abs(amounts[k]) < certain[k] * spread:
            return shown, rest
        amount = f"{amounts[k] / norms[k]:.3g} +- {spread / norms[k]:.2g}"
        shown.append(ShownTorque(*places[k], texts[k].format(amount)))
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
