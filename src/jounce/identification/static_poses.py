"""Fit a robot to poses at rest: what gravity, springs and constant torques determine.

Without velocities and accelerations Q = Y(q, 0, 0) p holds first moments, masses that gravity pulls, springs and
offsets. Moments of inertia, damping and armature have columns of 0, and get no value (`NEVER_AT_REST`).

Friction at rest is anything within +-f. What remains of it after a joint has stopped has the direction from which the
joint came: a column of signs, which is one parameter of Coulomb friction where a joint came from both sides, and the
same as an offset where it came from one. Where no directions are stated, those from row to row stand for them: of poses
in the order in which they were taken, these columns take friction out that would be taken for load, as a joint that
comes from below is mostly high; of others they cost a degree of freedom per joint. Friction is not named then. What
these columns leave of it is noise, and makes deviations as large as it is.

`fit_poses` is the door. It poses a `StaticProblem`, which is a problem of logs of which each cell is a pose, and fits
it as logs are fitted, with residuals that are independent from pose to pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from jounce.arguments.names import check_names, find_followers
from jounce.core import cures
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, shorten
from jounce.core.typing import ArrayLike, DriveTerm
from jounce.dynamics import base_parameters
from jounce.engine.drives import compute_regressor
from jounce.engine.engine import Engine
from jounce.engine.plan import compute
from jounce.identification import noise_spectra
from jounce.identification.averaging import CellAverages
from jounce.identification.force_checks import force_warnings, refuse_odd_scale, unexplained_warnings
from jounce.identification.least_squares_problem import FitOptions, IdentificationProblem
from jounce.identification.measurements import Measurements, check_measurements
from jounce.identification.motion_errors import find_acceleration_errors
from jounce.identification.regression import Regression, fit_forces, informed_directions
from jounce.identification.result import ForceResidual
from jounce.model import coordinates
from jounce.model.mechanism import Mechanism
from jounce.motion import units
from jounce.motion.hermite import HermiteCurve
from jounce.motion.motion import Motion
from jounce.motion.poses import Poses
from jounce.spatial import inertia

NEVER_AT_REST = ("moments of inertia", "damping", "armature", "Stribeck friction", "friction by the load")
REST_TERMS: tuple[DriveTerm, ...] = ("friction", "spring", "offset")  # drive terms that rest may determine
MIN_FREEDOM = 2.0  # of the residuals of a joint: of fewer nobody knows how far off its torques are
MIN_LOADED_SHARE = 0.1  # of the largest torque of the model: signs and units of smaller ones do not show at rest
ROUNDING = 1e-12  # of the largest entry of a regressor: smaller ones are sums of zeros
PROBE_POSES = 64  # at which parameters are sought that no poses determine: more than an arm has parameters
PROBE_REACH = 1.5  # rad or m, of joints in these poses
ANGLES_CURE = Remedy(
    "numpy.deg2rad makes rad of them, and Poses(..., angles='rad') states that they are rad",
    "state the unit by --angles deg or --angles rad",
)


@dataclass(frozen=True, eq=False)
class StaticProblem(IdentificationProblem):
    """The least-squares problem of N poses at rest: each of them is a cell."""

    regressor: np.ndarray = field(kw_only=True)  # (N, nv, P) of all columns, also where no torque is measured

    @property
    def labels(self) -> tuple[str, ...]:
        """The names of the sought parameters."""
        joints = self.robot.mechanism.joints
        names = [*self.base.names, *(f"{joint} {term}" for term in self.terms for joint in joints)]
        return tuple(names[k] for k in self.places)

    def _linear_forces(self, changes: np.ndarray) -> np.ndarray:
        """Return forces of changes (P, k) at the poses: (k, N, nv)."""
        return np.moveaxis(self.regressor @ changes, -1, 0) + self.model


@dataclass(frozen=True, eq=False)
class StaticFit:
    """A fit of poses at rest."""

    posed: StaticProblem
    solution: Regression
    named: np.ndarray  # (terms * joints,) which drive parameters are named: friction may only be taken out
    determined: np.ndarray  # (P,) which of the sought parameters the poses determine
    undetermined: tuple[str, ...]  # what rest does not determine
    unseen: tuple[str, ...]  # what other poses would determine
    warnings: tuple[str, ...]  # of suspicious torques
    notes: tuple[str, ...]  # on friction

    def without_nuisance(self) -> tuple[StaticProblem, Regression, np.ndarray]:
        """Return problem, solution and what is determined (K,), of named parameters."""
        count = self.posed.base.count
        keep = np.append(np.ones(count, dtype=bool), self.named[self.posed.sought])
        solution, information = self.solution, self.solution.information
        # What is taken out is eliminated: a Schur complement, in the directions that have information.
        X = informed_directions(information[np.ix_(~keep, ~keep)])[0]
        part = X.T @ information[np.ix_(~keep, keep)]
        reduced = replace(
            solution,
            x=solution.x[keep],
            covariance=solution.covariance[np.ix_(keep, keep)],
            information=information[np.ix_(keep, keep)] - part.T @ part,
            offsets=solution.offsets[keep],
        )
        # The robot that is identified has no terms of which nothing is named.
        joints = len(self.posed.robot.mechanism.joints)
        of_terms = self.named.reshape(-1, joints)
        terms = tuple(term for term, of_term in zip(self.posed.terms, of_terms, strict=True) if of_term.any())
        first = len(self.posed.base.parameters)
        columns = np.append(np.ones(first, dtype=bool), np.repeat(of_terms.any(axis=1), joints))
        posed = replace(
            self.posed,
            terms=terms,
            sought=of_terms[of_terms.any(axis=1)].ravel(),
            cells=replace(self.posed.cells, Y=self.posed.cells.Y[..., columns]),
            regressor=self.posed.regressor[..., columns],
        )
        return posed, reduced, self.determined[keep]

    def unexplained_warnings(self, rows: Sequence[ForceResidual], parameters: np.ndarray) -> list[str]:
        """Return a warning of loaded joints whose torques remain unexplained."""
        loaded = np.array(coordinates.force_names(self.posed.robot.mechanism))[_loaded_forces(self.posed)]
        return unexplained_warnings(self.posed, [row for row in rows if row.force in loaded], parameters)

    def unseen_warnings(self, uncertain: Sequence[str]) -> list[str]:
        """Name the parameters that other poses would determine.

        They have no value, or are `uncertain`, with deviations that exceed their sizes.
        """
        names = [*self.unseen, *uncertain]
        if len(names) == 0:
            return []
        return [f"these poses do not determine {join_names(names)}: more poses, which differ more, determine them"]


def fit_poses(
    options: FitOptions, poses: Poses, weights: ArrayLike | None = None, deviations: ArrayLike | None = None
) -> StaticFit:
    """Fit a robot to poses at rest.

    Raise `JounceError` if measured torques are fewer than unknowns, or determine no inertial parameter.
    """
    m = options.robot.mechanism
    poses = _order_joints(m, poses)
    samples = check_measurements(m, _resting_motion(poses), None, None, weights, deviations)
    poses = _select_poses(poses, samples.t.astype(int))
    signs = _approach_signs(m, poses)
    stated = poses.approach is not None
    terms = tuple(term for term in options.terms if term in REST_TERMS)
    # Friction is a parameter of joints that came from both sides: of others it is the same as their offset.
    both_sides = np.asarray((signs > 0).any(axis=0) & (signs < 0).any(axis=0))
    has_column = both_sides if "offset" in terms else np.asarray((signs != 0).any(axis=0))
    sought = _mask_parameters(terms, has_column)
    posed = _pose_at_rest(options.robot, poses, samples, terms, sought, signs)
    by_any = _determined_by_any_poses(posed)
    _check_count(posed, by_any.sum())
    refuse_odd_scale(_loaded_part(posed), options.as_given)
    solution = fit_forces(posed.cells, posed.columns, None, options.known, noise_spectra.INDEPENDENT)
    by_these = np.isfinite(np.diag(solution.covariance))
    count = posed.base.count
    if not by_these[:count].any():
        raise JounceError(_nothing_words(poses, bool(by_any[:count].any())))
    if not options.known:
        _check_freedom(posed, solution)
    # What has no value, in words: moments of inertia are one of them, as rest determines none.
    of_moments = posed.base.columns % len(inertia.INERTIAL_PARAMETERS) >= inertia.INERTIAL_PARAMETERS.index("Ixx")
    of_moments = np.append(of_moments, np.zeros(len(by_any) - count, dtype=bool))
    labels = np.array(posed.labels)
    by_none = labels[~by_any & ~of_moments].tolist()
    friction, friction_notes = _describe_friction(m, options.terms, both_sides, stated)
    return StaticFit(
        posed,
        solution,
        _mask_parameters(terms, both_sides & stated),
        by_these,
        (*NEVER_AT_REST, *by_none, *friction),
        tuple(labels[by_any & ~by_these].tolist()),
        tuple(_loaded_warnings(posed)),
        tuple(friction_notes),
    )


def _mask_parameters(terms: Sequence[DriveTerm], with_friction: np.ndarray) -> np.ndarray:
    """Return a mask (terms * joints,) of drive parameters: friction of some joints."""
    rows = [with_friction if term == "friction" else np.ones_like(with_friction) for term in terms]
    return np.concatenate(rows) if len(rows) > 0 else np.zeros(0, dtype=bool)


# The poses: joints, samples, directions.
def _order_joints(m: Mechanism, poses: Poses) -> Poses:
    """Return poses with the joints of a robot, in its order."""
    if m.floats:
        cure = Remedy("base='fixed' of jounce.load", "--base fixed")
        raise JounceError(f"{m.name!r} has a floating base; poses at rest are those of robots that stand: {cure}")
    if poses.joint_names is not None:
        expected = f"{join_names(m.coordinates)}, the joints of {m.name!r}"
        check_names(poses.joint_names, m.coordinates, find_followers(m), expected)
        order = [poses.joint_names.index(joint) for joint in m.coordinates]
        approach = None if poses.approach is None else poses.approach[:, order]
        poses = replace(
            poses, q=poses.q[:, order], torques=poses.torques[:, order], joint_names=m.coordinates, approach=approach
        )
    elif poses.q.shape[1] != m.n:
        came = f"poses of {poses.q.shape[1]} joints without names"
        raise JounceError(f"{came}; {m.name!r} has {join_names(m.coordinates)}")
    if poses.angles is None:
        t = np.arange(float(len(poses)))
        units.check_angles(t, poses.q, np.zeros_like(poses.q), m, "the poses", ANGLES_CURE)
    return poses


def _resting_motion(poses: Poses) -> Motion:
    """Return a motion that rests in pose k at k seconds.

    What takes logs takes it too; nothing depends on the way between.
    """
    t = np.arange(float(len(poses)))
    curve = HermiteCurve(t, (poses.q, np.zeros_like(poses.q), np.zeros_like(poses.q)))
    return Motion(curve, poses.joint_names, "poses at rest", grid=t, torques=(t, poses.torques))


def _select_poses(poses: Poses, rows: np.ndarray) -> Poses:
    approach = None if poses.approach is None else poses.approach[rows]
    places = tuple(poses.places[k] for k in rows)
    return replace(poses, q=poses.q[rows], torques=poses.torques[rows], approach=approach, places=places)


def _approach_signs(m: Mechanism, poses: Poses) -> np.ndarray:
    """Return the directions (N, nc) from which joints came: those stated, or those from pose to pose."""
    return np.asarray(np.sign(poses.directions @ m.G.T))


# The problem, and what it determines.
def _pose_at_rest(
    robot: Engine,
    poses: Poses,
    samples: Measurements,
    terms: tuple[DriveTerm, ...],
    sought: np.ndarray,
    signs: np.ndarray,
) -> StaticProblem:
    """Pose the problem of poses, with friction by directions (N, nc)."""
    m, base = robot.mechanism, base_parameters.base_parameters(robot.mechanism)
    Y = _regressor_at_rest(robot, poses.q, terms, signs)
    at_rest = np.zeros_like(poses.q)
    model = np.asarray(compute(robot, "inverse_dynamics", (poses.q, at_rest, at_rest)))
    # Friction of the model acts where its direction is known.
    if "friction" in m.acting and poses.approach is not None:
        model = model + (signs * m.drives.friction) @ m.G
    measured = samples.weights > 0
    off, zero = (samples.forces - model) * measured, np.zeros_like(model)
    cells = CellAverages(Y * measured[..., None], off, model * measured, samples.weights, zero)
    columns = np.append(base.columns, len(base.parameters) + np.flatnonzero(sought))
    motion = _resting_motion(poses)
    times = np.arange(float(len(poses)))
    errors = find_acceleration_errors(
        robot, motion, (times, np.arange(len(poses))), terms, columns=columns, deviations=None
    )
    samples = replace(samples, t=times)
    return StaticProblem(
        robot, motion, terms, sought, base, samples, np.ones(len(poses), dtype=bool), samples, model,
        band=np.nan, width=1.0, cells=cells, errors=errors, noise=noise_spectra.INDEPENDENT, regressor=Y,
    )  # fmt: skip


def _regressor_at_rest(robot: Engine, q: np.ndarray, terms: Sequence[DriveTerm], signs: np.ndarray) -> np.ndarray:
    """Return the regressor (N, nv, P), with friction by directions (N, nc)."""
    at_rest = np.zeros_like(q)
    Y = np.array(compute_regressor(robot, "regressor", (q, at_rest, at_rest), terms))
    joints = signs.shape[1]
    # Gravity has no moment about a vertical joint, but for rounding, which the fit of its torques alone would weigh.
    Y[np.abs(Y) < ROUNDING * np.abs(Y).max()] = 0.0
    if "friction" in terms:
        first = Y.shape[-1] - joints * (len(terms) - terms.index("friction"))
        # A unit of friction of each joint, along the rows of G: (N, nv, nc).
        Y[..., first : first + joints] = signs[:, None] * robot.mechanism.G.T
    return Y


def _determined_by_any_poses(posed: StaticProblem) -> np.ndarray:
    """Return which of the sought parameters (P,) some poses determine: those of random poses, from all sides."""
    m, rng = posed.robot.mechanism, np.random.default_rng(0)
    Y = posed.regressor
    # Random positions of joints in loops need not close them: their own poses say what rest determines.
    if m.closure is None:
        q = rng.uniform(-PROBE_REACH, PROBE_REACH, (PROBE_POSES, m.n))
        signs = rng.choice([-1.0, 1.0], (PROBE_POSES, len(m.joints)))
        Y = _regressor_at_rest(posed.robot, q, posed.terms, signs)
    columns = Y[..., posed.columns]
    return np.asarray(~informed_directions(noise_spectra.gram(columns, columns))[2])


def _check_count(posed: StaticProblem, unknowns: int) -> None:
    """Raise `JounceError` if there are fewer torques than unknowns."""
    measured, count = np.count_nonzero(posed.samples.weights), len(posed.samples.t)
    if measured >= unknowns:
        return
    needed = int(np.ceil(unknowns * count / measured))
    came = f"{count} poses hold {measured} measured torques for {unknowns} unknowns"
    raise JounceError(f"{came}; expected {needed} poses or more, or fewer {cures.option_name('drives')}")


def _check_freedom(posed: StaticProblem, solution: Regression) -> None:
    """Raise `JounceError` if parameters take all torques of a joint."""
    weights = np.where(posed.cells.counts > 0, solution.weights, 0.0)
    Z = posed.cells.Y[..., posed.columns] * np.sqrt(weights)[..., None]
    Q = Z @ informed_directions(noise_spectra.gram(Z, Z))[0]
    counts = (posed.cells.counts > 0).sum(axis=0)
    freedom = np.where(counts > 0, counts - (Q**2).sum(axis=(0, 2)), np.inf)
    j = int(freedom.argmin())
    if freedom[j] >= MIN_FREEDOM:
        return
    name = shorten(coordinates.force_names(posed.robot.mechanism)[j])
    came = f"the parameters take {counts[j] - freedom[j]:.3g} of {counts[j]} torques of {name} for themselves"
    deviations = Remedy("deviations= of the torques", "--deviation of the torques")
    ways: list[Remedy | str] = ["more poses", f"fewer {cures.option_name('drives')}", deviations]
    raise JounceError(f"{came}: nothing says how far off they are; expected {cures.join_cures(ways)}")


def _nothing_words(poses: Poses, by_others: bool) -> str:
    """Say that poses determine nothing, and why."""
    if not by_others:
        return (
            "rest determines no inertial parameter of this robot: gravity loads none of its joints; expected a motion"
        )
    spread = np.ptp(poses.q, axis=0).max()
    came = f"{len(poses)} poses determine no inertial parameter: joints differ by {spread:.2g} rad or m at most"
    return f"{came}; expected poses that differ, such as half the reach of each joint"


# Warnings.
def _loaded_warnings(posed: StaticProblem) -> list[str]:
    """Return warnings of the torques of joints that gravity loads."""
    return force_warnings(_loaded_part(posed))


def _loaded_part(posed: StaticProblem) -> StaticProblem:
    """Return the problem of the joints that gravity loads alone."""
    cells = posed.cells
    return replace(posed, cells=replace(cells, counts=cells.counts * _loaded_forces(posed)))


def _loaded_forces(posed: StaticProblem) -> np.ndarray:
    """Return a mask (nv,) of the forces that gravity makes: friction hides signs and sizes of others."""
    sizes = np.sqrt((posed.model**2).mean(axis=0))
    return np.asarray(sizes >= MIN_LOADED_SHARE * sizes.max())


def _describe_friction(
    m: Mechanism, terms: Sequence[DriveTerm], both_sides: np.ndarray, stated: bool
) -> tuple[list[str], list[str]]:
    """Return which friction has no value, and notes on why."""
    if not stated:
        if "friction" not in terms:
            return ["Coulomb friction"], []
        note = (
            "no directions are stated from which joints came to rest: friction that follows the order of the poses is"
            " taken out, other friction counts as noise; columns JOINT.approach of 1, -1 or 0 state them"
        )
        return ["Coulomb friction"], [note]
    if both_sides.all() and "friction" in terms:
        return [], []
    if "friction" not in terms or not both_sides.any():
        names = "Coulomb friction"
    else:
        names = f"Coulomb friction of {join_names(np.array(m.joints)[~both_sides].tolist())}"
    if "friction" not in terms:
        return [names], []
    note = f"{names} is part of the offset, as no poses were approached from both sides; approach some from the other"
    return [names], [note]
