"""The information matrix of base parameters and drive terms from forces along a motion: its log det, and gradients.

The information matrix is the time mean of Y^T W Y: Y the regressor of the parameters, W the weights of the forces.
Where these are inverse variances, its inverse over the number of samples is the covariance of the parameters that
weighted least squares finds. Parameters in other units add a constant to its log determinant.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jounce.core.typing import DriveTerm
from jounce.dynamics.base_parameters import base_parameters
from jounce.dynamics.computation import Computation
from jounce.engine.backends import compile_ahead
from jounce.engine.drives import regressor
from jounce.engine.engine import Engine
from jounce.model import drives
from jounce.model.coordinates import joint_variables
from jounce.native.kernel import Kernel
from jounce.spatial.series import column_series

INFORMATION_FLOOR = 1e-12  # of typical states, added to the matrix: log det is finite even of motions that show less
COLUMN_RANK_TOLERANCE = 1e-7  # of its length: a column with less outside of the span of those before depends on them

Rates = Sequence[np.ndarray]  # q, qd, q2d, ..., (M, n) each


@dataclass(frozen=True, eq=False)
class Information:
    """The parameters that forces of a robot determine, and the code of gradients of their regressor."""

    robot: Engine
    terms: tuple[DriveTerm, ...]  # the drive terms among the parameters
    roots: np.ndarray  # (n,) square roots of the weights of the forces
    names: tuple[str, ...]  # of the parameters
    unseen: tuple[str, ...]  # base parameters and drive terms that no motion separates from them
    places: np.ndarray  # (count,) the columns of the parameters in the regressor with those terms
    sizes: np.ndarray  # (count,) root mean squares over typical states of the lengths of these columns, weighted
    product: Kernel  # vector-Jacobian products of the regressor

    def log_det(self, rates: Rates) -> float:
        """The log determinant of the information matrix, of parameters in SI units."""
        sign, log = np.linalg.slogdet(_mean_square(self._columns(self._regressor(rates))))
        return float(log + 2 * np.log(self.sizes).sum()) if sign > 0 else -np.inf

    def condition(self, rates: Rates) -> float:
        """The condition number of the weighted regressor with columns of unit length."""
        A = self._columns(self._regressor(rates)).reshape(-1, len(self.names))
        lengths = np.linalg.norm(A, axis=0)
        return float(np.linalg.cond(A / lengths)) if lengths.all() else np.inf

    def loss(self, rates: Rates) -> tuple[float, list[np.ndarray]]:
        """Minus the log determinant up to a constant, and its gradients by q, qd and q2d.

        d log det H = 2 <A H^-1, dA> / M for the columns A with H = A^T A / M.
        """
        Y = self._regressor(rates)
        A = self._columns(Y)
        H = _mean_square(A) + INFORMATION_FLOOR * np.eye(len(self.names))
        pushes = np.zeros_like(Y)
        pushes[..., self.places] = A @ (np.linalg.inv(H) * (-2 / len(A)) / self.sizes)
        pushes *= self.roots[:, None]
        own = Y.shape[-1] - len(self.terms) * len(self.robot.mechanism.joints)
        gradients = list(self.product(*rates[:3], np.ascontiguousarray(pushes[..., :own])))
        if self.terms:
            self._add_drives(gradients, rates, pushes[..., own:])
        return -float(np.linalg.slogdet(H)[1]), gradients

    def _regressor(self, rates: Rates) -> np.ndarray:
        return _weighted_regressor(self.robot, self.terms, self.roots, rates)

    def _columns(self, Y: np.ndarray) -> np.ndarray:
        """The columns (M, n, count) of the parameters in a weighted regressor, each over its typical size."""
        return np.asarray(Y[..., self.places] / self.sizes)

    def _add_drives(self, gradients: list[np.ndarray], rates: Rates, pushes: np.ndarray) -> None:
        """Add the gradients through the columns of drive terms, from pushes (M, n, terms nc) on these."""
        m, nc = self.robot.mechanism, len(self.robot.mechanism.joints)
        theta = joint_variables(m, column_series(list(rates)))
        units = {**drives.coefficients(m.drives)} | dict.fromkeys(drives.AMOUNTS.values(), np.ones((nc, 1)))
        for i, term in enumerate(self.terms):
            push = np.einsum("jc,mcj->mj", m.G, pushes[..., i * nc : (i + 1) * nc])
            for gradient, slope in zip(gradients, drives.partials(units, (term,), theta), strict=True):
                gradient += (push * slope[0][..., 0]) @ m.G


def build_information(
    robot: Engine, terms: tuple[DriveTerm, ...], weights: np.ndarray, typical: Rates, load: int | None = None
) -> Information:
    """The information of motions whose states are like typical ones: the parameters that forces there determine.

    Those of the robot, or of a load on a body with a number.
    """
    m, base = robot.mechanism, base_parameters(robot.mechanism)
    sought = base.columns if load is None else 10 * load + np.arange(10)
    Y = _weighted_regressor(robot, terms, np.sqrt(weights), typical)
    own = Y.shape[-1] - len(terms) * len(m.joints)
    names = np.array(
        [*(base.parameters[k] for k in sought), *(f"{joint} {term}" for term in terms for joint in m.joints)]
    )
    places = np.concatenate([sought, np.arange(own, Y.shape[-1])])
    A = Y.reshape(-1, Y.shape[-1])[:, places]
    sizes = np.sqrt(np.mean(A**2, axis=0) * robot.n)
    R = np.linalg.qr(A / np.where(sizes > 0, sizes, 1) / np.sqrt(len(typical[0])), mode="r")
    seen = np.abs(np.diag(R)) > COLUMN_RANK_TOLERANCE  # of what columns before leave of each
    return Information(
        robot, terms, np.sqrt(weights), tuple(names[seen].tolist()), tuple(names[~seen].tolist()),
        places[seen], sizes[seen], compile_ahead(robot, Computation("regressor", 0, product="vjp")),
    )  # fmt: skip


def _mean_square(A: np.ndarray) -> np.ndarray:
    """A^T A of columns (M, n, count), over M: by state, as BLAS makes threads for larger products that wait long."""
    return np.asarray((A.mT @ A).sum(axis=0) / len(A))


def _weighted_regressor(robot: Engine, terms: tuple[DriveTerm, ...], roots: np.ndarray, rates: Rates) -> np.ndarray:
    """The regressor (M, n, columns) with rows times the roots of the weights."""
    q, qd, q2d, *_ = rates
    return regressor(robot, "regressor", (q, qd, q2d), terms) * roots[:, None]
