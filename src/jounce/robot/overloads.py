"""The rule of results for type checkers: an array, or with further rates of q a tuple; a protocol for each group of
methods that take the same arguments.
"""

from collections.abc import Callable
from typing import Any, Protocol, TypedDict, TypeVar, Unpack, overload

from jounce._scalars import Array

P = TypeVar("P")
P_co = TypeVar("P_co", covariant=True)


class MethodOf(Protocol[P_co]):
    """A method that is called as a protocol says."""

    def __get__(self, instance: Any, owner: Any = None) -> P_co: ...


def typed(protocol: type[P]) -> Callable[[Callable[..., Any]], MethodOf[P]]:
    """Give a method the overloads of a protocol; nothing changes when it runs."""
    return lambda method: method


class Options(TypedDict, total=False):
    """Keywords that all quantities share: see `Robot`."""

    method: str | None
    out: Any
    threads: int


class _Form(Options, total=False):
    form: str


class _Wrench(Options, total=False):
    wrench: Any


class _Body(Options, total=False):
    body: str | None


class _Frame(_Body, total=False):
    frame: str


class OfPosition(Protocol):
    """Of q: M, Qgrav, U."""

    @overload
    def __call__(self, q: Array, **options: Unpack[Options]) -> Array: ...
    @overload
    def __call__(self, q: Array, qd: Array, *higher: Array, **options: Unpack[Options]) -> tuple[Array, ...]: ...


class PosesOfBodies(Protocol):
    """Of q and a body."""

    @overload
    def __call__(self, q: Array, **options: Unpack[_Body]) -> Array: ...
    @overload
    def __call__(self, q: Array, qd: Array, *higher: Array, **options: Unpack[_Body]) -> tuple[Array, ...]: ...


class JacobiansOfBodies(Protocol):
    """Of q, a body and a frame."""

    @overload
    def __call__(self, q: Array, **options: Unpack[_Frame]) -> Array: ...
    @overload
    def __call__(self, q: Array, qd: Array, *higher: Array, **options: Unpack[_Frame]) -> tuple[Array, ...]: ...


class OfVelocity(Protocol):
    """Of q and qd: h, p, T."""

    @overload
    def __call__(self, q: Array, qd: Array, **options: Unpack[Options]) -> Array: ...
    @overload
    def __call__(
        self, q: Array, qd: Array, q2d: Array, *higher: Array, **options: Unpack[Options]
    ) -> tuple[Array, ...]: ...


class CoriolisMatrix(Protocol):
    """Of q and qd, in one of two forms."""

    @overload
    def __call__(self, q: Array, qd: Array, **options: Unpack[_Form]) -> Array: ...
    @overload
    def __call__(
        self, q: Array, qd: Array, q2d: Array, *higher: Array, **options: Unpack[_Form]
    ) -> tuple[Array, ...]: ...


class TwistsOfBodies(Protocol):
    """Of q, qd, a body and a frame."""

    @overload
    def __call__(self, q: Array, qd: Array, **options: Unpack[_Frame]) -> Array: ...
    @overload
    def __call__(
        self, q: Array, qd: Array, q2d: Array, *higher: Array, **options: Unpack[_Frame]
    ) -> tuple[Array, ...]: ...


class OfAcceleration(Protocol):
    """Of q, qd, q2d and wrenches: Q, F."""

    @overload
    def __call__(self, q: Array, qd: Array, q2d: Array, **options: Unpack[_Wrench]) -> Array: ...
    @overload
    def __call__(
        self, q: Array, qd: Array, q2d: Array, q3d: Array, *higher: Array, **options: Unpack[_Wrench]
    ) -> tuple[Array, ...]: ...


class DriveForces(Protocol):
    """Of q, qd, q2d and drive terms."""

    @overload
    def __call__(self, q: Array, qd: Array, q2d: Array, *, terms: Any = True, out: Any = None) -> Array: ...
    @overload
    def __call__(
        self, q: Array, qd: Array, q2d: Array, q3d: Array, *higher: Array, terms: Any = True, out: Any = None
    ) -> tuple[Array, ...]: ...


class WrenchOfLoad(Protocol):
    """Of q and a load."""

    @overload
    def __call__(
        self, q: Array, *, body: str, force: Any = None, torque: Any = None, frame: str = "world", point: Any = None
    ) -> Array: ...
    @overload
    def __call__(
        self,
        q: Array,
        qd: Array,
        *higher: Array,
        body: str,
        force: Any = None,
        torque: Any = None,
        frame: str = "world",
        point: Any = None,
    ) -> tuple[Array, ...]: ...
