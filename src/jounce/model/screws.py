"""`from_screws`, `from_spatial_screws` and `from_dh` make mechanisms from arrays and tables of a caller.

Screw data are body-fixed, or in the inertial frame. Every array is checked here, and nowhere else: shapes, finite
numbers, names, parents, and the forms of poses, unit screws and inertia matrices, which are made exact to rounding.
What goes with bodies and screws, names, limits, drives or a base, travels as `ScrewOptions`, a table of
Denavit-Hartenberg parameters as `DhTable`. Memory grows with the square of the number of bodies, so that `check_size`
bounds it before anything is built.

Denavit-Hartenberg tables, standard and modified, are made into screws. Frame i comes from frame i - 1 by turns and
slides about and along two axes, in the order of the convention:

    standard:  T_i = Rot_z(theta_i) Trans_z(d_i) Trans_x(a_i) Rot_x(alpha_i)    the joint moves about z of frame i - 1
    modified:  T_i = Rot_x(alpha_i) Trans_x(a_i) Rot_z(theta_i) Trans_z(d_i)    the joint moves about z of frame i

In the modified one, Craig's, row i holds what he calls a_{i-1} and alpha_{i-1}. The variable of a revolute joint is
added to theta_i, that of a prismatic one to d_i.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any

import numpy as np

from jounce.core import scalars
from jounce.core.cures import Remedy
from jounce.core.errors import (
    JounceError,
    as_list,
    check_bool,
    check_choice,
    locate_errors,
    one_line,
    quote_value,
    shorten,
    warn,
)
from jounce.core.scalars import Array, asarray, is_finite, is_numeric, is_symbolic
from jounce.model import coordinates, positions
from jounce.model.drive_trains import UNDRIVEN, Drives, drive_error
from jounce.model.frame import UNIT_ROUNDING, Frame
from jounce.model.limits import Limits, check_limits
from jounce.model.mechanism import GRAVITY, Mechanism, with_exact_integers
from jounce.spatial import inertia, lie

UNIT_TOLERANCE = 1e-9  # how far a direction or rotation may be from unit length before it is taken for a mistake
MAX_BODIES = 5000  # a matrix of all joint variables by all coordinates takes 200 MB then, and a robot keeps a few
VARIABLE = "JOUNCE_MAX_BODIES"
DEGREES_CURE = Remedy("degrees=True takes degrees", "angles: deg in its file takes degrees")
DH_PARAMETERS = ("a", "alpha", "d", "theta")
CONVENTIONS = ("standard", "modified")
TYPES = ("revolute", "prismatic")
TOOL = "tool"  # the name of its frame
Row = tuple[Array, str]  # a, alpha, d, theta in rad, (4,), and the type of the joint


@dataclass(frozen=True, kw_only=True, eq=False)
class ScrewOptions:
    """What goes with bodies and screws: names, coordinates, limits, drives, a base.

    `Robot.from_screws` says what each of them is. Gravity, texts and the base are checked when it is made, all that
    depends on the numbers of bodies and joints by `from_screws`.
    """

    names: Sequence[str] | None = None
    gravity: Array = GRAVITY
    joint_names: Sequence[str] | None = None
    owners: Sequence[int] | None = None
    G: Array | None = None
    g: Array | None = None
    limits: Limits | Mapping[str, Array] | None = None
    drives: Drives | Mapping[str, Array] | None = None
    base: Array | None = None
    base_name: str = "base"
    name: str = "robot"

    def __post_init__(self) -> None:
        gravity = _copy_data(self.gravity, "gravity")
        if gravity.shape != (3,):
            raise JounceError(f"gravity has shape {gravity.shape}; expected a vector (3,), as {GRAVITY}")
        _check_finite(gravity, "gravity")
        object.__setattr__(self, "gravity", gravity)
        _check_text(self.name, "name")
        if self.base is not None:
            _check_text(self.base_name, "base_name")
            object.__setattr__(self, "base", _base_inertia(self.base))


def from_screws(
    B: Array, X: Array, M: Array, parent: Sequence[int] | None = None, options: ScrewOptions | None = None
) -> Mechanism:
    """Return a mechanism of body-fixed data, every array checked; see `Robot.from_screws`."""
    options = ScrewOptions() if options is None else options
    # Sizes: nb bodies by the poses B, nc joint variables by their owners, n coordinates by the columns of G. Without G
    # each joint variable is a coordinate.
    data = {label: _copy_data(array, label) for label, array in (("B", B), ("X", X), ("M", M))}
    data["gravity"] = options.gravity
    nb = data["B"].shape[0] if data["B"].ndim == 3 else 0
    check_size(nb)
    owners = _check_owners(options.owners, nb)
    nc = len(owners)
    data["G"] = np.eye(nc) if options.G is None else _copy_data(options.G, "G")
    data["g"] = np.zeros(nc) if options.g is None else _copy_data(options.g, "g")
    _check_shapes(data, nb, nc)

    # Numbers of files and of other libraries have rounding, which would break the forms that all equations rely on.
    for label, exact in (("B", exact_pose), ("X", exact_screw), ("M", exact_inertia)):
        data[label] = np.stack([exact(x, f"{label}[{i}]") for i, x in enumerate(data[label])])
    data |= {label: array + 0.0 for label, array in data.items() if is_numeric(array)}  # no -0.0 among data

    has_own_coordinates = options.G is not None
    bodies = _check_names(options.names, nb, "names", "body")
    stem = "q" if has_own_coordinates else "joint"
    coordinates = _check_names(options.joint_names, data["G"].shape[1], "joint_names", stem)
    joints = _check_names(None, nc, "joints", "joint") if has_own_coordinates else coordinates
    parents = _check_parents(parent, nb)

    # A floating base is body 0, ahead of all others, whose numbers grow by one; it has no joint variable.
    if options.base is not None:
        if options.base_name in bodies:
            came = f"base_name is {quote_value(options.base_name)}, which is the name of a body"
            raise JounceError(f"{came}; expected another")
        bodies = (options.base_name, *bodies)
        data["B"], data["M"] = np.stack([np.eye(4), *data["B"]]), np.stack([options.base, *data["M"]])
        parents, owners = (-1, *(p + 1 for p in parents)), tuple(i + 1 for i in owners)
    mechanism = Mechanism(
        B=data["B"],
        X=data["X"],
        M=data["M"],
        gravity=data["gravity"],
        G=data["G"],
        g=data["g"],
        parent=parents,
        owners=owners,
        bodies=bodies,
        joints=joints,
        coordinates=coordinates,
        limits=check_limits(options.limits, nc),
        drives=_check_drives(options.drives, nc),
        floats=options.base is not None,
        name=options.name,
    )
    positions.multiscrew_joints(mechanism)  # refuses screws that together form no joint
    has_symbols = any(map(is_symbolic, mechanism.arrays.values()))
    return with_exact_integers(mechanism) if has_symbols else mechanism


def _check_owners(owners: Sequence[int] | None, nb: int) -> tuple[int, ...]:
    """Return the body that each joint variable moves.

    Each body has some, in the order of the bodies.
    """
    if owners is None:
        return tuple(range(nb))
    numbers = as_list(owners)
    if not all(is_finite(i) for i in numbers) or sorted(set(numbers)) != list(range(nb)) or sorted(numbers) != numbers:
        expected = f"the bodies 0 .. {nb - 1} that the screws move, in order"
        raise JounceError(f"owners is {quote_value(owners)}; expected {expected}")
    return tuple(map(int, numbers))


def _base_inertia(inertia_matrix: Array) -> np.ndarray:
    """Return the checked inertia matrix of a floating base."""
    M = _copy_data(inertia_matrix, "base")
    if M.shape != (6, 6):
        raise JounceError(f"base has shape {M.shape}; expected the inertia matrix (6, 6) of the base that floats")
    _check_finite(M, "base")
    M = exact_inertia(M, "base")
    return M + 0.0 if is_numeric(M) else M


def from_spatial_screws(
    A: Array, Y: Array, M: Array, parent: Sequence[int] | None = None, options: ScrewOptions | None = None
) -> Mechanism:
    """Return a mechanism of poses A_i and screws Y_i.

    They are absolute, at q = 0. Both are in the inertial frame. ``B_i = A_p^-1 A_i`` and ``X_i = Ad(A_i^-1) Y_i``.
    """
    A, Y = _copy_data(A, "A"), _copy_data(Y, "Y")
    nb = A.shape[0] if A.ndim == 3 else 0
    if nb == 0 or A.shape != (nb, 4, 4) or Y.shape != (nb, 6):
        raise JounceError(f"A and Y have shapes {A.shape} and {Y.shape}; expected (n, 4, 4) and (n, 6)")
    A = [exact_pose(T, f"A[{i}]") for i, T in enumerate(A)]
    Y = [exact_screw(y, f"Y[{i}]") for i, y in enumerate(Y)]
    B = [A_i if p < 0 else lie.inverse(A[p]) @ A_i for A_i, p in zip(A, _check_parents(parent, nb), strict=True)]
    X = [lie.Ad(lie.inverse(A_i)) @ Y_i for A_i, Y_i in zip(A, Y, strict=True)]
    return from_screws(np.stack(B), np.stack(X), M, parent, options)


def _copy_data(x: Array, label: str) -> np.ndarray:
    """Return a copy of the caller's array.

    The data of a robot must be concrete, even if states are traced.
    """
    array = asarray(x, label)
    kinds = {type(entry) for entry in array.flat} if is_symbolic(array) else set()
    if any(kind.__module__.startswith("casadi") and kind.__name__ == "MX" for kind in kinds):
        cure = "robot.casadi_function(parameters=...) is called with MX"
        raise JounceError(f"{label} holds a CasADi MX; a robot's data may be SX: {cure}")
    try:
        return np.array(array if isinstance(array, np.ndarray) else np.asarray(array, dtype=np.float64))
    except Exception as error:  # such as a tracer of JAX
        why = shorten(one_line(error))
        raise JounceError(f"{label} is not concrete: {why}; a state may be traced, the robot's data may not") from None


def _check_shapes(data: Mapping[str, np.ndarray], nb: int, nc: int) -> None:
    """Raise `JounceError` for wrong shapes, infinite numbers or zero columns.

    Columns are those of G.
    """
    if nb == 0 or data["B"].shape != (nb, 4, 4):
        raise JounceError(f"B has shape {data['B'].shape}; expected (n, 4, 4) with at least one body")
    n = data["G"].shape[1] if data["G"].ndim == 2 else 0
    for label, shape in {"X": (nc, 6), "M": (nb, 6, 6), "G": (nc, n), "g": (nc,)}.items():
        if data[label].shape != shape or 0 in shape:
            raise JounceError(f"{label} has shape {data[label].shape}; expected {shape} for {nb} bodies")
    for label, array in data.items():
        _check_finite(array, label)
    for j, column in enumerate(data["G"].T):
        if is_numeric(column) and not column.any():
            raise JounceError(f"G[:, {j}] is zero; every coordinate must move a joint")


def _check_finite(array: np.ndarray, label: str) -> None:
    if is_numeric(array) and not np.all(np.isfinite(array)):
        index = np.argwhere(~np.isfinite(array))[0].tolist()
        raise JounceError(f"{label}{index} is {array[tuple(index)]}; expected finite numbers")


def exact_pose(T: np.ndarray, label: str) -> np.ndarray:
    """Check a pose, and make its rotation orthonormal to rounding."""
    if not is_numeric(T):
        return T
    R = T[:3, :3]
    error = np.abs(lie.portable_product(R.T, R) - np.eye(3)).max()
    if not error <= UNIT_TOLERANCE or np.linalg.det(R) < 0 or np.any(T[3] != [0, 0, 0, 1]):
        what = f"R^T R differs from I by {error:.2g}, det R = {np.linalg.det(R):.6g}, last row {T[3].tolist()}"
        raise JounceError(f"{label} is not a pose [[R, r], [0, 1]]: {what}")
    # R (3 I - R^T R) / 2 is a Newton step of the polar decomposition: it squares the error, which is 1e-9 at most.
    if error > UNIT_ROUNDING:
        R = R @ (3 * np.eye(3) - R.T @ R) / 2
    return lie.pose(R, T[:3, 3:]) + 0.0


def exact_screw(X: np.ndarray, label: str) -> np.ndarray:
    """Check a unit screw, and make its length 1 to rounding."""
    if not is_numeric(X):
        return X
    length = _length(X[:3]) or _length(X[3:])
    if not abs(length - 1) <= UNIT_TOLERANCE:
        raise JounceError(f"{label} = {X.tolist()} is not a unit screw (xi; eta): |xi| = 1, or xi = 0 and |eta| = 1")
    return X if abs(length - 1) <= UNIT_ROUNDING else X / length


def _length(v: np.ndarray) -> Any:
    """Return the length of a vector.

    It has the same bits on every processor, as `portable_product` has: `numpy.linalg.norm` takes a product of BLAS.
    """
    return np.sqrt((v * v).sum())


def exact_inertia(M: np.ndarray, label: str) -> np.ndarray:
    """Check an inertia matrix, and make its form exact.

    It has one mass, one first moment and one symmetric tensor.
    """
    if not is_numeric(M):
        return M
    error = inertia.form_error(M)
    if error is not None:
        raise JounceError(f"{label} {error}; an inertia matrix is [[Theta, m c~], [-m c~, m I]]")
    return inertia.restore_form(M)


def _check_drives(drives: object, nb: int) -> Drives:
    """Return the drive trains of joint variables.

    They are those of another robot, or of a mapping of arrays (nb,).
    """
    parameters: object = {} if drives is None else drives
    if isinstance(drives, Drives):
        parameters = vars(drives)
    if not isinstance(parameters, Mapping):
        raise JounceError(f"drives is of type {type(drives).__name__}; expected a mapping of {', '.join(UNDRIVEN)}")
    for key in parameters:
        check_choice("drive", key, UNDRIVEN)
    # What is not stated has the values of a joint without a drive train.
    unstated = {key: np.full(nb, value) for key, value in UNDRIVEN.items()}
    arrays = {key: _copy_data(array, key) for key, array in (unstated | dict(parameters)).items()}
    for key, array in arrays.items():
        if array.shape != (nb,) or not is_numeric(array):
            raise JounceError(f"drives: {key} has shape {array.shape}; expected numbers ({nb},), one per joint")
    for i in range(nb):
        error = drive_error(**{key: array[i] for key, array in arrays.items()})
        if error is not None:
            raise JounceError(f"drives of joint {i}: {error}")
    return Drives(**{key: array + 0.0 for key, array in arrays.items()})  # no -0.0 among data


def _check_parents(parent: Sequence[int] | None, nb: int) -> tuple[int, ...]:
    """Return the parent of each body, the body before it by default."""
    if parent is None:
        return tuple(range(-1, nb - 1))
    numbers = as_list(parent)
    if len(numbers) != nb:
        raise JounceError(f"parent is {quote_value(parent)}; expected {nb} indices, one for each body")
    for i, p in enumerate(numbers):
        if not is_finite(p) or p not in range(-1, i):
            earlier = f" or an earlier body, 0 .. {i - 1}" if i > 0 else ""
            raise JounceError(f"parent[{i}] = {quote_value(p)}; expected -1 (the ground){earlier}")
    return tuple(map(int, numbers))


def _check_text(name: object, label: str) -> str:
    if not isinstance(name, str):
        raise JounceError(f"{label} is {quote_value(name)}; expected a text")
    return name


def _check_names(names: Sequence[str] | None, count: int, label: str, stem: str) -> tuple[str, ...]:
    """Return names that are different texts.

    By default they are a stem with numbers from 1 on.
    """
    if names is None:
        return tuple(f"{stem}{i + 1}" for i in range(count))
    entries = as_list(names)
    are_texts = not isinstance(names, str) and all(isinstance(x, str) for x in entries)
    if not are_texts or not len(entries) == len(set(entries)) == count:
        raise JounceError(f"{label} is {quote_value(names)}; expected {count} different texts")
    return tuple(entries)


# Denavit-Hartenberg tables.
@dataclass(frozen=True, eq=False)
class DhTable:
    """A Denavit-Hartenberg table, read and checked when it is made; see `Robot.from_dh`."""

    rows: Any  # as a caller gives them, then as a list of rows (a, alpha, d, theta) with the types of their joints
    convention: str
    _: KW_ONLY
    types: Sequence[str] | None = None
    degrees: bool = False
    base: Array | None = None  # the pose of the first frame, and of a tool in the last one, (4, 4)
    tool: Array | None = None

    def __post_init__(self) -> None:
        check_choice("Denavit-Hartenberg convention", self.convention, CONVENTIONS)
        check_bool("degrees", self.degrees, "the unit of alpha and theta")
        object.__setattr__(self, "rows", _read_rows(self.rows, self.types))
        for label, pose in (("base", self.base), ("tool", self.tool)):
            if pose is not None:
                object.__setattr__(self, label, _check_pose(pose, label))


def from_dh(table: DhTable, M: Array, options: ScrewOptions | None = None) -> Mechanism:
    """Return a mechanism of a table; see `Robot.from_dh`."""
    if not table.degrees:
        _warn_of_degrees(table.rows)
    place = _standard_row if table.convention == "standard" else _modified_row
    placed = [place(row, kind, table.degrees) for row, kind in table.rows]
    B, X = [B_i for B_i, _ in placed], [X_i for _, X_i in placed]
    if table.base is not None:
        B[0] = table.base @ B[0]
    mechanism = from_screws(np.stack(B), np.stack(X), M, None, options)
    if table.tool is None:
        return mechanism
    if TOOL in mechanism.bodies:
        raise JounceError(f"a body is named {TOOL!r} like the frame of tool=; rename the body")
    return replace(mechanism, frames=(Frame(TOOL, mechanism.nb - 1, table.tool),))


def _standard_row(row: Array, kind: str, degrees: bool) -> tuple[Array, Array]:
    """Return B and X of a row of the standard convention.

    The axis, z of the frame before, is seen from the frame at the end of the link.
    """
    a, alpha, d, theta = row
    (ct, st), (ca, sa) = _cos_sin(theta, degrees), _cos_sin(alpha, degrees)
    B = _to_array([
        [ct, -st * ca, st * sa, a * ct],
        [st, ct * ca, -ct * sa, a * st],
        [0, sa, ca, d],
        [0, 0, 0, 1],
    ])  # fmt: skip
    return B, _to_array([0, sa, ca, 0, a * ca, -a * sa] if kind == "revolute" else [0, 0, 0, 0, sa, ca])


def _modified_row(row: Array, kind: str, degrees: bool) -> tuple[Array, Array]:
    """Return B and X of a row of the modified convention: the axis is z of the frame itself."""
    a, alpha, d, theta = row
    (ct, st), (ca, sa) = _cos_sin(theta, degrees), _cos_sin(alpha, degrees)
    B = _to_array([
        [ct, -st, 0, a],
        [st * ca, ct * ca, -sa, -d * sa],
        [st * sa, ct * sa, ca, d * ca],
        [0, 0, 0, 1],
    ])  # fmt: skip
    return B, _to_array([0, 0, 1, 0, 0, 0] if kind == "revolute" else [0, 0, 0, 0, 0, 1])


def _cos_sin(angle: Any, degrees: bool) -> tuple[Any, Any]:
    """Return cosine and sine, exact at right angles.

    Zeros of an arm are zeros then.
    """
    if isinstance(angle, int | float):
        right = 90 if degrees else np.pi / 2
        quarters = round(angle / right)
        if quarters * right == angle:
            return ((1, 0), (0, 1), (-1, 0), (0, -1))[quarters % 4]
    x = np.array([angle * (np.pi / 180) if degrees else angle])
    return scalars.cos(x)[0], scalars.sin(x)[0]


def _to_array(entries: list[Any]) -> Array:
    """Return floats, or an object array with symbols."""
    row = np.array(entries, dtype=object)
    return row.astype(float) if all(isinstance(x, int | float) for x in row.flat) else row


def _read_rows(table: Any, types: Sequence[str] | None) -> list[Row]:
    """Return the checked rows of a table, with joint types."""
    rows = as_list(table) if isinstance(table, Sequence | np.ndarray) and not isinstance(table, str) else []
    if len(rows) == 0:
        raise JounceError(f"table is {quote_value(table)}; expected rows of {', '.join(DH_PARAMETERS)}")
    # Types are in the rows if these have names, else in `types`; joints are revolute if neither says so.
    if types is None:
        kinds = [row.get("type", TYPES[0]) if isinstance(row, Mapping) else TYPES[0] for row in rows]
    elif any(isinstance(row, Mapping) for row in rows):
        raise JounceError("types= applies to rows of numbers; rows of names have their own 'type'")
    else:
        kinds = [] if isinstance(types, str) else as_list(types)
    if len(kinds) != len(rows):
        raise JounceError(f"types is {quote_value(types)}; expected {len(rows)} of {', '.join(TYPES)}, one per row")
    for i, kind in enumerate(kinds):
        with locate_errors(f"joint of table[{i}]"):
            check_choice("type", kind, TYPES)
    return [(_read_row(row, f"table[{i}]"), kind) for i, (row, kind) in enumerate(zip(rows, kinds, strict=True))]


def _read_row(row: Any, label: str) -> Array:
    """Return a, alpha, d and theta of a row.

    The row has four numbers or names.
    """
    order = ", ".join(DH_PARAMETERS)
    if isinstance(row, Mapping):
        for key in row:
            check_choice("key", key, [*DH_PARAMETERS, "type"], label)
        for key in DH_PARAMETERS:
            if key not in row:
                raise JounceError(f"{label} has no {key!r}; expected {order}")
        row = [row[key] for key in DH_PARAMETERS]
    numbers = asarray(row, label)
    if numbers.shape != (4,):
        raise JounceError(f"{label} has shape {numbers.shape}; expected 4 numbers: {order}")
    if is_symbolic(numbers):
        return numbers
    if not np.isfinite(numbers).all():
        raise JounceError(f"{label} is {numbers.tolist()}; expected finite numbers: {order}")
    return numbers.astype(float).astype(object)  # Python's own floats


def _warn_of_degrees(rows: Sequence[Row]) -> None:
    """Warn of the first angle that is more than a turn."""
    for i, (row, _) in enumerate(rows):
        for name in ("alpha", "theta"):
            angle = row[DH_PARAMETERS.index(name)]
            if isinstance(angle, float) and abs(angle) > coordinates.MIN_DEGREES_ANGLE:
                warn(f"table[{i}]: {name} is {angle:g} rad, more than a turn; {DEGREES_CURE}")
                return


def _check_pose(T: Array, label: str) -> Array:
    """Return a pose (4, 4), checked and of exact form."""
    array = asarray(T, label)
    if array.shape != (4, 4):
        raise JounceError(f"{label} has shape {array.shape}; expected a pose (4, 4)")
    return exact_pose(array, label)


def check_size(bodies: int) -> None:
    """Raise `JounceError` if a robot has too many bodies."""
    limit = os.environ.get(VARIABLE) or str(MAX_BODIES)
    if not (limit.isascii() and limit.isdigit()):
        raise JounceError(f"{VARIABLE}={quote_value(limit)}; expected the largest number of bodies")
    if bodies > int(limit):
        why = f"a mass matrix would take {8e-9 * bodies**2:.2g} GB; the environment variable {VARIABLE} raises this"
        raise JounceError(f"{bodies} movable joints; expected up to {limit}: {why}")
