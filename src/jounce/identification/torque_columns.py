"""Torques that may act on a robot and that no parameter holds: of each a column, one unit of it along a log.

* friction that grows with the load, |Q| tanh(v / eps) with the torque Q of the bodies;
* a constant force on the last body, as of a cable;
* springs of joints, as of a hose;
* rotors of joints;
* torques of a joint that are read too large, by a wrong torque constant: the torque itself;
* a load on the last body from some time on: the torque of a mass at its origin.

Springs pull back, and friction and rotors are positive; the others have either sign.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from jounce.core.errors import shorten
from jounce.engine.plan import compute
from jounce.identification.averaging import number_cells, weighted_means
from jounce.identification.force_warnings import MAX_PASSIVE_SHARE
from jounce.identification.least_squares_problem import IdentificationProblem
from jounce.spatial.inertia import INERTIAL_PARAMETERS

MAX_DEVIATIONS = 4.0  # of a coefficient by chance: once in 1000 logs with some twenty columns
MAX_MOTION_DEVIATIONS = 6.0  # of what errors of accelerations look like, up to 4.2: rotors, factors, loads
MAX_LOAD_SHARE = 0.5  # of friction that grows with the load: gears with more lock themselves
MAX_GAIN = 0.5  # of torques that are read too large: more is a wrong unit, or a joint without a motor
LOAD_TIMES = 15  # at which a load may begin or end: even parts of a log


TorqueKind = Literal["friction by the load", "force", "spring", "rotor", "factor", "load"]


@dataclass(frozen=True, eq=False)
class TorqueColumns:
    """Columns of K torques of one kind."""

    kind: TorqueKind
    rows: np.ndarray  # (C, nv, K)
    texts: tuple[str, ...]  # what they are, with {} for the amount
    certain: float = MAX_DEVIATIONS  # deviations beyond which an amount is none by chance
    signed: bool = False  # whether amounts below 0 make sense
    most: float = np.inf  # amount beyond which it is something else


def mean_rates(posed: IdentificationProblem) -> list[np.ndarray]:
    """q, qd and q2d (C, n), averaged over cells."""
    t = posed.samples.t
    ones, place = np.ones((len(t), 1)), number_cells(t, posed.width)
    return [weighted_means(rate, ones, place)[0] for rate in posed.motion(t, 2)]


def load_friction_columns(posed: IdentificationProblem, x: np.ndarray) -> TorqueColumns:
    """Friction that grows with the load by corrections x, where friction is sought."""
    joints, base, Y = posed.robot.mechanism.joints, posed.base, posed.cells.Y
    if "friction" not in posed.terms:
        return _no_columns(posed, "friction by the load")
    first = len(base.parameters) + len(joints) * posed.terms.index("friction")
    load = np.abs(Y[..., base.columns] @ (base.values + x[: base.count]))
    rows = load[..., None] * Y[..., first : first + len(joints)]
    texts = tuple(f"friction of {shorten(joint)} that grows by {{}} of its load" for joint in joints)
    return TorqueColumns("friction by the load", rows, texts, most=MAX_LOAD_SHARE)


def force_columns(posed: IdentificationProblem, q: np.ndarray) -> TorqueColumns:
    """A constant force on the last body of a robot whose base stands still, at positions (C, n)."""
    m = posed.robot.mechanism
    if posed.motion.base_curve is not None:
        return _no_columns(posed, "force")
    J = compute(posed.robot, "jacobian", (q,), body=m.bodies[-1], frame="world")
    texts = tuple(f"a force of {{}} N along {axis} on {shorten(m.bodies[-1])}" for axis in "xyz")
    return TorqueColumns("force", -np.asarray(J)[:, 3:].mT, texts, signed=True)


def spring_columns(posed: IdentificationProblem, q: np.ndarray) -> TorqueColumns:
    """Springs of joints about the means of positions (C, n)."""
    m = posed.robot.mechanism
    if posed.motion.base_curve is not None:
        return _no_columns(posed, "spring")
    rows = ((q - q.mean(axis=0)) @ m.G.T)[:, None] * m.G.T
    units = _joint_units(posed, "N m/rad", "N/m")
    texts = (f"a spring of {{}} {unit} at {shorten(j)}" for unit, j in zip(units, m.joints, strict=True))
    return TorqueColumns("spring", rows, tuple(texts))


def rotor_columns(posed: IdentificationProblem, q2d: np.ndarray) -> TorqueColumns:
    """Rotors of joints at accelerations (C, n), where drives are sought and these are not among them."""
    m = posed.robot.mechanism
    if "armature" in posed.terms or m.elasticity is not None or not posed.terms:
        return _no_columns(posed, "rotor")
    rows = _pad_forces(posed, (q2d @ m.G.T)[:, None] * m.G.T)
    units = _joint_units(posed, "kg m^2", "kg")
    texts = (f"a rotor of {{}} {unit} at {shorten(j)}" for unit, j in zip(units, m.joints, strict=True))
    return TorqueColumns("rotor", rows, tuple(texts), MAX_MOTION_DEVIATIONS)


def gain_columns(posed: IdentificationProblem, x: np.ndarray) -> TorqueColumns:
    """Torques of joints with motors that are read too large, by those of corrections x."""
    m, cells = posed.robot.mechanism, posed.cells
    Q = cells.model + cells.Y[..., posed.columns] @ x
    parts = posed.single_forces(posed.corrected_parameters(x)[posed.places])
    active = np.sqrt((Q**2).mean(axis=0)) > MAX_PASSIVE_SHARE * parts
    rows = _pad_forces(posed, (Q * active)[:, -m.n :, None] * np.eye(m.n))
    texts = (f"torques of {shorten(joint)} that are read too large by {{}} of them" for joint in m.coordinates)
    return TorqueColumns("factor", rows, tuple(texts), MAX_MOTION_DEVIATIONS, signed=True, most=MAX_GAIN)


def load_change_columns(posed: IdentificationProblem) -> TorqueColumns:
    """A load on the last body that begins, or ends, at some times."""
    body = len(posed.robot.mechanism.bodies) - 1
    of_mass = posed.cells.Y[..., len(INERTIAL_PARAMETERS) * body]
    t, count = posed.samples.t, len(of_mass)
    first = t[np.unique(number_cells(t, posed.width), return_index=True)[1]]
    starts = np.unique(count * np.arange(1, LOAD_TIMES + 1) // (LOAD_TIMES + 1))
    rows = of_mass[..., None] * (np.arange(count)[:, None] >= starts)[:, None]
    name = shorten(posed.robot.mechanism.bodies[-1])
    texts = tuple(f"a change of the load on {name} of {{}} kg at {first[k]:.3g} s" for k in starts)
    return TorqueColumns("load", rows, texts, MAX_MOTION_DEVIATIONS, signed=True)


def _no_columns(posed: IdentificationProblem, kind: TorqueKind) -> TorqueColumns:
    return TorqueColumns(kind, posed.cells.Y[..., :0], ())


def _pad_forces(posed: IdentificationProblem, rows: np.ndarray) -> np.ndarray:
    """Columns (C, nv, K) of all forces from those (C, n, K) of joints: none act on a base."""
    return np.pad(rows, ((0, 0), (posed.cells.Y.shape[1] - rows.shape[1], 0), (0, 0)))


def _joint_units(posed: IdentificationProblem, turning: str, sliding: str) -> Sequence[str]:
    return [turning if np.any(X[:3]) else sliding for X in posed.robot.mechanism.X]
