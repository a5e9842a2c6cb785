"""Magnitudes: the sizes of the terms summed in a quantity and its rates, nonzero where the quantity itself cancels.

Rounding errors are in proportion to them: a force that is zero in exact arithmetic comes out as noise of some 1e-16 of
its magnitude. Magnitudes are roots of sums of squares, the sizes of sums of independent terms: sums of absolute values
outgrow the results with every body and every order.

No equation is written for them. The laws of the quantities run on arrays of another kind, which hold the square of the
magnitude of every entry along with its value: sums and differences add squares, products multiply them. Squares of the
entries of a rotation add up to 1 in every row and column, hence magnitudes do not grow from frame to frame.
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
    """The magnitudes of the entries of a quantity and of its rates, from q, qd, ..., W, Wd, ....

    The larger ones of two, by the closed form and by the recursion. Those of accelerations are what the magnitudes of
    the forces cause.
    """
    if computation.quantity.takes.motors:
        return _motor_magnitudes(mechanism, computation, arrays)
    return _RULES.get(computation.name, _law_magnitudes)(mechanism, computation, arrays)


def _law_magnitudes(mechanism: Mechanism, computation: Computation, arrays: Sequence[Array]) -> tuple[np.ndarray, ...]:
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
    moving = _with_accelerations(mechanism, computation, arrays)
    forces = magnitudes(mechanism, replace(computation, name=DEFAULT_QUANTITY.name), moving)
    squares = _square_inverse(mechanism, arrays)
    return tuple(np.sqrt((squares @ np.square(Q)[..., None])[..., 0]) for Q in forces)


def _forward_partial_magnitudes(
    mechanism: Mechanism, computation: Computation, arrays: Sequence[Array]
) -> tuple[np.ndarray, ...]:
    moving = _with_accelerations(mechanism, computation, arrays)
    (P,) = magnitudes(mechanism, replace(computation, name="inverse_dynamics_partials"), moving)
    squares = _square_inverse(mechanism, arrays)[..., None, :, :]
    by = squares @ np.square(P)
    return tuple(np.sqrt(x) for x in (by[..., 0, :, :], by[..., 1, :, :], (by[..., 2:, :, :] @ squares)[..., 0, :, :]))


def _second_partial_magnitudes(
    mechanism: Mechanism, computation: Computation, arrays: Sequence[Array]
) -> tuple[np.ndarray, ...]:
    """Tensors have the recursion alone, whose base parameters may vanish: no less than the first partials.

    A derivative by an angle leaves the sizes of terms.
    """
    (P,) = magnitudes(mechanism, replace(computation, name="inverse_dynamics_partials"), arrays)
    tensors = _law_magnitudes(mechanism, computation, arrays)
    return tuple(np.maximum(x, P[..., k, :, None, :]) for x, k in zip(tensors, (0, 1, 2, 2), strict=True))


def _second_forward_magnitudes(
    mechanism: Mechanism, computation: Computation, arrays: Sequence[Array]
) -> tuple[np.ndarray, ...]:
    moving = _with_accelerations(mechanism, computation, arrays)
    of_forces = magnitudes(mechanism, replace(computation, name="inverse_dynamics_second_partials"), moving)
    first = _forward_partial_magnitudes(mechanism, replace(computation, name="forward_dynamics_partials"), arrays)
    squares = ([np.square(x) for x in terms] for terms in (first, of_forces))
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
    """What the state of motors causes: the forces of springs are differences of positions many times as large."""
    x, sized = (computation.state(mechanism, given) for given in (arrays, [_make_sized(x) for x in arrays]))
    plant, count = elastic.with_rigid_rotors(mechanism), computation.rates
    Q, phi, drive = elastic.plant_forces(mechanism, sized.q, sized.motors, sized.motors[2])
    if len(computation.quantity.gives.results) == 1:  # the torques of motors
        x = replace(x, Q=elastic.spring_forces(mechanism, x.q, x.motors))
        found = QUANTITIES["forward_dynamics"].law("recursion", mechanism)(mechanism, x).upto(1)
        moving = [*arrays[:2], *found, *arrays[count - 1 :]]
        (tau,) = magnitudes(mechanism, replace(computation, name="motor_torques"), moving)
        return (np.sqrt(tau**2 + phi.square[..., 0]),)
    q2d, _ = generic_methods.compute_by_method(computation, "recursion", mechanism, arrays)
    (forces,) = magnitudes(plant, replace(computation, name=DEFAULT_QUANTITY.name), [*arrays[:2], q2d, *arrays[count:]])
    squares = _square_inverse(plant, arrays) @ (forces[..., None] ** 2 + Q.square)
    theta2d = elastic.rotor_accelerations(mechanism, _Sized(q2d[..., None], squares), drive - phi)
    return np.sqrt(squares[..., 0]), np.sqrt(theta2d.square[..., 0])


def _with_accelerations(mechanism: Mechanism, computation: Computation, arrays: Sequence[Array]) -> list[Array]:
    """The arrays that forces take, from those of forward dynamics: accelerations in the place of forces.

    Those of a floating base follow the twist of the base.
    """
    found = generic_methods.compute_by_method(
        replace(computation, name="forward_dynamics"), "recursion", mechanism, arrays
    )
    own, first = computation.quantity.takes.coordinates(computation.rates), mechanism.nv - mechanism.n
    of_base = [x[..., :first] for x in found] if first else []
    loads, dependent = _split_dependent(mechanism, arrays[computation.rates :])
    return [*arrays[:own], *(x[..., first:] for x in found), *loads, *of_base, *dependent]


def _split_dependent(mechanism: Mechanism, arrays: Sequence[Array]) -> tuple[Sequence[Array], Sequence[Array]]:
    """The arrays without the last one of a closed robot, its dependent coordinates, and this one."""
    return (arrays[:-1], arrays[-1:]) if mechanism.takes_dependent else (arrays, [])


def _square_inverse(mechanism: Mechanism, arrays: Sequence[Array]) -> np.ndarray:
    """The squares of the entries of M^-1."""
    at = [arrays[0], *_split_dependent(mechanism, arrays)[1]]
    (M,) = generic_methods.compute_by_method(Computation("mass_matrix", 0), "recursion", mechanism, at)
    return np.square(np.linalg.inv(M.astype(float)))


def scale(expected: Array, magnitude: np.ndarray) -> float:
    """Return the scale of relative errors of an array: its largest entry or magnitude; 1 if all terms are zero."""
    return float(max(np.abs(expected).max(), magnitude.max())) or 1.0


class _Sized:
    """An array of numbers with the squares of their magnitudes, as far as laws need one."""

    __slots__ = ("square", "value")
    __array_ufunc__ = None  # array @ _Sized is ours, not NumPy's

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
        """The entries elsewhere, or added up."""
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
    """A X = b is off by A^-1 of what b and A X are off by, whatever the steps of the elimination add up."""

    def __init__(self, A: _Sized) -> None:
        self.A, self.inverse = A, np.linalg.inv(A.value)

    def solve(self, b: Any) -> _Sized:
        given = _make_sized(b)
        X = self.inverse @ given.value
        return _Sized(X, np.square(self.inverse) @ (given.square + self.A.square @ np.square(X)))


factor.register(_Sized, _SizedSolver)


@joint_springs.solve_deflection.register
def _(force: _Sized, spring: Spring, Q: Series, largest: float) -> Series:
    """Solutions of phi(delta) = Q: of small changes P of Q, delta changes by P / phi'(delta), with all rates.

    The steps that lead to a solution add no terms, since later ones correct what earlier ones round.
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
