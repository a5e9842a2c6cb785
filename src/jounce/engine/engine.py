"""An engine: a mechanism and its native code, which is all that a computation needs of a robot."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self, TypeVar

from jounce.core.errors import JounceError
from jounce.dynamics.computation import Computation
from jounce.model import positions
from jounce.model.mechanism import Mechanism
from jounce.native.kernel import Kernel
from jounce.native.laws import NativeStep

Form = tuple[Any, ...]  # of a call: what it asks for, and the types of what it gives


@dataclass(frozen=True, eq=False)
class Kernels:
    """The native code of one robot, dropped with it.

    `known` maps a computation to its kernel, or to the reason that it has none; `steps` holds the step that closes
    loops.
    """

    known: dict[Computation, tuple[Kernel | None, str | None]] = field(default_factory=dict)
    steps: list[NativeStep | None] = field(default_factory=list)


@dataclass(frozen=True, eq=False, repr=False)
class Engine:
    """A mechanism, its native code, and how it serves calls. `Robot` is one, with a method for each quantity."""

    mechanism: Mechanism
    _kernels: Kernels = field(default_factory=Kernels, init=False)
    _plans: dict[Form, Any] = field(default_factory=dict, init=False)  # a `Plan` for each form that was served

    def __post_init__(self) -> None:
        mechanism: object = self.mechanism
        if not isinstance(mechanism, Mechanism):
            name, came = type(self).__name__, type(mechanism).__name__
            raise JounceError(f"{name}() expects a Mechanism, got {came}; try jounce.load")

    def __reduce__(self) -> tuple[type[Self], tuple[Mechanism]]:  # without native code, of which another needs its own
        return type(self), (self.mechanism,)

    @property
    def name(self) -> str:
        """The robot's name."""
        return self.mechanism.name

    @property
    def n(self) -> int:
        """The number of coordinates."""
        return self.mechanism.n

    @property
    def nv(self) -> int:
        """The number of velocities: n, or 6 + n if the robot floats, whose base comes first."""
        return self.mechanism.nv

    @property
    def nq(self) -> int:
        """The number of entries of q.

        They are n, and more where there are balls, planar or free joints, or a base that floats.
        """
        return positions.whole_count(self.mechanism)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The names of the coordinates, in the order of q."""
        return self.mechanism.coordinates

    @property
    def body_names(self) -> tuple[str, ...]:
        """The names of the bodies; a floating base is first.

        They are in the order of rows of wrenches, poses and Jacobians.
        """
        return self.mechanism.bodies


if TYPE_CHECKING:  # with a default, which Python itself knows from 3.13 on
    import typing_extensions

    R = typing_extensions.TypeVar("R", bound=Engine, default=Any)
else:
    R = TypeVar("R", bound=Engine)  # a robot of the caller's own type


def with_mechanism(robot: R, mechanism: Mechanism) -> R:
    """Return a robot of the same type with another mechanism.

    It has no native code yet.
    """
    return type(robot)(mechanism)
