"""The least-squares problem of an identification: a model, the motion, measured forces, and what is sought.

Rows are the forces, averaged over cells of time; unknowns are corrections of the base parameters and of drive terms.
The band is that of the forces that the model predicts, unless a caller states it; cells are as wide as the band allows,
and narrower where there would be too few of them for the number of parameters.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jounce.core import cures, scalars
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, quote_value
from jounce.core.typing import DriveTerm
from jounce.dynamics import base_parameters
from jounce.dynamics.base_parameters import BaseParameters
from jounce.engine import along
from jounce.engine.engine import Engine, R, with_mechanism
from jounce.identification.averaging import (
    CELLS_PER_PERIOD,
    CellAverages,
    average_forces,
    force_band,
    number_cells,
    regressor_pieces,
    weighted_means,
)
from jounce.identification.measurements import Measurements, median_step
from jounce.identification.motion_errors import (
    AccelerationErrors,
    EncoderOffsets,
    error_band,
    find_acceleration_errors,
    find_offsets,
    join_errors,
)
from jounce.model import body_parameters, coordinates, drive_trains
from jounce.motion import resmoothing
from jounce.motion.motion import Motion

ERROR_BAND_FACTOR = 2.0  # of the band of the motion's errors: cells that are narrower hold the same errors
LIMITED_BAND_SHARE = 0.5  # of a bandwidth that limits a smoothing: averages over its period keep what it keeps
CELLS_PER_PARAMETER = 4  # of all forces, at least: residuals of fewer say little of the variances


@dataclass(frozen=True, eq=False)
class IdentificationProblem:
    """What is known, and what is sought."""

    robot: Engine  # the model
    motion: Motion  # of its joints, in its order
    terms: tuple[DriveTerm, ...]  # drive terms that are sought
    sought: np.ndarray  # (terms * joints,) which of their parameters are
    base: BaseParameters  # of the model
    given: Measurements  # all measured forces
    used: np.ndarray  # (N,) which of their samples are used
    samples: Measurements  # these, with the weights of the fit
    model: np.ndarray  # (N, nv) forces of the model
    band: float  # highest frequency of the forces, Hz
    width: float  # of the cells, s
    cells: CellAverages  # averages of the samples that are used
    errors: AccelerationErrors  # of the motion in the cells
    offsets: tuple[EncoderOffsets, ...] = ()  # of the encoders in the cells of each log
    log: str = ""  # name of the log, if there are several
    tests: bool = False  # whether the log is not fitted

    @property
    def columns(self) -> np.ndarray:
        """The columns of the regressor that are sought: those of base parameters and of drive terms."""
        return _sought_columns(self.base, self.sought)

    @property
    def places(self) -> np.ndarray:
        """The places of those that are sought among all base parameters and all parameters of the drive terms."""
        return np.append(np.arange(self.base.count), self.base.count + np.flatnonzero(self.sought))

    @property
    def model_parameters(self) -> np.ndarray:
        """The parameters with which the forces of the model are computed: drive terms that do not act are zero."""
        m = self.robot.mechanism
        drives = [
            getattr(m.drives, drive_trains.AMOUNTS[term]) if term in m.acting else np.zeros(len(m.joints))
            for term in self.terms
        ]
        return np.concatenate([self.base.values, *drives])

    def corrected_parameters(self, x: np.ndarray) -> np.ndarray:
        """The parameters of the model with corrections x of those that are sought."""
        parameters = self.model_parameters
        parameters[self.places] += x
        return parameters

    @property
    def regressor_parameters(self) -> np.ndarray:
        """The parameters of the model for all columns of the regressor."""
        return np.append(
            body_parameters.inertial_parameters(self.robot.mechanism), self.model_parameters[self.base.count :]
        )

    def single_forces(self, parameters: np.ndarray) -> np.ndarray:
        """Root mean squares (nv,) of the forces that sought parameters (P,) make, each alone, as if none cancelled."""
        return np.asarray(np.sqrt(((self.cells.Y[..., self.columns] * parameters) ** 2).sum(axis=-1).mean(axis=0)))

    def predict(self, parameters: np.ndarray, drives: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Forces (2, N, nv): of a robot with other inertial parameters and drive terms, and of corrections x alone."""
        drives = drives - self.model_parameters[self.base.count :]
        changes = np.zeros((len(parameters) + len(drives), 2))
        changes[:, 0] = np.append(parameters - body_parameters.inertial_parameters(self.robot.mechanism), drives)
        changes[self.columns, 1] = x
        Q = self._linear_forces(changes)
        if drive_trains.LOAD_FRICTION not in self.terms:
            return Q
        shares = changes[-len(self.robot.mechanism.joints) :]
        return (
            Q
            + self._load_friction(Q)
            * (coordinates.velocity_map(self.robot.mechanism)[-len(shares) :].T @ shares).T[:, None]
        )

    def _linear_forces(self, changes: np.ndarray) -> np.ndarray:
        """Forces (k, N, nv) of changes (P, k) of all parameters, without friction by the load."""
        terms = [term for term in self.terms if term != drive_trains.LOAD_FRICTION]
        pieces = regressor_pieces(self.robot, self.motion, self.given.t, terms)
        return np.moveaxis(np.concatenate([Y @ changes[: Y.shape[-1]] for _, Y in pieces]), -1, 0) + self.model

    def _load_friction(self, Q: np.ndarray) -> np.ndarray:
        """The friction (..., N, nv) by forces Q of joints with a coordinate of their own, for a share of 1."""
        m, found = self.robot.mechanism, np.zeros_like(Q)
        eps, least = (x[coordinates.leading_joints(m)] for x in (m.drives.eps, m.drives.load_eps))
        found[..., -m.n :] = np.tanh(self.motion(self.given.t, 1)[1] / eps) * np.hypot(Q[..., -m.n :], least)
        return found

    def with_load_friction(self, x: np.ndarray, joints: np.ndarray) -> "IdentificationProblem":
        """The problem with friction of some joints (nc,) by the loads that corrections x give: by turns both settle."""
        changes, terms = (
            np.zeros((self.cells.Y.shape[-1], 1)),
            tuple(t for t in self.terms if t != drive_trains.LOAD_FRICTION),
        )
        changes[self.columns, 0] = x
        L = self._load_friction(self._linear_forces(changes)[0])[self.used]
        means = weighted_means(L, self.samples.weights, number_cells(self.samples.t, self.width))[0]
        added = means[..., None] * coordinates.velocity_map(self.robot.mechanism)[-len(joints) :].T
        linear = len(self.base.parameters) + len(terms) * len(joints)
        Y = np.concatenate([self.cells.Y[..., :linear], added], axis=-1)
        sought = np.append(self.sought[: len(terms) * len(joints)], joints)
        one = replace(self, terms=(*terms, drive_trains.LOAD_FRICTION), sought=sought, cells=replace(self.cells, Y=Y))
        # accelerations alone add to it no more than to Coulomb friction
        errors = replace(self.errors, terms=(*terms, "friction"), columns=one.columns)
        offsets = tuple(
            replace(
                of,
                terms=(*terms, "friction"),
                columns=one.columns,
                parameters=np.append(of.parameters[:linear], 0.0 * joints),
            )
            for of in self.offsets
        )
        return replace(one, errors=errors, offsets=offsets)


def pose_problem(
    robot: Engine,
    motion: Motion,
    terms: tuple[DriveTerm, ...],
    sought: np.ndarray,
    given: Measurements,
    used: np.ndarray,
    samples: Measurements,
    band: float | None,
    share: float = 1.0,
) -> IdentificationProblem:
    """Pose the problem of a log that has a share of all measured forces.

    Raise `JounceError` if all forces are fewer than parameters, or samples cannot have the band.
    """
    base = base_parameters.base_parameters(robot.mechanism)
    columns = _sought_columns(base, sought)
    count = len(columns)
    if (measured := np.count_nonzero(samples.weights)) < share * count:
        came = f"the data hold {measured / share:.0f} measured forces for {count} parameters"
        raise JounceError(f"{came}; expected a longer motion or fewer {cures.option_name('drives')}")
    modelled = along.forces_along(robot, motion, given.t, 0)
    model = modelled.forces[0]
    step = median_step(samples.t)
    lowest, highest = 1 / (len(samples.t) * step), 0.5 / step
    limit = np.inf
    if band is None:
        limit = LIMITED_BAND_SHARE * resmoothing.limited_bandwidth(motion)
        theta = modelled.rates[1][used] @ robot.mechanism.G.T
        eps = np.maximum(
            robot.mechanism.drives.eps, drive_trains.DEFAULT_SMOOTHING_VELOCITY
        )  # friction that jumps has no band
        band = force_band(samples.t, model[used], theta, eps)
    elif not scalars.is_finite(band) or not lowest <= band <= highest:
        span = f"{lowest:.4g} Hz, one period of the samples, to {highest:.4g} Hz, half their rate"
        raise JounceError(f"band is {quote_value(band)}; expected a frequency from {span}")
    band = float(band)
    deviations = motion.deviations(samples.t, 2)
    width = _cell_width(samples, min(band, limit, ERROR_BAND_FACTOR * error_band(deviations)), share * count)
    place = number_cells(samples.t, width)
    errors = find_acceleration_errors(robot, motion, samples.t, place, terms, columns, deviations)
    cells = average_forces(robot, motion, samples, model[used], terms, place)
    posed = IdentificationProblem(
        robot, motion, terms, sought, base, given, used, samples, model, band, width, cells, errors
    )
    offsets = find_offsets(robot, motion, (samples.t, place), terms, columns, posed.regressor_parameters)
    return replace(posed, offsets=(offsets,))


def join_problems(posed: Sequence[IdentificationProblem]) -> tuple[IdentificationProblem, list[slice]]:
    """The problem with the cells of all logs, and which are those of each; all else is that of the first."""
    counts = [len(one.cells.off) for one in posed]
    cells = CellAverages(*map(np.concatenate, zip(*(vars(one.cells).values() for one in posed), strict=True)))
    errors = join_errors([one.errors for one in posed])
    ends = np.cumsum([0, *counts]).tolist()
    offsets = tuple(of for one in posed for of in one.offsets)
    return replace(posed[0], cells=cells, errors=errors, offsets=offsets), list(map(slice, ends, ends[1:]))


def with_smoothing_velocity(robot: R, terms: Sequence[DriveTerm], eps: float | None) -> R:
    """Return a robot with another smoothing velocity of friction; refuse an eps without use, and drives of motors."""
    if robot.mechanism.elasticity is not None and set(terms) - {"spring", "offset"}:
        cure = f"{Remedy('drives=False', '--drives none')} identifies links from the torques of the springs"
        raise JounceError(f"{robot.name} has elastic joints: its drives act on motors, not on links; {cure}")
    if "friction" not in terms and (eps is not None or drive_trains.LOAD_FRICTION in terms):
        what = cures.option_value("eps", eps) if eps is not None else drive_trains.LOAD_FRICTION
        raise JounceError(f"{what} is of friction, which {drive_trains.describe_terms(list(terms))} does not identify")
    if robot.mechanism.has_load_friction and drive_trains.LOAD_FRICTION not in terms:
        cure = f"expected it in {cures.option_name('drives')}, or {drive_trains.OMIT_LOAD_FRICTION}"
        raise JounceError(
            f"{robot.name}: {drive_trains.LOAD_FRICTION} acts, and takes the loads that are identified; {cure}"
        )
    m, drives = (
        robot.mechanism,
        robot.mechanism.drives if eps is None else drive_trains.with_eps(robot.mechanism.drives, eps),
    )
    if drive_trains.LOAD_FRICTION in terms and drives.load_friction.any():  # sought anew
        drives = replace(drives, load_friction=np.where(m.lone_joints, 0.0, drives.load_friction))
    return robot if drives is m.drives else with_mechanism(robot, replace(m, drives=drives))


def _sought_columns(base: BaseParameters, sought: np.ndarray) -> np.ndarray:
    return np.append(base.columns, len(base.parameters) + np.flatnonzero(sought))


def _cell_width(samples: Measurements, band: float, count: float) -> float:
    """The width of cells that a band needs, so that there are enough for the number of parameters."""
    duration, forces = float(samples.t[-1] - samples.t[0]), np.count_nonzero(samples.weights.any(axis=0))
    longest = duration * forces / (CELLS_PER_PARAMETER * count)
    return min(1 / (CELLS_PER_PERIOD * band) if band else np.inf, longest) or 1.0
