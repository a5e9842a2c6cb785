"""Overloads for type checkers: a method returns an array, or with further rates of q a tuple. There is one protocol for
each group of methods with the same arguments.

Up to order 2 the number of results is known. The last overload of each is for higher orders, and for calls whose number
of rates only the program knows: ``robot.mass_matrix(*rates)``.
"""

from collections.abc import Callable
from typing import Any, Literal, Protocol, TypedDict, TypeVar, Unpack, overload

from jounce.core.typing import (
    Array,
    ArrayLike,
    DriveColumns,
    DriveTerms,
    Floats,
    Form,
    Frame,
    LoadFrame,
    Method,
    Named,
    Out,
    Product,
    QuantityName,
    Rates,
    Side,
)
from jounce.native.kernel import Kernel

P = TypeVar("P")
P_co = TypeVar("P_co", covariant=True)
R_co = TypeVar("R_co", covariant=True)  # a result: an array; of energies anything, a number where q is one state


class MethodOf(Protocol[P_co]):
    """A method that is called as a protocol says."""

    def __get__(self, instance: Any, owner: Any = None) -> P_co: ...


def typed(protocol: type[P]) -> Callable[[Callable[..., Any]], MethodOf[P]]:
    """Give a method the overloads of a protocol; nothing changes at run time."""
    return lambda method: method


class Options(TypedDict, total=False):
    """Keywords that all quantities share: see `Robot`."""

    base: Rates | None
    method: Method | None
    out: Out
    threads: int


class _Form(Options, total=False):
    form: Form


class _Wrench(Options, total=False):
    wrench: Rates | None
    side: Side | None


class _Drives(Options, total=False):
    drives: DriveColumns


class _Motors(Options, total=False):
    wrench: Rates | None
    stiffness: Rates | None


class _Place(TypedDict, total=False):
    body: str | None
    frame: Frame


class _Compiled(_Place, total=False):
    moving_base: bool


class _Body(Options, total=False):
    body: str | None


class _Frame(Options, _Place, total=False):
    pass


class _Terms(TypedDict, total=False):
    terms: DriveTerms
    out: Out


class _Load(TypedDict, total=False):
    base: Rates | None
    force: ArrayLike | None
    torque: ArrayLike | None
    frame: LoadFrame
    point: ArrayLike | None


class OfPosition(Protocol[R_co]):
    """Methods that take q: M, Qgrav, U."""

    @overload
    def __call__(self, q: Named, **options: Unpack[Options]) -> R_co: ...
    @overload
    def __call__(self, q: Named, qd: Named, **options: Unpack[Options]) -> tuple[R_co, R_co]: ...
    @overload
    def __call__(self, q: Named, qd: Named, q2d: Named, **options: Unpack[Options]) -> tuple[R_co, R_co, R_co]: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, /, *higher: Named, **options: Unpack[Options]
    ) -> tuple[R_co, ...]: ...


class PosesOfBodies(Protocol):
    """Methods that take q and a body."""

    @overload
    def __call__(self, q: Named, **options: Unpack[_Body]) -> Array: ...
    @overload
    def __call__(self, q: Named, qd: Named, **options: Unpack[_Body]) -> tuple[Array, Array]: ...
    @overload
    def __call__(self, q: Named, qd: Named, q2d: Named, **options: Unpack[_Body]) -> tuple[Array, Array, Array]: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, /, *higher: Named, **options: Unpack[_Body]
    ) -> tuple[Array, ...]: ...


class JacobiansOfBodies(Protocol):
    """Methods that take q, a body and a frame."""

    @overload
    def __call__(self, q: Named, **options: Unpack[_Frame]) -> Array: ...
    @overload
    def __call__(self, q: Named, qd: Named, **options: Unpack[_Frame]) -> tuple[Array, Array]: ...
    @overload
    def __call__(self, q: Named, qd: Named, q2d: Named, **options: Unpack[_Frame]) -> tuple[Array, Array, Array]: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, /, *higher: Named, **options: Unpack[_Frame]
    ) -> tuple[Array, ...]: ...


class OfVelocity(Protocol[R_co]):
    """Methods that take q and qd: h, p, T."""

    @overload
    def __call__(self, q: Named, qd: Named, **options: Unpack[Options]) -> R_co: ...
    @overload
    def __call__(self, q: Named, qd: Named, q2d: Named, **options: Unpack[Options]) -> tuple[R_co, R_co]: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, **options: Unpack[Options]
    ) -> tuple[R_co, R_co, R_co]: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, q4d: Named, /, *higher: Named, **options: Unpack[Options]
    ) -> tuple[R_co, ...]: ...


class CoriolisMatrix(Protocol):
    """The method that takes q and qd, and returns one of two forms."""

    @overload
    def __call__(self, q: Named, qd: Named, **options: Unpack[_Form]) -> Array: ...
    @overload
    def __call__(self, q: Named, qd: Named, q2d: Named, **options: Unpack[_Form]) -> tuple[Array, Array]: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, **options: Unpack[_Form]
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, q4d: Named, /, *higher: Named, **options: Unpack[_Form]
    ) -> tuple[Array, ...]: ...


class TwistsOfBodies(Protocol):
    """Methods that take q, qd, a body and a frame."""

    @overload
    def __call__(self, q: Named, qd: Named, **options: Unpack[_Frame]) -> Array: ...
    @overload
    def __call__(self, q: Named, qd: Named, q2d: Named, **options: Unpack[_Frame]) -> tuple[Array, Array]: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, **options: Unpack[_Frame]
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, q4d: Named, /, *higher: Named, **options: Unpack[_Frame]
    ) -> tuple[Array, ...]: ...


class OfAcceleration(Protocol):
    """Methods that take q, qd, q2d and wrenches: Q, F."""

    @overload
    def __call__(self, q: Named, qd: Named, q2d: Named, **options: Unpack[_Wrench]) -> Array: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, **options: Unpack[_Wrench]
    ) -> tuple[Array, Array]: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, q4d: Named, **options: Unpack[_Wrench]
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def __call__(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        /,
        *higher: Named,
        **options: Unpack[_Wrench],
    ) -> tuple[Array, ...]: ...


class Regressor(Protocol):
    """The method that takes q, qd, q2d, and appends columns of drive terms."""

    @overload
    def __call__(self, q: Named, qd: Named, q2d: Named, **options: Unpack[_Drives]) -> Array: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, **options: Unpack[_Drives]
    ) -> tuple[Array, Array]: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, q4d: Named, **options: Unpack[_Drives]
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def __call__(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        /,
        *higher: Named,
        **options: Unpack[_Drives],
    ) -> tuple[Array, ...]: ...


class OfVelocityRegressor(Protocol):
    """Methods that take q, qd, and append columns of drive terms: regressors of momentum and energy."""

    @overload
    def __call__(self, q: Named, qd: Named, **options: Unpack[_Drives]) -> Array: ...
    @overload
    def __call__(self, q: Named, qd: Named, q2d: Named, **options: Unpack[_Drives]) -> tuple[Array, Array]: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, **options: Unpack[_Drives]
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, q4d: Named, /, *higher: Named, **options: Unpack[_Drives]
    ) -> tuple[Array, ...]: ...


class OfMotorPositions(Protocol):
    """Methods that take q, qd, q2d, wrenches and stiffnesses: motor positions."""

    @overload
    def __call__(self, q: Named, qd: Named, q2d: Named, **options: Unpack[_Motors]) -> Array: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, **options: Unpack[_Motors]
    ) -> tuple[Array, Array]: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, q4d: Named, **options: Unpack[_Motors]
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def __call__(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        /,
        *higher: Named,
        **options: Unpack[_Motors],
    ) -> tuple[Array, ...]: ...


class OfSnap(Protocol):
    """Methods that take q to q4d and wrenches: motor torques."""

    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, q4d: Named, **options: Unpack[_Motors]
    ) -> Array: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, q4d: Named, q5d: Named, **options: Unpack[_Motors]
    ) -> tuple[Array, Array]: ...
    @overload
    def __call__(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        q6d: Named,
        /,
        *higher: Named,
        **options: Unpack[_Motors],
    ) -> tuple[Array, ...]: ...


class OfForces(Protocol):
    """Of q, qd, forces Q and wrenches: q2d."""

    @overload
    def __call__(self, q: Named, qd: Named, Q: Named, **options: Unpack[_Wrench]) -> Array: ...
    @overload
    def __call__(self, q: Named, qd: Named, Q: Named, Qd: Named, **options: Unpack[_Wrench]) -> tuple[Array, Array]: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, Q: Named, Qd: Named, Q2d: Named, **options: Unpack[_Wrench]
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def __call__(
        self,
        q: Named,
        qd: Named,
        Q: Named,
        Qd: Named,
        Q2d: Named,
        Q3d: Named,
        /,
        *higher: Named,
        **options: Unpack[_Wrench],
    ) -> tuple[Array, ...]: ...


class ForwardPartials(Protocol):
    """The method that takes q, qd, forces Q and wrenches, and returns three matrices."""

    def __call__(self, q: Named, qd: Named, Q: Named, **options: Unpack[_Wrench]) -> tuple[Array, Array, Array]:
        """Return dq2d/dq, dq2d/dqd and M^-1."""


class DriveForces(Protocol):
    """The method that takes q, qd, q2d and drive terms."""

    @overload
    def __call__(self, q: Named, qd: Named, q2d: Named, **options: Unpack[_Terms]) -> Array: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, **options: Unpack[_Terms]
    ) -> tuple[Array, Array]: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, q4d: Named, **options: Unpack[_Terms]
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def __call__(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        /,
        *higher: Named,
        **options: Unpack[_Terms],
    ) -> tuple[Array, ...]: ...


class WrenchOfLoad(Protocol):
    """The method that takes q and a load."""

    @overload
    def __call__(self, q: Named, *, body: str, **options: Unpack[_Load]) -> Array: ...
    @overload
    def __call__(self, q: Named, qd: Named, *, body: str, **options: Unpack[_Load]) -> tuple[Array, Array]: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, *, body: str, **options: Unpack[_Load]
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def __call__(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, /, *higher: Named, body: str, **options: Unpack[_Load]
    ) -> tuple[Array, ...]: ...


class Compile(Protocol):
    """A quantity to an order, as native code."""

    @overload
    def __call__(
        self, quantity: QuantityName = ..., order: Literal[2] = ..., wrench: bool = ..., **options: Unpack[_Compiled]
    ) -> Kernel[tuple[Floats, Floats, Floats]]: ...

    @overload
    def __call__(
        self, quantity: QuantityName = ..., order: Literal[1] = ..., wrench: bool = ..., **options: Unpack[_Compiled]
    ) -> Kernel[tuple[Floats, Floats]]: ...

    @overload
    def __call__(
        self, quantity: QuantityName = ..., order: Literal[0] = ..., wrench: bool = ..., **options: Unpack[_Compiled]
    ) -> Kernel[Floats]: ...

    @overload
    def __call__(
        self, quantity: QuantityName = ..., order: int = ..., wrench: bool = ..., **options: Unpack[_Compiled]
    ) -> Kernel[Any]: ...

    @overload
    def __call__(
        self,
        quantity: QuantityName = ...,
        order: int = ...,
        wrench: bool = ...,
        *,
        product: Product,
        **options: Unpack[_Compiled],
    ) -> Kernel[Any]: ...
