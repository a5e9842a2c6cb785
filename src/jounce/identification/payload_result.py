"""The result of the identification of a payload: its parameters with deviations, a body that can exist, a robot."""

from dataclasses import dataclass
from functools import cached_property
from typing import Generic

import numpy as np

from jounce.core.display import HtmlDisplay, align_columns, print_table
from jounce.core.errors import shorten
from jounce.engine.engine import R
from jounce.identification.result import describe_torque_scale
from jounce.spatial import inertia
from jounce.spatial.lie import hat

PARAMETER_COLUMNS = ("parameter", "value", "deviation", "body", "unit", "")
KUKA_SINGULAR_ANGLE = 1e-9  # of cos B: below it A and C turn about one axis, and C is 0


@dataclass(frozen=True)
class PayloadParameter:
    """A parameter of a payload in the axes of its frame, of which inertia is that about the centre of mass.

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
        Mass and its deviation from each half of the log with the load.
    mismatch : float
        chi^2 of what the load does not explain, over its degrees of freedom: 1 on average.
    factors : tuple of ((nv,), (nv,)), or None
        Factors that make measured torques true, and their deviations, of a load of known mass.
    notes : tuple of str
        What is suspicious, and what the logs do not determine.

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
        """The inertia (3, 3) of the body about its centre of mass, in the axes of the frame, kg m^2."""
        return np.asarray(inertia.from_parameters(central_parameters(self.body))[:3, :3])

    @property
    def unseen(self) -> tuple[str, ...]:
        """The parameters that the logs do not determine."""
        return tuple(row.name for row in self.table if not row.seen)

    @cached_property
    def settings(self) -> dict[str, str]:
        """What controllers take, if the frame is their flange: lines for libfranka and URScript, KUKA's load data."""
        theta, m, com = self.inertia, f"{self.mass:.4f}", _join(self.com, 5)
        nine, six = _join(theta.T.ravel(), 6), _join(theta[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]], 6)
        moments, axes = np.linalg.eigh(theta)
        angles = kuka_angles(axes * np.sign(np.linalg.det(axes)))
        place, turn = _join(1000 * self.com, 2, "X Y Z"), _join(angles, 3, "A B C")
        principal = _join(moments, 6, "JX JY JZ")
        return {
            "franka": f"robot.setLoad({m}, {{{{{com}}}}}, {{{{{nine}}}}});",
            "ur": f"set_target_payload({m}, [{com}], [{six}])",
            "ur before 5.10": f"set_payload({m}, [{com}])",
            "iiwa": f"M {m} kg, {place} mm, {turn} deg, {principal} kg m^2",
        }

    @property
    def assumption(self) -> str | None:
        """What is taken for granted since no residual shows it, and how to find it; None of a load of known mass."""
        return describe_torque_scale() if self.factors is None else None

    @property
    def summary(self) -> str:
        """On what the load is, and its mass, in one line."""
        row = self.table[0]
        return f"Payload on {shorten(self.frame)}: {row.value:.4g} +- {row.deviation:.2g} kg"

    @property
    def parameter_rows(self) -> list[tuple[str, ...]]:
        """The parameters with deviations, and those of the nearest body that can exist."""
        return [
            (
                of.name,
                f"{of.value:.5g}",
                f"{of.deviation:.2g}",
                f"{of.body:.5g}",
                of.unit,
                "" if of.seen else "not seen",
            )
            for of in self.table
        ]

    def __repr__(self) -> str:
        """At most twelve lines: mass, centre of mass and inertia."""
        return print_table(self.summary, PARAMETER_COLUMNS, self.parameter_rows)

    def __str__(self) -> str:
        rows = [PARAMETER_COLUMNS, *self.parameter_rows]
        halves = ", ".join(f"{m:.5g} +- {s:.2g} kg" for m, s in self.halves)
        head = [f"load on {shorten(self.robot.name)}, in the frame of {shorten(self.frame)}", *self.notes]
        checks = [
            f"mass of the halves of the log {halves}; chi^2 of the rest {self.mismatch:.3g} per degree of freedom"
        ]
        lines = [*head, *checks, "", *align_columns(rows), ""]
        if self.factors is not None:
            table = [("factor of torques", "value", "deviation")]
            names = self.robot.joint_names
            of_joints = zip(names, self.factors[0][-len(names) :], self.factors[1][-len(names) :], strict=True)
            table += [(name, f"{c:.5g}", f"{s:.2g}") for name, c, s in of_joints]
            lines += [*align_columns(table), ""]
        if self.assumption is not None:
            lines += [self.assumption, ""]
        return "\n".join([*lines, *(f"{who}: {text}" for who, text in self.settings.items())])


def _join(numbers: np.ndarray, digits: int, names: str = "") -> str:
    """Numbers between commas, or behind their names, without negative zeros."""
    texts = [f"{x:.{digits}f}" for x in np.round(numbers, digits) + 0.0]
    return " ".join(map(" ".join, zip(names.split(), texts, strict=True))) if names else ", ".join(texts)


def kuka_angles(R: np.ndarray) -> np.ndarray:
    """A, B, C in degrees of a rotation: about z, then the new y, then the new x."""
    cosine = float(np.hypot(R[0, 0], R[1, 0]))
    if cosine < KUKA_SINGULAR_ANGLE:
        angles = np.arctan2(-R[0, 1], R[1, 1]), np.arctan2(-R[2, 0], cosine), 0.0
    else:
        angles = np.arctan2(R[1, 0], R[0, 0]), np.arctan2(-R[2, 0], cosine), np.arctan2(R[2, 1], R[2, 2])
    return np.asarray(np.degrees(angles))


COMPLEX_STEP = 1e-100  # of complex-step differentiation, which has no rounding


def central_parameters(x: np.ndarray) -> np.ndarray:
    """Mass, centre of mass, and moments of inertia about it, from inertial parameters (10,) of a mass that is not 0."""
    mass, h, cross = x[:1], x[1:4], hat(x[1:4])
    central = inertia.from_parameters(x)
    central[:3, :3] += cross @ cross / mass  # Steiner, back to the COM
    return np.concatenate([mass, h / mass, inertia.parameters(central)[4:]])


def central_covariance(x: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """The covariance of `central_parameters` by the delta method; what depends on infinite variances has them."""
    J = np.stack([central_parameters(x + 1j * COMPLEX_STEP * unit).imag / COMPLEX_STEP for unit in np.eye(10)], axis=1)
    blind = np.isinf(np.diag(covariance))
    found = J @ np.where(blind | blind[:, None], 0.0, covariance) @ J.T
    lost = (J[:, blind] != 0).any(axis=1)
    found[lost, lost] = np.inf
    return np.asarray(found)
