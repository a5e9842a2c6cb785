"""Types of arguments and results, as signatures show them.

Arguments may be numbers and symbols, arrays of any library that have a shape, and nested
lists. Strings are excluded. Results are typed as arrays of NumPy with any scalars, since they have the scalar type
of what is given: float64 of floats, objects of symbols, and arrays of JAX of such.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Literal, Never, Protocol, TypeAlias, TypedDict, TypeVar

import numpy as np
from numpy.typing import NDArray

T_co = TypeVar("T_co", covariant=True)


class Scalar(Protocol):
    """A number, a symbol, or an array of them."""

    def __neg__(self) -> Any: ...


class Shaped(Protocol):
    """An array, matrix, series or data frame of any library."""

    @property
    def shape(self) -> Any:
        """The lengths of its axes."""
        ...


class Nested(Protocol[T_co]):
    """A list or tuple. A string is excluded: its `__contains__` takes strings only."""

    def __len__(self) -> int: ...
    def __getitem__(self, index: int, /) -> T_co: ...
    def __contains__(self, x: object, /) -> bool: ...
    def __iter__(self) -> Iterator[T_co]: ...
    def __reversed__(self) -> Iterator[T_co]: ...


class Nothing(Protocol[T_co]):
    """As `Nothing[Never]` a type that nothing has.

    Where an argument fits no overload, mypy lists them all; if its parameter has a generic type too that might fit, as
    this one for all that mypy knows then, it names the argument in one line.
    """

    def __sizeof__(self) -> T_co: ...  # type: ignore[override]


ArrayLike: TypeAlias = Scalar | Shaped | Nested["ArrayLike"] | Nothing[Never]  # recursive: checkers print its name
Named: TypeAlias = ArrayLike | Mapping[str, ArrayLike]  # by joint, or by body
Rates: TypeAlias = Named | tuple[Named, ...]  # a quantity, or a tuple of it and its rates

JsonObject: TypeAlias = dict[str, Any]  # what JSON, plotly.js or a template takes, made where it is written

Array: TypeAlias = NDArray[Any]
Floats: TypeAlias = NDArray[np.float64]
Results: TypeAlias = Array | tuple[Array, ...]  # a quantity, or a tuple of it and its rates; overloads say how many
Out: TypeAlias = Array | tuple[Array, ...] | list[Array] | None

Angles: TypeAlias = Literal["rad", "deg"]
Base: TypeAlias = Literal["fixed", "floating"]
Convention: TypeAlias = Literal["standard", "modified"]
DriveTerm: TypeAlias = Literal["armature", "damping", "friction", "stribeck", "spring", "offset", "load_friction"]
DriveTerms: TypeAlias = bool | DriveTerm | Iterable[DriveTerm]
Form: TypeAlias = Literal["paper", "skew"]
Frame: TypeAlias = Literal["body", "world", "spatial"]
LimitValues: TypeAlias = ArrayLike | Mapping[str, ArrayLike] | None
Coupling: TypeAlias = Literal["spong"] | int
Library: TypeAlias = Literal["pinocchio", "mujoco"]
LoadFrame: TypeAlias = Literal["world", "body"]
JointType: TypeAlias = Literal["revolute", "prismatic"]
Language: TypeAlias = Literal["c", "casadi", "cpp", "cuda", "javascript", "julia", "latex", "matlab", "python", "rust"]
Method: TypeAlias = Literal["kernel", "recursion", "closed_form", "paper"]
Product: TypeAlias = Literal["vjp", "jvp", "hvp", "jjvp", "hessian"]
RowKind: TypeAlias = Literal["samples", "commands"]
TimeUnit: TypeAlias = Literal["s", "ms", "us", "ns"]
OnError: TypeAlias = Literal["stop", "skip"]


class Planar2R(TypedDict, total=False):
    """The parameters of the planar 2R."""

    L1: Scalar
    L2: Scalar
    m1: Scalar
    m2: Scalar
    g: Scalar
