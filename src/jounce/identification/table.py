"""The parameters that data tell: base parameters and those of drive terms, with deviations, and which are seen."""

from dataclasses import dataclass

import numpy as np

from jounce.core.typing import DriveColumn
from jounce.dynamics.base_parameters import BaseParameters
from jounce.identification.cells import Cells
from jounce.identification.problem import Problem
from jounce.identification.regression import Solution, row_weights
from jounce.model.mechanism import Mechanism
from jounce.spatial import inertia

INERTIAL_UNITS = ("kg", *["kg m"] * 3, *["kg m^2"] * 6)  # of the inertial parameters of one body
LENGTH_POWERS = np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])  # of a length in them
MIN_DRIVE_FORCE_SHARE = 0.01  # of a force: less is not worth the name of a drive term
TRACE_PLACES = [inertia.PARAMETERS.index(name) for name in ("Ixx", "Iyy", "Izz")]


@dataclass(frozen=True)
class IdentifiedParameter:
    """A base parameter or a parameter of a drive term, as the data alone tell it.

    Attributes
    ----------
    name, unit : str
        A base parameter is named after the inertial parameter that it contains with the factor 1.
    value, deviation : float
        The least-squares estimate and its standard deviation, which is infinite if the data hold nothing on it.
    model : float
        The value of the model as it was.
    seen : bool
        Whether the deviation is smaller than the size of the parameter: the largest of its value, that of the model,
        and what mass and extent of its body suggest; for drive terms, what forces and their residuals suggest.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r")
    >>> motion = jounce.Motion.fourier([0, 0], [[0.5, 0.2], [0.1, 0.4]], [[0.1, 0.3], [0.5, 0.2]], 3.0, 4.0)
    >>> found = robot.identify(motion, robot.forces_along(motion, order=0).forces[0])
    >>> row = found.table[0]
    >>> row.name, row.unit, round(row.value, 6), row.seen
    ('body1 mcx', 'kg m', 2.0, True)
    """

    name: str
    unit: str
    value: float
    deviation: float
    model: float
    seen: bool


def parameter_table(posed: Problem, solution: Solution, variances: np.ndarray) -> tuple[IdentifiedParameter, ...]:
    """The table of a solution, which corrects the model, with the variances (nv,) of the forces."""
    m, base, model = posed.robot.mechanism, posed.base, posed.own
    revolute = [bool(np.any(X[:3])) for X in m.X]
    names = [*base.names, *(f"{joint} {term}" for term in posed.terms for joint in m.joints)]
    units = [INERTIAL_UNITS[column % len(INERTIAL_UNITS)] for column in base.columns]
    units += [_unit(term, turns) for term in posed.terms for turns in revolute]
    values, spreads = model + solution.x, np.sqrt(np.diag(solution.covariance))
    sizes = np.append(_inertial_sizes(m, base), _drive_sizes(posed.cells, variances, posed.columns[base.count :]))
    seen = spreads <= np.maximum(sizes, np.maximum(np.abs(values), np.abs(model)))
    return tuple(
        IdentifiedParameter(name, unit, float(values[k]), float(spreads[k]), float(model[k]), bool(seen[k]))
        for k, (name, unit) in enumerate(zip(names, units, strict=True))
    )


def _inertial_sizes(m: Mechanism, base: BaseParameters) -> np.ndarray:
    """The sizes of the base parameters: m, m r or m r^2 of a body, r its radius about the origin of its frame."""
    p = inertia.parameters(m.M).astype(float)
    mass, moments = np.abs(p[:, 0]), np.abs(p[:, TRACE_PLACES].sum(axis=1)) / 2
    r = np.sqrt(np.divide(moments, mass, out=np.zeros_like(mass), where=mass > 0))
    mass, r = (np.where(x > 0, x, x[x > 0].mean() if x.any() else 0.0) for x in (mass, r))
    return (mass[:, None] * r[:, None] ** LENGTH_POWERS).ravel()[base.columns]


def _drive_sizes(cells: Cells, variances: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """The sizes of drive parameters: each alone makes forces as large as those that the model leaves where it acts.

    A hundredth of the measured forces counts too: of a model that leaves nothing it is seen that it leaves nothing.
    """
    weights = row_weights(cells, variances)
    left = (weights * (cells.off**2 + (MIN_DRIVE_FORCE_SHARE * (cells.off + cells.model)) ** 2)).sum(axis=0)
    power = (weights[..., None] * cells.Y[..., columns] ** 2).sum(axis=0)
    total = power.sum(axis=0)
    return np.sqrt(((power > 0) * left[:, None]).sum(axis=0) / np.where(total > 0, total, np.inf))


def _unit(term: DriveColumn, turns: bool) -> str:
    """The unit of a drive parameter of a revolute joint, or of a prismatic one."""
    if term == "armature":
        return "kg m^2" if turns else "kg"
    force, path = ("N m", "rad") if turns else ("N", "m")
    return {"damping": f"{force} s/{path}", "spring": f"{force}/{path}"}.get(term, force)
