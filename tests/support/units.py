"""The same robot in other units of length and mass, and what its states and results are in these.

A rule that compares lengths or masses with numbers of their own, or kg with kg m^2, takes the same robot for another
one. Times and angles keep their units.

Shares with jounce: all that it computes, twice; the factors of units are written down here.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from hypothesis import strategies as st

from jounce.model import coordinates
from jounce.model.contacts import Contact
from jounce.model.drive_trains import Drives
from jounce.model.mechanism import Mechanism


@dataclass(frozen=True)
class Units:
    """How many new units an old one is."""

    length: float
    mass: float

    def of(self, length: int = 0, mass: int = 0) -> float:
        """The factor of what is measured in powers of both."""
        return self.length**length * self.mass**mass

    @property
    def twist(self) -> np.ndarray:
        """The factors (6,) of a twist: rad/s, m/s."""
        return np.repeat([1.0, self.length], 3)

    @property
    def wrench(self) -> np.ndarray:
        """The factors (6,) of a wrench or of a momentum."""
        return self.of(2, 1) / self.twist

    @property
    def inertial(self) -> np.ndarray:
        """The factors (10,) of the mass, the first and the second moments of a body."""
        return np.repeat([self.of(0, 1), self.of(1, 1), self.of(2, 1)], [1, 3, 6])

    def pose(self, T: np.ndarray) -> np.ndarray:
        """A pose, or several."""
        moved = np.array(T, dtype=float)
        moved[..., :3, 3] *= self.length
        return moved


SI = Units(1.0, 1.0)
UNITS = [Units(*factors) for factors in ((1e-6, 1.0), (1e4, 1.0), (1.0, 1e-9), (1e-6, 1e9), (1e4, 1e-9))]
ANY_UNITS = st.builds(Units, st.sampled_from((1.0, 1e-6, 1e4)), st.sampled_from((1.0, 1e-9, 1e9)))  # SI is simplest
UNIT_IDS = [f"{u.length:g}m-{u.mass:g}kg" for u in UNITS]


def in_units(m: Mechanism, u: Units) -> Mechanism:
    """The mechanism in other units."""
    v = joint_factors(m, u)
    own, elastic = coordinate_factors(m, u), m.elasticity
    X = np.array(m.X, dtype=float)
    X[:, 3:] *= np.where(X[:, :3].any(axis=1), u.length, 1.0)[:, None]
    if elastic:
        force = u.of(2, 1) / own
        elastic = replace(
            elastic, stiffness=elastic.stiffness * force / own, rotor=elastic.rotor * force / own,
            viscous=elastic.viscous * force / own, friction=elastic.friction * force, eps=elastic.eps * own,
            motors=tuple(motor and _motor(motor, x, u) for motor, x in zip(elastic.motors, own, strict=False)),
        )  # fmt: skip
    return replace(
        m,
        B=u.pose(m.B),
        X=X,
        M=m.M * (u.wrench[:, None] / u.twist),
        gravity=np.asarray(m.gravity) * u.length,
        G=m.G * v[:, None] / own,
        g=m.g * v,
        frames=tuple(replace(frame, T=u.pose(frame.T)) for frame in m.frames),
        drives=_drives(m.drives, v, u),
        contacts=tuple(_contact(contact, u) for contact in m.contacts),
        elasticity=elastic,
    )


def joint_factors(m: Mechanism, u: Units) -> np.ndarray:
    """The factors (nc,) of joint variables: rad or m."""
    return np.where(m.X[:, :3].any(axis=1), 1.0, u.length)


def coordinate_factors(m: Mechanism, u: Units) -> np.ndarray:
    """The factors (n,) of coordinates."""
    return np.where(np.array(coordinates.units(m)) == "m", u.length, 1.0)


def velocity_factors(m: Mechanism, u: Units) -> np.ndarray:
    """The factors (nv,) of velocities, those of a base that floats first."""
    return np.concatenate([u.twist[: 6 * m.floats], coordinate_factors(m, u)])


def _drives(d: Drives, v: np.ndarray, u: Units) -> Drives:
    force = u.of(2, 1) / v
    of_inertia = {name: getattr(d, name) * force / v for name in ("armature", "damping", "stiffness")}
    of_force = {name: getattr(d, name) * force for name in ("friction", "stribeck", "offset", "load_eps")}
    of_motion = {name: getattr(d, name) * v for name in ("eps", "stribeck_velocity", "rest")}
    return replace(d, **of_inertia, **of_force, **of_motion)


def _contact(contact: Contact, u: Units) -> Contact:
    """A contact whose wrench is divided in the same way among others."""
    sole = contact.sole if contact.sole is None else np.asarray(contact.sole) * u.length
    weights = contact.weights * (u.of(1, 1) / u.wrench) ** 2
    return replace(contact, place=u.pose(contact.place), sole=sole, weights=weights)


def _motor(motor: Any, v: float, u: Units) -> Any:
    """A motor that takes the same current: its gear turns a slide, its constant holds the unit of torques."""
    torque = u.of(2, 1)
    scaled = {name: torque * getattr(motor, name) for name in ("damping", "friction", "inductance")}
    scaled |= {name: torque * x for name in ("inertia", "resistance", "constant") if (x := getattr(motor, name))}
    return replace(motor, gear=motor.gear / v, **scaled)


Factors = Callable[[Mechanism, Units], Sequence[Any]]


def _outer(*axes: np.ndarray) -> np.ndarray:
    """The products of the factors of some axes."""
    product = np.ones(())
    for axis in axes:
        product = product[..., None] * axis
    return product


def _forces(m: Mechanism, u: Units) -> np.ndarray:
    return u.of(2, 1) / velocity_factors(m, u)


def _per(m: Mechanism, u: Units, first: np.ndarray, count: int) -> np.ndarray:
    """The factors of derivatives by `count` coordinates."""
    return _outer(first, *[1 / velocity_factors(m, u)] * count)


def _parameters(m: Mechanism, u: Units, rows: np.ndarray) -> np.ndarray:
    return _outer(rows, 1 / np.tile(u.inertial, m.nb))


def _pose(m: Mechanism, u: Units) -> np.ndarray:
    return np.array([[1, 1, 1, u.length]] * 3 + [[1, 1, 1, 1]])


def _motors(m: Mechanism, u: Units) -> np.ndarray:
    return coordinate_factors(m, u)


def _alone(f: Callable[[Mechanism, Units], Any]) -> Factors:
    return lambda m, u: [f(m, u)]


FACTORS: dict[str, Factors] = {
    **dict.fromkeys(("inverse_dynamics", "gravity_forces", "generalized_momentum"), _alone(_forces)),
    **dict.fromkeys(
        ("inverse_dynamics_partials", "mass_matrix", "coriolis_matrix", "skew_coriolis_matrix"),
        _alone(lambda m, u: _per(m, u, _forces(m, u), 1)),
    ),
    "inverse_dynamics_second_partials": lambda m, u: [_per(m, u, _forces(m, u), 2)] * 4,
    "forward_dynamics": _alone(velocity_factors),
    "forward_dynamics_partials": lambda m, u: [
        *[_per(m, u, velocity_factors(m, u), 1)] * 2,
        _outer(velocity_factors(m, u), 1 / _forces(m, u)),
    ],
    "forward_dynamics_second_partials": lambda m, u: [
        *[_per(m, u, velocity_factors(m, u), 2)] * 3,
        _outer(velocity_factors(m, u), 1 / velocity_factors(m, u), 1 / _forces(m, u)),
    ],
    **dict.fromkeys(("regressor", "momentum_regressor"), _alone(lambda m, u: _parameters(m, u, _forces(m, u)))),
    "energy_regressor": _alone(lambda m, u: u.of(2, 1) / np.tile(u.inertial, m.nb)),
    "poses": _alone(_pose),
    "twists": _alone(lambda m, u: u.twist),
    "jacobian": _alone(lambda m, u: _per(m, u, u.twist, 1)),
    **dict.fromkeys(
        ("momentum", "centroidal_momentum", "base_wrench", "joint_wrenches"), _alone(lambda m, u: u.wrench)
    ),
    "centroidal_momentum_matrix": _alone(lambda m, u: _per(m, u, u.wrench, 1)),
    "center_of_mass": _alone(lambda m, u: u.length),
    "contact_wrenches": _alone(lambda m, u: u.wrench),
    **dict.fromkeys(("kinetic_energy", "potential_energy"), _alone(lambda m, u: u.of(2, 1))),
    "motor_positions": _alone(_motors),
    "motor_torques": _alone(lambda m, u: u.of(2, 1) / _motors(m, u)),
    "motor_commands": lambda m, u: [_motors(m, u), _motors(m, u), u.of(2, 1) / _motors(m, u)],
    "motor_currents": _alone(lambda m, u: 1.0),
    "motor_voltages": _alone(lambda m, u: u.of(2, 1)),
    "elastic_forward_dynamics": lambda m, u: [_motors(m, u)] * 2,
    "feedback_linearization": _alone(lambda m, u: u.of(2, 1) / _motors(m, u)),
}


def in_si(name: str, m: Mechanism, u: Units, found: Any) -> list[np.ndarray]:
    """The results of a quantity in the old units: those of several results, or with rates."""
    terms, factors = found if isinstance(found, tuple) else (found,), FACTORS[name](m, u)
    factors = factors if len(factors) > 1 else list(factors) * len(terms)
    return [np.asarray(x) / factor for x, factor in zip(terms, factors, strict=True)]
