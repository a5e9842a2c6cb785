"""Computation: a request for a quantity with its rates up to an order, and its signature: the arrays in and out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate
from math import prod

from jounce._scalars import Array
from jounce.dynamics.quantities import QUANTITIES, Quantity, State
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series, columns, rate_name

Shape = tuple[int, ...]


@dataclass(frozen=True)
class Port:
    """One array of a computation, for one state. Its scalars are numbered from `start` on, inputs and outputs apart."""

    name: str  # q, qd, W, Wd, masses, Q, Qd
    shape: Shape
    role: str  # "parameter", "state", "wrench" or "result"
    rate: int = 0  # which time derivative it is
    first_order: int = 0  # of an input, the lowest order of the results that depend on it
    start: int = 0

    @property
    def size(self) -> int:
        """The number of scalars."""
        return prod(self.shape)

    @property
    def end(self) -> int:
        """One past the number of the last scalar."""
        return self.start + self.size


@dataclass(frozen=True)
class Signature:
    """The input and output arrays of a computation, in order."""

    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]

    def of_role(self, role: str) -> tuple[Port, ...]:
        """The inputs of a role."""
        return tuple(port for port in self.inputs if port.role == role)


@dataclass(frozen=True)
class Computation:
    """A quantity with its rates up to an order, with wrenches on the bodies or without, of one body or of all.

    `body` is None for all bodies, and for quantities that do not belong to bodies.
    """

    name: str
    order: int
    wrench: bool = False
    body: str | None = None
    frame: str = "body"

    @cached_property
    def _hash(self) -> int:
        return hash((self.name, self.order, self.wrench, self.body, self.frame))

    def __hash__(self) -> int:  # computed once: every call of a robot's method looks its kernel up
        return self._hash

    @property
    def quantity(self) -> Quantity:
        """The row of the quantity."""
        return QUANTITIES[self.name]

    @property
    def rates(self) -> int:
        """The number of rates q, qd, ..., or q, qd, Q, Qd, ..., that it takes."""
        return self.quantity.rates + self.order

    @property
    def spelling(self) -> str:
        """The quantity, its body and its frame as one text, NAME[:BODY[:FRAME]]; `arguments.requests` reads it."""
        parts = [self.name] if self.body is None else [self.name, self.body]
        misread = self.body is not None and self.body.rpartition(":")[2] in self.quantity.frames
        if self.frame != "body" or misread:  # the end of such a name would be read as the frame
            parts = [self.name, self.body or "", self.frame]
        return ":".join(parts)

    def keywords(self) -> list[str]:
        """The arguments of `Robot.compile` that compile it, as strings."""
        named = {"wrench": self.wrench, "body": self.body, "frame": self.frame}
        default = Computation(self.name, self.order)
        others = [f"{key}={value!r}" for key, value in named.items() if value != getattr(default, key)]
        return [repr(self.name), f"order={self.order}", *others]

    def signature(self, n: int, nb: int, parameters: Mapping[str, Shape] | None = None) -> Signature:
        """The ports for a robot of n coordinates and nb bodies, of which some data are parameters."""
        inputs = [Port(name, shape, "parameter") for name, shape in (parameters or {}).items()]
        inputs += state_ports(n, self.quantity.input_names(self.rates), self.quantity.rates)
        own = self.quantity.wrench_rates
        for k in range(own + self.order if self.wrench else 0):
            inputs.append(Port(rate_name("W", k), (nb, 6), "wrench", k, max(0, k + 1 - own)))
        shape = self.shape(n, nb)
        outputs = [Port(name, shape, "result", k) for k, name in enumerate(self.quantity.names(self.order))]
        return Signature(in_a_row(inputs), in_a_row(outputs))

    def shape(self, n: int, nb: int) -> Shape:
        """The shape of a result for one state."""
        sizes = {"n": n, "nb": nb}
        axes = (axis for axis in self.quantity.shape if axis != "nb" or self.body is None)
        return tuple(sizes[axis] if isinstance(axis, str) else axis for axis in axes)

    def state(self, arrays: Sequence[Array]) -> State:
        """Build the argument of a law from arrays q, qd, ..., Q, Qd, ... (..., n), then W, Wd, ... (..., nb, 6)."""
        given, W = arrays[: self.rates], [w.reshape((*w.shape[:-2], 6 * w.shape[-2], 1)) for w in arrays[self.rates :]]
        own = self.quantity.coordinate_inputs(self.rates)
        q, Q = columns(given[:own]), columns(given[own:])
        return State(q, Series.of(W) if W else None, Q, self.body, self.frame)

    def series(self, method: str, mechanism: Mechanism, arrays: Sequence[Array]) -> Series:
        """The quantity by a method, from the arrays of `state`."""
        return self.quantity.law(method, mechanism)(mechanism, self.state(arrays))


def state_ports(n: int, names: Sequence[str], least: int) -> list[Port]:
    """Return the ports of q, qd, ... by name; the quantity itself, without rates, takes the first `least`."""
    return [Port(name, (n,), "state", k, max(0, k + 1 - least)) for k, name in enumerate(names)]


def in_a_row(ports: Sequence[Port]) -> tuple[Port, ...]:
    """The ports, their scalars numbered one port after the other."""
    starts = accumulate((port.size for port in ports), initial=0)
    return tuple(replace(port, start=start) for port, start in zip(ports, starts, strict=False))
