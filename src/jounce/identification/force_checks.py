"""Find what is wrong with measured forces, and what no parameter explains.

Before a fit, `force_warnings` compares forces with those of the model: another sign or unit, missing columns, sensors
that stand still; `refuse_odd_scale` refuses those that are a small share of the model's at most joints, as currents
of motors are; `free_swing_warnings` looks for logs without motors. After it, `unexplained_warnings` names the forces
of which the identified robot leaves most.

`find_torques` then asks which torques act that no parameter holds: friction that grows with the load, a rotor, a cable,
a hose, a push.

Problem: the residuals r of a fit, over their deviations, and rows U, orthonormal in the directions that parameters
take. Some torques that robots have are tried, one unit of each along the log as a column a:

* friction that grows with the load, |Q| tanh(v / eps) with the torque Q of the bodies;
* a constant force on the last body, as of a cable;
* springs of joints, as of a hose;
* rotors of joints;
* torques of a joint that are read too large, by a wrong torque constant: the torque itself;
* a load on the last body from some time on: the torque of a mass at its origin.

Springs pull back, and friction and rotors are positive; the others have either sign. What parameters leave of a column,
a' = a - U U^T a, has the coefficient a'^T r / a'^T a', with a deviation by the spectrum of r, as parameters have.

Algorithm: orthogonal matching pursuit (Y. C. Pati, R. Rezaiifar and P. S. Krishnaprasad, 1993). The column that is
beyond zero by the most deviations, over those that its kind needs, joins U, until none has as many, which is more than
Bayes' information criterion asks of logs of any length. What is left of each force is then searched for a short time
that holds most of its squares. Nothing is corrected here: parameters adapt to such torques, and a column that they
explain shows nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from jounce.core import errors
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names
from jounce.engine.plan import compute
from jounce.identification import noise_spectra
from jounce.identification.averaging import number_cells, weighted_means
from jounce.identification.least_squares_problem import IdentificationProblem
from jounce.identification.measurements import median_step
from jounce.identification.regression import MIN_RELATIVE_DEVIATION, Regression, informed_directions
from jounce.identification.result import ForceResidual
from jounce.model import coordinates, drive_trains
from jounce.spatial import inertia

MAX_SAMPLE_STEP = 1.0  # s: joints of arms start and stop within it
MAX_OPPOSED_CORRELATION = -0.5  # of measured forces with those of the model: below it their sign is suspected
MIN_SIMILAR_CORRELATION = 0.8  # of the same: above it their sizes are compared
MAX_SIZE_RATIO = 10.0  # of these sizes, beyond which the unit is suspected: no parameters are that wrong
# Of torques to those of a model that they follow: below it they are currents, or torques of motors before the gears.
# Currents are a fifth of the torques of an arm, or less. A real Panda has 0.8 to 0.9 next to the masses that its makers
# publish; next to bodies that are wrong by factors of exp(0.7 n), with n of variance 1, most joints never had less.
MIN_TORQUE_SCALE = 0.3
MIN_ODD_JOINTS = 2  # of another scale, where a robot has as many
MIN_FOLLOWED_SHARE = 0.75  # of the squares of torques beside friction: a joint with less does not follow the model
MAX_UNEXPLAINED_SHARE = 0.5  # of a force: what remains beyond it is more than friction or noise
MAX_PASSIVE_SHARE = 0.1  # of a force to the forces of single parameters, of which no motor makes them cancel
MAX_FREE_SHARE = 0.05  # of all forces to those of single parameters: no motor acts
MIN_FREE_SHARE = 1e-4  # of a column that parameters leave: below it they take its place
MIN_PUSH_CELLS = 40  # of a log, of which a tenth has not most of the squares by chance
PUSH_SHARE = 0.1  # of the time, within which pushes are looked for
MIN_PUSH_SQUARES = 2 / 3  # of a force's residuals in that time: they are four times as large there as elsewhere
MAX_DEVIATIONS = 4.0  # of a coefficient by chance: once in 1000 logs with some twenty columns
MAX_MOTION_DEVIATIONS = 6.0  # of what errors of accelerations look like, up to 4.2: rotors, factors, loads
MAX_LOAD_SHARE = 0.5  # of friction that grows with the load: gears with more lock themselves
MAX_GAIN = 0.5  # of torques that are read too large: more is a wrong unit, or a joint without a motor
LOAD_TIMES = 15  # at which a load may begin or end: even parts of a log
TorqueKind = Literal["friction by the load", "force", "spring", "rotor", "factor", "load"]


def force_warnings(posed: IdentificationProblem) -> list[str]:
    """Return warnings of measured forces, compared with the forces of the model."""
    names, cells = coordinates.force_names(posed.robot.mechanism), posed.cells
    # Whoever comes here with another scale has asked for it: others are refused.
    scale = refuse_odd_scale(posed, as_given=True)
    compared = compare_forces(names, cells.counts, cells.off + cells.model, cells.model)
    return [*_sparse_warnings(posed), *_missing_forces(posed, names), *compared, *scale]


def _sparse_warnings(posed: IdentificationProblem) -> list[str]:
    """Return a warning of samples that are too far apart."""
    step = median_step(posed.samples.t)
    if posed.motion.samples is None or step < MAX_SAMPLE_STEP:
        return []
    cure = "if each row is a pose at rest, leave the column of times out"
    return [f"samples are {step:.3g} s apart, and hide what moves between them: {cure}"]


def refuse_odd_scale(posed: IdentificationProblem, as_given: bool) -> list[str]:
    """Refuse torques of another scale than the model's, see `scale_notes`."""
    cells, n = posed.cells, posed.robot.n
    joints = coordinates.force_names(posed.robot.mechanism)[-n:]
    # Forces on a base that floats are left out.
    measured, model, counts = (x[:, -n:] for x in (cells.off + cells.model, cells.model, cells.counts))
    return scale_notes(joints, counts, np.stack([measured, model, mean_rates(posed)[1]]), as_given)


ODD_SCALE_CURE = Remedy(
    "torque_constants= (N m/A) and gear_ratios= of jounce.load_motion, or torques_as_given=True, which reads them as"
    " they are",
    "--torque-constants (N m/A) and --gear-ratios, or --torques-as-given, which reads them as they are",
)


def scale_notes(joints: Sequence[str], weights: np.ndarray, values: np.ndarray, as_given: bool) -> list[str]:
    """Refuse torques of another scale than the model's.

    They are so at most joints, and at two or more; where they are to be read `as_given`, a note says it. `values`
    (3, N, n) are measured torques, those Q of the model, and velocities. For each joint, the scale s is that of the fit
    tau = s Q + f sign(qd) + d qd + c, so that friction and offsets take no part. It counts where Q explains
    `MIN_FOLLOWED_SHARE` of what these leave.
    """
    errors.check_bool("torques_as_given", as_given, "whether torques of another scale than the model's are read")
    scales, follows = np.ones(len(joints)), np.zeros(len(joints), dtype=bool)
    for j, (w, tau, Q, qd) in enumerate(zip(weights.T, *np.moveaxis(values, -1, 1), strict=True)):
        friction = np.tanh(qd / drive_trains.DEFAULT_SMOOTHING_VELOCITY)
        columns = np.stack([Q, friction, qd, np.ones_like(qd)], axis=1) * np.sqrt(w)[:, None]
        # Columns of length 1, so that units do not decide on the rank.
        lengths = np.linalg.norm(columns, axis=0)
        columns, right = columns / np.where(lengths > 0, lengths, 1.0), np.sqrt(w) * tau
        (x, *_), (y, *_) = (np.linalg.lstsq(part, right, rcond=None) for part in (columns, columns[:, 1:]))
        left, left_without_model = (np.sum((right - part @ z) ** 2) for part, z in ((columns, x), (columns[:, 1:], y)))
        follows[j] = lengths[0] > 0 and left < (1 - MIN_FOLLOWED_SHARE) * left_without_model
        scales[j] = x[0] / lengths[0] if lengths[0] > 0 else 1.0
    # Torques of the other sign are named elsewhere.
    follows &= scales > 0
    odd = follows & ((scales < MIN_TORQUE_SCALE) | (scales > MAX_SIZE_RATIO))
    # One joint alone may have another load; of a robot of one joint it decides.
    if not 2 * odd.sum() > follows.sum() or odd.sum() < min(MIN_ODD_JOINTS, len(joints)):
        return []
    low, high = (f"{x:.2g}" for x in (scales[odd].min(), scales[odd].max()))
    share = low if low == high else f"{low} to {high}"
    came = f"torques of {join_names(np.array(joints)[odd])} are {share} times those of the model, which they follow"
    came += "; they may be currents, torques of motors before the gears, or in another unit"
    if not as_given:
        raise JounceError(f"{came}: expected {ODD_SCALE_CURE}")
    return [f"{came}; read as given"]


def free_swing_warnings(posed: IdentificationProblem) -> list[str]:
    """Return a warning of a log whose forces are next to nothing.

    Parameters times any factor explain such forces.
    """
    # Next to nothing: the forces of single parameters, as if none cancelled, are far larger.
    cells, model = posed.cells, posed.model_parameters[posed.places]
    measured = np.sqrt(((cells.off + cells.model) ** 2).mean(axis=0))
    parts = posed.single_forces(model)
    if not (measured < MAX_FREE_SHARE * parts).all():
        return []
    share = float((measured / parts).max())
    return [
        f"measured forces are at most {share:.2g} of what single parameters make: a free swing determines ratios, and"
        " their size only by the rotors and friction that the model states; expected a log with torques of a motor"
    ]


def unexplained_warnings(
    posed: IdentificationProblem, rows: Sequence[ForceResidual], parameters: np.ndarray
) -> list[str]:
    """Return a warning of forces of which the identified robot leaves most.

    Errors of the motion explain a part. A force that is next to nothing, as of a joint without a motor, is held against
    the forces of single parameters (P,), which nearly cancel.
    """
    used_rows = [row for row in rows if row.part == "used"]
    least = MIN_RELATIVE_DEVIATION * max((max(row.measured, row.model) for row in used_rows), default=0.0)
    # The size of each force; of those that nearly cancel, errors of accelerations leave a part of the single forces.
    names, sizes = coordinates.force_names(posed.robot.mechanism), {row.force: row.measured for row in used_rows}
    if posed.errors.variances.any():
        single_sizes = dict(zip(names, posed.single_forces(parameters), strict=True))
        sizes |= {name: single_sizes[name] for name, x in sizes.items() if x < MAX_PASSIVE_SHARE * single_sizes[name]}
    unexplained = [
        row
        for row in used_rows
        if row.identified**2 - row.motion_errors**2 > max(MAX_UNEXPLAINED_SHARE * sizes[row.force], least) ** 2
    ]
    if len(unexplained) == 0:
        return []
    worst = max(unexplained, key=lambda row: row.identified)
    return [
        f"the identified robot does not explain the forces of {join_names(row.force for row in unexplained)}: it leaves"
        f" {worst.identified:.3g} of {worst.measured:.3g} {worst.unit} of {errors.shorten(worst.force)}; expected"
        " torques of these joints at these times: check the order of columns, times, gravity, wild samples and noise"
        f"{Remedy('', ' (--picture shows them)')}"
    ]


def _missing_forces(posed: IdentificationProblem, names: tuple[str, ...]) -> list[str]:
    """Return warnings of missing forces, and of sensors that stand still.

    No force on a base is expected to be measured.
    """
    samples, model = posed.samples, posed.model[posed.used]
    measured, of_joints = samples.weights > 0, np.arange(len(names)) >= len(names) - posed.robot.n
    missing = of_joints & ~measured.any(axis=0)
    # A sensor stands still where all its samples are the first one, although the model's force varies.
    first = np.take_along_axis(samples.forces, measured.argmax(axis=0)[None], axis=0)
    constant = (~measured | (samples.forces == first)).all(axis=0) & (measured.sum(axis=0) > 1)
    varies = np.ptp(model, axis=0) > MIN_RELATIVE_DEVIATION * np.abs(model).max()
    still = constant & varies
    warnings = []
    if missing.any():
        warnings.append(f"{_describe_forces(names, missing)} are not measured: no column, NaN or a weight of 0")
    if still.any():
        cure = "expected measured ones: leave the columns of dead sensors out"
        warnings.append(f"{_describe_forces(names, still)} are constant, and those of the model are not; {cure}")
    return warnings


def compare_forces(names: tuple[str, ...], weights: np.ndarray, measured: np.ndarray, model: np.ndarray) -> list[str]:
    """Return warnings of signs and units of measured forces: (N, nv), by the model's."""
    # The correlation about 0, not about means: gravity has the sign of the forces too.
    products = (weights * measured * model).sum(axis=0)
    model_squares = (weights * model**2).sum(axis=0)
    measured_squares = (weights * measured**2).sum(axis=0)
    both = (model_squares > 0) & (measured_squares > 0)
    correlation = np.where(both, products / np.sqrt(np.where(both, model_squares * measured_squares, 1.0)), 0.0)
    size = np.where(both, np.sqrt(measured_squares / np.where(both, model_squares, 1.0)), 1.0)
    # Sizes are compared only where forces are similar, as others are not in another unit.
    similar = np.abs(correlation) > MIN_SIMILAR_CORRELATION
    opposed = correlation < MAX_OPPOSED_CORRELATION
    odd = similar & (np.abs(np.log(size)) > np.log(MAX_SIZE_RATIO))
    warnings = []
    if opposed.any():
        worst = correlation[opposed].min()
        why = f"their correlation with the model's is {worst:.2g}"
        cure = "expected Q = M q2d + C qd + Qgrav, which the drives exert on the robot"
        warnings.append(f"{_describe_forces(names, opposed)} seem to have the wrong sign: {why}; {cure}")
    if odd.any():
        ratio = float(np.exp(np.log(size[odd]).mean()))
        why = f"they are {ratio:.3g} times those of the model; expected N m or N at the joints, behind the gears"
        warnings.append(f"{_describe_forces(names, odd)} seem to have the wrong unit: {why}")
    return warnings


def _describe_forces(names: tuple[str, ...], mask: np.ndarray) -> str:
    if mask.all():
        return "forces of all joints"
    return f"forces of {join_names(name for name, is_named in zip(names, mask, strict=True) if is_named)}"


@dataclass(frozen=True)
class ShownTorque:
    """A torque that residuals show."""

    kind: TorqueKind
    number: int  # of the column among those of its kind
    text: str  # what it is, with its amount


@dataclass(frozen=True, eq=False)
class ShownTorques:
    """Torques that no parameter holds, as residuals of a fit show them."""

    loaded: np.ndarray  # (nc,) joints whose friction grows with the load
    rotors: tuple[str, ...]  # joints with rotors, and their inertia
    gains: bool  # whether torques of a joint are read too large or too small
    notes: list[str]  # warnings of all of them, and of when forces are off


# After a fit: torques that no parameter holds.
def find_torques(posed: IdentificationProblem, solution: Regression) -> ShownTorques:
    """Find torques in the residuals of a fit that no parameter holds.

    Residuals of loops are torques of several joints, and are not searched. Runs once per log and fit.
    """
    m = posed.robot.mechanism
    if m.closure:
        return ShownTorques(np.zeros(len(m.joints), dtype=bool), (), False, [])
    # Residuals r and the columns of parameters over the deviations of residuals; U spans what parameters take.
    cells, roots = posed.cells, np.sqrt(solution.weights)
    Y = cells.Y[..., posed.columns]
    residuals, Z = (cells.off - Y @ solution.x) * roots, Y * roots[..., None]
    least = MIN_RELATIVE_DEVIATION**2 * (((cells.off + cells.model) * roots) ** 2).mean(axis=0)
    # What residuals show of each kind of torques.
    q, _, q2d = mean_rates(posed)
    kinds = (
        load_friction_columns(posed, solution.x),
        force_columns(posed, q),
        spring_columns(posed, q),
        rotor_columns(posed, q2d),
        gain_columns(posed, solution.x),
        load_change_columns(posed),
    )
    U = Z @ informed_directions(noise_spectra.gram(Z, Z))[0]
    whitened = [replace(columns, rows=columns.rows * roots[..., None]) for columns in kinds]
    shown, residuals = _pursue(whitened, U, residuals, least)
    notes = []
    if len(shown) > 0:
        names = ", ".join(torque.text for torque in shown)
        cost = "parameters adapt to these, and may be off by more than their deviations"
        notes.append(f"residuals look like torques that no term of the model is: {names}; {cost}")
    # Friction by the load is sought where it is shown, of joints that are alone on their coordinate.
    numbers = [torque.number for torque in shown if torque.kind == "friction by the load"]
    loaded = np.isin(np.arange(len(m.joints)), numbers) & m.lone_joints & ("friction" in posed.terms)
    # What these torques leave is searched for pushes, in units of the forces.
    unexplained = np.abs(np.divide(residuals, roots, out=np.zeros_like(residuals), where=roots > 0))
    notes += _push_notes(posed, np.maximum(residuals**2, least), unexplained)
    rotors = tuple(torque.text for torque in shown if torque.kind == "rotor")
    return ShownTorques(loaded, rotors, any(torque.kind == "factor" for torque in shown), notes)


@dataclass(frozen=True, eq=False)
class TorqueColumns:
    """Columns of K torques of one kind."""

    kind: TorqueKind
    rows: np.ndarray  # (C, nv, K)
    texts: tuple[str, ...]  # what they are, with {} for the amount
    certain: float = MAX_DEVIATIONS  # deviations beyond which an amount does not arise by chance
    signed: bool = False  # whether amounts below 0 make sense
    most: float = np.inf  # amount beyond which it is something else


def _pursue(
    kinds: Sequence[TorqueColumns], U: np.ndarray, residuals: np.ndarray, least: np.ndarray
) -> tuple[list[ShownTorque], np.ndarray]:
    """Find torques in residuals (C, nv) beyond orthonormal U (C, nv, r).

    Returns them, and what they leave of the residuals. Each round adds one column to U.
    """
    # All columns side by side, (C, nv, K), with what their kinds ask of an amount: (K,) each.
    counts = [len(columns.texts) for columns in kinds]
    rows = np.concatenate([columns.rows for columns in kinds], axis=-1)
    texts = [text for columns in kinds for text in columns.texts]
    places = [(columns.kind, number) for columns in kinds for number in range(len(columns.texts))]
    signed, certain, most = np.repeat([(columns.signed, columns.certain, columns.most) for columns in kinds],
                                      counts, axis=0).T  # fmt: skip
    shown, sizes = list[ShownTorque](), (rows**2).sum(axis=(0, 1))
    spectra = noise_spectra.noise_spectra(noise_spectra.leverages(U), residuals, least)
    while True:
        # What U leaves of the columns, a' = a - U U^T a, and their coefficients for a' of length 1. Columns that
        # parameters explain become 0.
        rows = rows - U @ noise_spectra.gram(U, rows)
        norms = np.sqrt((rows**2).sum(axis=(0, 1)))
        units = rows / np.where(norms**2 > MIN_FREE_SHARE * sizes, norms, np.inf)
        coefficients = noise_spectra.gradient(units, residuals)
        spreads = np.sqrt(np.diag(noise_spectra.spectral_gram(units, spectra)))
        # By how much coefficients are beyond chance; those with the wrong sign, or of impossible size, are out.
        sizes_of_sign = np.where(signed > 0, np.abs(coefficients), coefficients)
        over = sizes_of_sign / np.maximum(certain * spreads, np.finfo(float).tiny)
        amounts = np.divide(np.abs(coefficients), norms, out=np.zeros_like(norms), where=norms > 0)
        over[amounts > most] = 0
        if not (over > 0).any():
            return shown, residuals
        # The column that is chance least, by the spectrum of what it leaves.
        k = int(over.argmax())
        extended = np.concatenate([U, units[..., [k]]], axis=-1)
        remainder = residuals - units[..., k] * coefficients[k]
        spectra = noise_spectra.noise_spectra(noise_spectra.leverages(extended), remainder, least)
        spread = np.sqrt(noise_spectra.spectral_gram(units[..., [k]], spectra)[0, 0])
        if np.abs(coefficients[k]) < certain[k] * spread:
            return shown, residuals
        amount = f"{coefficients[k] / norms[k]:.3g} +- {spread / norms[k]:.2g}"
        shown.append(ShownTorque(*places[k], texts[k].format(amount)))
        U, residuals = extended, remainder


def _push_notes(posed: IdentificationProblem, squares: np.ndarray, residuals: np.ndarray) -> list[str]:
    """Name forces of which a short time holds most squares of residuals.

    Squares (C, nv) are in units of their variances; residuals (C, nv) are sizes in N m or N.
    """
    # Sums of squares within each span of `length` cells, (C - length + 1, nv).
    m, t, length = posed.robot.mechanism, posed.samples.t, max(1, int(PUSH_SHARE * len(residuals)))
    sums = np.cumsum(np.pad(squares, ((1, 0), (0, 0))), axis=0)
    within = sums[length:] - sums[:-length]
    pushed = within.max(axis=0) > MIN_PUSH_SQUARES * sums[-1]
    if len(residuals) < MIN_PUSH_CELLS or not pushed.any():
        return []
    # The times at which the worst of them is off by more than half of the most.
    j = int(np.where(pushed, within.max(axis=0), 0.0).argmax())
    start = int(within[:, j].argmax())
    most = residuals[start : start + length, j].max()
    cells = start + np.flatnonzero(residuals[start : start + length, j] > most / 2)
    times = t[np.isin(number_cells(t, posed.width), cells)]
    names, when = join_names(np.array(coordinates.force_names(m))[pushed]), f"from {times[0]:.4g} to {times[-1]:.4g} s"
    cure = "expected no push, contact or wild sample; NaN or weights of 0 leave samples out"
    return [f"forces of {names} are unexplained {when}, by up to {most:.3g} {coordinates.force_units(m)[j]}: {cure}"]


# Columns: one unit of each torque that robots have.
def mean_rates(posed: IdentificationProblem) -> list[np.ndarray]:
    """Return q, qd and q2d (C, n), averaged over cells."""
    t = posed.samples.t
    ones, place = np.ones((len(t), 1)), number_cells(t, posed.width)
    return [weighted_means(rate, ones, place)[0] for rate in posed.motion(t, 2)]


def load_friction_columns(posed: IdentificationProblem, x: np.ndarray) -> TorqueColumns:
    """Return columns of friction by the load, where friction is sought."""
    joints, base, Y = posed.robot.mechanism.joints, posed.base, posed.cells.Y
    if "friction" not in posed.terms:
        return _no_columns(posed, "friction by the load")
    # |Q| of the bodies times the columns of friction, tanh(v / eps): of averages, as cells are short.
    first = len(base.parameters) + len(joints) * posed.terms.index("friction")
    load = np.abs(Y[..., base.columns] @ (base.values + x[: base.count]))
    rows = load[..., None] * Y[..., first : first + len(joints)]
    texts = tuple(f"friction of {errors.shorten(joint)} that grows by {{}} of its load" for joint in joints)
    return TorqueColumns("friction by the load", rows, texts, most=MAX_LOAD_SHARE)


def force_columns(posed: IdentificationProblem, q: np.ndarray) -> TorqueColumns:
    """Return columns of a constant force on the last body: at positions (C, n).

    The base stands still.
    """
    m = posed.robot.mechanism
    if posed.motion.base_curve is not None:
        return _no_columns(posed, "force")
    # The drives bear what acts: Q = -J^T f, with the linear rows of the Jacobian.
    J = compute(posed.robot, "jacobian", (q,), body=m.bodies[-1], frame="world")
    texts = tuple(f"a force of {{}} N along {axis} on {errors.shorten(m.bodies[-1])}" for axis in "xyz")
    return TorqueColumns("force", -np.asarray(J)[:, 3:].mT, texts, signed=True)


def spring_columns(posed: IdentificationProblem, q: np.ndarray) -> TorqueColumns:
    """Return columns of springs of joints about mean positions: at positions (C, n)."""
    m = posed.robot.mechanism
    if posed.motion.base_curve is not None:
        return _no_columns(posed, "spring")
    # Deflections G q of the joints, and their forces along the rows of G: (C, n, nc).
    rows = ((q - q.mean(axis=0)) @ m.G.T)[:, None] * m.G.T
    units = _joint_units(posed, "N m/rad", "N/m")
    texts = (f"a spring of {{}} {unit} at {errors.shorten(j)}" for unit, j in zip(units, m.joints, strict=True))
    return TorqueColumns("spring", rows, tuple(texts))


def rotor_columns(posed: IdentificationProblem, q2d: np.ndarray) -> TorqueColumns:
    """Return columns of rotors, unless they are sought already.

    At accelerations (C, n). A caller who seeks no drive terms wants no rotors either.
    """
    m = posed.robot.mechanism
    if "armature" in posed.terms or m.elasticity is not None or len(posed.terms) == 0:
        return _no_columns(posed, "rotor")
    rows = _pad_forces(posed, (q2d @ m.G.T)[:, None] * m.G.T)
    units = _joint_units(posed, "kg m^2", "kg")
    texts = (f"a rotor of {{}} {unit} at {errors.shorten(j)}" for unit, j in zip(units, m.joints, strict=True))
    return TorqueColumns("rotor", rows, tuple(texts), MAX_MOTION_DEVIATIONS)


def gain_columns(posed: IdentificationProblem, x: np.ndarray) -> TorqueColumns:
    """Return columns of torques that are read too large, by corrections x."""
    # The torque itself, of joints with motors: a torque far below its single parts is of a joint that swings freely.
    m, cells = posed.robot.mechanism, posed.cells
    Q = cells.model + cells.Y[..., posed.columns] @ x
    parts = posed.single_forces(posed.corrected_parameters(x)[posed.places])
    active = np.sqrt((Q**2).mean(axis=0)) > MAX_PASSIVE_SHARE * parts
    rows = _pad_forces(posed, (Q * active)[:, -m.n :, None] * np.eye(m.n))
    texts = (f"torques of {errors.shorten(joint)} that are read too large by {{}} of them" for joint in m.coordinates)
    return TorqueColumns("factor", rows, tuple(texts), MAX_MOTION_DEVIATIONS, signed=True, most=MAX_GAIN)


def load_change_columns(posed: IdentificationProblem) -> TorqueColumns:
    """Return columns of a load on the last body: from some times on."""
    # The column of the body's mass, 0 before the load begins: (C, nv, times).
    body = len(posed.robot.mechanism.bodies) - 1
    of_mass = posed.cells.Y[..., len(inertia.INERTIAL_PARAMETERS) * body]
    t, count = posed.samples.t, len(of_mass)
    first = t[np.unique(number_cells(t, posed.width), return_index=True)[1]]
    starts = np.unique(count * np.arange(1, LOAD_TIMES + 1) // (LOAD_TIMES + 1))
    rows = of_mass[..., None] * (np.arange(count)[:, None] >= starts)[:, None]
    name = errors.shorten(posed.robot.mechanism.bodies[-1])
    texts = tuple(f"a change of the load on {name} of {{}} kg at {first[k]:.3g} s" for k in starts)
    return TorqueColumns("load", rows, texts, MAX_MOTION_DEVIATIONS, signed=True)


def _no_columns(posed: IdentificationProblem, kind: TorqueKind) -> TorqueColumns:
    return TorqueColumns(kind, posed.cells.Y[..., :0], ())


def _pad_forces(posed: IdentificationProblem, rows: np.ndarray) -> np.ndarray:
    """Return columns of all forces from those of joints: (C, n, K) -> (C, nv, K)."""
    return np.pad(rows, ((0, 0), (posed.cells.Y.shape[1] - rows.shape[1], 0), (0, 0)))


def _joint_units(posed: IdentificationProblem, turning: str, sliding: str) -> Sequence[str]:
    return [turning if np.any(X[:3]) else sliding for X in posed.robot.mechanism.X]
