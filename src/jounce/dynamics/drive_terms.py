"""Drive trains contribute forces, inertia and energy in the coordinates.

The laws are those of `model.drive_trains`.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from jounce.core.scalars import Array, concatenate
from jounce.core.typing import DriveTerm
from jounce.model import coordinates, drive_trains
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series, join_series


def forces(m: Mechanism, q: Series, terms: Sequence[str]) -> Series:
    """Return the contribution of some drive terms to Q, (..., n, 1)."""
    stated_terms = [term for term in drive_trains.stated_terms(m.drives) if term in terms]
    by_joint = drive_trains.forces(drive_trains.coefficients(m.drives), stated_terms, coordinates.joint_variables(m, q))
    return coordinates.generalized_forces(m, by_joint)


def regressor(m: Mechanism, q: Series, terms: Sequence[DriveTerm]) -> Series:
    """Return the forces of unit parameters of drive terms.

    There are (..., nv, nc) of each term, side by side.
    """
    return _project_columns(m, _unit_terms(drive_trains.DRIVE_LAWS, m, q, terms))


def momentum_regressor(m: Mechanism, q: Series, terms: Sequence[DriveTerm]) -> Series:
    """Return the generalized momenta of unit parameters, like `regressor`: zero where a term has none."""
    return _project_columns(m, _unit_terms(drive_trains.MOMENTUM_LAWS, m, q, terms))


def energy_regressor(m: Mechanism, q: Series, terms: Sequence[DriveTerm]) -> Series:
    """Return the energies of unit parameters of drive terms.

    There are (..., nc) of each term, one after the other. They are zero where a term has none.
    """
    return join_series(_unit_terms(drive_trains.ENERGY_LAWS, m, q, terms), axis=-2).map(lambda E: E[..., 0])


def _unit_terms(
    laws: Mapping[DriveTerm, drive_trains.DriveLaw], m: Mechanism, q: Series, terms: Sequence[DriveTerm]
) -> list[Series]:
    """Return the contributions of unit parameters at the joints.

    There is a column (..., nc, 1) for each term.
    """
    c, theta = drive_trains.coefficients(m.drives), coordinates.joint_variables(m, q)
    return [drive_trains.unit_contribution(laws, c, term, theta) for term in terms]


def _project_columns(m: Mechanism, contributions: Sequence[Series]) -> Series:
    """Return columns of contributions of each joint, side by side.

    Contributions (..., nc, 1) become columns (..., nv, nc).
    """
    # A diagonal matrix has a column for each joint, which acts there alone.
    by_joint = join_series([x * np.eye(len(m.joints), dtype=int) for x in contributions], axis=-1)
    return pad_base(m, coordinates.generalized_forces(m, by_joint), (-2,))


def partials(m: Mechanism, q: Series, terms: Sequence[str]) -> tuple[Series, Series, Series]:
    """Return the contributions to dQ/dq, dQ/dqd and dQ/dq2d.

    They are (..., n, n) each, of some drive terms.
    """
    by_joint = drive_trains.partials(drive_trains.coefficients(m.drives), terms, coordinates.joint_variables(m, q))
    K, D, M = (coordinates.generalized_matrix(m, x * np.eye(len(m.joints), dtype=int)) for x in by_joint)
    return K, D, M


def second_partials(m: Mechanism, q: Series, terms: Sequence[str]) -> Array:
    """Return the contribution of drive terms to d2Q/dqd dqd.

    The shape is (..., nv, nv, nv). Friction alone has one.
    """
    theta = coordinates.joint_variables(m, q)
    slopes = drive_trains.partials(
        drive_trains.coefficients(m.drives), terms, Series.of([theta[0], theta[1], 0 * theta[0] + 1])
    )[1]
    # With theta'' = 1 the rate of a derivative by theta' is its derivative by theta'. (nc, n) by joint, then sums over
    # joints of G_ji G_jk G_jl times it.
    by_joint = slopes.dot[0] * m.G
    tensor = (m.G.T[:, None, :] * m.G.T) @ by_joint[..., None, :, :]
    return pad_base(m, tensor, (-3, -2, -1))


def load_forces(m: Mechanism, law: Callable[..., Series], q: Series, Q: Series) -> Series:
    """Return forces of joints whose friction grows with their load.

    `law` computes them from forces Q (..., nv, 1). These are lone joints, each of one coordinate of its own. The law is
    zero elsewhere.
    """
    loaded = np.flatnonzero(m.drives.load_friction)
    c = {name: x[loaded] for name, x in drive_trains.coefficients(m.drives).items()}
    onto = np.concatenate([np.zeros((m.nv - m.n, len(loaded)), dtype=int), m.G[loaded].T])
    return onto @ law(c, coordinates.joint_variables(m, q).map(lambda x: x[..., loaded, :]), onto.T @ Q)


def armature_matrix(m: Mechanism) -> Array:
    """Return the constant contribution of the armature to the mass matrix.

    The shape is (n, n).
    """
    return coordinates.generalized_matrix(m, m.drives.armature[:, None] * np.eye(len(m.joints), dtype=int))


def pad_base(m: Mechanism, x: Series | Array, axes: Sequence[int]) -> Series | Array:
    """Pad contributions with zeros for the velocities of a base.

    `axes`, counted from the end, are those of velocities.
    """
    if not m.floats:
        return x
    if isinstance(x, Series):
        return x.map(lambda x: pad_base(m, x, axes))
    for axis in axes:
        # Six zeros of the kind and the shape of the first entry along the axis.
        first = (..., slice(0, 1), *[slice(None)] * (-1 - axis))
        x = concatenate([*[0 * x[first]] * 6, x], axis=axis)
    return x


def spring_energy(m: Mechanism, q: Series) -> Series:
    """Return the energy of the springs, (..., 1, 1)."""
    c = drive_trains.coefficients(m.drives)
    stretch = coordinates.joint_variables(m, q) - c["rest"]
    return stretch.mT @ (c["stiffness"] * stretch) * 0.5
