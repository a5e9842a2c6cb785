"""Forces, inertia and energy of the drive trains in the coordinates, by the laws of `model.drive_trains`."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from jounce.core.scalars import Array, concatenate
from jounce.core.typing import DriveTerm
from jounce.model import coordinates, drive_trains
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series, join_series


def forces(m: Mechanism, q: Series, terms: Sequence[str]) -> Series:
    """Return the contribution of some drive terms to Q, (..., n, 1)."""
    some = [term for term in drive_trains.stated_terms(m.drives) if term in terms]
    return coordinates.generalized_forces(
        m, drive_trains.forces(drive_trains.coefficients(m.drives), some, coordinates.joint_variables(m, q))
    )


def regressor(m: Mechanism, q: Series, terms: Sequence[DriveTerm]) -> Series:
    """Return the forces of unit parameters of some drive terms, (..., nv, nc) of each, side by side."""
    return _project_columns(m, _unit_terms(drive_trains.DRIVE_LAWS, m, q, terms))


def momentum_regressor(m: Mechanism, q: Series, terms: Sequence[DriveTerm]) -> Series:
    """Return the generalized momenta of unit parameters, like `regressor`: zero where a term has none."""
    return _project_columns(m, _unit_terms(drive_trains.MOMENTUM_LAWS, m, q, terms))


def energy_regressor(m: Mechanism, q: Series, terms: Sequence[DriveTerm]) -> Series:
    """Return the energies of unit parameters, (..., nc) of each term, one after the other: zero where it has none."""
    return join_series(_unit_terms(drive_trains.ENERGY_LAWS, m, q, terms), axis=-2).map(lambda E: E[..., 0])


def _unit_terms(
    laws: Mapping[DriveTerm, drive_trains.DriveLaw], m: Mechanism, q: Series, terms: Sequence[DriveTerm]
) -> list[Series]:
    c, theta = drive_trains.coefficients(m.drives), coordinates.joint_variables(m, q)
    return [drive_trains.unit_contribution(laws, c, term, theta) for term in terms]


def _project_columns(m: Mechanism, of_terms: Sequence[Series]) -> Series:
    """Columns, one for each joint, of what terms contribute at the joints."""
    by_joint = join_series([x * np.eye(len(m.joints), dtype=int) for x in of_terms], axis=-1)
    return pad_base(m, coordinates.generalized_forces(m, by_joint), (-2,))


def partials(m: Mechanism, q: Series, terms: Sequence[str]) -> tuple[Series, Series, Series]:
    """Return the contributions of some drive terms to dQ/dq, dQ/dqd and dQ/dq2d, (..., n, n) each."""
    by_joint = drive_trains.partials(drive_trains.coefficients(m.drives), terms, coordinates.joint_variables(m, q))
    K, D, M = (coordinates.generalized_matrix(m, x * np.eye(len(m.joints), dtype=int)) for x in by_joint)
    return K, D, M


def second_partials(m: Mechanism, q: Series, terms: Sequence[str]) -> Array:
    """Return the contribution of some drive terms to d2Q/dqd dqd, (..., nv, nv, nv): that of friction."""
    theta = coordinates.joint_variables(m, q)
    slopes = drive_trains.partials(
        drive_trains.coefficients(m.drives), terms, Series.of([theta[0], theta[1], 0 * theta[0] + 1])
    )[1]
    by_joint = slopes.dot[0] * m.G  # the rate of a derivative by theta', as if theta'' were 1
    tensor = (m.G.T[:, None, :] * m.G.T) @ by_joint[..., None, :, :]
    return pad_base(m, tensor, (-3, -2, -1))


def load_forces(m: Mechanism, law: Callable[..., Series], q: Series, Q: Series) -> Series:
    """Return a law of forces Q (..., nv, 1) at the lone joints whose friction grows with their load, 0 elsewhere."""
    loaded = np.flatnonzero(m.drives.load_friction)
    c = {name: x[loaded] for name, x in drive_trains.coefficients(m.drives).items()}
    onto = np.concatenate([np.zeros((m.nv - m.n, len(loaded)), dtype=int), m.G[loaded].T])
    return onto @ law(c, coordinates.joint_variables(m, q).map(lambda x: x[..., loaded, :]), onto.T @ Q)


def armature_matrix(m: Mechanism) -> Array:
    """Return the contribution of the armature to the mass matrix, which is constant: (n, n)."""
    return coordinates.generalized_matrix(m, m.drives.armature[:, None] * np.eye(len(m.joints), dtype=int))


def pad_base(m: Mechanism, x: Series | Array, axes: Sequence[int]) -> Series | Array:
    """What drives add to a quantity whose axes of velocities begin with those of a floating base: nothing there."""
    if not m.floats:
        return x
    if isinstance(x, Series):
        return x.map(lambda x: pad_base(m, x, axes))
    for axis in axes:
        first = (..., slice(0, 1), *[slice(None)] * (-1 - axis))
        x = concatenate([*[0 * x[first]] * 6, x], axis=axis)
    return x


def spring_energy(m: Mechanism, q: Series) -> Series:
    """The energy of the springs, (..., 1, 1)."""
    c = drive_trains.coefficients(m.drives)
    stretch = coordinates.joint_variables(m, q) - c["rest"]
    return stretch.mT @ (c["stiffness"] * stretch) * 0.5
