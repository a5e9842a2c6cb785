"""`from_screws`, `from_spatial_screws` and `from_dh` make mechanisms from arrays and tables of a caller.

Screw data are body-fixed, or in the inertial frame. Every array is checked here, and nowhere else: shapes, finite
numbers, names, parents, and the forms of poses, unit screws and inertia matrices, which are made exact to rounding.
Memory grows with the square of the number of bodies, so that `check_size` bounds it before anything is built.

Denavit-Hartenberg tables, standard and modified, are made into screws. Frame i comes from frame i - 1 by turns and
slides about and along two axes, in the order of the convention:

    standard:  T_i = Rot_z(theta_i) Trans_z(d_i) Trans_x(a_i) Rot_x(alpha_i)    the joint moves about z of frame i - 1
    modified:  T_i = Rot_x(alpha_i) Trans_x(a_i) Rot_z(theta_i) Trans_z(d_i)    the joint moves about z of frame i

In the modified one, Craig's, row i holds what he calls a_{i-1} and alpha_{i-1}. The variable of a revolute joint is
added to theta_i, that of a prismatic one to d_i.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
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


def from_screws(
    B: Array,
    X: Array,
    M: Array,
    parent: Sequence[int] | None = None,
    names: Sequence[str] | None = None,
    gravity: Array = GRAVITY,
    *,
    joint_names: Sequence[str] | None = None,
    owners: Sequence[int] | None = None,
    G: Array | None = None,
    g: Array | None = None,
    limits: Limits | Mapping[str, Array] | None = None,
    drives: Drives | Mapping[str, Array] | None = None,
    base: Array | None = None,
    base_name: str = "base",
    name: str = "robot",
) -> Mechanism:
    """A mechanism from body-fixed data, every array checked; see `Robot.from_screws` for what they are."""
    given = {"B": B, "X": X, "M": M, "gravity": gravity}
    data = {label: _copy_data(array, label) for label, array in given.items()}
    nb = data["B"].shape[0] if data["B"].ndim == 3 else 0
    check_size(nb)
    moved = _check_owners(owners, nb)
    nc = len(moved)
    data["G"] = np.eye(nc) if G is None else _copy_data(G, "G")
    data["g"] = np.zeros(nc) if g is None else _copy_data(g, "g")
    _check_shapes(data, nb, nc)
    for label, exact in (("B", exact_pose), ("X", exact_screw), ("M", exact_inertia)):
        data[label] = np.stack([exact(x, f"{label}[{i}]") for i, x in enumerate(data[label])])
    data |= {label: array + 0.0 for label, array in data.items() if is_numeric(array)}  # no -0.0 among data
    bodies = _check_names(names, nb, "names", "body")
    coordinates = _check_names(joint_names, data["G"].shape[1], "joint_names", "joint" if G is None else "q")
    carriers = _check_parents(parent, nb)
    if base is not None:
        if _check_text(base_name, "base_name") in bodies:
            raise JounceError(f"base_name is {quote_value(base_name)}, which is the name of a body; expected another")
        bodies = (base_name, *bodies)
        data["B"], data["M"] = np.stack([np.eye(4), *data["B"]]), np.stack([_base_inertia(base), *data["M"]])
        carriers, moved = (-1, *(p + 1 for p in carriers)), tuple(i + 1 for i in moved)
    built = Mechanism(
        B=data["B"],
        X=data["X"],
        M=data["M"],
        gravity=data["gravity"],
        G=data["G"],
        g=data["g"],
        parent=carriers,
        owners=moved,
        bodies=bodies,
        joints=coordinates if G is None else _check_names(None, nc, "joints", "joint"),
        coordinates=coordinates,
        limits=check_limits(limits, nc),
        drives=_check_drives(drives, nc),
        floats=base is not None,
        name=_check_text(name, "name"),
    )
    positions.multiscrew_joints(built)  # refuses screws that together form no joint
    return with_exact_integers(built) if any(map(is_symbolic, built.arrays.values())) else built


def _check_owners(given: Sequence[int] | None, nb: int) -> tuple[int, ...]:
    """The body that each joint variable moves: each body has some, in the order of the bodies."""
    if given is None:
        return tuple(range(nb))
    numbers = as_list(given)
    if not all(is_finite(i) for i in numbers) or sorted(set(numbers)) != list(range(nb)) or sorted(numbers) != numbers:
        expected = f"the bodies 0 .. {nb - 1} that the screws move, in order"
        raise JounceError(f"owners is {quote_value(given)}; expected {expected}")
    return tuple(map(int, numbers))


def _base_inertia(given: Array) -> np.ndarray:
    M = _copy_data(given, "base")
    if M.shape != (6, 6):
        raise JounceError(f"base has shape {M.shape}; expected the inertia matrix (6, 6) of the base that floats")
    _check_finite(M, "base")
    M = exact_inertia(M, "base")
    return M + 0.0 if is_numeric(M) else M


def from_spatial_screws(A: Array, Y: Array, M: Array, parent: Sequence[int] | None = None, **data: Any) -> Mechanism:
    """A mechanism from absolute reference poses A_i and joint screws Y_i in the inertial frame, both at q = 0.

    ``B_i = A_p^-1 A_i`` and ``X_i = Ad(A_i^-1) Y_i``.
    """
    A, Y = _copy_data(A, "A"), _copy_data(Y, "Y")
    nb = A.shape[0] if A.ndim == 3 else 0
    if nb == 0 or A.shape != (nb, 4, 4) or Y.shape != (nb, 6):
        raise JounceError(f"A and Y have shapes {A.shape} and {Y.shape}; expected (n, 4, 4) and (n, 6)")
    A = [exact_pose(T, f"A[{i}]") for i, T in enumerate(A)]
    Y = [exact_screw(y, f"Y[{i}]") for i, y in enumerate(Y)]
    B = [A_i if p < 0 else lie.inverse(A[p]) @ A_i for A_i, p in zip(A, _check_parents(parent, nb), strict=True)]
    X = [lie.Ad(lie.inverse(A_i)) @ Y_i for A_i, Y_i in zip(A, Y, strict=True)]
    return from_screws(np.stack(B), np.stack(X), M, parent, **data)


def _copy_data(x: Array, label: str) -> np.ndarray:
    """Return a copy of the caller's array; a robot's data must be concrete, even if states are traced."""
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
    if nb == 0 or data["B"].shape != (nb, 4, 4):
        raise JounceError(f"B has shape {data['B'].shape}; expected (n, 4, 4) with at least one body")
    if data["gravity"].shape != (3,):
        raise JounceError(f"gravity has shape {data['gravity'].shape}; expected a vector (3,), as {GRAVITY}")
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
        at = np.argwhere(~np.isfinite(array))[0].tolist()
        raise JounceError(f"{label}{at} is {array[tuple(at)]}; expected finite numbers")


def exact_pose(T: np.ndarray, label: str) -> np.ndarray:
    """Check a pose, and make its rotation orthonormal to rounding by a Newton step of the polar decomposition."""
    if not is_numeric(T):
        return T
    R = T[:3, :3]
    error = np.abs(lie.portable_product(R.T, R) - np.eye(3)).max()
    if not error <= UNIT_TOLERANCE or np.linalg.det(R) < 0 or np.any(T[3] != [0, 0, 0, 1]):
        what = f"R^T R differs from I by {error:.2g}, det R = {np.linalg.det(R):.6g}, last row {T[3].tolist()}"
        raise JounceError(f"{label} is not a pose [[R, r], [0, 1]]: {what}")
    return lie.pose(R if error <= UNIT_ROUNDING else R @ (3 * np.eye(3) - R.T @ R) / 2, T[:3, 3:]) + 0.0


def exact_screw(X: np.ndarray, label: str) -> np.ndarray:
    """Check a unit screw, and make its length 1 to rounding."""
    if not is_numeric(X):
        return X
    length = _length(X[:3]) or _length(X[3:])
    if not abs(length - 1) <= UNIT_TOLERANCE:
        raise JounceError(f"{label} = {X.tolist()} is not a unit screw (xi; eta): |xi| = 1, or xi = 0 and |eta| = 1")
    return X if abs(length - 1) <= UNIT_ROUNDING else X / length


def _length(v: np.ndarray) -> Any:
    """The length of a vector, without the product of BLAS that `numpy.linalg.norm` takes, as in `portable_product`."""
    return np.sqrt((v * v).sum())


def exact_inertia(M: np.ndarray, label: str) -> np.ndarray:
    """Check an inertia matrix, and make its form exact: one mass, one first moment, one symmetric tensor."""
    if not is_numeric(M):
        return M
    if error := inertia.form_error(M):
        raise JounceError(f"{label} {error}; an inertia matrix is [[Theta, m c~], [-m c~, m I]]")
    return inertia.restore_form(M)


def _check_drives(given: object, nb: int) -> Drives:
    """The drive trains of joint variables: those of another robot, or a mapping of arrays, one number for each."""
    stated = vars(given) if isinstance(given, Drives) else {} if given is None else given
    if not isinstance(stated, Mapping):
        raise JounceError(f"drives is of type {type(given).__name__}; expected a mapping of {', '.join(UNDRIVEN)}")
    for key in stated:
        check_choice("drive", key, UNDRIVEN)
    whole = {key: np.full(nb, value) for key, value in UNDRIVEN.items()}
    arrays = {key: _copy_data(array, key) for key, array in (whole | dict(stated)).items()}
    for key, array in arrays.items():
        if array.shape != (nb,) or not is_numeric(array):
            raise JounceError(f"drives: {key} has shape {array.shape}; expected numbers ({nb},), one per joint")
    for i in range(nb):
        if error := drive_error(**{key: array[i] for key, array in arrays.items()}):
            raise JounceError(f"drives of joint {i}: {error}")
    return Drives(**{key: array + 0.0 for key, array in arrays.items()})  # no -0.0 among data


def _check_parents(parent: Sequence[int] | None, nb: int) -> tuple[int, ...]:
    if parent is None:
        return tuple(range(-1, nb - 1))
    numbers = as_list(parent)
    if len(numbers) != nb:
        raise JounceError(f"parent is {quote_value(parent)}; expected {nb} indices, one for each body")
    for i, p in enumerate(numbers):
        if not is_finite(p) or p not in range(-1, i):
            earlier = f" or an earlier body, 0 .. {i - 1}" if i else ""
            raise JounceError(f"parent[{i}] = {quote_value(p)}; expected -1 (the ground){earlier}")
    return tuple(map(int, numbers))


def _check_text(name: object, label: str) -> str:
    if not isinstance(name, str):
        raise JounceError(f"{label} is {quote_value(name)}; expected a text")
    return name


def _check_names(given: Sequence[str] | None, count: int, label: str, stem: str) -> tuple[str, ...]:
    if given is None:
        return tuple(f"{stem}{i + 1}" for i in range(count))
    names = as_list(given)
    texts = not isinstance(given, str) and all(isinstance(x, str) for x in names)
    if not texts or not len(names) == len(set(names)) == count:
        raise JounceError(f"{label} is {quote_value(given)}; expected {count} different texts")
    return tuple(names)


# Denavit-Hartenberg tables.
def from_dh(
    table: Any,
    M: Array,
    convention: str,
    *,
    types: Sequence[str] | None = None,
    degrees: bool = False,
    base: Array | None = None,
    tool: Array | None = None,
    **data: Any,
) -> Mechanism:
    """A mechanism from a table, every entry checked; see `Robot.from_dh` for what they are."""
    check_choice("Denavit-Hartenberg convention", convention, CONVENTIONS)
    check_bool("degrees", degrees, "the unit of alpha and theta")
    rows = _read_rows(table, types)
    if not degrees:
        _warn_of_degrees(rows)
    moved = [_standard_row(*row, degrees) if convention == "standard" else _modified_row(*row, degrees) for row in rows]
    B, X = ([pair[k] for pair in moved] for k in (0, 1))
    if base is not None:
        B[0] = _check_pose(base, "base") @ B[0]
    built = from_screws(np.stack(B), np.stack(X), M, **data)
    if tool is None:
        return built
    if TOOL in built.bodies:
        raise JounceError(f"a body is named {TOOL!r} like the frame of tool=; rename the body")
    return replace(built, frames=(Frame(TOOL, built.nb - 1, _check_pose(tool, "tool")),))


def _standard_row(row: Array, kind: str, degrees: bool) -> tuple[Array, Array]:
    """B and X: the axis, z of the frame before, seen from the frame at the end of the link."""
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
    """B and X: the axis is z of the frame itself."""
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
    """Cosine and sine; those of right angles exact, so that zeros of an arm are zeros."""
    if isinstance(angle, int | float):
        right = 90 if degrees else np.pi / 2
        quarters = round(angle / right)
        if quarters * right == angle:
            return ((1, 0), (0, 1), (-1, 0), (0, -1))[quarters % 4]
    x = np.array([angle * (np.pi / 180) if degrees else angle])
    return scalars.cos(x)[0], scalars.sin(x)[0]


def _to_array(entries: list[Any]) -> Array:
    """Numbers, or an object array where a symbol is among them."""
    row = np.array(entries, dtype=object)
    return row.astype(float) if all(isinstance(x, int | float) for x in row.flat) else row


def _read_rows(table: Any, types: Sequence[str] | None) -> list[Row]:
    rows = as_list(table) if isinstance(table, Sequence | np.ndarray) and not isinstance(table, str) else []
    if not rows:
        raise JounceError(f"table is {quote_value(table)}; expected rows of {', '.join(DH_PARAMETERS)}")
    named = [isinstance(row, Mapping) for row in rows]
    if types is None:
        kinds = [row.get("type", TYPES[0]) if isinstance(row, Mapping) else TYPES[0] for row in rows]
    elif any(named):
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
    """a, alpha, d and theta of a row, which are numbers in this order or have these names."""
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
    array = asarray(T, label)
    if array.shape != (4, 4):
        raise JounceError(f"{label} has shape {array.shape}; expected a pose (4, 4)")
    return exact_pose(array, label)


def check_size(bodies: int) -> None:
    """Raise `JounceError` where a robot would have more bodies on movable joints than are allowed."""
    stated = os.environ.get(VARIABLE) or str(MAX_BODIES)
    if not (stated.isascii() and stated.isdigit()):
        raise JounceError(f"{VARIABLE}={quote_value(stated)}; expected the largest number of bodies")
    if bodies > int(stated):
        why = f"a mass matrix would take {8e-9 * bodies**2:.2g} GB; the environment variable {VARIABLE} raises this"
        raise JounceError(f"{bodies} movable joints; expected up to {stated}: {why}")
