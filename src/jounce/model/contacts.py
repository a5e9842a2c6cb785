"""Contacts of a floating robot with its surroundings: which wrenches they transmit, and what limits these.

A wrench (moment; force) of a contact is what the surroundings exert on the body, about the point of contact.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, check_choice, quote_value
from jounce.core.scalars import Array, array_of_shape, is_finite, is_numeric

HELD: Mapping[str, tuple[int, ...]] = {"point": (3, 4, 5), "line": (1, 2, 3, 4, 5), "plane": (0, 1, 2, 3, 4, 5)}
TWIST_COMPONENTS = ("about x", "about y", "about z", "along x", "along y", "along z")
DEFAULT_HALF_LENGTH = 0.1  # m, of a sole that states none: that of a human foot, and of humanoids of 0.5 to 2 m
_STEEP = 0.9  # of a normal along x: beyond that, y is projected on the ground instead
_UNIT_TOLERANCE = 1e-9  # of a normal's length and a place's rotation: more than rounding is a mistake


@dataclass(frozen=True, eq=False)
class Contact:
    """A contact of a body with its surroundings: a point, a line along x, or a plane across z of its axes.

    The axes of a plane and of a line are those of `place` on the body. Those of a point are inertial axes, or z is the
    `normal` of the ground. Without `friction` and `sole` a contact holds whatever the wrench.

    Attributes
    ----------
    frame : str
        The body, or the link merged into one, that touches.
    kind : str
        "point" transmits a force, "line" no moment about x, "plane" all six components.
    place : (3,) or (4, 4), optional
        Where the contact is in the frame: a point, or a pose with the axes; by default the origin.
    normal : (3,), optional
        Of a point, the unit normal of the ground in inertial axes, out of the ground. Then x of the contact is the
        inertial x axis projected on the ground; y where the ground is steeper than 64 degrees along x.
    friction : float, optional
        Coefficient mu of a pyramid of friction, ``|fx|, |fy| <= mu fz``; the one inside the cone takes mu / sqrt(2).
    sole : (2,), optional
        Half the lengths of a plane's rectangle along x and y, m; the centre of pressure stays in it. With friction, mz
        is limited as the rectangle's friction allows.
    weights : (6,), optional
        Weights of the squares of the components, whose sum is least. By default 1 for forces and 1 / l^2 for moments,
        with the lever l of the sole (0.1 m where none is stated): a force at the edge counts as much as its moment.

    Raises
    ------
    JounceError
        If a value is out of range, or friction is stated without a normal.

    References
    ----------
    S. Caron, Q.-C. Pham, Y. Nakamura, "Stability of surface contacts for humanoid robots: closed-form formulae of the
    contact wrench cone for rectangular support areas", ICRA 2015.

    Examples
    --------
    >>> import jounce
    >>> foot = jounce.Contact("left_ankle_roll_link", "plane", place=(0.035, 0, -0.037), sole=(0.09, 0.03))
    >>> foot.rows.shape
    (5, 6)
    """

    frame: str
    kind: str
    place: Any = (0, 0, 0)
    normal: Any = None
    friction: float | None = None
    sole: Any = None
    weights: Any = None

    def __post_init__(self) -> None:
        label = f"contact {quote_value(self.frame)}"
        check_choice("kind of contact", self.kind, HELD)
        _set(self, "place", _as_pose(self.place, f"{label}: place"))
        if self.normal is not None:
            _set(self, "normal", _numbers(self.normal, (3,), f"{label}: normal"))
            if self.kind != "point":
                raise JounceError(f"{label}: the normal of a {self.kind} is the z axis of place=; leave normal= out")
            if abs(np.linalg.norm(self.normal) - 1) > _UNIT_TOLERANCE:
                raise JounceError(f"{label}: normal has length {np.linalg.norm(self.normal):.6g}; expected 1")
        if self.friction is not None:
            if not is_finite(self.friction) or self.friction < 0:
                raise JounceError(f"{label}: friction is {quote_value(self.friction)}; expected a number, 0 or more")
            if self.kind == "line" or (self.kind == "point" and self.normal is None):
                cure = "state normal=(0, 0, 1)" if self.kind == "point" else "state two points in place of the line"
                raise JounceError(f"{label}: friction of a {self.kind} needs the normal of the ground; {cure}")
        if self.sole is not None:
            _set(self, "sole", _numbers(self.sole, (2,), f"{label}: sole", positive=True))
            if self.kind != "plane":
                raise JounceError(f"{label}: a {self.kind} has no sole; leave sole= out, or use kind 'plane'")
        given = self._default_weights if self.weights is None else self.weights
        _set(self, "weights", _numbers(given, (6,), f"{label}: weights", positive=True))

    @property
    def _default_weights(self) -> list[float]:
        x, y = (DEFAULT_HALF_LENGTH,) * 2 if self.sole is None else self.sole
        return [1 / y**2, 1 / x**2, 1 / (x**2 + y**2), 1, 1, 1]

    @property
    def arrays(self) -> tuple[Array, ...]:
        """Its numbers that wrenches depend on where no limit is reached."""
        return self.place, self.weights, np.zeros(0) if self.normal is None else self.normal

    @property
    def held(self) -> tuple[int, ...]:
        """The components that it transmits, among the six of a wrench."""
        return HELD[self.kind]

    @cached_property
    def ground_axes(self) -> Array | None:
        """The axes of a point in inertial ones, (3, 3); None where the axes are those of the body."""
        if self.kind != "point":
            return None
        if self.normal is None or (self.normal == (0, 0, 1)).all():
            return np.eye(3, dtype=int)
        e = np.eye(3)[int(abs(self.normal[0]) > _STEEP)]
        x = e - (e @ self.normal) * self.normal
        x = x / np.linalg.norm(x)
        return np.stack([x, np.cross(self.normal, x), self.normal], axis=1)

    @cached_property
    def rows(self) -> np.ndarray:
        """C (r, 6): friction, sole and a force that pushes hold where ``C f <= 0``."""
        mx, my, mz, fx, fy, fz = np.eye(6)
        mu, sole, signs = self.friction, self.sole, (1, -1)
        found = [-fz] if mu is not None or sole is not None else []
        if mu is not None:
            found += [s * f - mu * fz for f in (fx, fy) for s in signs]
        if sole is not None:
            x, y = sole
            found += [s * m - length * fz for m, length in ((mx, y), (my, x)) for s in signs]
            if mu is not None:
                found += [
                    s * mz - mu * (x + y) * fz + a * (y * fx + s * mu * mx) + b * (x * fy + s * mu * my)
                    for s, a, b in product(signs, repeat=3)
                ]
        return np.array(found).reshape(-1, 6)

    def row_name(self, k: int) -> str:
        """What row k of `rows` limits."""
        names = ["normal force"] + ["friction along x", "friction along y"] * (self.friction is not None)
        names += ["centre of pressure along y", "centre of pressure along x"] * (self.sole is not None)
        return names[(k + 1) // 2] if (k + 1) // 2 < len(names) else "friction about z"

    def convert(self, convert: Callable[[Array], Array]) -> "Contact":
        """The contact with its numbers as other scalars."""
        made = replace(self)
        for name in ("place", "weights", "normal"):
            if getattr(self, name) is not None:
                _set(made, name, convert(getattr(self, name)))
        if self.ground_axes is not None:
            _set(made, "ground_axes", convert(self.ground_axes))
        return made


def _set(contact: Contact, name: str, value: Array) -> None:
    vars(contact)[name] = value


def _numbers(given: Any, shape: tuple[int, ...], label: str, positive: bool = False) -> np.ndarray:
    array = array_of_shape(given, shape, label)
    least = "positive " if positive else ""
    if array.shape != shape or not is_numeric(array) or not np.isfinite(array).all() or (positive and (array <= 0).any()):
        raise JounceError(f"{label} is {quote_value(given)}; expected {shape[0]} {least}finite numbers")
    return array.astype(float)


def _as_pose(given: Any, label: str) -> np.ndarray:
    """A point as the pose of axes that are not turned, or a pose."""
    if np.shape(given) != (4, 4):
        T = np.eye(4)
        T[:3, 3] = _numbers(given, (3,), label)
        return T
    T = _numbers(given, (4, 4), label)
    if np.abs(T[:3, :3].T @ T[:3, :3] - np.eye(3)).max() > _UNIT_TOLERANCE or (T[3] != (0, 0, 0, 1)).any():
        raise JounceError(f"{label} is no pose; expected a rotation matrix, a position, and the last row (0, 0, 0, 1)")
    return T
