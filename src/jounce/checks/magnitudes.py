"""Magnitudes: the sizes of the terms summed in a quantity and its rates.

They are nonzero where the quantity itself cancels. Rounding errors are proportional to magnitudes: a force that is zero
in exact arithmetic comes out as noise of some 1e-16 of its magnitude. Magnitudes are roots of sums of squares, the
sizes of sums of independent terms; sums of absolute values would outgrow the results with every body and every order.

No equation is written for magnitudes. The laws of the quantities run on arrays of another kind (`_Sized`), which hold
the square of the magnitude of every entry along with its value: sums and differences add squares, products multiply
them. Squares of the entries of a rotation add up to 1 in every row and column, so magnitudes do not grow from frame to
frame.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from jounce.core.scalars import Array
from jounce.dynamics import elastic, joint_springs
from jounce.dynamics.computation import Computation
from jounce.dynamics.partials import second_acceleration_partials
from jounce.dynamics.quantities import DEFAULT_QUANTITY, QUANTITIES
from jounce.engine import generic_methods
from jounce.model.mechanism import Mechanism
from jounce.model.series_functions import inverse
from jounce.model.springs import Spring, force_along
from jounce.spatial import groups
from jounce.spatial.linear import factor
from jounce.spatial.series import Series

_COMPARED_METHODS = ("closed_form", "recursion")  # in the body frames as given, and in those on the joint axes


def magnitudes(mechanism: Mechanism, computation: Computation, arrays: Sequence[Array]) -> tuple[np.ndarray, ...]:
    """Return the magnitudes of a quantity and its rates.

    The arrays are q, qd, ..., W, Wd, .... The magnitudes are the larger ones by two methods, the closed form and the
    recursion. Magnitudes of accelerations are those that the magnitudes of the forces cause.
    """
    if computation.quantity.takes.motors:
        return _motor_magnitudes(mechanism, computation, arrays)
    return _RULES.get(computation.name, _law_magnitudes)(mechanism, computation, arrays)


def _law_magnitudes(mechanism: Mechanism, computation: Computation, arrays: Sequence[Array]) -> tuple[np.ndarray, ...]:
    """Return the larger magnitudes by the closed form and the recursion."""
    by_method = [
        generic_methods.compute_by_method(
            computation, method, mechanism, [_Sized(np.asarray(x, dtype=float)) for x in arrays]
        )
        for method in _COMPARED_METHODS
        if method in computation.quantity.laws
    ]
    return tuple(np.sqrt(np.max([x.square for x in terms], axis=0)) for terms in zip(*by_method, strict=True))


def _acceleration_magnitudes(
    mechanism: Mechanism, computation: Computation, arrays: Sequence[Array]
) -> tuple[np.ndarray, ...]:
    """Return the magnitudes of accelerations, from those of the forces."""
    arrays_with_accelerations = _with_accelerations(mechanism, computation, arrays)
    forces = magnitudes(mechanism, replace(computation, name=DEFAULT_QUANTITY.name), arrays_with_accelerations)
    # q2d = M^-1 Q: squares of M^-1 times squares of the magnitudes of Q.
    squares = _square_inverse(mechanism, arrays)
    return tuple(np.sqrt((squares @ np.square(Q)[..., None])[..., 0]) for Q in forces)


def _forward_partial_magnitudes(
    mechanism: Mechanism, computation: Computation, arrays: Sequence[Array]
) -> tuple[np.ndarray, ...]:
    """Return the magnitudes of the partials of accelerations."""
    arrays_with_accelerations = _with_accelerations(mechanism, computation, arrays)
    (P,) = magnitudes(mechanism, replace(computation, name="inverse_dynamics_partials"), arrays_with_accelerations)
    squares = _square_inverse(mechanism, arrays)[..., None, :, :]
    # dq2d/dq = -M^-1 dQ/dq, likewise by qd; by Q it is M^-1 = M^-1 M M^-1. (..., 3, n, n)
    partials_by = squares @ np.square(P)
    return tuple(
        np.sqrt(x)
        for x in (
            partials_by[..., 0, :, :],
            partials_by[..., 1, :, :],
            (partials_by[..., 2:, :, :] @ squares)[..., 0, :, :],
        )
    )


def _second_partial_magnitudes(
    mechanism: Mechanism, computation: Computation, arrays: Sequence[Array]
) -> tuple[np.ndarray, ...]:
    """Return the magnitudes of the second partials of forces.

    Only the recursion computes them, and its base parameters may vanish. They are hence at least those of the first
    partials, since a derivative by an angle keeps the sizes of terms.
    """
    (P,) = magnitudes(mechanism, replace(computation, name="inverse_dynamics_partials"), arrays)
    tensors = _law_magnitudes(mechanism, computation, arrays)
    return tuple(np.maximum(x, P[..., k, :, None, :]) for x, k in zip(tensors, (0, 1, 2, 2), strict=True))


def _second_forward_magnitudes(
    mechanism: Mechanism, computation: Computation, arrays: Sequence[Array]
) -> tuple[np.ndarray, ...]:
    """Return the magnitudes of the second partials of accelerations."""
    arrays_with_accelerations = _with_accelerations(mechanism, computation, arrays)
    force_partials = magnitudes(
        mechanism, replace(computation, name="inverse_dynamics_second_partials"), arrays_with_accelerations
    )
    first_partials = _forward_partial_magnitudes(
        mechanism, replace(computation, name="forward_dynamics_partials"), arrays
    )
    squares = ([np.square(x) for x in terms] for terms in (first_partials, force_partials))
    return tuple(np.sqrt(-x) for x in second_acceleration_partials(*squares))


_RULES = {
    "inverse_dynamics_second_partials": _second_partial_magnitudes,
    "forward_dynamics": _acceleration_magnitudes,
    "forward_dynamics_partials": _forward_partial_magnitudes,
    "forward_dynamics_second_partials": _second_forward_magnitudes,
}


def _motor_magnitudes(
    mechanism: Mechanism, computation: Computation, arrays: Sequence[Array]
) -> tuple[np.ndarray, ...]:
    """Return the magnitudes of motor torques, or of elastic forward dynamics."""
    # Forces of springs are differences of positions that are much larger.
    x, sized = (
        computation.state(mechanism, input_arrays) for input_arrays in (arrays, [_make_sized(x) for x in arrays])
    )
    plant, count = elastic.with_rigid_rotors(mechanism), computation.rates
    Q, phi, drive = elastic.plant_forces(mechanism, sized.q, sized.motors, sized.motors[2])
    # A single result is that of motor torques: those along the accelerations that the springs cause.
    if len(computation.quantity.gives.results) == 1:
        x = replace(x, Q=elastic.spring_forces(mechanism, x.q, x.motors))
        accelerations = QUANTITIES["forward_dynamics"].law("recursion", mechanism)(mechanism, x).upto(1)
        arrays_with_accelerations = [*arrays[:2], *accelerations, *arrays[count - 1 :]]
        (tau,) = magnitudes(mechanism, replace(computation, name="motor_torques"), arrays_with_accelerations)
        return (np.sqrt(tau**2 + phi.square[..., 0]),)
    # Two results are the accelerations of links, from M^-1, and of motors.
    q2d, _ = generic_methods.compute_by_method(computation, "recursion", mechanism, arrays)
    (forces,) = magnitudes(plant, replace(computation, name=DEFAULT_QUANTITY.name), [*arrays[:2], q2d, *arrays[count:]])
    squares = _square_inverse(plant, arrays) @ (forces[..., None] ** 2 + Q.square)
    theta2d = elastic.rotor_accelerations(mechanism, _Sized(q2d[..., None], squares), drive - phi)
    return np.sqrt(squares[..., 0]), np.sqrt(theta2d.square[..., 0])


def _with_accelerations(mechanism: Mechanism, computation: Computation, arrays: Sequence[Array]) -> list[Array]:
    """Return the arrays of inverse dynamics from those of forward dynamics.

    Accelerations take the place of forces; those of a floating base follow the twist of the base.
    """
    accelerations = generic_methods.compute_by_method(
        replace(computation, name="forward_dynamics"), "recursion", mechanism, arrays
    )
    coordinate_count, base_count = computation.quantity.takes.coordinates(computation.rates), mechanism.nv - mechanism.n
    base_accelerations = [x[..., :base_count] for x in accelerations] if base_count else []
    loads, dependent = _split_dependent(mechanism, arrays[computation.rates :])
    return [
        *arrays[:coordinate_count],
        *(x[..., base_count:] for x in accelerations),
        *loads,
        *base_accelerations,
        *dependent,
    ]


def _split_dependent(mechanism: Mechanism, arrays: Sequence[Array]) -> tuple[Sequence[Array], Sequence[Array]]:
    """Split off the dependent coordinates of a closed robot.

    They are the last array, if there are any.
    """
    return (arrays[:-1], arrays[-1:]) if mechanism.takes_dependent else (arrays, [])


def _square_inverse(mechanism: Mechanism, arrays: Sequence[Array]) -> np.ndarray:
    """Return the squares of the entries of M^-1."""
    positions_of_robot = [arrays[0], *_split_dependent(mechanism, arrays)[1]]
    (M,) = generic_methods.compute_by_method(Computation("mass_matrix", 0), "recursion", mechanism, positions_of_robot)
    return np.square(np.linalg.inv(M.astype(float)))


def scale(expected: Array, magnitude: np.ndarray) -> float:
    """Return the scale of relative errors of an array: its largest entry or magnitude; 1 if all terms are zero."""
    return float(max(np.abs(expected).max(), magnitude.max())) or 1.0


class _Sized:
    """An array with the squares of its magnitudes, as laws need it."""

    __slots__ = ("square", "value")
    __array_ufunc__ = None  # `array @ sized` calls our __rmatmul__, not NumPy's ufunc

    def __init__(self, value: np.ndarray, square: np.ndarray | None = None) -> None:
        self.value, self.square = value, np.square(value) if square is None else square

    def __array_namespace__(self, **_: Any) -> SimpleNamespace:
        return _SIZED_NAMESPACE

    @property
    def shape(self) -> tuple[int, ...]:
        return self.value.shape

    @property
    def ndim(self) -> int:
        return self.value.ndim

    @property
    def mT(self) -> "_Sized":
        return self.map(lambda x: x.mT)

    def map(self, rearrange: Callable[[np.ndarray], np.ndarray]) -> "_Sized":
        """Rearrange the entries, or add some of them up."""
        return _Sized(rearrange(self.value), rearrange(self.square))

    def reshape(self, shape: Sequence[int]) -> "_Sized":
        return self.map(lambda x: x.reshape(shape))

    def swapaxes(self, i: int, j: int) -> "_Sized":
        return self.map(lambda x: x.swapaxes(i, j))

    def sum(self, axis: int) -> "_Sized":
        return self.map(lambda x: x.sum(axis=axis))

    def __getitem__(self, index: Any) -> "_Sized":
        return self.map(lambda x: x[index])

    def __neg__(self) -> "_Sized":
        return _Sized(-self.value, self.square)

    def __add__(self, other: Any) -> "_Sized":
        y = _make_sized(other)
        return _Sized(self.value + y.value, self.square + y.square)

    def __sub__(self, other: Any) -> "_Sized":
        return self + -_make_sized(other)

    def __rsub__(self, other: Any) -> "_Sized":
        return _make_sized(other) + -self

    def __mul__(self, other: Any) -> "_Sized":
        y = _make_sized(other)
        return _Sized(self.value * y.value, self.square * y.square)

    def __matmul__(self, other: Any) -> "_Sized":
        y = _make_sized(other)
        return _Sized(self.value @ y.value, self.square @ y.square)

    def __rmatmul__(self, other: Any) -> "_Sized":
        return _make_sized(other) @ self

    def __rtruediv__(self, other: int) -> "_Sized":
        return _Sized(other / self.value, self.square * (other / self.value**2) ** 2)

    __radd__, __rmul__ = __add__, __mul__


class _SizedSolver:
    """Solves A X = b for arrays with magnitudes.

    The error of X is A^-1 times the errors of b and of A X; the steps of the elimination add nothing to it.
    """

    def __init__(self, A: _Sized) -> None:
        self.A, self.inverse = A, np.linalg.inv(A.value)

    def solve(self, b: Any) -> _Sized:
        right_side = _make_sized(b)
        X = self.inverse @ right_side.value
        return _Sized(X, np.square(self.inverse) @ (right_side.square + self.A.square @ np.square(X)))


factor.register(_Sized, _SizedSolver)


@joint_springs.solve_deflection.register
def _(force: _Sized, spring: Spring, Q: Series, largest: float) -> Series:
    """Solve phi(delta) = Q for deflections with magnitudes and all rates.

    A small change P of Q changes delta by P / phi'(delta). The steps that lead to a solution add no terms, since later
    steps correct the rounding of earlier ones.
    """
    delta = joint_springs.deflect_spring(spring, Q.map(lambda x: x.value), largest)
    compliance = inverse(force_along(spring, delta, 1)).map(_make_sized)
    changes = compliance * Q
    return Series(lambda k: _Sized(delta[k], np.maximum(changes[k].square, np.square(delta[k]))))


@groups.rotation_from_quaternion.register
def _(p: _Sized) -> _Sized:
    return _Sized(groups.rotation_from_quaternion(p.value))


@groups.rotation_from_angle.register
def _(p: _Sized) -> _Sized:
    return _Sized(groups.rotation_from_angle(p.value))


def _make_sized(x: Any) -> _Sized:
    return x if isinstance(x, _Sized) else _Sized(np.asarray(x, dtype=float))


def _concatenate(arrays: Sequence[Any], axis: int) -> _Sized:
    parts = [_make_sized(x) for x in arrays]
    return _Sized(np.concatenate([x.value for x in parts], axis), np.concatenate([x.square for x in parts], axis))


_SIZED_NAMESPACE = SimpleNamespace(
    broadcast_to=lambda x, shape: _make_sized(x).map(lambda a: np.broadcast_to(a, shape)),
    concatenate=_concatenate,
    zeros_like=lambda x: x.map(np.zeros_like),
    sin=lambda x: _Sized(np.sin(x.value)),
    cos=lambda x: _Sized(np.cos(x.value)),
    sqrt=lambda x: _Sized(np.sqrt(x.value)),
    tanh=lambda x: _Sized(np.tanh(x.value)),
    exp=lambda x: _Sized(np.exp(x.value)),
)
