"""Mass and Coriolis matrices from composite inertias projected onto joint screws (CRBA, with rates).

With S_j the screw of joint j as it moves in space, I_j the composite inertia of the bodies that the joint carries, and
a prime for the rate in space, the matrices of the joint variables are, where joint i carries joint j or is j itself,

    M_ij = S_i . I_j S_j = M_ji,    C_ij = S_i . (I_j S_j)',    C_ji = S_j . (I_j S_i)',

and ``Cbar_ji = S_j . (I_j S_i' + Y_j S_i)``, ``Cbar_ij = M_ij' - Cbar_ji``, where Y_j sums -ad(V)^T M over the bodies
carried, so that ``I_j' = Y_j + Y_j^T``. The momenta and wrenches of joint j are transported inward and projected onto
the screw of joint i:

    Phi_ij = S_i' . I_j S_j,      Psi_ij = S_i . I_j' S_j,     Chi_ij = S_i . Y_j^T S_j,
    C_ij = M_ij' - Phi_ij,        C_ji = Phi_ij + Psi_ij,      Cbar_ji = Phi_ij + Chi_ij.

Composite inertias are 4x4 moments of mass, fewer numbers than 6x6 inertia matrices; all quantities are in frames on
the joint axes, because of the zeros there.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from jounce.dynamics.recursion.joints import Joint, batch_zeros, joints
from jounce.dynamics.recursion.sweeps import Columns, above, collect, composites, evaluate_in_order, project, velocities
from jounce.model.coordinates import generalized_matrix
from jounce.model.equivalent import on_axes
from jounce.model.mechanism import Mechanism
from jounce.spatial.inertia import moment_matrix
from jounce.spatial.lie import ad, cowedge, wedge
from jounce.spatial.series import Series


@dataclass(frozen=True)
class _Composites:
    """The composite inertias of a mechanism, and the momenta that unit joint velocities give them."""

    chain: Mechanism
    tree: list[Joint]
    Pi: list[Series]  # (..., 4, 4) moments of mass of the bodies that each joint carries
    momenta: list[Columns]  # I_j S_j


def mass_matrix(mechanism: Mechanism, q: Series) -> Series:
    """gM, the generalized mass matrix (MC): (..., n, n)."""
    bodies = _composites(mechanism, q)
    M = project(_screws(bodies), bodies.momenta)  # its upper triangle
    return evaluate_in_order(_to_coordinates(bodies, q, M + above(M).mT), [*bodies.Pi[::-1], *_sweep(bodies.momenta)])


def coriolis_matrix(mechanism: Mechanism, q: Series) -> Series:
    """gC, the generalized Coriolis matrix (MC) of the paper's (Csys): (..., n, n)."""
    bodies = _composites(mechanism, q)
    V = velocities(bodies.tree)
    flows = [V_i.map(lambda v: wedge(v[..., 0])) @ Pi for V_i, Pi in zip(V, bodies.Pi, strict=True)]
    rates = [Pi.dot + flow + flow.mT for Pi, flow in zip(bodies.Pi, flows, strict=True)]  # in space
    changes = collect(bodies.tree, _momenta(bodies.tree, rates))  # I_j' S_j
    M, Phi, Psi = (
        project(_screws(bodies), bodies.momenta),
        project(_screw_rates(bodies, V), bodies.momenta),
        project(_screws(bodies), changes),
    )
    C = M.dot - Phi + above(Phi + Psi).mT
    return evaluate_in_order(_to_coordinates(bodies, q, C), [*_dynamic(bodies, V), *_sweep(changes)])


def skew_coriolis_matrix(mechanism: Mechanism, q: Series) -> Series:
    """gCbar, the generalized Coriolis matrix (Cbar) for which gM' - 2 gCbar is skew: (..., n, n)."""
    bodies = _composites(mechanism, q)
    V = velocities(bodies.tree)
    b = [V_i.map(lambda v: ad(v[..., 0])) for V_i in V]  # (b)
    Y = composites(bodies.tree, [-(b_i.mT @ M_i) for b_i, M_i in zip(b, bodies.chain.M, strict=True)], Joint.forms)
    wrenches = collect(bodies.tree, [Y_j.mT @ joint.X for Y_j, joint in zip(Y, bodies.tree, strict=True)])
    M, Phi, Chi = (
        project(_screws(bodies), bodies.momenta),
        project(_screw_rates(bodies, V), bodies.momenta),
        project(_screws(bodies), wrenches),
    )
    Cbar = M.dot - (Phi + Chi) + above(Phi + Chi).mT
    return evaluate_in_order(_to_coordinates(bodies, q, Cbar), [*_dynamic(bodies, V), *Y[::-1], *_sweep(wrenches)])


def _composites(mechanism: Mechanism, q: Series) -> _Composites:
    chain = on_axes(mechanism)
    tree = joints(chain, q)
    Pi = composites(tree, [Series.constant(Pi_i) for Pi_i in moment_matrix(chain.M)], Joint.moments)
    return _Composites(chain, tree, Pi, collect(tree, _momenta(tree, Pi)))


def _momenta(tree: Sequence[Joint], Pi: Sequence[Series]) -> list[Series]:
    """I_j S_j from the moments of mass, or from their rates."""
    flows = (joint.X_hat @ Pi_j for joint, Pi_j in zip(tree, Pi, strict=True))
    return [flow.map(lambda T: cowedge(T)[..., None]) for flow in flows]


def _screws(bodies: _Composites) -> list[Series]:
    return [Series.constant(joint.X) for joint in bodies.tree]


def _screw_rates(bodies: _Composites, V: Sequence[Series]) -> list[Series]:
    return [-(joint.ad_X @ V_i) for joint, V_i in zip(bodies.tree, V, strict=True)]  # ad(V) X = -ad(X) V


def _to_coordinates(bodies: _Composites, q: Series, matrix: Series) -> Series:
    return generalized_matrix(bodies.chain, matrix + batch_zeros(q))


def _sweep(columns: Sequence[Columns]) -> list[Series]:
    return [c.values for c in reversed(columns)]


def _dynamic(bodies: _Composites, V: Sequence[Series]) -> list[Series]:
    """The steps to C, which needs one more rate of moments and momenta than C itself has."""
    return [*V, *(Pi.dot for Pi in reversed(bodies.Pi)), *(p.dot for p in _sweep(bodies.momenta))]
