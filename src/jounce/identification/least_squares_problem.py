"""Pose the least-squares problem of a log: a model, the motion, measured forces, and the sought parameters.

`pose_problem` runs once per log and fit, and `join_problems` joins the logs. Rows are the forces, averaged over cells
of time; unknowns are corrections of the base parameters and of drive terms.
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
from jounce.identification import noise_spectra
from jounce.identification.averaging import (
    CELLS_PER_PERIOD,
    CellAverages,
    average_forces,
    force_band,
    number_cells,
    regressor_pieces,
    weighted_means,
)
from jounce.identification.measurements import MeasuredLog, Measurements, median_step
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
class FitOptions:
    """The options of a fit that a caller states."""

    robot: Engine  # the model
    terms: tuple[DriveTerm, ...]  # drive terms that are sought
    known: bool = False  # whether weights are inverse variances
    given_eps: bool = False  # whether smoothing velocities of friction are stated
    band: float | None = None  # highest frequency of the forces, Hz
    delay: float | None = None  # of forces after positions, s
    as_given: bool = False  # whether torques of another scale than the model's are read as they are


@dataclass(frozen=True, eq=False)
class IdentificationProblem:
    """The least-squares problem of a log, or of several with joined cells."""

    robot: Engine  # the model
    motion: Motion  # of its joints, in its order
    terms: tuple[DriveTerm, ...]  # drive terms that are sought
    sought: np.ndarray  # (terms * joints,) which of their parameters are sought
    base: BaseParameters  # of the model
    measurements: Measurements  # all measured forces
    used: np.ndarray  # (N,) which of their samples are used
    samples: Measurements  # the used samples, with the weights of the fit
    model: np.ndarray  # (N, nv) forces of the model
    band: float  # highest frequency of the forces, Hz
    width: float  # of the cells, s
    cells: CellAverages  # averages of the samples that are used
    errors: AccelerationErrors  # of the motion in the cells
    offsets: tuple[EncoderOffsets, ...] = ()  # of the encoders in the cells of each log
    log: str = ""  # name of the log, if there are several
    tests: bool = False  # whether the log is not fitted
    noise: noise_spectra.Logs = noise_spectra.ONE_LOG  # whether cells are independent: of a log they are not

    @property
    def columns(self) -> np.ndarray:
        """The columns (P,) of the sought parameters in the regressor."""
        return _sought_columns(self.base, self.sought)

    @property
    def places(self) -> np.ndarray:
        """The places (P,) of the sought parameters among base and drive parameters."""
        return np.append(np.arange(self.base.count), self.base.count + np.flatnonzero(self.sought))

    @property
    def model_parameters(self) -> np.ndarray:
        """The base and drive parameters that make the forces of the model."""
        # Drive terms that do not act have amounts that make no force: they count as zero.
        m = self.robot.mechanism
        drives = [
            getattr(m.drives, drive_trains.AMOUNTS[term]) if term in m.acting else np.zeros(len(m.joints))
            for term in self.terms
        ]
        return np.concatenate([self.base.values, *drives])

    def corrected_parameters(self, x: np.ndarray) -> np.ndarray:
        """Return the parameters of the model with corrections x (P,)."""
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
        """Return the sizes of the forces of parameters, as if none cancelled.

        They are root mean squares (nv,) of the forces that each of the parameters (P,) makes alone.
        """
        return np.asarray(np.sqrt(((self.cells.Y[..., self.columns] * parameters) ** 2).sum(axis=-1).mean(axis=0)))

    def predict(self, parameters: np.ndarray, drives: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Predict forces (2, N, nv) at all samples.

        The first are those of a robot with other inertial parameters and drive terms, the second those of the model
        with corrections x alone.
        """
        # Both robots as changes of all parameters of the model, one in each column.
        drives = drives - self.model_parameters[self.base.count :]
        changes = np.zeros((len(parameters) + len(drives), 2))
        changes[:, 0] = np.append(parameters - body_parameters.inertial_parameters(self.robot.mechanism), drives)
        changes[self.columns, 1] = x
        Q = self._linear_forces(changes)
        if drive_trains.LOAD_FRICTION not in self.terms:
            return Q
        # Friction by the load follows from the forces without it; its shares are the last parameters, of joints, which
        # the velocity map takes to forces: (nc, 2) -> (2, 1, nv).
        shares = changes[-len(self.robot.mechanism.joints) :]
        force_shares = (coordinates.velocity_map(self.robot.mechanism)[-len(shares) :].T @ shares).T[:, None]
        return Q + self._load_friction(Q) * force_shares

    def _linear_forces(self, changes: np.ndarray) -> np.ndarray:
        """Return forces of changes (P, k), without friction by the load: (k, N, nv)."""
        terms = [term for term in self.terms if term != drive_trains.LOAD_FRICTION]
        # The regressor of a long log is never held as a whole: (N, nv, P) in pieces, each times (P, k) at once.
        pieces = regressor_pieces(self.robot, self.motion, self.measurements.t, terms)
        return np.moveaxis(np.concatenate([Y @ changes[: Y.shape[-1]] for _, Y in pieces]), -1, 0) + self.model

    def _load_friction(self, Q: np.ndarray) -> np.ndarray:
        """Return friction by forces Q for shares of 1: (..., N, nv).

        Only joints that are alone on their coordinate have it; its size is that of the load, rounded near 0.
        """
        m, friction = self.robot.mechanism, np.zeros_like(Q)
        eps, load_eps = (x[coordinates.leading_joints(m)] for x in (m.drives.eps, m.drives.load_eps))
        friction[..., -m.n :] = np.tanh(self.motion(self.measurements.t, 1)[1] / eps) * np.hypot(
            Q[..., -m.n :], load_eps
        )
        return friction

    def with_load_friction(self, x: np.ndarray, joints: np.ndarray) -> "IdentificationProblem":
        """Return the problem with friction of some joints (nc,) by their loads.

        The loads are those that corrections x give. They depend on the friction in turn, so that fits and loads follow
        each other until both settle.
        """
        # The loads at all samples, by the parameters of the last fit.
        terms = tuple(t for t in self.terms if t != drive_trains.LOAD_FRICTION)
        changes = np.zeros((self.cells.Y.shape[-1], 1))
        changes[self.columns, 0] = x
        L = self._load_friction(self._linear_forces(changes)[0])[self.used]
        # One more column for each joint, averaged as the others are; columns of an earlier load are replaced.
        means = weighted_means(L, self.samples.weights, number_cells(self.samples.t, self.width))[0]
        load_columns = means[..., None] * coordinates.velocity_map(self.robot.mechanism)[-len(joints) :].T
        linear = len(self.base.parameters) + len(terms) * len(joints)
        Y = np.concatenate([self.cells.Y[..., :linear], load_columns], axis=-1)
        sought = np.append(self.sought[: len(terms) * len(joints)], joints)
        problem = replace(
            self, terms=(*terms, drive_trains.LOAD_FRICTION), sought=sought, cells=replace(self.cells, Y=Y)
        )
        # Regressors of errors and offsets have no column of it: accelerations alone add to it no more than to Coulomb
        # friction, which stands in its place, and the model has none of it.
        errors = replace(self.errors, terms=(*terms, "friction"), columns=problem.columns)
        offsets = tuple(
            replace(
                offsets_of_log,
                terms=(*terms, "friction"),
                columns=problem.columns,
                parameters=np.append(offsets_of_log.parameters[:linear], 0.0 * joints),
            )
            for offsets_of_log in self.offsets
        )
        return replace(problem, errors=errors, offsets=offsets)


def pose_problem(
    options: FitOptions, log: MeasuredLog, samples: Measurements, *, sought: np.ndarray, share: float = 1.0
) -> IdentificationProblem:
    """Pose the problem of a log, with its share of the forces.

    The samples are those of the log that are used, with the weights of the fit; sought are which of the parameters
    (terms * joints,) of the drive terms. Raise `JounceError` if all forces are fewer than parameters, or samples cannot
    have the band.
    """
    robot, motion, terms, used = options.robot, log.motion, options.terms, log.used
    base = base_parameters.base_parameters(robot.mechanism)
    columns = _sought_columns(base, sought)
    count = len(columns)
    measured = np.count_nonzero(samples.weights)
    if measured < share * count:
        came = f"the data hold {measured / share:.0f} measured forces for {count} parameters"
        raise JounceError(f"{came}; expected a longer motion or fewer {cures.option_name('drives')}")
    # The forces of the model at all samples, those that only test included.
    modelled = along.forces_along(robot, motion, log.measurements.t, 0)
    model = modelled.forces[0]
    # The band of the forces: stated, or the one that holds nearly all power of the model's.
    step = median_step(samples.t)
    lowest, highest = 1 / (len(samples.t) * step), 0.5 / step
    limit = np.inf
    band = options.band
    if band is None:
        limit = LIMITED_BAND_SHARE * resmoothing.limited_bandwidth(motion)
        theta = modelled.rates[1][used] @ robot.mechanism.G.T
        # Friction that jumps has no band: it is smoothed at least as by default.
        eps = np.maximum(robot.mechanism.drives.eps, drive_trains.DEFAULT_SMOOTHING_VELOCITY)
        band = force_band(samples.t, model[used], theta, eps)
    elif not scalars.is_finite(band) or not lowest <= band <= highest:
        span = f"{lowest:.4g} Hz, one period of the samples, to {highest:.4g} Hz, half their rate"
        raise JounceError(f"band is {quote_value(band)}; expected a frequency from {span}")
    band = float(band)
    # Cells for the lowest of the bands of forces, of a smoothing that limits them, and of the motion's errors.
    deviations = motion.deviations(samples.t, 2)
    width = _cell_width(samples, min(band, limit, ERROR_BAND_FACTOR * error_band(deviations)), share * count)
    place = number_cells(samples.t, width)
    # All that the regression takes in, in these cells.
    errors = find_acceleration_errors(robot, motion, (samples.t, place), terms, columns=columns, deviations=deviations)
    cells = average_forces(robot, motion, samples, model[used], terms, place)
    problem = IdentificationProblem(
        robot, motion, terms, sought, base, log.measurements, used, samples, model, band, width, cells, errors,
        log=log.name, tests=log.tests,
    )  # fmt: skip
    parameters = problem.regressor_parameters
    offsets = find_offsets(robot, motion, (samples.t, place), terms, columns=columns, parameters=parameters)
    return replace(problem, offsets=(offsets,))


def join_problems(posed: Sequence[IdentificationProblem]) -> tuple[IdentificationProblem, list[slice]]:
    """Join the cells of all logs, and return their slices.

    All else of the problem is that of the first log.
    """
    counts = [len(problem.cells.off) for problem in posed]
    fields_of_logs = zip(*(vars(problem.cells).values() for problem in posed), strict=True)
    cells = CellAverages(*map(np.concatenate, fields_of_logs))
    errors = join_errors([problem.errors for problem in posed])
    ends = np.cumsum([0, *counts]).tolist()
    offsets = tuple(offsets_of_log for problem in posed for offsets_of_log in problem.offsets)
    return replace(posed[0], cells=cells, errors=errors, offsets=offsets), list(map(slice, ends, ends[1:]))


def with_smoothing_velocity(robot: R, terms: Sequence[DriveTerm], eps: float | None) -> R:
    """Return a robot with another smoothing velocity of friction.

    Raise `JounceError` for an eps without use, and for drives of motors behind elastic joints.
    """
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
    m, drives = robot.mechanism, robot.mechanism.drives
    if eps is not None:
        drives = drive_trains.with_eps(drives, eps)
    # Friction by the load that is sought starts from 0: its columns are those of whole shares, not of corrections.
    if drive_trains.LOAD_FRICTION in terms and drives.load_friction.any():
        drives = replace(drives, load_friction=np.where(m.lone_joints, 0.0, drives.load_friction))
    return robot if drives is m.drives else with_mechanism(robot, replace(m, drives=drives))


def _sought_columns(base: BaseParameters, sought: np.ndarray) -> np.ndarray:
    return np.append(base.columns, len(base.parameters) + np.flatnonzero(sought))


def _cell_width(samples: Measurements, band: float, count: float) -> float:
    """Return the width of cells for a band and some parameters."""
    # Cells become narrower than the band asks for, where they would be too few for the parameters.
    duration, forces = float(samples.t[-1] - samples.t[0]), np.count_nonzero(samples.weights.any(axis=0))
    width = float(duration * forces / (CELLS_PER_PARAMETER * count))
    if band > 0:
        width = min(1 / (CELLS_PER_PERIOD * band), width)
    # One sample has no duration: any width makes one cell of it.
    return width if width > 0 else 1.0
