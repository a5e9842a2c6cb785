"""Mass and Coriolis matrices follow from composite inertias and joint screws.

This is CRBA, with rates. With S_j the screw of joint j as it moves in space, I_j the composite inertia of the bodies
that the joint carries, and a prime for the rate in space, the matrices of the joint variables are, where joint i
carries joint j or is j itself,

    M_ij = S_i . I_j S_j = M_ji,    C_ij = S_i . (I_j S_j)',    C_ji = S_j . (I_j S_i)',

and ``Cbar_ji = S_j . (I_j S_i' + Y_j S_i)``, ``Cbar_ij = M_ij' - Cbar_ji``, where Y_j sums -ad(V)^T M over the bodies
carried, so that ``I_j' = Y_j + Y_j^T``. The momenta and wrenches of joint j are transported inward and projected onto
the screw of joint i:

    Phi_ij = S_i' . I_j S_j,      Psi_ij = S_i . I_j' S_j,     Chi_ij = S_i . Y_j^T S_j,
    C_ij = M_ij' - Phi_ij,        C_ji = Phi_ij + Psi_ij,      Cbar_ji = Phi_ij + Chi_ij.

How often what runs: `_composites` once per evaluation, two sweeps inward; then one projection for M, three for C.

Composite inertias are 4x4 moments of mass, fewer numbers than 6x6 inertia matrices; all quantities are in frames on the
joint axes, because of the zeros there.

CRBA: R. Featherstone, Rigid Body Dynamics Algorithms, 6.2; M. W. Walker, D. E. Orin, J. Dyn. Sys. Meas. Control 104(3),
1982. Cbar by composite bodies: S. Echeandia, P. M. Wensing, J. Comput. Nonlinear Dynam. 16(9), 2021.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np

from jounce.dynamics.recursion.bodies import find_centre, shift_to_centre
from jounce.dynamics.recursion.joints import MovingJoint, batch_zeros
from jounce.dynamics.recursion.tree import (
    KinematicTree,
    ScrewColumns,
    collect,
    composites,
    evaluate_in_order,
    kinematic_tree,
    mask_above,
    project,
    velocities,
)
from jounce.dynamics.state import JointMotion
from jounce.model.equivalent_mechanisms import align_to_axes
from jounce.model.mechanism import Mechanism
from jounce.spatial.inertia import moment_matrix
from jounce.spatial.lie import ad, wedge
from jounce.spatial.series import Series


@dataclass(frozen=True)
class _Composites:
    """The composite inertias with the momenta of unit joint velocities."""

    tree: KinematicTree[MovingJoint]
    Pi: list[Series]  # (..., 4, 4) moments of mass of the bodies that each joint carries
    momenta: list[ScrewColumns]  # I_j S_j


def mass_matrix(m: Mechanism, q: Series) -> Series:
    """Return gM, the generalized mass matrix (MC): (..., nv, nv)."""
    bodies = _composites(m, q, None)
    # The upper triangle S_i . I_j S_j, and its mirror image.
    M = project(_screws(bodies), bodies.momenta)
    return _project_to_coordinates(
        bodies, q, M + _mirror_below(bodies, M), [*bodies.Pi[::-1], *_inward_values(bodies.momenta)]
    )


def coriolis_matrix(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """Return gC, the generalized Coriolis matrix (MC) of the paper's (Csys): (..., nv, nv)."""
    bodies = _composites(m, q, base)
    V = velocities(bodies.tree.joints)
    # I_j' in space, as moments of mass: Pi' in body axes, and wedge(V) Pi + Pi wedge(V)^T by the motion of the axes.
    flows = [V_i.map(lambda v: wedge(v[..., 0])) @ Pi for V_i, Pi in zip(V, bodies.Pi, strict=True)]
    rates_in_space = [Pi.dot + flow + flow.mT for Pi, flow in zip(bodies.Pi, flows, strict=True)]
    changes = collect(bodies.tree.joints, _momenta(bodies.tree, rates_in_space))
    M, Phi, Psi = _projections(bodies, V, changes)
    # C_ij = M_ij' - Phi_ij above the diagonal and on it, C_ji = Phi_ij + Psi_ij below.
    C = M.dot - Phi + _mirror_below(bodies, Phi + Psi)
    return _project_to_coordinates(bodies, q, C, [*_coriolis_steps(bodies, V), *_inward_values(changes)])


def skew_coriolis_matrix(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """Return gCbar, (Cbar), (..., nv, nv): the Coriolis matrix with gM' - 2 gCbar skew."""
    bodies = _composites(m, q, base)
    tree = bodies.tree.joints
    V = velocities(tree)
    b = [V_i.map(lambda v: ad(v[..., 0])) for V_i in V]  # (b)
    # Y_j, then the wrenches Y_j^T S_j.
    Y = composites(tree, [-(b_i.mT @ M_i) for b_i, M_i in zip(b, bodies.tree.M, strict=True)], MovingJoint.forms)
    wrenches = collect(tree, [Y_j.mT @ joint.X for Y_j, joint in zip(Y, tree, strict=True)])
    M, Phi, Chi = _projections(bodies, V, wrenches)
    # Cbar_ij = M_ij' - Cbar_ji and Cbar_ji = Phi_ij + Chi_ij.
    Cbar = M.dot - (Phi + Chi) + _mirror_below(bodies, Phi + Chi)
    return _project_to_coordinates(bodies, q, Cbar, [*_coriolis_steps(bodies, V), *Y[::-1], *_inward_values(wrenches)])


def centroidal_momentum_matrix(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """Return AG, the centroidal momenta of unit velocities.

    AG is (..., 6, nv). They are in inertial axes.
    """
    bodies = _composites(m, q, None if base is None else base.at_origin)
    unit, columns = np.eye(len(bodies.tree.G), dtype=int), zip(bodies.tree.joints, bodies.momenta, strict=True)
    # Joints on the ground have the columns of all joints; there they are about the inertial origin.
    roots = [joint.wrenches(p.values) @ unit[p.screws] for joint, p in columns if joint.parent < 0]
    A = (reduce(add, roots) + batch_zeros(q)) @ bodies.tree.G
    A = evaluate_in_order(A, [*bodies.Pi[::-1], *_inward_values(bodies.momenta)])
    return shift_to_centre(A, find_centre(m, bodies.tree, q))


def _composites(m: Mechanism, q: Series, base: JointMotion | None) -> _Composites:
    """Return the composite inertias at coordinates q, and I_j S_j transported inward."""
    tree = kinematic_tree(align_to_axes(m), q, base)
    Pi = composites(tree.joints, [Series.constant(Pi_i) for Pi_i in moment_matrix(tree.M)], MovingJoint.moments)
    return _Composites(tree, Pi, collect(tree.joints, _momenta(tree, Pi)))


def _momenta(tree: KinematicTree[MovingJoint], Pi: Sequence[Series]) -> list[Series]:
    """Return I_j S_j from moments of mass.

    From their rates it is I_j' S_j.
    """
    return [joint.momentum(Pi_j) for joint, Pi_j in zip(tree.joints, Pi, strict=True)]


def _screws(bodies: _Composites) -> list[Series]:
    return [Series.constant(joint.X) for joint in bodies.tree.joints]


def _projections(bodies: _Composites, V: Sequence[Series], wrenches: Sequence[ScrewColumns]) -> tuple[Series, ...]:
    """Return the triangles M and Phi, and that of the wrenches: Psi or Chi."""
    rates = [joint.screw_rate(V_i) for joint, V_i in zip(bodies.tree.joints, V, strict=True)]
    return project(_screws(bodies), bodies.momenta), project(rates, bodies.momenta), project(_screws(bodies), wrenches)


def _mirror_below(bodies: _Composites, triangle: Series) -> Series:
    """Return the entries above the diagonal as those below."""
    return mask_above(triangle, bodies.tree.joints).unkept.mT.unkept


def _project_to_coordinates(bodies: _Composites, q: Series, matrix: Series, steps: Sequence[Series]) -> Series:
    """Return G^T M G of a matrix of all joints.

    It is evaluated step by step.
    """
    return evaluate_in_order(bodies.tree.generalized_matrix((matrix.unkept + batch_zeros(q)).unkept).unkept, steps)


def _inward_values(columns: Sequence[ScrewColumns]) -> list[Series]:
    """Return the values of columns in the order of the sweep inward."""
    return [c.values for c in reversed(columns)]


def _coriolis_steps(bodies: _Composites, V: Sequence[Series]) -> list[Series]:
    """Return the steps to C.

    C needs one more rate of moments and momenta than itself has.
    """
    return [*V, *(Pi.dot for Pi in reversed(bodies.Pi)), *(p.dot for p in _inward_values(bodies.momenta))]
