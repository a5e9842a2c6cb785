"""Contacts of a floating robot with its surroundings: which wrenches they transmit, and what limits these.

A wrench (moment; force) of a contact is what the surroundings exert on the body, about the point of contact.
"""

from collections.abc import Iterator, Mapping
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from itertools import product
from math import sqrt
from typing import Any

import numpy as np

from jounce.core.equality import EqualByValue
from jounce.core.errors import JounceError, check_choice, quote_value
from jounce.core.scalars import Array, array_of_shape, asarray, is_finite, is_numeric

HELD: Mapping[str, list[int]] = {"point": [3, 4, 5], "line": [1, 2, 3, 4, 5], "plane": [0, 1, 2, 3, 4, 5]}
DEFAULT_HALF_LENGTH = 0.1  # m, of a sole that states none: that of a human foot, and of humanoids of 0.5 to 2 m
_STEEP = 0.9  # of a normal along x: beyond that, y is projected on the ground instead
_UNIT_TOLERANCE = 1e-9  # of a normal's length and a place's rotation: more than rounding is a mistake


@dataclass(frozen=True, eq=False)
class Contact(EqualByValue):
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
        Coulomb's coefficient mu. Forces stay in the pyramid within its cone, ``|fx|, |fy| <= mu fz / sqrt(2)``, so that
        nothing slips in any direction.
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
    >>> foot.limits.shape
    (5, 6)
    """

    frame: str
    kind: str
    _: KW_ONLY
    place: Any = (0, 0, 0)
    normal: Any = None
    friction: float | None = None
    sole: Any = None
    weights: Any = None

    def __post_init__(self) -> None:
        label, mu = f"contact {quote_value(self.frame)}", self.friction
        check_choice("kind of contact", self.kind, HELD)
        if self.normal is not None and self.kind != "point":
            raise JounceError(f"{label}: the normal of a {self.kind} is the z axis of place=; leave normal= out")
        if self.sole is not None and self.kind != "plane":
            raise JounceError(f"{label}: a {self.kind} has no sole; leave sole= out, or use kind 'plane'")
        if mu is not None and (not is_finite(mu) or mu < 0):
            raise JounceError(f"{label}: friction is {quote_value(mu)}; expected a number, 0 or more")
        if mu is not None and self.kind != "plane" and self.normal is None:
            cure = "state normal=(0, 0, 1)" if self.kind == "point" else "state two points in place of the line"
            raise JounceError(f"{label}: friction of a {self.kind} needs the normal of the ground; {cure}")
        arrays = {"place": _as_pose(self.place, f"{label}: place")}
        for name, size, least in (("normal", 3, -np.inf), ("sole", 2, 0.0), ("weights", 6, 0.0)):
            numbers = getattr(self, name)
            if numbers is not None:
                arrays[name] = _numbers(numbers, (size,), f"{label}: {name}", least)
        length = np.linalg.norm(arrays.get("normal", 1.0))
        if abs(length - 1) > _UNIT_TOLERANCE:
            raise JounceError(f"{label}: normal has length {length:.6g}; expected 1")
        for array in arrays.values():
            array.flags.writeable = False
        # A moment counts as the force at the edge of the sole that it takes: about x with the lever y, about z with
        # the diagonal.
        x, y = arrays.get("sole", (DEFAULT_HALF_LENGTH,) * 2)
        arrays.setdefault("weights", np.array([1 / y**2, 1 / x**2, 1 / (x**2 + y**2), 1, 1, 1]))
        for name, array in arrays.items():
            object.__setattr__(self, name, array)

    @property
    def held(self) -> list[int]:
        """The components that it transmits, among the six of a wrench."""
        return HELD[self.kind]

    @cached_property
    def ground_axes(self) -> Array | None:
        """The inertial axes (3, 3) of a point, else None.

        Lines and planes have axes of the body.
        """
        if self.kind != "point":
            return None
        if self.normal is None:
            return np.eye(3, dtype=int)
        # x is the inertial x axis less its part along the normal; y where the two are nearly parallel.
        e = np.eye(3)[int(abs(self.normal[0]) > _STEEP)]
        x = e - (e @ self.normal) * self.normal
        x = x / np.linalg.norm(x)
        return np.stack([x, np.cross(self.normal, x), self.normal], axis=1)

    @cached_property
    def named_limits(self) -> list[tuple[str, np.ndarray]]:
        """The rows (6,) of the limits with their names."""
        return list(self._list_limits())

    @property
    def limits(self) -> np.ndarray:
        """C (r, 6): friction, sole and a force that pushes hold where ``C f <= 0``."""
        return np.array([row for _, row in self.named_limits]).reshape(-1, 6)

    def _list_limits(self) -> Iterator[tuple[str, np.ndarray]]:
        """Yield the rows of the contact wrench cone with their names."""
        # Rows are linear in the unit rows of the components; mu of the pyramid within the cone is smaller by sqrt(2).
        (mx, my, mz, fx, fy, fz), mu, signs = np.eye(6), (self.friction or 0.0) / sqrt(2), (1, -1)
        has_friction = self.friction is not None
        if has_friction or self.sole is not None:
            yield "normal force", -fz
        # |fx| <= mu fz and |fy| <= mu fz
        for s, (name, f) in product(signs, (("x", fx), ("y", fy)) if has_friction else ()):
            yield f"friction along {name}", s * f - mu * fz
        if self.sole is None:
            return
        # |mx| <= y fz and |my| <= x fz
        x, y = self.sole
        for s, (name, m, length) in product(signs, (("y", mx, y), ("x", my, x))):
            yield f"centre of pressure along {name}", s * m - length * fz
        # s mz <= mu (x + y) fz - |y fx + s mu mx| - |x fy + s mu my| for both signs s: eight rows in all.
        for s, a, b in product(signs, repeat=3) if has_friction else ():
            sheared = a * (y * fx + s * mu * mx) + b * (x * fy + s * mu * my)
            yield "friction about z", s * mz - mu * (x + y) * fz + sheared


def _numbers(x: Any, shape: tuple[int, ...], label: str, least: float = -np.inf) -> np.ndarray:
    """Return an array of finite numbers above a bound.

    It has the shape that is expected.
    """
    array = array_of_shape(x, shape, label)
    if array.shape != shape or not is_numeric(array) or not (np.isfinite(array) & (array > least)).all():
        kind = "finite" if np.isinf(least) else "positive finite"
        raise JounceError(f"{label} is {quote_value(x)}; expected {shape[0]} {kind} numbers")
    return array.astype(float)


def _as_pose(place: Any, label: str) -> np.ndarray:
    """Return the pose (4, 4) of a place: a point in the axes of the body, or a pose."""
    T = np.eye(4)
    if asarray(place, label).shape != (4, 4):
        T[:3, 3] = _numbers(place, (3,), label)
        return T
    T = _numbers(place, (4, 4), label)
    if np.abs(T[:3, :3].T @ T[:3, :3] - np.eye(3)).max() > _UNIT_TOLERANCE or (T[3] != (0, 0, 0, 1)).any():
        raise JounceError(f"{label} is no pose; expected a rotation matrix, a position, and the last row (0, 0, 0, 1)")
    return T
