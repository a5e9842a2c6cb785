"""Mechanism: the frozen data of a tree of rigid bodies on 1-DOF joints, and its check at the door.

Body i hangs by joint i on body ``parent[i] < i`` (or on the ground, -1), with the joint screw X_i in its own frame:
``C_i = C_p B_i exp(X_i theta_i)``. The joint variables follow the coordinates by ``theta = G q + g`` with constant G
and g: the identity, unless joints mimic others.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from jounce import inertia, lie
from jounce._scalars import Array, asarray, is_numeric, is_symbolic, whole
from jounce.errors import JounceError, no_such, one_line, shortened

UNIT_TOLERANCE = 1e-9  # how far a direction or rotation may be from unit length before it is taken for a mistake


DATA = ("B", "X", "M", "gravity", "G", "g")  # the arrays of a mechanism


@dataclass(frozen=True)
class Frame:
    """A named frame fixed on a body (-1: the ground), `T` its pose in the body frame."""

    name: str
    body: int
    T: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Mechanism:
    """A tree or forest of nb bodies with n coordinates; build it by `from_screws` or `from_spatial_screws`."""

    B: Array  # (nb, 4, 4) pose of body i in its parent's frame at theta_i = 0
    X: Array  # (nb, 6) joint screw in the body frame, (xi; eta)
    M: Array  # (nb, 6, 6) inertia matrix in the body frame
    parent: tuple[int, ...]
    gravity: Array  # (3,) in the inertial frame, m/s^2
    G: Array  # (nb, n)
    g: Array  # (nb,)
    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    coordinates: tuple[str, ...]
    frames: tuple[Frame, ...] = ()  # of the links merged into bodies
    name: str = "robot"

    def __post_init__(self) -> None:
        for array in (*(getattr(self, name) for name in DATA), *(frame.T for frame in self.frames)):
            array.flags.writeable = False

    def __setstate__(self, state: dict[str, Any]) -> None:  # a copy or an unpickled one is as frozen as any
        self.__dict__.update(state)
        self.__post_init__()

    @property
    def nb(self) -> int:
        """The number of bodies."""
        return len(self.parent)

    @property
    def n(self) -> int:
        """The number of coordinates."""
        return len(self.coordinates)

    def frame(self, name: str) -> Frame:
        """Where a body, or a link merged into one, sits."""
        if name in self.bodies:
            return Frame(name, self.bodies.index(name), np.eye(4, dtype=int))
        for frame in self.frames:
            if frame.name == name:
                return frame
        raise no_such("body", name, [*self.bodies, *(frame.name for frame in self.frames)])


@lru_cache(maxsize=64)
def in_whole_numbers(mechanism: Mechanism) -> Mechanism:
    """The same mechanism to calculate with symbols: whole numbers are integers, so that they leave no 1.0 behind."""
    return _converted(mechanism, whole)


@lru_cache(maxsize=64)
def in_extended_precision(mechanism: Mechanism) -> Mechanism:
    """The same mechanism to calculate with long doubles: what is derived from its data is not rounded to doubles."""
    return _converted(mechanism, lambda array: array.astype(np.longdouble))


def _converted(mechanism: Mechanism, convert: Callable[[Array], Array]) -> Mechanism:
    data: dict[str, Any] = {name: convert(getattr(mechanism, name)) for name in DATA}
    frames = tuple(replace(frame, T=convert(frame.T)) for frame in mechanism.frames)
    return replace(mechanism, frames=frames, **data)


def suited(mechanism: Mechanism, arrays: Sequence[Array]) -> Mechanism:
    """The mechanism with data of the kind that states and wrenches of these scalar types go with."""
    if any(map(is_symbolic, arrays)):
        return in_whole_numbers(mechanism)
    if any(is_numeric(x) and x.dtype == np.longdouble for x in arrays):
        return in_extended_precision(mechanism)
    return mechanism


def ancestors(mechanism: Mechanism) -> np.ndarray:
    """(nb, nb) integers: 1 where body j is body i itself or carries it."""
    rows: list[np.ndarray] = []
    for i, p in enumerate(mechanism.parent):
        rows.append(np.eye(mechanism.nb, dtype=int)[i] + (rows[p] if p >= 0 else 0))
    return np.stack(rows)


def reference_poses(mechanism: Mechanism) -> list[Array]:
    """The poses of all the bodies at theta = 0."""
    poses: list[Array] = []
    for B, p in zip(mechanism.B, mechanism.parent, strict=True):
        poses.append(B if p < 0 else poses[p] @ B)
    return poses


def from_screws(
    B: Array,
    X: Array,
    M: Array,
    parent: Sequence[int] | None = None,
    names: Sequence[str] | None = None,
    gravity: Array = (0, 0, -9.81),
    *,
    joint_names: Sequence[str] | None = None,
    G: Array | None = None,
    g: Array | None = None,
    name: str = "robot",
) -> Mechanism:
    """A mechanism from body-fixed data, every array checked; see `Robot.from_screws` for what they are."""
    given = {"B": B, "X": X, "M": M, "gravity": gravity}
    data: dict[str, Any] = {label: _data(array, label) for label, array in given.items()}
    nb = data["B"].shape[0] if data["B"].ndim == 3 else 0
    data["G"] = np.eye(nb) if G is None else _data(G, "G")
    data["g"] = np.zeros(nb) if g is None else _data(g, "g")
    _check_shapes(data, nb)
    data["B"] = np.stack([_pose(T, f"B[{i}]") for i, T in enumerate(data["B"])])
    data["X"] = np.stack([_screw(x, f"X[{i}]") for i, x in enumerate(data["X"])])
    for i, M_i in enumerate(data["M"]):
        error = inertia.form_error(M_i) if is_numeric(M_i) else None
        if error:
            raise JounceError(f"M[{i}] {error}; an inertia matrix is [[Theta, m c~], [-m c~, m I]]")
    coordinates = _names(joint_names, data["G"].shape[1], "joint_names", "joint" if G is None else "q")
    built = Mechanism(
        **data,
        parent=_tree(parent, nb),
        bodies=_names(names, nb, "names", "body"),
        joints=coordinates if G is None else _names(None, nb, "joints", "joint"),
        coordinates=coordinates,
        name=name,
    )
    return in_whole_numbers(built) if any(map(is_symbolic, data.values())) else built


def from_spatial_screws(A: Array, Y: Array, M: Array, parent: Sequence[int] | None = None, **data: Any) -> Mechanism:
    """A mechanism from absolute reference poses A_i and joint screws Y_i in the inertial frame, both at q = 0.

    ``B_i = A_p^-1 A_i`` and ``X_i = Ad(A_i^-1) Y_i``.
    """
    A, Y = _data(A, "A"), _data(Y, "Y")
    nb = A.shape[0] if A.ndim == 3 else 0
    if nb == 0 or A.shape != (nb, 4, 4) or Y.shape != (nb, 6):
        raise JounceError(f"A and Y have shapes {A.shape} and {Y.shape}; expected (n, 4, 4) and (n, 6)")
    A = [_pose(T, f"A[{i}]") for i, T in enumerate(A)]
    Y = [_screw(y, f"Y[{i}]") for i, y in enumerate(Y)]
    B = [A_i if p < 0 else lie.inverse(A[p]) @ A_i for A_i, p in zip(A, _tree(parent, nb), strict=True)]
    X = [lie.Ad(lie.inverse(A_i)) @ Y_i for A_i, Y_i in zip(A, Y, strict=True)]
    return from_screws(np.stack(B), np.stack(X), M, parent, **data)


def spatial_screws(mechanism: Mechanism) -> tuple[Array, Array]:
    """The absolute reference poses A_i and the joint screws Y_i in the inertial frame: ``Y_i = Ad(A_i) X_i``."""
    A = reference_poses(mechanism)
    return np.stack(A), np.stack([lie.Ad(A_i) @ X for A_i, X in zip(A, mechanism.X, strict=True)])


def _data(x: Array, label: str) -> np.ndarray:
    """A copy of the caller's array; data are concrete, however a state is traced."""
    array = asarray(x, label)
    try:
        return np.array(array if isinstance(array, np.ndarray) else np.asarray(array, dtype=np.float64))
    except Exception as error:  # a tracer of JAX, say
        raise JounceError(
            f"{label} is not concrete: {shortened(one_line(error))}; states may be traced, data not"
        ) from None


def _check_shapes(data: Mapping[str, np.ndarray], nb: int) -> None:
    if nb == 0 or data["B"].shape != (nb, 4, 4):
        raise JounceError(f"B has shape {data['B'].shape}; expected (n, 4, 4) with at least one body")
    if data["gravity"].shape != (3,):
        raise JounceError(f"gravity has shape {data['gravity'].shape}; expected a vector (3,), as (0, 0, -9.81)")
    n = data["G"].shape[1] if data["G"].ndim == 2 else 0
    expected = {"X": (nb, 6), "M": (nb, 6, 6), "G": (nb, n), "g": (nb,)}
    for label, shape in expected.items():
        if data[label].shape != shape or 0 in shape:
            raise JounceError(f"{label} has shape {data[label].shape}; expected {shape} for {nb} bodies")
    for label, array in data.items():
        if is_numeric(array) and not np.all(np.isfinite(array)):
            at = np.argwhere(~np.isfinite(array))[0].tolist()
            raise JounceError(f"{label}{at} is {array[tuple(at)]}; expected finite numbers")


def _pose(T: np.ndarray, label: str) -> np.ndarray:
    """A pose, checked, its rotation made orthonormal to the last digit by a Newton step of the polar decomposition."""
    if not is_numeric(T):
        return T
    R = T[:3, :3]
    error = np.abs(R.T @ R - np.eye(3)).max()
    if not error <= UNIT_TOLERANCE or np.linalg.det(R) < 0 or np.any(T[3] != [0, 0, 0, 1]):
        what = f"R^T R differs from I by {error:.2g}, det R = {np.linalg.det(R):.6g}, last row {T[3].tolist()}"
        raise JounceError(f"{label} is not a pose [[R, r], [0, 1]]: {what}")
    return lie.pose(R @ (3 * np.eye(3) - R.T @ R) / 2, T[:3, 3:])


def _screw(X: np.ndarray, label: str) -> np.ndarray:
    """A unit screw, checked, its length made 1 to the last digit."""
    if not is_numeric(X):
        return X
    length = np.linalg.norm(X[:3]) or np.linalg.norm(X[3:])
    if not abs(length - 1) <= UNIT_TOLERANCE:
        raise JounceError(f"{label} = {X.tolist()} is not a unit screw (xi; eta): |xi| = 1, or xi = 0 and |eta| = 1")
    return X / length


def _tree(parent: Sequence[int] | None, nb: int) -> tuple[int, ...]:
    if parent is None:
        return tuple(range(-1, nb - 1))
    numbers = np.asarray(parent)
    if numbers.shape != (nb,):
        raise JounceError(f"parent has shape {numbers.shape}; expected ({nb},), one entry a body")
    for i, p in enumerate(numbers.tolist()):
        if p not in range(-1, i):
            earlier = f" or an earlier body, 0 .. {i - 1}" if i else ""
            raise JounceError(f"parent[{i}] = {p!r}; expected -1 (the ground){earlier}")
    return tuple(int(p) for p in numbers)


def _names(given: Sequence[str] | None, count: int, label: str, stem: str) -> tuple[str, ...]:
    if given is None:
        return tuple(f"{stem}{i + 1}" for i in range(count))
    names = tuple(given) if isinstance(given, Iterable) else ()
    if isinstance(given, str) or not names or not all(isinstance(x, str) for x in names):
        raise JounceError(f"{label} is {given!r}; expected {count} texts")
    if len(names) != count or len(set(names)) != count:
        raise JounceError(f"{label} is {list(names)}; expected {count} different texts")
    return names
