"""Identify a payload from logs with and without it.

An identified robot may take the place of the log without it.

`identify_payload` is the door: it fits each log alone, with friction of its own, then the load to all of these fits
(`fit_loads`), once more by the halves of the log with it, and, with a load of known mass, torque constants
(`calibrate_torques`).

The load: the fit of log l alone has base parameters and drive terms z_l with the information A_l, which is all that the
log holds. With p the robot's own base parameters, d_l the drive terms in log l, and x the ten inertial parameters of
the load in a frame of a body, z_l = (p + K x; d_l), where K maps the parameters of that body to base parameters;
without a load, or with p known, terms fall away. Sought are p, d_l and x, by least squares: the sum of
(z - z_l)^T A_l (z - z_l). That is the same as one fit of all rows of all logs, with friction that may differ from log
to log, and the minimum is chi^2 of what a load does not explain: it shows a log of another robot. Deviations grow with
its root.

Torque constants: joint j measures g_j times its torque. The rows of that joint alone, in log l, have base parameters
z_jl with the information A_jl, once friction is eliminated, and z_jl = g_j (p + K x), with the mass in x known and
without x in the log without the load. Sought are p, x and all g_j, by least squares. Joints share p and x, so that the
mass sets the factors of those too that hardly lift it. Algorithm: Gauss-Newton from the load that torques as they are
give. Errors of the motion enter as known variances.

What the logs do not determine is filled by the nearest body that can exist, and a `Payload` says which that is.

`Payload` is the result: parameters with deviations, a body that can exist, and the robot that carries it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic

import numpy as np

from jounce.core import display, errors, scalars
from jounce.core.cures import Remedy
from jounce.core.display import HtmlDisplay
from jounce.core.errors import JounceError, join_names, quote_value, warn
from jounce.core.progress import stage
from jounce.core.typing import DriveTerms
from jounce.dynamics import base_parameters
from jounce.engine import along
from jounce.engine.engine import R, with_mechanism
from jounce.identification.averaging import CellAverages
from jounce.identification.fits import fit_logs
from jounce.identification.force_checks import force_warnings, unexplained_warnings
from jounce.identification.least_squares_problem import FitOptions, IdentificationProblem, with_smoothing_velocity
from jounce.identification.measurements import MeasuredLog, check_measurements
from jounce.identification.physical_consistency import fit_consistent_body
from jounce.identification.regression import Regression, fit_forces, informed_directions
from jounce.identification.result import ForceResidual, describe_torque_scale, force_residuals
from jounce.identification.static_poses import fit_poses
from jounce.model import body_parameters, drive_trains, positions
from jounce.motion.motion import Motion
from jounce.motion.poses import Poses
from jounce.spatial import inertia, lie

PARAMETER_COLUMNS = ("parameter", "value", "deviation", "body", "unit", "")
KUKA_SINGULAR_ANGLE = 1e-9  # of cos B: below it A and C turn about one axis, and C is 0


@dataclass(frozen=True)
class PayloadParameter:
    """A parameter of a payload, in the axes of its frame.

    Moments of inertia are about the centre of mass.

    Attributes
    ----------
    name, unit : str
        "mass", "com x", ..., "Ixx", ...
    value, deviation : float
        The estimate of the logs alone and its standard deviation, which is infinite if they hold nothing on it.
    body : float
        The value of the nearest body that can exist, which is in the robot.
    seen : bool
        Whether the deviation is smaller than the parameter, or than such parameters of a load of this mass are.

    Examples
    --------
    >>> import jounce
    >>> row = jounce.PayloadParameter("mass", "kg", 2.013, 0.002, 2.013, True)
    >>> f"{row.name}: {row.value:.3f} +- {row.deviation:.3f} {row.unit}"
    'mass: 2.013 +- 0.002 kg'
    """

    name: str
    unit: str
    value: float
    deviation: float
    body: float
    seen: bool


@dataclass(frozen=True, eq=False, repr=False)
class Payload(HtmlDisplay, Generic[R]):
    """A payload identified from logs. `Robot.payload` makes one.

    Attributes
    ----------
    robot : Robot
        The robot with the payload.
    frame : str
        The body or link in whose frame the payload is described.
    parameters, covariance : (10,) and (10, 10)
        Estimate of the inertial parameters m, mcx, ..., Izz about the origin of the frame, from the logs alone.
    body : (10,)
        Those of the nearest body that can exist.
    table : tuple of PayloadParameter
        Mass, centre of mass, inertia about it.
    halves : ((float, float), (float, float))
        Mass and its deviation from each half of the log with the load; empty of few poses.
    mismatch : float
        chi^2 of what the load does not explain, over its degrees of freedom: 1 on average.
    factors : tuple of ((nv,), (nv,)), or None
        Factors that make measured torques true, and their deviations, of a load of known mass.
    notes : tuple of str
        What is suspicious, and what the logs do not determine.
    undetermined : tuple of str
        What poses at rest do not determine: it has no rows in the table. The body, and so the robot, has the moments of
        inertia of a ball as dense as water then. Empty of logs.

    Examples
    --------
    >>> import jounce
    >>> from dataclasses import replace
    >>> robot = jounce.load("iiwa14")
    >>> motion = jounce.load_motion("paper", robot).with_step(0.01)
    >>> p = robot.inertial_parameters
    >>> p[-10] += 1.5  # a point mass at the origin of the last body
    >>> Q = robot.with_inertial_parameters(p).forces_along(motion, order=0).forces[0]
    >>> load = robot.payload(replace(motion, torques=(motion.times, Q)))
    >>> load.settings["ur before 5.10"]
    'set_payload(1.5000, [0.00000, 0.00000, 0.00000])'
    """

    robot: R
    frame: str
    parameters: np.ndarray
    covariance: np.ndarray
    body: np.ndarray
    table: tuple[PayloadParameter, ...]
    halves: tuple[tuple[float, float], ...]
    mismatch: float
    factors: tuple[np.ndarray, np.ndarray] | None
    notes: tuple[str, ...] = ()
    undetermined: tuple[str, ...] = ()

    @property
    def at_rest(self) -> bool:
        """Whether the load was at rest, in poses."""
        return len(self.undetermined) > 0

    @property
    def mass(self) -> float:
        """The mass of the body, kg."""
        return float(self.body[0])

    @property
    def com(self) -> np.ndarray:
        """The centre of mass (3,) of the body in the frame, m."""
        return np.asarray(self.body[1:4] / self.body[0])

    @property
    def inertia(self) -> np.ndarray:
        """The inertia (3, 3) about the centre of mass: in the frame's axes, kg m^2."""
        return np.asarray(inertia.from_parameters(central_parameters(self.body))[:3, :3])

    @property
    def unseen(self) -> tuple[str, ...]:
        """The parameters that the logs do not determine."""
        return (*(row.name for row in self.table if not row.seen), *self.undetermined)

    @cached_property
    def settings(self) -> dict[str, str]:
        """The settings that controllers take, if the frame is their flange.

        Lines for libfranka and URScript, and KUKA's load data; of a load at rest those without moments of inertia.
        """
        m, com = f"{self.mass:.4f}", _join(self.com, 5)
        place = _join(1000 * self.com, 2, "X Y Z")
        if self.at_rest:
            return {
                "ur": f"set_target_payload({m}, [{com}])",
                "ur before 5.10": f"set_payload({m}, [{com}])",
                "iiwa": f"M {m} kg, {place} mm",
            }
        # libfranka takes nine moments column by column, URScript six; KUKA principal moments along turned axes, which
        # are made right-handed.
        theta = self.inertia
        nine, six = _join(theta.T.ravel(), 6), _join(theta[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]], 6)
        moments, axes = np.linalg.eigh(theta)
        angles = kuka_angles(axes * np.sign(np.linalg.det(axes)))
        turn, principal = _join(angles, 3, "A B C"), _join(moments, 6, "JX JY JZ")
        return {
            "franka": f"robot.setLoad({m}, {{{{{com}}}}}, {{{{{nine}}}}});",
            "ur": f"set_target_payload({m}, [{com}], [{six}])",
            "ur before 5.10": f"set_payload({m}, [{com}])",
            "iiwa": f"M {m} kg, {place} mm, {turn} deg, {principal} kg m^2",
        }

    @property
    def assumption(self) -> str | None:
        """The assumption that no residual shows, and how to test it: None of a load of known mass."""
        return describe_torque_scale() if self.factors is None else None

    @property
    def rest_notes(self) -> tuple[str, ...]:
        """Words on what poses at rest do not determine."""
        ball = "the robot gets those of a ball as dense as water"
        return (f"rest does not determine the moments of inertia of the load: {ball}",) if self.at_rest else ()

    @property
    def summary(self) -> str:
        """The frame and the mass of the load, in one line."""
        row = self.table[0]
        return f"Payload on {errors.shorten(self.frame)}: {row.value:.4g} +- {row.deviation:.2g} kg"

    @property
    def parameter_rows(self) -> list[tuple[str, ...]]:
        """The parameters with deviations, and the nearest body that can exist."""
        return [
            (
                row.name,
                f"{row.value:.5g}",
                f"{row.deviation:.2g}",
                f"{row.body:.5g}",
                row.unit,
                "" if row.seen else "not seen",
            )
            for row in self.table
        ]

    def __repr__(self) -> str:
        """Return at most twelve lines: mass, centre of mass and inertia."""
        return display.print_table(self.summary, PARAMETER_COLUMNS, self.parameter_rows, self.rest_notes)

    def __str__(self) -> str:
        rows = [PARAMETER_COLUMNS, *self.parameter_rows]
        halves = ", ".join(f"{m:.5g} +- {s:.2g} kg" for m, s in self.halves)
        head = [f"load on {errors.shorten(self.robot.name)}, in the frame of {errors.shorten(self.frame)}"]
        head += [*self.rest_notes, *self.notes]
        whose = "the first and the last poses" if self.at_rest else "the halves of the log"
        checks = [f"mass of {whose} {halves}"] if len(self.halves) > 0 else []
        checks = ["; ".join([*checks, f"chi^2 of the rest {self.mismatch:.3g} per degree of freedom"])]
        lines = [*head, *checks, "", *display.align_columns(rows), ""]
        if self.factors is not None:
            table = [("factor of torques", "value", "deviation")]
            names = self.robot.joint_names
            of_joints = zip(names, self.factors[0][-len(names) :], self.factors[1][-len(names) :], strict=True)
            table += [(name, f"{c:.5g}" if np.isfinite(s) else "not seen", f"{s:.2g}") for name, c, s in of_joints]
            lines += [*display.align_columns(table), ""]
        if self.assumption is not None:
            lines += [self.assumption, ""]
        return "\n".join([*lines, *(f"{who}: {text}" for who, text in self.settings.items())])


def _join(numbers: np.ndarray, digits: int, names: str = "") -> str:
    """Join numbers by commas, or each to its name, without negative zeros."""
    texts = [f"{x:.{digits}f}" for x in np.round(numbers, digits) + 0.0]
    if names == "":
        return ", ".join(texts)
    return " ".join(map(" ".join, zip(names.split(), texts, strict=True)))


def kuka_angles(R: np.ndarray) -> np.ndarray:
    """Return A, B, C in degrees of a rotation: about z, then the new y, then the new x."""
    cosine = float(np.hypot(R[0, 0], R[1, 0]))
    if cosine < KUKA_SINGULAR_ANGLE:
        angles = np.arctan2(-R[0, 1], R[1, 1]), np.arctan2(-R[2, 0], cosine), 0.0
    else:
        angles = np.arctan2(R[1, 0], R[0, 0]), np.arctan2(-R[2, 0], cosine), np.arctan2(R[2, 1], R[2, 2])
    return np.asarray(np.degrees(angles))


COMPLEX_STEP = 1e-100  # of complex-step differentiation, which has no rounding


def central_parameters(x: np.ndarray) -> np.ndarray:
    """Return mass, centre of mass, and moments of inertia about it, (10,).

    From inertial parameters (10,) of a mass that is not 0.
    """
    mass, h, cross = x[:1], x[1:4], lie.hat(x[1:4])
    central = inertia.from_parameters(x)
    central[:3, :3] += cross @ cross / mass  # Steiner, back to the COM
    return np.concatenate([mass, h / mass, inertia.parameters(central)[4:]])


def central_covariance(x: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return the covariance of `central_parameters` by the delta method.

    Parameters that depend on infinite variances have infinite ones.
    """
    # C -> J C J^T with the derivatives J (10, 10) of the central parameters.
    J = np.stack([central_parameters(x + 1j * COMPLEX_STEP * unit).imag / COMPLEX_STEP for unit in np.eye(10)], axis=1)
    blind = np.isinf(np.diag(covariance))
    central = J @ np.where(blind | blind[:, None], 0.0, covariance) @ J.T
    undetermined = (J[:, blind] != 0).any(axis=1)
    central[undetermined, undetermined] = np.inf
    return np.asarray(central)


LOAD_DENSITY = 1000.0  # kg/m^3 of the ball that stands where logs say nothing: tools and parts are mostly hollow
LOAD_PRIOR_WEIGHT = 1.0  # of that ball: second moments of other bodies are off by as much as their size
MIN_LOAD_SHARE = 0.01  # of the robot's mass: a deviation below it determines the mass, even of no load
MAX_MISMATCH = 4.0  # chi^2 per degree of freedom: beyond it more than a load has changed
MAX_DEVIATIONS = 4.0  # by which a mass is below 0, or halves differ, by chance
MAX_CONSTANT_ERROR = 1.3  # factor by which torque constants of most joints are off: 1.13 at a real arm's worst joint
NULL_DEVIATIONS = 2.0  # within which of 0 no load is seen
TABLE = (
    ("mass", "kg"), *((f"com {axis}", "m") for axis in "xyz"),
    *((name, "kg m^2") for name in inertia.INERTIAL_PARAMETERS[4:]),
)  # fmt: skip
LOGS = ("with the load", "without the load")
MIN_HALF_TORQUES = 2.0  # of half of the poses, over the unknowns: fewer leave halves that differ by chance
MIN_POSE_SPREAD = 0.1  # rad or m, of the joint that differs most: within it gravity changes by a tenth at most
MASS_AND_CENTRE = 4  # parameters of a load, the first of the table, which rest determines
MOMENTS_OF_INERTIA = tuple(inertia.INERTIAL_PARAMETERS[MASS_AND_CENTRE:])
MAX_CALIBRATION_STEPS = 30  # of Gauss and Newton; fewer than 10 as a rule
CALIBRATION_STEP_TOLERANCE = 1e-3  # of steps, in deviations
EXACT_MASS_TOLERANCE = 1e-6  # relative deviation of a known mass for the body that can exist


@dataclass(frozen=True, eq=False)
class LoadFit:
    """Inertial parameters of H loads."""

    x: np.ndarray  # (H, 10)
    covariance: np.ndarray  # (10 H, 10 H); infinite on the diagonal where the logs do not determine a parameter
    information: np.ndarray  # (10 H, 10 H) of x alone
    mismatch: float  # chi^2 over its degrees of freedom, of what the loads do not explain


@dataclass(frozen=True)
class PayloadOptions:
    """The options of `Robot.payload`."""

    body: str | None
    drives: DriveTerms
    mass: float | None
    as_given: bool


@stage("identification of the payload")
def identify_payload(
    robot: R, with_load: Motion | Poses, without_load: Motion | Poses | None, given: PayloadOptions
) -> Payload[R]:
    """Identify a payload, see `Robot.payload`."""
    terms, m, mass = drive_trains.select_terms(given.drives), robot.mechanism, given.mass
    model = with_smoothing_velocity(robot, terms, None)
    positions.check_single_screws(m, "payload()")
    frame = body_parameters.find_load_frame(m, given.body)
    if mass is not None and (not scalars.is_finite(mass) or not mass > 0 or without_load is None):
        raise JounceError(f"mass is {quote_value(mass)}; expected kg > 0 of a known load, and a log without it too")
    logs = [with_load] if without_load is None else [with_load, without_load]
    # Each log alone: its problem, its fit with friction of its own, warnings, and notes on poses.
    options = FitOptions(model, terms, as_given=given.as_given)
    results = [_fit_log(options, log, name) for log, name in zip(logs, LOGS, strict=False)]
    posed, fits, log_warnings, pose_notes = map(list, zip(*results, strict=True))
    # K (base, 10) maps parameters of the load in its frame to base parameters, through those of its body.
    place = 10 * frame.body
    transport = base_parameters.transport_parameters(np.asarray(frame.T, dtype=float))
    K, known = posed[0].base.matrix[:, place : place + 10] @ transport, without_load is None
    # The load from all fits, and two loads from the halves of its log: they differ where the load changes.
    load = fit_loads(fits, (0, None)[: len(fits)], K, known)
    halves = None
    if len(posed[0].noise) > 0 or _are_halves_full(posed[0], fits[0]):
        halves = fit_loads([*_fit_halves(posed[0]), *fits[1:]], (0, 1, None)[: 1 + len(fits)], K, known)
    notes = [
        f"{'poses' if isinstance(log, Poses) else 'log'} {name}: {text}"
        for log, texts, name in zip(logs, log_warnings, LOGS, strict=False)
        for text in texts
    ]
    _check_mass(load, known, mass, notes)
    at_rest = isinstance(with_load, Poses)
    when = "from the first poses to the last" if at_rest else "during the log"
    half_notes = [] if halves is None else _half_notes(halves, when)
    notes += [*half_notes, *_mismatch_notes(load, fits, K, known, frame.name)]
    # A known mass separates the scale of the torques from the load: both are fitted once more, from this load.
    factors: list[np.ndarray] = []
    if mass is not None:
        shown = f"{load.x[0, 0]:.4g} +- {np.sqrt(load.covariance[0, 0]):.2g} kg"
        *factors, load = calibrate_torques(posed, fits, load, K, float(mass))
        notes += _factor_notes(factors[0], factors[1], float(mass), shown)
    x, table, body_parameters_of_load = _describe(load, float(m.M[:, 3, 3].sum()))
    if mass is None and len(half_notes) == 0 and abs(x[0]) < NULL_DEVIATIONS * table[0].deviation:
        notes.append(f"no load is seen: its mass is {x[0]:.3g} +- {table[0].deviation:.2g} kg")
    if isinstance(with_load, Poses):
        table = table[:MASS_AND_CENTRE]
        _check_seen(table[0], with_load)
    undetermined = [row.name for row in table if not row.seen]
    if at_rest and len(undetermined) > 0:
        notes.append(f"these poses do not determine {join_names(undetermined)}: more poses, which differ more, do")
    elif len(undetermined) > 0:
        cure = f"expected the motion of {Remedy('robot.excite(payload=True)', '`jounce excite --payload`')}"
        notes.append(f"the logs do not determine {join_names(undetermined)}: deviations exceed sizes; {cure}")
    for text in notes:
        warn(text)
    read_notes = [text for log in logs if isinstance(log, Poses) for text in log.notes]
    notes += dict.fromkeys([*read_notes, *(text for texts in pose_notes for text in texts)])
    # The robot that carries the nearest body that can exist.
    p = np.array(body_parameters.inertial_parameters(m))
    p[place : place + 10] += transport @ body_parameters_of_load
    return Payload(
        robot=with_mechanism(robot, body_parameters.with_inertial_parameters(m, p)),
        frame=frame.name,
        parameters=x,
        covariance=load.covariance,
        body=body_parameters_of_load,
        table=table,
        halves=() if halves is None else _half_masses(halves),
        mismatch=load.mismatch,
        factors=None if mass is None else (factors[0], factors[1]),
        notes=tuple(notes),
        undetermined=MOMENTS_OF_INERTIA if at_rest else (),
    )


def _fit_log(
    options: FitOptions, log: Motion | Poses, name: str
) -> tuple[IdentificationProblem, Regression, list[str], tuple[str, ...]]:
    """Fit one log: its problem, its solution, warnings, and notes on poses."""
    if isinstance(log, Poses):
        if not np.nan_to_num(log.torques).any():
            raise JounceError(f"all torques of the poses {name} are 0; expected measured ones, N m or N at the joints")
        poses_fit = fit_poses(options, log)
        rows = _residual_rows(poses_fit.posed, poses_fit.solution)
        estimate = poses_fit.posed.corrected_parameters(poses_fit.solution.x)[poses_fit.posed.places]
        unexplained = poses_fit.unexplained_warnings(rows, estimate)
        return poses_fit.posed, poses_fit.solution, [*poses_fit.warnings, *unexplained], poses_fit.notes
    mechanism = options.robot.mechanism
    path = along.check_motion(mechanism, log)
    measurements = check_measurements(mechanism, path, None, None, None, None)
    if not measurements.forces.any():
        raise JounceError(f"all torques of the log {name} are 0; expected measured ones, N m or N at the joints")
    measured = MeasuredLog(f"log {name}", path, measurements, np.ones(len(measurements.t), dtype=bool))
    fit = fit_logs(options, [measured])
    posed, solution = fit.posed[0], fit.solution
    rows, estimate = _residual_rows(posed, solution), posed.corrected_parameters(solution.x)[posed.places]
    unexplained = unexplained_warnings(posed, rows, estimate)
    return posed, solution, [*force_warnings(posed), *fit.delayed[0], *fit.shown[0].notes, *unexplained], ()


def _fit_halves(posed: IdentificationProblem) -> list[Regression]:
    """Fit both halves of the cells of a log."""
    half, fits = len(posed.cells.off) // 2, []
    for part in (slice(half), slice(half, None)):
        errors = posed.errors.part(part)
        cells = CellAverages(*(values[part] for values in vars(posed.cells).values()))
        fits.append(fit_forces(cells, posed.columns, errors, known=False, logs=posed.noise))
    return fits


def _are_halves_full(posed: IdentificationProblem, fit: Regression) -> bool:
    """Return whether half of the poses hold enough torques for a fit."""
    half = len(posed.cells.off) // 2
    return bool(np.count_nonzero(posed.cells.counts[:half]) >= MIN_HALF_TORQUES * fit.rank)


def _residual_rows(posed: IdentificationProblem, fit: Regression) -> tuple[ForceResidual, ...]:
    """Return what a fit leaves of the torques of a log."""
    # Corrections of base parameters are corrections of the inertial parameters after which they are named.
    base, parameters = posed.base, np.array(body_parameters.inertial_parameters(posed.robot.mechanism))
    parameters[base.columns] += fit.x[: base.count]
    estimate = posed.corrected_parameters(fit.x)
    return force_residuals(posed, posed.predict(parameters, estimate[base.count :], fit.x), fit.motion_errors)


def _check_seen(mass: PayloadParameter, poses: Poses) -> None:
    """Raise `JounceError` of poses that are too alike to determine the mass."""
    spread = np.ptp(poses.q, axis=0).max()
    if mass.seen or spread > MIN_POSE_SPREAD:
        return
    came = f"{len(poses)} poses do not determine the mass of the load, {mass.value:.3g} +- {mass.deviation:.2g} kg"
    raise JounceError(f"{came}: joints differ by at most {spread:.2g} rad or m; expected poses that differ more")


def _check_mass(load: LoadFit, known: bool, mass: float | None, notes: list[str]) -> None:
    """Raise `JounceError` of a negative mass, or of one that calibrates nothing.

    Of a negative mass, notes on the torques may say why.
    """
    m, s = load.x[0, 0], np.sqrt(load.covariance[0, 0])
    if m < -MAX_DEVIATIONS * s:
        cure = "ROBOT without the load" if known else "the log with the load first: they seem to be swapped"
        why = "; ".join(notes) if len(notes) > 0 else f"expected {cure}"
        raise JounceError(f"the mass of the load is negative, {m:.4g} +- {s:.2g} kg; {why}")
    if mass is not None and not m > MAX_DEVIATIONS * s:
        raise JounceError(
            f"mass is {float(mass):g}, and the torques show {m:.3g} +- {s:.2g} kg: too little to calibrate them"
        )


def _factor_notes(factors: np.ndarray, deviations: np.ndarray, mass: float, shown: str) -> list[str]:
    """Return a note on a mass that asks for impossible torque constants."""
    usual = float(np.median(factors[np.isfinite(deviations)]))
    if 1 / MAX_CONSTANT_ERROR < usual < MAX_CONSTANT_ERROR:
        return []
    why = f"the torques show {shown}, and true ones would be {usual:.3g} times as large"
    return [f"mass is {mass:g} kg and contradicts the torques: {why}; weigh the load again, or check their unit"]


def _mismatch_notes(load: LoadFit, fits: list[Regression], K: np.ndarray, known: bool, frame: str) -> list[str]:
    """Return notes on logs that differ by more than a load."""
    if load.mismatch > MAX_MISMATCH:
        pair = "the robot and the log differ" if known else "the logs differ"
        cure = "a log without the load, or identify the robot first" if known else "logs of one robot, in one state"
        why = f"chi^2 of the rest is {load.mismatch:.3g} per degree of freedom"
        return [f"{pair} by more than a load on {errors.shorten(frame)}: {why}; expected {cure}"]
    if known:
        return []
    # The log without the load, held against the model as if it carried one: only a load explains it, or nothing.
    null = fit_loads(fits[1:], (0,), K, known=True)
    m, s = null.x[0, 0], np.sqrt(null.covariance[0, 0])
    if null.mismatch > MAX_MISMATCH or not abs(m) > MAX_DEVIATIONS * s:
        return []
    return [f"the log without the load differs from the robot by a load of {m:.4g} +- {s:.2g} kg; expected none"]


def _half_masses(halves: LoadFit) -> tuple[tuple[float, float], ...]:
    """Return the mass of each half, and its deviation."""
    spreads = np.sqrt(np.diag(halves.covariance)[::10])
    return tuple((float(m), float(s)) for m, s in zip(halves.x[:, 0], spreads, strict=True))


def _half_notes(halves: LoadFit, when: str) -> list[str]:
    """Return a note on halves of the log whose loads differ.

    They differ by masses and first moments, as second moments are known worse.
    """
    # Those that both halves determine, and the covariance C11 + C22 - C12 - C21 of their change.
    determined = np.flatnonzero(np.isfinite(np.diag(halves.covariance)[:4] + np.diag(halves.covariance)[10:14]))
    C, change = halves.covariance, (halves.x[1] - halves.x[0])[determined]
    blocks = [C[np.ix_(determined + a, determined + b)] for a, b in ((0, 0), (10, 10), (0, 10), (10, 0))]
    change_covariance = blocks[0] + blocks[1] - blocks[2] - blocks[3]
    # chi^2 of the change, over its degrees of freedom.
    if change @ np.linalg.solve(change_covariance, change) <= len(determined) * MAX_DEVIATIONS**2:
        return []
    both = " and ".join(f"{m:.4g} +- {s:.2g} kg" for m, s in _half_masses(halves))
    return [f"the load changes {when}: its halves have {both}; expected one load from start to end"]


def _describe(load: LoadFit, robot_mass: float) -> tuple[np.ndarray, tuple[PayloadParameter, ...], np.ndarray]:
    """Return the estimate of a load, its table, and a possible body."""
    # A positive mass near to the estimate: a part of the robot's, where the logs do not determine it.
    x, least = load.x[0], MIN_LOAD_SHARE * robot_mass
    deviation = np.sqrt(load.covariance[0, 0])
    m = least
    if deviation < max(abs(x[0]), least):
        m = max(float(x[0]), min(float(deviation), least))
    # A ball of this mass, for sizes of parameters, and for what the logs do not determine.
    radius = (3 * m / (4 * np.pi * LOAD_DENSITY)) ** (1 / 3)
    nonzero = x if x[0] != 0 else np.append(m, x[1:])
    values = central_parameters(nonzero)
    deviations = np.sqrt(np.diag(central_covariance(nonzero, load.covariance)))
    sizes = m * np.append(0, np.ones(9)) * radius**base_parameters.LENGTH_POWERS
    sizes[1:4] = radius
    seen = deviations <= np.maximum(np.abs(values), np.where(base_parameters.LENGTH_POWERS == 0, least, sizes))
    # The prior: moments of mass of the ball at the COM, as far as this is seen, else at the origin.
    c = np.where(seen[1:4], values[1:4], 0.0)
    moments = m * np.block([[radius**2 / 5 * np.eye(3) + np.outer(c, c), c[:, None]], [c, np.ones(1)]])
    body = fit_consistent_body(x, load.information, moments, LOAD_PRIOR_WEIGHT)
    rows = zip(TABLE, values, deviations, central_parameters(body), seen, strict=True)
    table = tuple(PayloadParameter(*name, float(v), float(s), float(b), bool(k)) for name, v, s, b, k in rows)
    return x, table, body


# The load, from fits of logs.
def fit_loads(logs: Sequence[Regression], loads: Sequence[int | None], K: np.ndarray, known: bool) -> LoadFit:
    """Fit loads to the fits of logs, which have load numbers.

    The number is None of a log without a load. The robot's base parameters may be `known`.
    """
    # Unknowns u: base parameters p unless they are known, drive terms d_l of each log, then ten of each load.
    base = len(K)
    count, robot = 1 + max(load for load in loads if load is not None), 0 if known else base
    ends = robot + np.cumsum([0, *(len(log.x) - base for log in logs)])  # of the drive terms of each log
    first = int(ends[-1])
    # z_l = L_l u = (p + K x; d_l), with L_l (len(z_l), len(u)).
    maps = [np.zeros((len(log.x), first + 10 * count)) for log in logs]
    for L, load, start, end in zip(maps, loads, ends, ends[1:], strict=False):
        L[:robot, :robot] = np.eye(robot)
        L[base:, start:end] = np.eye(end - start)
        if load is not None:
            L[:base, first + 10 * load : first + 10 * (load + 1)] = K
    # Normal equations of the sum of (L u - z_l)^T A_l (L u - z_l), solved in the directions with information.
    A = np.sum([L.T @ log.information @ L for L, log in zip(maps, logs, strict=True)], axis=0)
    X, values, blind = informed_directions(A)
    u = X @ (X.T @ np.sum([L.T @ log.information @ log.x for L, log in zip(maps, logs, strict=True)], axis=0))
    # chi^2 of what loads do not explain; deviations grow with its root.
    remainders = [log.x - L @ u for L, log in zip(maps, logs, strict=True)]
    freedom = sum(log.rank for log in logs) - len(values)
    chi_square = sum(float(r @ log.information @ r) for r, log in zip(remainders, logs, strict=True))
    mismatch = chi_square / freedom if freedom > 0 else 1.0
    scale = max(1.0, mismatch)
    covariance = scale * X[first:] @ X[first:].T
    covariance[blind[first:], blind[first:]] = np.inf
    # The information of the loads alone: a Schur complement, which eliminates all other unknowns.
    others = informed_directions(A[:first, :first])[0]
    part = others.T @ A[:first, first:]
    return LoadFit(u[first:].reshape(count, 10), covariance, (A[first:, first:] - part.T @ part) / scale, mismatch)


# Torque constants, from a load of known mass.
def calibrate_torques(
    posed: Sequence[IdentificationProblem], fits: Sequence[Regression], start: LoadFit, K: np.ndarray, mass: float
) -> tuple[np.ndarray, np.ndarray, LoadFit]:
    """Fit factors of torques to logs with and without a known load.

    Returns the factors (nv,) that make torques true, their deviations, and the load.
    """
    # The rows of each measured force in each log, alone: base parameters z_jl with the information A_jl.
    base = len(K)
    measured = np.flatnonzero([np.isfinite(x) for x in fits[0].deviations + fits[1].deviations])
    pairs = [*enumerate(zip(posed, fits, strict=True))]
    rows = [(j, log, *_fit_force(problem, fit, int(j), base)) for j in measured for log, (problem, fit) in pairs]
    # z_jl = g_j L_l u with u = (p; x), and L = (1, K) of the log with the load, (1, 0) of the other. The mass is known.
    maps = np.stack([np.hstack([np.eye(base), K]), np.hstack([np.eye(base), 0 * K])])
    free = np.delete(np.arange(base + 10), base)
    # Start: one factor for all, with which the load that the torques show has its mass.
    scale = float(start.x[0, 0]) / mass
    g = np.full(len(fits[0].deviations), scale)
    u = np.append(posed[0].base.values + fits[1].x[:base], start.x[0]) / scale
    u[base] = mass
    for _ in range(MAX_CALIBRATION_STEPS):
        # Gauss-Newton's normal equations A step = b, of unknowns (free part of u; g), by the derivatives J of g_j L u.
        A, b, chi_square = np.zeros((len(free) + len(g),) * 2), np.zeros(len(free) + len(g)), 0.0
        for j, log, z, information in rows:
            J = np.zeros((base, len(b)))
            J[:, : len(free)], J[:, len(free) + j] = g[j] * maps[log][:, free], maps[log] @ u
            remainder = z - g[j] * maps[log] @ u
            A += J.T @ information @ J
            b += J.T @ information @ remainder
            chi_square += float(remainder @ information @ remainder)
        # X^T b is the step in deviations, as X^T A X = 1.
        X, values, blind = informed_directions(A)
        step = X.T @ b
        u[free] += (X @ step)[: len(free)]
        g += (X @ step)[len(free) :]
        if np.linalg.norm(step) < CALIBRATION_STEP_TOLERANCE:
            break
    # chi^2 of what neither load nor factors explain; deviations grow with its root.
    freedom = sum(np.linalg.matrix_rank(information, hermitian=True) for *_, information in rows) - len(values)
    mismatch = chi_square / freedom if freedom > 0 else 1.0
    covariance = max(1.0, mismatch) * X @ X.T
    covariance[blind, blind] = np.inf
    # Factors of forces without rows are not determined. A factor that makes torques true is 1 / g.
    deviations = np.sqrt(np.diag(covariance)[len(free) :])
    deviations[np.diag(A)[len(free) :] == 0] = np.inf
    # The load with its mass as an exact measurement.
    load_covariance = np.zeros((10, 10))
    load_covariance[1:, 1:] = covariance[base : base + 9, base : base + 9]
    finite = np.where(np.isinf(load_covariance), 0.0, load_covariance)
    information = np.linalg.pinv(finite, hermitian=True)
    information[0, 0] = (EXACT_MASS_TOLERANCE * mass) ** -2
    load = LoadFit(u[None, base:], load_covariance, information, mismatch)
    return 1 / g, deviations / g**2, load


def _fit_force(posed: IdentificationProblem, fit: Regression, j: int, base: int) -> tuple[np.ndarray, np.ndarray]:
    """Fit the rows of one force alone.

    Returns its base parameters, and their information without drive terms.
    """
    # One force says nothing of errors of accelerations: those of the fit of all enter as known variances.
    cells = CellAverages(*(values[:, [j]] for values in vars(posed.cells).values()))
    cells = replace(cells, spread=cells.spread + fit.motion_errors[j] ** 2)
    force_fit = fit_forces(cells, posed.columns, None, known=False, logs=posed.noise)
    # A Schur complement eliminates the drive terms.
    X = informed_directions(force_fit.information[base:, base:])[0]
    part = X.T @ force_fit.information[base:, :base]
    return posed.base.values + force_fit.x[:base], force_fit.information[:base, :base] - part.T @ part
