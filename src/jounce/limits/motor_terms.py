"""What limits of motors bound along a path: terms of the products of sigma's rates, behind linear springs.

    theta^(k) = q^(k) + Q^(k) / K,    tau = Q + B theta2d + d thetad,    i = tau / (r k),    u = R i + r k thetad

Coulomb friction f tanh(thetad / eps) comes on top of tau, see `friction`. Q2d takes the fourth rate of sigma, and rows
take no higher one: voltages of windings with an inductance, which take Q3d, have no terms.
"""

from dataclasses import dataclass

import numpy as np

from jounce.core.errors import join_names
from jounce.core.scalars import Array, reciprocal
from jounce.dynamics import electrical
from jounce.dynamics.quantities import DEFAULT_QUANTITY
from jounce.limits.factor_search import is_nonlinear
from jounce.limits.friction import Friction, coulomb_friction
from jounce.limits.joints import scatter_columns
from jounce.limits.path import Path, Terms, add_terms
from jounce.model.elasticity import Elasticity
from jounce.model.limit_kinds import LIMIT_KINDS
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series


@dataclass(frozen=True, eq=False)
class MotorTerms:
    """The motors of a robot, whose limits bound a motion."""

    mechanism: Mechanism
    elasticity: Elasticity

    def terms(self, path: Path, kind: str) -> Terms:
        """The terms of what limits of a kind bound, without friction."""
        row = LIMIT_KINDS[kind]
        if row.of == "theta":
            return self.position(path, row.rate)
        of_tau, of_velocity = self.shares(kind)
        rotor, viscous = self._columns(self.elasticity.rotor, self.elasticity.viscous)
        return add_terms(
            (of_tau, path.force(0)),
            (of_tau * rotor, self.position(path, 2)),
            (of_tau * viscous + of_velocity, self.position(path, 1)),
        )

    def position(self, path: Path, order: int) -> Terms:
        """The terms of theta, or of a rate of it."""
        [compliance] = self._columns(reciprocal(self.elasticity.stiffness))
        return add_terms((np.ones_like(compliance), path.rate(order)), (compliance, path.force(order)))

    def shares(self, kind: str) -> list[Array]:
        """What tau and thetad are multiplied by in what limits of a kind bound, (n,) each."""
        e, one = self.elasticity, np.ones(self.mechanism.n)
        if kind == "motor_torque":
            return self._columns(one, 0 * one)
        if kind == "motor_current":
            return self._columns(electrical.currents(e, Series.of([one]))[0], 0 * one)
        tau, theta = (Series.of([x, y]) for x, y in ((one, 0 * one), (0 * one, one)))
        nothing = Series.of([0 * one] * 2)
        return self._columns(electrical.voltages(e, nothing, tau)[0], electrical.voltages(e, theta, nothing)[0])

    def friction(self) -> Friction | None:
        """The Coulomb friction of the motors; None without."""
        amounts, eps = self._columns(self.elasticity.friction, self.elasticity.eps)
        which = np.flatnonzero(amounts)
        ratios = np.eye(len(amounts))[which]
        return coulomb_friction(ratios, ratios * amounts, eps[which]) if which.size else None

    def _columns(self, *arrays: Array) -> list[Array]:
        """Columns of all joints, 0 for those without a motor or without the data."""
        return scatter_columns(self.mechanism, [np.nan_to_num(x) for x in arrays], DEFAULT_QUANTITY)


def find_motor_obstacle(e: Elasticity, kinds: list[str]) -> str | None:
    """Why limits of motors of some kinds are no sums of products along a path, or None."""
    inductive = e.is_inductive and "motor_voltage" in kinds
    found = {
        "two motors on a joint": bool(e.pairs),
        "springs with dampers": bool(e.dampers),
        "springs that are not linear": any(map(is_nonlinear, e.springs)),
        "rotors that links carry (coupling)": e.level is not None,
        "windings with an inductance under limits of voltage": inductive,
    }
    return join_names(what for what, there in found.items() if there) or None
