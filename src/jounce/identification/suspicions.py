"""Measured forces whose sign or unit is not that of the model."""

import numpy as np

from jounce.errors import listed
from jounce.identification.cells import Cells

OPPOSED = -0.5  # correlation of measured forces with those of the model, below which their sign is suspected
ALIKE = 0.8  # and that above which their size is compared
FACTOR = 10.0  # in size, beyond which the unit is suspected: no parameters are that wrong


def suspicions(cells: Cells, names: tuple[str, ...]) -> list[str]:
    """Return what is suspicious about measured forces, by their correlation with the forces of the model."""
    measured = cells.off + cells.model
    shared = (cells.counts * measured * cells.model).sum(axis=0)
    of_model = (cells.counts * cells.model**2).sum(axis=0)
    of_forces = (cells.counts * measured**2).sum(axis=0)
    there = (of_model > 0) & (of_forces > 0)
    correlation = np.where(there, shared / np.sqrt(np.where(there, of_model * of_forces, 1.0)), 0.0)
    size = np.where(there, np.sqrt(of_forces / np.where(there, of_model, 1.0)), 1.0)
    alike = np.abs(correlation) > ALIKE
    found = []
    if (opposed := correlation < OPPOSED).any():
        worst = correlation[opposed].min()
        found.append(
            f"forces of {_of(names, opposed)} seem to have the wrong sign: their correlation with the model's is"
            f" {worst:.2g}; expected Q = M q2d + C qd + Qgrav, which the drives exert on the robot"
        )
    if (odd := alike & (np.abs(np.log(size)) > np.log(FACTOR))).any():
        ratio = float(np.exp(np.log(size[odd]).mean()))
        found.append(
            f"forces of {_of(names, odd)} seem to have the wrong unit: they are {ratio:.3g} times those of the model;"
            " expected N m or N at the joints, behind the gears"
        )
    return found


def _of(names: tuple[str, ...], which: np.ndarray) -> str:
    return "all joints" if which.all() else listed(name for name, odd in zip(names, which, strict=True) if odd)
