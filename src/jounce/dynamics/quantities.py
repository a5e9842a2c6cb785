"""The table of quantities, one row each, with everything that is known about them. It is the index of the package.

Native code, generated code, CasADi, symbolic form, the command and the documentation derive what they need from these
rows. A new quantity takes its mathematics, a row, and a method of `Robot`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from jounce.core.scalars import Array, element
from jounce.dynamics import closed_form as dense
from jounce.dynamics import (
    coupling,
    drive_terms,
    elastic,
    electrical,
    forward,
    kinematics,
    loop_partials,
    loops,
    partials,
)
from jounce.dynamics.base import BaseMotion
from jounce.dynamics.paper import Paper
from jounce.dynamics.recursion import (
    articulated,
    bodies,
    energy_regressor,
    force_partials,
    forces,
    matrices,
    momenta,
    regressor,
)
from jounce.dynamics.recursion.forces import Sweep
from jounce.dynamics.state import Law, State
from jounce.dynamics.stretch import NO_INPUTS, elasticity_of, with_stiffness
from jounce.model.drives import TERMS
from jounce.model.elasticity import Elasticity
from jounce.model.mechanism import Mechanism
from jounce.spatial.linear import Factors
from jounce.spatial.series import Series, rate_name

# "n" coordinates, "nv" velocities, "nb" bodies, "parameters" ten inertial ones per body, "rates" q, qd, ..., as many as
# the quantity or its rate takes; of closed robots the coordinates of the "tree", "loops", "motors"
Axis = int | str


@dataclass(frozen=True)
class Method:
    """A law, the function that computes a quantity, and the number of its working scalars for a state of nb bodies."""

    law: Law
    width: Callable[[int], int] = lambda nb: (6 * nb) ** 2  # dense system matrices
    base: bool = True  # whether the base may move


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """One quantity. All its methods agree; the first is the default."""

    name: str
    symbol: str  # names of results: Q, Qd, Q2d
    first_rate: int = 0  # of the symbol, which the quantity itself is: 2 of accelerations
    rates: int  # how many of q, qd, ... the quantity itself takes
    forces: bool = False  # whether the last of these, and what follows, are generalized forces Q, Qd, ...
    inputs: tuple[str, ...] = ()  # their names where motors have a state of their own: q, qd, theta, thetad, ...
    shape: tuple[Axis, ...]  # of one state; the axis "nb" is absent where one body is named
    methods: Mapping[str, Method]
    unit: str
    caption: str  # a noun phrase
    meaning: str  # a sentence for the head of generated code
    tex: str
    tex_symbol: str = ""  # where it is not printed as it is named; one index at most, in braces
    wrench_term: str = ""  # what wrenches on the bodies add to it, a noun phrase; empty where they do not enter
    wrench_tex: str = ""
    wrench_rates: int = 1  # how many of W, Wd, ... the quantity itself takes, where they enter
    elastic: bool = False  # whether it is one of robots with elastic joints only
    inductive: bool = False  # whether it takes a rate more if a motor has an inductance
    obstacle: Callable[[Mechanism], str | None] | None = None  # why a robot has none of it, the end of a sentence
    of_motors: str = ""  # the quantity that release 0.1 had under its name for robots with elastic joints
    closed: bool = False  # whether it is one of robots with closed loops only
    all_constraints: bool = False  # whether constraints are solved for followers with constant ratios too
    drive_terms: tuple[str, ...] = ()  # which of those that act enter
    drive_law: Law | None = None  # what they add
    results: tuple[str, ...] = ()  # of a quantity of several results, which has no rates: the terms of its law
    frames: tuple[str, ...] = ()  # in which its components may be given, the default first
    sweep: Sweep | None = None  # of the recursion, where its steps are those of forces
    without_base: tuple[str, ...] = ()  # frames in which neither the pose nor the twist of the base enters
    turns_with: str = ""  # of a matrix of velocities, which quantity times F' is added where loops are closed

    @property
    def wrenches(self) -> bool:
        """Whether wrenches on the bodies enter."""
        return bool(self.wrench_term)

    @property
    def inverts(self) -> bool:
        """Whether it takes the inverse of the mass matrix."""
        return self.forces or bool(self.inputs)

    @property
    def takes_stiffness(self) -> bool:
        """Whether the stiffness of joints with two motors enters, as often as wrenches."""
        return self.elastic and not self.inputs

    @property
    def everywhere(self) -> bool:
        """Whether all robots have it."""
        return not (self.elastic or self.closed)

    @property
    def follows_others(self) -> bool:
        """Whether its laws take those of other quantities, with loops closed as they are."""
        return self.forces or self.elastic or self.closed or "rates" in self.shape

    @property
    def of_bodies(self) -> bool:
        """Whether it is a quantity of bodies, one of which may be selected."""
        return "nb" in self.shape

    def names(self, order: int) -> tuple[str, ...]:
        """The names of the quantity and its rates, or of its results."""
        return self.results or tuple(rate_name(self.symbol, self.first_rate + k) for k in range(order + 1))

    def highest(self, order: int) -> int:
        """The highest order up to this one that the quantity has."""
        return 0 if self.results else order

    def coordinate_inputs(self, count: int) -> int:
        """How many of its first inputs are q, qd, ...; the others are forces, or the state of the motors."""
        return min(count, 2 if self.inputs else self.rates - 1) if self.inverts else count

    def input_names(self, count: int) -> tuple[str, ...]:
        """The names of its first inputs: q, qd, q2d, ..., or q, qd, Q, Qd, ..."""
        if self.inputs:
            return (*self.inputs, *(rate_name(self.inputs[-1], k + 1) for k in range(count)))[:count]
        own = self.coordinate_inputs(count)
        return tuple(rate_name("q", k) if k < own else rate_name("Q", k - own) for k in range(count))

    def law(self, method: str, mechanism: Mechanism) -> Law:
        """Return the law of a method for a mechanism, with the drive terms that act."""
        if mechanism.closure and not self.follows_others:
            of_turning = QUANTITIES[self.turns_with].law(method, mechanism.tree) if self.turns_with else None
            return loops.law(self.law(method, mechanism.tree), self.shape, of_turning)
        rigid, added = self.methods[method].law, self.drive_law
        if added is None or mechanism.closure or not set(self.drive_terms) & set(mechanism.acting):
            return rigid  # where loops are closed, it has those of the tree
        if self.shape:
            axes = tuple(k - len(self.shape) for k, axis in enumerate(self.shape) if axis == "nv")
            return lambda m, x: rigid(m, x) + drive_terms.behind_base(m, added(m, x), axes)
        return lambda m, x: (rigid(m, x) + added(m, x)).map(_array)


def _array(total: Any) -> Array:
    """A sum of arrays without axes as an array again: NumPy makes a scalar of it."""
    return np.asarray(total) if isinstance(total, np.ndarray | np.generic) else element(total, "a sum")


def _column(nb: int) -> int:
    """The width of a method that works on one column of vectors."""
    return 4 * nb


def _columns(nb: int) -> int:
    """The width of a method that works on columns of screws, one for each joint."""
    return 6 * nb


def _ten(nb: int) -> int:
    """The width of a method that works on ten numbers per body."""
    return 10 * nb


def _row(column: Series) -> Series:
    """Columns (..., n, 1) as (..., n)."""
    return column.map(lambda Q: Q[..., 0])


def _scalar(column: Series) -> Series:
    """(..., 1, 1) as (...)."""
    return column.map(lambda T: T[..., 0, 0])


def _forward(m: Mechanism, x: State, method: str) -> Series:
    """Forward dynamics by a method of other rows, with the terms of the drives that act."""
    inverse = FORCES.law(method, m)
    if articulated.has_deep_branches(m) and not m.closure:
        M: forward.Solver = articulated.ArticulatedBodies.of(m, x.q[0])
    else:
        M = Factors.of(QUANTITIES["mass_matrix"].law(method, m)(m, x)[0])

    def required(q: Series, base: BaseMotion | None) -> Series:
        return inverse(m, replace(x, q=q, base=base)).map(lambda Q: Q[..., None])

    return forward.from_inverse(M, required, m, x.q, x.Q, x.base)


def _forward_dense(m: Mechanism, x: State) -> Series:
    return _forward(m, x, "closed_form") if m.closure else forward.dense(m, x.q, x.Q, x.W, x.base)


def _of_all_rates(m: Mechanism, x: State, method: str) -> Series:
    """Partial derivatives of the forces and their rates, from those of the forces themselves."""
    of_forces = {"recursion": force_partials.partials, "closed_form": partials.dense}[method]
    if not m.closure:
        return partials.of_all_rates(*of_forces(m, x.q, x.W, x.base), partials.turning(m, x.base))
    motion = loops.closed_motion(m, x)
    rigid = of_forces(m.tree, motion.q, x.W, x.base)
    of_drives = drive_terms.partials(m.tree, motion.q, m.acting)
    K, D, M = (P + drive_terms.behind_base(m, own, (-2, -1)) for P, own in zip(rigid, of_drives, strict=True))
    found = loop_partials.partials(motion, (K, D, M), _tree_forces(m, x, motion, method))
    return partials.of_all_rates(*found, partials.turning(m, x.base))


def _forward_partials(m: Mechanism, x: State, method: str) -> Series:
    """Partial derivatives of the accelerations from those of the forces, by a method of other rows."""
    found = QUANTITIES["forward_dynamics"].law(method, m)(m, x)[0][..., None]
    moving = replace(x, q=Series.of([x.q[0], x.q[1], found[..., -m.n :, :]]))
    if m.base and x.base:
        moving = replace(moving, base=replace(x.base, V=Series.of([x.base.V[0], found[..., :6, :]])))
    P = QUANTITIES["inverse_dynamics_partials"].law(method, m)(m, moving)
    return Series.of(partials.of_accelerations(P[0]))


Choice = Callable[[Elasticity, Series, Callable[[], Series]], Series]  # from the positions and torques of motors


def _of_motors(choose: Choice, method: str) -> Law:
    """A law of theta and tau, the positions and torques of motors, with the forces on the links by a method."""

    def motors(m: Mechanism, x: State) -> Series:
        def forces(added: Series | None) -> Series:
            W = x.W if added is None else added if x.W is None else x.W + added
            return FORCES.law(method, m)(m, replace(x, W=W)).map(lambda Q: Q[..., -m.n :, None])

        inputs = NO_INPUTS if x.stiffness is None else with_stiffness(m, x.stiffness)
        theta, phi = elastic.motor_positions(m, x.q, forces, inputs)
        return choose(elasticity_of(m), _row(theta), lambda: _row(elastic.motor_torques(m, x.q, theta, phi)))

    return motors


def _methods_of_motors(choose: Choice) -> Mapping[str, Method]:
    return {
        "recursion": Method(_of_motors(choose, "recursion"), _column),
        "closed_form": Method(_of_motors(choose, "closed_form")),
    }


def _elastic_forward(m: Mechanism, x: State, method: str) -> Series:
    """q2d and theta2d of links and motors, which the forces of the springs couple, or the inertia of the whole too."""
    theta, thetad, tau = x.motors.upto(2)
    Q, phi, drive = elastic.plant_forces(m, x.q, Series.of([theta, thetad]), tau)
    e = elasticity_of(m)
    if e.level is not None and e.motors:
        q, motors = (Series.of([*rates, 0 * rates[0]]) for rates in (x.q.upto(1), (theta, thetad)))
        W = coupling.reaction_wrenches(m, q, motors)
        still = replace(x, q=q, W=W if x.W is None else W + x.W)
        M, bias = (QUANTITIES[name].law(method, m)(m, still)[0] for name in ("mass_matrix", FORCES.name))
        return _row(Series.of(coupling.accelerations(m, q, M, phi - bias[..., None], drive - phi)))
    plant = elastic.with_rigid_rotors(m)
    q2d = QUANTITIES["forward_dynamics"].law(method, plant)(plant, replace(x, Q=Series.of([Q])))[0][..., None]
    return _row(Series.of([q2d, elastic.rotor_accelerations(m, q2d, drive - phi)]))


def _linearizing_torques(m: Mechanism, x: State, method: str) -> Series:
    """tau that makes q4d what is given; q2d and q3d follow from the forces of the springs."""
    theta, thetad, q4d = x.motors.upto(2)
    Q = elastic.spring_forces(m, x.q, Series.of([theta, thetad]))
    found = QUANTITIES["forward_dynamics"].law(method, m)(m, replace(x, Q=Q))
    q = Series.of([*x.q.upto(1), *(x[..., None] for x in found.upto(1)), q4d])
    return QUANTITIES["motor_torques"].law(method, m)(m, replace(x, q=q))


def _actuator_forces(m: Mechanism, x: State, method: str) -> Series:
    Q = FORCES.law(method, m)(m, x).map(lambda Q: Q[..., -m.n :, None])
    return _row(loops.actuator_forces(m, loops.closed_motion(m, x).F, Q))


def _loop_wrenches(m: Mechanism, x: State, method: str) -> Series:
    motion = loops.closed_motion(m, x)
    return loops.loop_wrenches(m, motion, _tree_forces(m, x, motion, method))


def _tree_forces(m: Mechanism, x: State, motion: loops.ClosedMotion, method: str) -> Series:
    """The forces that move the tree of a closed robot, (..., nv, 1)."""
    Q = FORCES.law(method, m.tree)(m.tree, replace(x, q=motion.q, position=None))
    return Q.map(lambda Q: Q[..., None])


def _poses(m: Mechanism, x: State, poses: kinematics.OfBodies) -> Series:
    return kinematics.poses(m, x.q, x.motion_of_base, x.body, poses)


def _screws(m: Mechanism, x: State, poses: kinematics.OfBodies, screws: kinematics.OfBodies) -> Series:
    return kinematics.screws(m, x.q, x.motion_of_base, x.body, x.frame, poses, screws)


def _dense(m: Mechanism, x: State) -> dense.ClosedForm:
    return dense.closed_form(m, x.q, x.W, x.base)


QUANTITIES: Mapping[str, Quantity] = {
    quantity.name: quantity
    for quantity in (
        Quantity(
            name="inverse_dynamics",
            symbol="Q",
            rates=3,
            shape=("nv",),
            of_motors="motor_torques",
            wrench_term="J^T W",
            wrench_tex="J^T W",
            drive_terms=TERMS,
            drive_law=lambda m, x: _row(drive_terms.forces(m, x.q, m.acting)),
            sweep=forces.MOVING,
            unit="N m or, for coordinates in m, N",
            caption="generalized forces",
            meaning="Q = M(q) q2d + C(q, qd) qd + Qgrav(q): generalized forces.",
            tex=r"Q = M(q)\,\ddot{q} + C(q, \dot{q})\,\dot{q} + Q_{\mathrm{grav}}(q)",
            methods={
                "recursion": Method(lambda m, x: _row(forces.rnea(forces.MOVING, m, x.q, x.W, x.base)), _column),
                "closed_form": Method(lambda m, x: _row(_dense(m, x).Q)),
                "paper": Method(lambda m, x: _row(Paper(m, x.q, x.W).Q), base=False),
            },
        ),
        Quantity(
            name="forward_dynamics",
            symbol="q",
            first_rate=2,
            rates=3,
            forces=True,
            shape=("nv",),
            of_motors="elastic_forward_dynamics",
            wrench_term="-M^-1 J^T W",
            wrench_tex="-M^{-1} J^T W",
            drive_terms=TERMS,
            unit="rad/s^2 or, for coordinates in m, m/s^2",
            caption="accelerations of the coordinates",
            meaning="q2d = M^-1 (Q - C qd - Qgrav): the accelerations that generalized forces Q cause.",
            tex=r"\ddot{q} = M^{-1} \left(Q - C(q, \dot{q})\,\dot{q} - Q_{\mathrm{grav}}(q)\right)",
            methods={
                "recursion": Method(lambda m, x: _row(_forward(m, x, "recursion")), _columns),
                "closed_form": Method(lambda m, x: _row(_forward_dense(m, x))),
            },
        ),
        Quantity(
            name="inverse_dynamics_partials",
            symbol="P",
            rates=3,
            shape=("rates", "nv", "nv"),
            wrench_term="d(J^T W)/dq, of wrenches W fixed in the bodies",
            wrench_tex=r"\partial (J^T W) / \partial q^{(j)}",
            drive_terms=TERMS,
            drive_law=lambda m, x: partials.of_all_rates(*drive_terms.partials(m, x.q, m.acting)),
            unit="that of Q over that of q, qd, q2d",
            caption="partial derivatives of the generalized forces",
            meaning="P[j] = dQ/dq^(j): the partial derivatives of the generalized forces by q, qd and q2d.",
            tex=r"P_j = \partial Q / \partial q^{(j)}",
            methods={
                "recursion": Method(lambda m, x: _of_all_rates(m, x, "recursion"), _columns),
                "closed_form": Method(lambda m, x: _of_all_rates(m, x, "closed_form")),
            },
        ),
        Quantity(
            name="forward_dynamics_partials",
            symbol="dq",
            results=("dq", "dqd", "Minv"),
            rates=3,
            forces=True,
            shape=("nv", "nv"),
            wrench_term="-M^-1 d(J^T W)/dq, of wrenches W fixed in the bodies",
            wrench_tex=r"\partial (-M^{-1} J^T W) / \partial q",
            drive_terms=TERMS,
            unit="that of q2d over that of q, qd, Q",
            caption="partial derivatives of the accelerations",
            meaning="dq = dq2d/dq, dqd = dq2d/dqd, Minv = dq2d/dQ = M^-1: the partial derivatives of forward dynamics.",
            tex=r"\partial \ddot{q} / \partial (q, \dot{q}, Q)",
            methods={
                "recursion": Method(lambda m, x: _forward_partials(m, x, "recursion"), _columns),
                "closed_form": Method(lambda m, x: _forward_partials(m, x, "closed_form")),
            },
        ),
        Quantity(
            name="regressor",
            symbol="Y",
            rates=3,
            shape=("nv", "parameters"),
            unit="that of Q over kg, kg m or kg m^2",
            caption="inertial-parameter regressor",
            meaning="Y(q, qd, q2d): the regressor, Q = Y p of the inertial parameters p of the bodies, 10 of each.",
            tex=r"Q = Y(q, \dot{q}, \ddot{q})\,p",
            methods={
                "recursion": Method(lambda m, x: regressor.regressor(m, x.q, x.base), lambda nb: 60 * nb * nb),
                "closed_form": Method(lambda m, x: dense.regressor(m, x.q, x.base)),
            },
        ),
        Quantity(
            name="momentum_regressor",
            symbol="Yp",
            rates=2,
            shape=("nv", "parameters"),
            unit="that of p over kg, kg m or kg m^2",
            caption="regressor of the generalized momentum",
            meaning="Yp(q, qd): the regressor of the generalized momentum, M qd = Yp p of the inertial parameters p.",
            tex_symbol="Y_{p}",
            tex=r"M\,\dot{q} = Y_p(q, \dot{q})\,p",
            methods={
                "recursion": Method(lambda m, x: regressor.momentum_regressor(m, x.q, x.base), lambda nb: 60 * nb * nb),
                "closed_form": Method(lambda m, x: dense.momentum_regressor(m, x.q, x.base)),
            },
        ),
        Quantity(
            name="energy_regressor",
            symbol="YE",
            rates=2,
            shape=("parameters",),
            unit="J over kg, kg m or kg m^2",
            caption="regressor of the energy",
            meaning="YE(q, qd): the regressor of the energy, T + U = YE p of the inertial parameters p.",
            tex_symbol="Y_{E}",
            tex=r"T + U = Y_E(q, \dot{q})\,p",
            methods={
                "recursion": Method(lambda m, x: _row(energy_regressor.energy_regressor(m, x.q, x.base)), _ten),
                "closed_form": Method(lambda m, x: _row(dense.energy_regressor(m, x.q, x.base))),
            },
        ),
        Quantity(
            name="gravity_forces",
            symbol="Qgrav",
            rates=1,
            shape=("nv",),
            sweep=forces.AT_REST,
            unit="N m or, for coordinates in m, N",
            caption="gravity forces",
            meaning="Qgrav = dU/dq: the forces that hold the robot up against gravity.",
            tex_symbol=r"Q_{\mathrm{grav}}",
            tex=r"Q_{\mathrm{grav}} = \partial U / \partial q",
            methods={
                "recursion": Method(lambda m, x: _row(forces.rnea(forces.AT_REST, m, x.q, None, x.base)), _column),
                "closed_form": Method(lambda m, x: _row(_dense(m, x).Qgrav)),
                "paper": Method(lambda m, x: _row(Paper(m, x.q).Qgrav), base=False),
            },
        ),
        Quantity(
            name="mass_matrix",
            symbol="M",
            rates=1,
            shape=("nv", "nv"),
            without_base=("body",),
            drive_terms=("armature",),
            drive_law=lambda m, x: drive_terms.armature_matrix(m),
            unit="kg m^2, kg m or kg",
            caption="generalized mass matrix",
            meaning="M(q): the generalized mass matrix, symmetric.",
            tex=r"T = \tfrac{1}{2}\,\dot{q}^T M\,\dot{q}",
            methods={
                "recursion": Method(lambda m, x: matrices.mass_matrix(m, x.q), _columns),
                "closed_form": Method(lambda m, x: _dense(m, x).gM),
                "paper": Method(lambda m, x: Paper(m, x.q).gM, base=False),
            },
        ),
        Quantity(
            name="coriolis_matrix",
            symbol="C",
            rates=2,
            shape=("nv", "nv"),
            turns_with="mass_matrix",
            unit="kg m^2/s, kg m/s or kg/s",
            caption="Coriolis matrix of the paper",
            meaning="C(q, qd): the paper's Coriolis matrix; passivity-based control takes Cbar, skew_coriolis_matrix.",
            tex=r"C\,\dot{q} = Q - M\,\ddot{q} - Q_{\mathrm{grav}}",
            methods={
                "recursion": Method(lambda m, x: matrices.coriolis_matrix(m, x.q, x.base), _columns),
                "closed_form": Method(lambda m, x: _dense(m, x).gC),
                "paper": Method(lambda m, x: Paper(m, x.q).gC, base=False),
            },
        ),
        Quantity(
            name="skew_coriolis_matrix",
            symbol="Cbar",
            rates=2,
            shape=("nv", "nv"),
            turns_with="mass_matrix",
            unit="kg m^2/s, kg m/s or kg/s",
            caption="Coriolis matrix for passivity-based control",
            meaning="Cbar(q, qd): the Coriolis matrix for which Md - 2 Cbar is skew-symmetric.",
            tex_symbol=r"\bar{C}",
            tex=r"(\dot{M} - 2 \bar{C}) + (\dot{M} - 2 \bar{C})^T = 0",
            methods={
                "recursion": Method(lambda m, x: matrices.skew_coriolis_matrix(m, x.q, x.base), _columns),
                "closed_form": Method(lambda m, x: _dense(m, x).gCbar),
            },
        ),
        Quantity(
            name="poses",
            symbol="H",
            rates=1,
            shape=("nb", 4, 4),
            unit="1 and m",
            caption="poses of the bodies",
            meaning="H(q): the pose of the body in the inertial frame, a homogeneous matrix.",
            tex=r"H_i = H_p\,B_i \exp(\hat{X}_i \theta_i)",
            methods={
                "recursion": Method(lambda m, x: _poses(m, x, bodies.poses), _columns),
                "closed_form": Method(lambda m, x: _poses(m, x, dense.poses)),
            },
        ),
        Quantity(
            name="twists",
            symbol="V",
            rates=2,
            shape=("nb", 6),
            frames=tuple(kinematics.FRAMES),
            unit="rad/s and m/s",
            caption="twists of the bodies",
            meaning="V(q, qd): the twist (angular; linear) of the body.",
            tex=r"V = J\,\dot{q}",
            methods={
                "recursion": Method(lambda m, x: _row(_screws(m, x, bodies.poses, bodies.twists)), _columns),
                "closed_form": Method(lambda m, x: _row(_screws(m, x, dense.poses, dense.twists))),
            },
        ),
        Quantity(
            name="jacobian",
            symbol="J",
            rates=1,
            shape=("nb", 6, "nv"),
            without_base=("body",),
            frames=tuple(kinematics.FRAMES),
            unit="1 and m",
            caption="Jacobians of the bodies",
            meaning="J(q): the Jacobian of the body, twist (angular; linear) V = J qd.",
            tex=r"J = \partial V / \partial \dot{q}",
            methods={
                "recursion": Method(lambda m, x: _screws(m, x, bodies.poses, bodies.jacobians), _columns),
                "closed_form": Method(lambda m, x: _screws(m, x, dense.poses, dense.jacobians)),
            },
        ),
        Quantity(
            name="momentum",
            symbol="h",
            rates=2,
            shape=(6,),
            unit="kg m^2/s and kg m/s",
            caption="spatial momentum",
            meaning="h: the momentum (angular; linear) of the bodies about the inertial origin, in inertial axes.",
            tex=r"h = U^T M\,V",
            methods={
                "recursion": Method(lambda m, x: _row(momenta.momentum(m, x.q, x.base)), _column),
                "closed_form": Method(lambda m, x: _row(_dense(m, x).h)),
            },
        ),
        Quantity(
            name="centroidal_momentum",
            symbol="hG",
            rates=2,
            shape=(6,),
            unit="kg m^2/s and kg m/s",
            caption="centroidal momentum",
            meaning="hG: the momentum (angular; linear) of the bodies about their centre of mass, in inertial axes.",
            tex_symbol="h_{G}",
            tex=r"h_G = (k - c \times l;\ l), \quad h = (k; l)",
            methods={
                "recursion": Method(lambda m, x: _row(momenta.centroidal_momentum(m, x.q, x.base)), _column),
                "closed_form": Method(lambda m, x: _row(_dense(m, x).hG)),
            },
        ),
        Quantity(
            name="centroidal_momentum_matrix",
            symbol="AG",
            rates=1,
            shape=(6, "nv"),
            unit="kg m^2, kg m or kg",
            caption="centroidal momentum matrix",
            meaning="AG(q): the centroidal momentum matrix, hG = AG qd.",
            tex_symbol="A_{G}",
            tex=r"A_G = \partial h_G / \partial \dot{q}",
            methods={
                "recursion": Method(lambda m, x: matrices.centroidal_momentum_matrix(m, x.q, x.base), _columns),
                "closed_form": Method(lambda m, x: _dense(m, x).AG),
            },
        ),
        Quantity(
            name="center_of_mass",
            symbol="c",
            rates=1,
            shape=(3,),
            unit="m",
            caption="centre of mass",
            meaning="c(q): the centre of mass of the bodies, in the inertial frame.",
            tex=r"c = \sum_i m_i\, c_i / \sum_i m_i",
            methods={
                "recursion": Method(lambda m, x: _row(momenta.center_of_mass(m, x.q, x.base)), _column),
                "closed_form": Method(lambda m, x: _row(_dense(m, x).c)),
            },
        ),
        Quantity(
            name="base_wrench",
            symbol="F",
            rates=3,
            shape=(6,),
            wrench_term="their sum about the inertial origin",
            wrench_tex="U^T W",
            unit="N m and N",
            caption="wrench of the ground on the robot",
            meaning="F: the wrench (moment; force) of the ground on the robot, in the inertial frame about its origin.",
            tex=r"F = \dot{h} + U^T M\,U G",
            methods={
                "recursion": Method(lambda m, x: _row(forces.base_wrench(m, x.q, x.W, x.base)), _column),
                "closed_form": Method(lambda m, x: _row(_dense(m, x).F)),
            },
        ),
        Quantity(
            name="generalized_momentum",
            symbol="p",
            rates=2,
            shape=("nv",),
            drive_terms=("armature",),
            drive_law=lambda m, x: _row(drive_terms.armature_matrix(m) @ x.q.dot),
            unit="N m s or, for coordinates in m, N s",
            caption="generalized momentum",
            meaning="p = M qd: the generalized momentum.",
            tex=r"p = M\,\dot{q}",
            methods={
                "recursion": Method(lambda m, x: _row(momenta.generalized_momentum(m, x.q, x.base)), _column),
                "closed_form": Method(lambda m, x: _row(_dense(m, x).p)),
            },
        ),
        Quantity(
            name="kinetic_energy",
            symbol="T",
            rates=2,
            shape=(),
            drive_terms=("armature",),
            drive_law=lambda m, x: _scalar(x.q.dot.mT @ (drive_terms.armature_matrix(m) @ x.q.dot) * 0.5),
            unit="J",
            caption="kinetic energy",
            meaning="T = 1/2 qd . M qd: the kinetic energy.",
            tex=r"T = \tfrac{1}{2}\,\dot{q}^T M\,\dot{q}",
            methods={
                "recursion": Method(lambda m, x: _scalar(momenta.kinetic_energy(m, x.q, x.base)), _column),
                "closed_form": Method(lambda m, x: _scalar(_dense(m, x).T)),
            },
        ),
        Quantity(
            name="potential_energy",
            symbol="U",
            rates=1,
            shape=(),
            drive_terms=("spring",),
            drive_law=lambda m, x: _scalar(drive_terms.spring_energy(m, x.q)),
            unit="J",
            caption="potential energy",
            meaning="U(q): the potential energy, zero where all masses are at the height of the inertial origin.",
            tex=r"U = -\sum_i m_i\, g \cdot c_i",
            methods={
                "recursion": Method(lambda m, x: _scalar(momenta.potential_energy(m, x.q, x.base)), _column),
                "closed_form": Method(lambda m, x: _scalar(_dense(m, x).U)),
            },
        ),
        Quantity(
            name="motor_positions",
            symbol="theta",
            rates=3,
            shape=("n",),
            wrench_term="K^-1 J^T W",
            wrench_tex=r"K^{-1} J^T W",
            drive_terms=TERMS,
            elastic=True,
            unit="rad or, for coordinates in m, m",
            caption="motor positions",
            meaning="theta = q + K^-1 Q: positions of the motors behind elastic joints.",
            tex_symbol=r"\theta",
            tex=r"\theta = q + K^{-1} Q",
            methods=_methods_of_motors(lambda e, theta, tau: theta),
        ),
        Quantity(
            name="motor_torques",
            symbol="tau",
            rates=5,
            shape=("n",),
            wrench_term="J^T W, and B K^-1 times its second derivative",
            wrench_tex=r"J^T W + B K^{-1} \tfrac{d^2}{dt^2}(J^T W)",
            wrench_rates=3,
            drive_terms=TERMS,
            elastic=True,
            unit="N m or, for coordinates in m, N",
            caption="motor torques",
            meaning="tau = Q + B theta2d + F_m(thetad): torques of the motors behind elastic joints.",
            tex_symbol=r"\tau",
            tex=r"\tau = Q + B\,\ddot{\theta} + F_m(\dot{\theta})",
            methods=_methods_of_motors(lambda e, theta, tau: tau()),
        ),
        Quantity(
            name="motor_currents",
            symbol="i",
            rates=5,
            shape=("n",),
            wrench_term="what they add to tau, over r k",
            wrench_tex=r"\tau(W) / (r k)",
            wrench_rates=3,
            drive_terms=TERMS,
            elastic=True,
            obstacle=electrical.no_currents,
            unit="A",
            caption="motor currents",
            meaning="i = tau / (r k): currents of the motors, with gear ratios r and torque constants k.",
            tex=r"i = \tau / (r k)",
            methods=_methods_of_motors(lambda e, theta, tau: electrical.currents(e, tau())),
        ),
        Quantity(
            name="motor_voltages",
            symbol="u",
            rates=5,
            shape=("n",),
            wrench_term="what they add",
            wrench_tex="u(W)",
            wrench_rates=3,
            drive_terms=TERMS,
            elastic=True,
            inductive=True,
            obstacle=electrical.no_voltages,
            unit="V",
            caption="motor voltages",
            meaning="u = R i + L di/dt + k r thetad: voltages of the motors.",
            tex=r"u = R\,i + L\,\dot{i} + k r\,\dot{\theta}",
            methods=_methods_of_motors(lambda e, theta, tau: electrical.voltages(e, theta, tau())),
        ),
        Quantity(
            name="elastic_forward_dynamics",
            symbol="q",
            results=("q2d", "theta2d"),
            rates=5,
            inputs=("q", "qd", "theta", "thetad", "tau"),
            shape=("n",),
            wrench_term="-M^-1 J^T W to q2d",
            wrench_tex="-M^{-1} J^T W",
            drive_terms=TERMS,
            elastic=True,
            unit="rad/s^2 or, for coordinates in m, m/s^2",
            caption="accelerations of links and motors",
            meaning="q2d = M^-1 (K (theta - q) - C qd - Qgrav), theta2d = (tau - F_m - K (theta - q)) / B.",
            tex_symbol=r"(\ddot{q},\ \ddot{\theta})",
            tex=r"\ddot{q} = M^{-1} \left(K (\theta - q) - C\,\dot{q} - Q_{\mathrm{grav}}\right),\quad"
            r" \ddot{\theta} = B^{-1} \left(\tau - F_m(\dot{\theta}) - K (\theta - q)\right)",
            methods={
                "recursion": Method(lambda m, x: _elastic_forward(m, x, "recursion"), _columns),
                "closed_form": Method(lambda m, x: _elastic_forward(m, x, "closed_form")),
            },
        ),
        Quantity(
            name="feedback_linearization",
            symbol="tau",
            results=("tau",),
            rates=5,
            inputs=("q", "qd", "theta", "thetad", "q4d"),
            shape=("n",),
            wrench_term="what they add to tau",
            wrench_tex=r"\tau(W)",
            wrench_rates=3,
            drive_terms=TERMS,
            elastic=True,
            obstacle=elastic.no_linearization,
            unit="N m or, for coordinates in m, N",
            caption="motor torques for a wanted snap",
            meaning="tau that makes q4d what is given in the state q, qd, theta, thetad.",
            tex_symbol=r"\tau",
            tex=r"\tau = \tau(q, \dot{q}, \ddot{q}, q^{(3)}, q^{(4)}),\quad M\,\ddot{q}"
            r" = K (\theta - q) - C\,\dot{q} - Q_{\mathrm{grav}}",
            methods={
                "recursion": Method(lambda m, x: _linearizing_torques(m, x, "recursion"), _columns),
                "closed_form": Method(lambda m, x: _linearizing_torques(m, x, "closed_form")),
            },
        ),
        Quantity(
            name="coordinates",
            symbol="qt",
            rates=1,
            shape=("tree",),
            closed=True,
            without_base=("body",),
            unit="rad or, for coordinates in m, m",
            caption="coordinates of the tree",
            meaning="qt: the coordinates of all joints, with loops closed; qtd = F qd of the independent ones.",
            tex_symbol="q_{t}",
            tex=r"\dot{q}_t = F\,\dot{q}, \quad A\,F = 0",
            methods={"recursion": Method(lambda m, x: _row(loops.closed_motion(m, x).q), _columns)},
        ),
        Quantity(
            name="actuator_forces",
            symbol="u",
            rates=3,
            shape=("motors",),
            closed=True,
            wrench_term="F_u^-T F^T J^T W",
            wrench_tex=r"F_u^{-T} F^T J^T W",
            drive_terms=TERMS,
            unit="N m or, for coordinates in m, N",
            caption="forces of the motors",
            meaning="u: forces of the actuated joints, F_u^T u = Q, with the least weighted sum of squares.",
            tex=r"F_u^T u = Q",
            methods={
                "recursion": Method(lambda m, x: _actuator_forces(m, x, "recursion"), _columns),
                "closed_form": Method(lambda m, x: _actuator_forces(m, x, "closed_form")),
            },
        ),
        Quantity(
            name="loop_wrenches",
            all_constraints=True,
            symbol="Wl",
            rates=3,
            shape=("loops", 6),
            closed=True,
            wrench_term="what they add",
            wrench_tex=r"W_l(W)",
            drive_terms=TERMS,
            unit="N m and N",
            caption="wrenches at the cut joints",
            meaning="Wl: the wrench (moment; force) of a cut joint on the body of its second frame, in the first.",
            tex_symbol="W_{l}",
            tex=r"W_l = R^T \lambda, \quad A_d^T \lambda = Q_d",
            methods={
                "recursion": Method(lambda m, x: _loop_wrenches(m, x, "recursion"), _columns),
                "closed_form": Method(lambda m, x: _loop_wrenches(m, x, "closed_form")),
            },
        ),
    )
}
FORCES = QUANTITIES["inverse_dynamics"]  # the default where a quantity is chosen


@lru_cache(maxsize=64)
def row_of(name: str, more_rates: int = 0) -> Quantity:
    """The row of a quantity, for a robot whose springs and motors take further rates of the motion."""
    row = QUANTITIES[name]
    return replace(row, rates=row.rates + more_rates, wrench_rates=row.wrench_rates + more_rates) if more_rates else row
