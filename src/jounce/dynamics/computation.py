"""Computation: a request for a quantity with its rates up to an order, and its signature: the arrays in and out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate
from math import prod

import numpy as np

from jounce.core.scalars import Array
from jounce.dynamics import joint_springs
from jounce.dynamics.quantities import Quantity, find_row
from jounce.dynamics.state import JointMotion, State
from jounce.model import positions
from jounce.model.loops import all_coordinates
from jounce.model.mechanism import Mechanism
from jounce.spatial.inertia import INERTIAL_PARAMETERS
from jounce.spatial.lie import ad, cowedge, pose, position, rotation, wedge
from jounce.spatial.series import Series, column_series, rate_name, wrench_columns

Shape = tuple[int, ...]
DEPENDENT_INPUT = "q_dependent"  # the name of the dependent coordinates of a closed robot
FIRST_PRODUCTS = {
    "vjp": "vector-Jacobian products",
    "jvp": "Jacobian-vector products",
}  # of the derivatives by all inputs
SECOND_PRODUCTS = {
    "hvp": "derivatives of vector-Jacobian products along a direction",
    "jjvp": "derivatives of Jacobian-vector products along a second direction",
    "hessian": "Hessians of weighted sums of the results",
}
DERIVATIVE_PRODUCTS = FIRST_PRODUCTS | SECOND_PRODUCTS


@dataclass(frozen=True)
class Port:
    """One array of a computation, for one state. Its scalars are numbered from `start` on, inputs and outputs apart."""

    name: str  # q, qd, W, Wd, masses, Q, Qd
    shape: Shape
    role: str  # "parameter", "state", "wrench", "base", "stiffness", "dependent", "weight" or "result"
    rate: int = 0  # which time derivative it is
    first_order: int = 0  # of an input, the lowest order of the results that depend on it
    start: int = 0
    directions: int = 0  # of positions that are more numbers than velocities: how many displacements they have

    @property
    def size(self) -> int:
        """The number of scalars."""
        return prod(self.shape)

    @property
    def end(self) -> int:
        """One past the number of the last scalar."""
        return self.start + self.size

    @property
    def is_pose(self) -> bool:
        """Whether it is the pose of the base, a matrix of which only displacements by a twist make sense."""
        return self.role == "base" and self.shape == (4, 4)

    @property
    def is_free(self) -> bool:
        """Whether it varies by itself: parameters do not, and dependent coordinates follow the others."""
        return self.role not in ("parameter", "dependent")

    @property
    def displacement(self) -> Shape:
        """The shape of derivatives by it: of a pose C, those of C exp(wedge(d)) by a twist d; so of quaternions."""
        return (6,) if self.is_pose else (self.directions,) if self.directions else self.shape


@dataclass(frozen=True)
class Signature:
    """The input and output arrays of a computation, in order."""

    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]

    def as_matrices(self) -> "Signature":
        """The same results in two axes at most: several matrices stand one below the other, (3 nv, nv)."""
        outputs = [replace(x, shape=(prod(x.shape[:-1]), *x.shape[-1:])) if x.shape[2:] else x for x in self.outputs]
        return replace(self, outputs=tuple(outputs))

    def of_role(self, role: str) -> tuple[Port, ...]:
        """The inputs of a role."""
        return tuple(port for port in self.inputs if port.role == role)


@dataclass(frozen=True)
class Computation:
    """A quantity with its rates up to an order, with wrenches on the bodies or without, of one body or of all.

    `body` is None for all bodies, and for quantities that do not belong to bodies. `product` is one of
    `DERIVATIVE_PRODUCTS`, to be computed instead, or None. `more_rates` are those that springs and motors of the robot
    take in addition. `base` is whether the motion of the base is given.
    """

    name: str
    order: int
    wrench: bool = False
    body: str | None = None
    frame: str = "body"
    product: str | None = None
    more_rates: int = 0
    base: bool = False

    @cached_property
    def _hash(self) -> int:
        of_call = (self.name, self.order, self.wrench, self.body, self.frame, self.product, self.more_rates, self.base)
        return hash(of_call)

    def __hash__(self) -> int:  # computed once: every call of a robot's method looks its kernel up
        return self._hash

    @property
    def quantity(self) -> Quantity:
        """The row of the quantity."""
        return find_row(self.name, self.more_rates)

    @property
    def rates(self) -> int:
        """The number of rates q, qd, ..., or q, qd, Q, Qd, ..., that it takes."""
        return self.quantity.takes.rates + self.order

    @property
    def loads(self) -> int:
        """The number of wrenches W, Wd, ..., and of stiffnesses, where they are given."""
        return self.quantity.takes.wrench_rates + self.order

    @property
    def count(self) -> int:
        """The number of results: the quantity and its rates, or the several results that it has."""
        return len(self.quantity.names(self.order))

    @property
    def spelling(self) -> str:
        """The quantity, its body and its frame as one text, as `arguments.requests` reads it."""
        name = f"{self.name}.{self.product}" if self.product else self.name
        parts = [name] if self.body is None else [name, self.body]
        misread = self.body is not None and self.body.rpartition(":")[2] in self.quantity.gives.frames
        if self.frame != "body" or misread:  # the end of such a name would be read as the frame
            parts = [name, self.body or "", self.frame]
        return ":".join(parts)

    def keywords(self) -> list[str]:
        """The arguments of `Robot.compile` that compile it, as strings."""
        named = {"wrench": self.wrench, "body": self.body, "frame": self.frame, "product": self.product}
        default = Computation(self.name, self.order)
        others = [f"{key}={value!r}" for key, value in named.items() if value != getattr(default, key)]
        others += ["moving_base=True"] * self.base
        return [repr(self.name), f"order={self.order}", *others]

    def describe(self, robot: str) -> str:
        """Return what is computed, of a robot with a name, in words."""
        of = f" of {self.body!r} in frame {self.frame!r}" if self.body is not None else ""
        loaded = ", with wrenches" if self.wrench else ""
        loaded += ", with the motion of the base" if self.base else ""
        product = f"{self.product} of " if self.product else ""
        return f"{product}{self.name}{of} of {robot!r} to order {self.order}{loaded}"

    def signature(self, m: Mechanism, parameters: Mapping[str, Shape] | None = None) -> Signature:
        """The ports for a robot, of which some data are parameters."""
        inputs = [Port(name, shape, "parameter") for name, shape in (parameters or {}).items()]
        inputs += self.state_ports(m)
        own, of_bodies = self.quantity.takes.wrench_rates, (m.nb, 6)
        for k in range(self.loads if self.wrench else 0):
            inputs.append(Port(rate_name("W", k), of_bodies, "wrench", k, max(0, k + 1 - own)))
        for k in range(self.base_terms(m) if self.base else 0):
            shape: Shape = (6,) if k else (4, 4)
            inputs.append(Port(base_name(k), shape, "base", k, max(0, k + 1 - self.quantity.takes.rates)))
        for k in range(self.loads if self.takes_stiffness(m) else 0):
            pairs = (len(joint_springs.elasticity_of(m).pairs),)
            inputs.append(Port(rate_name("stiffness", k), pairs, "stiffness", k, max(0, k + 1 - own)))
        if m.closure and m.takes_dependent:
            inputs.append(Port(DEPENDENT_INPUT, (len(m.closure.dependent),), "dependent"))
        rates = [0] * self.count if self.quantity.gives.results else range(self.count)
        names = self.quantity.names(self.order)
        outputs = [Port(name, self.shape(m, k), "result", k) for k, name in zip(rates, names, strict=True)]
        if self.product:
            inputs, outputs = _product_ports(self.product, inputs, outputs)
        return Signature(number_scalars(inputs), number_scalars(outputs))

    def state_ports(self, m: Mechanism) -> list[Port]:
        """The ports of q, qd, ..., and of Q, Qd, ..., or of theta, thetad, ..."""
        least, own = self.quantity.takes.rates, self.quantity.takes.coordinates(self.rates)
        names = self.quantity.takes.names(self.rates)
        of_motors = self.quantity.takes.motors and m.elasticity
        others = len(of_motors.joints_of_motors) if of_motors else m.nv
        sizes = [m.n if k < own else others for k in range(self.rates)]
        both = enumerate(zip(names, sizes, strict=True))
        ports = [Port(name, (size,), "state", k, max(0, k + 1 - least)) for k, (name, size) in both]
        if positions.multiscrew_joints(m):
            ports[0] = replace(ports[0], shape=(positions.count(m),), directions=m.n)
        return ports

    def takes_stiffness(self, m: Mechanism) -> bool:
        """Whether joints with two motors take their stiffness."""
        return self.quantity.takes_stiffness and m.elasticity is not None and bool(m.elasticity.pairs)

    def base_terms(self, m: Mechanism) -> int:
        """The number of terms C, V, Vd, ... of the motion of the base, where it enters: as many as q has."""
        return self.quantity.takes.coordinates(self.rates) if m.floats else self.rates

    def shape(self, m: Mechanism, k: int = 0) -> Shape:
        """The shape of the k-th rate for one state."""
        bodies = m.nb
        sizes = {"n": m.n, "nv": m.nv, "nb": bodies, "bodies": bodies}
        sizes["rates"] = self.quantity.takes.rates + k
        sizes["contacts"] = len(m.contacts)
        sizes["parameters"] = len(INERTIAL_PARAMETERS) * bodies
        if closure := m.closure:
            sizes |= {"tree": len(closure.coordinates), "loops": len(m.loops), "motors": len(closure.force_places)}
            sizes["passive"] = len(closure.passive)
        axes = (axis for axis in self.quantity.gives.shape if axis != "nb" or self.body is None)
        return tuple(sizes[axis] if isinstance(axis, str) else axis for axis in axes)

    def state(self, m: Mechanism, arrays: Sequence[Array]) -> State:
        """Build the argument of a law from arrays q, qd, ..., Q, Qd, ..., then W, Wd, ..., then C, V, Vd, ...

        Those of joints with two motors go on with their stiffness, those of a closed robot end with the dependent
        coordinates.
        """
        tree = None
        if m.closure and m.takes_dependent:
            *arrays, dependent = arrays
            tree = all_coordinates(m.closure, arrays[0], dependent)[..., None]
        stiffness = None
        if self.takes_stiffness(m):
            arrays, stiffness = arrays[: -self.loads], column_series(arrays[-self.loads :])
        loads = self.rates + (self.loads if self.wrench else 0)
        given, W, base = arrays[: self.rates], arrays[self.rates : loads], arrays[loads:]
        own = self.quantity.takes.coordinates(self.rates)
        q, others = column_series(given[:own]), column_series(given[own:])
        behind = {"motors" if self.quantity.takes.motors else "Q": others}
        moving = JointMotion(pose(rotation(base[0]), position(base[0])), column_series(base[1:])) if self.base else None
        return State(
            q, wrench_columns(W) if W else None, base=moving, body=self.body, frame=self.frame, position=tree,
            stiffness=stiffness, **behind,
        )  # fmt: skip

    def series(self, method: str, m: Mechanism, arrays: Sequence[Array]) -> Series:
        """The quantity by a method, from the arrays of `state`; its terms are the results."""
        return self.quantity.law(method, m)(m, self.state(m, arrays))


def change(m: Mechanism, port: Port, x: Array, d: Array) -> Array:
    """The change of an input x by a displacement d, of the shape `port.displacement`."""
    if port.is_pose:
        return x @ wedge(d)
    return (positions.rate_map(m, x) @ d[..., None])[..., 0] if port.directions else d


def displacement(m: Mechanism, port: Port, x: Array, dx: Array) -> Array:
    """The displacement that a change dx of an input is; changes of the length of a quaternion do not count."""
    if port.is_pose:
        return cowedge(x.mT @ dx) * np.array([0.5, 0.5, 0.5, 1, 1, 1], dx.dtype)
    if not port.directions:
        return dx
    N = positions.rate_map(m, x)  # its columns are orthogonal
    return (N.mT @ dx[..., None])[..., 0] / (N * N).sum(axis=-2)


def commutator(m: Mechanism, port: Port, d: Array) -> Array:
    """A, (..., k, k): displacements of an input by d and by another one, e, do not commute, but for A e.

    ``x(d + e) = x(d)(e) = x(e)(d + A e)`` up to higher orders: [d, e] of twists. Zero where displacements are sums.
    """
    if port.is_pose:
        return ad(d)
    total = d[..., None] * np.zeros(port.displacement, dtype=int)
    for joint in positions.multiscrew_joints(m).values() if port.directions else ():
        own = np.eye(m.n, dtype=int)[:, joint.coordinates]
        twist = (joint.group.X @ (own.T @ d[..., None]))[..., 0]
        total = total + own @ (joint.group.X.T @ ad(twist) @ joint.group.X) @ own.T
    return total


def base_name(k: int) -> str:
    """The name of a term of the motion of the base: its pose, its twist and the rates of it."""
    return rate_name("base_twist", k - 1) if k else "base_pose"


def _product_ports(product: str, inputs: list[Port], results: list[Port]) -> tuple[list[Port], list[Port]]:
    """The ports of a product: weights wQ, ... and gradients gq, ..., directions dq, ... and tangents dQ, ..."""
    given = [replace(port, shape=port.displacement, directions=0) for port in inputs if port.is_free]
    directions = [replace(port, name=f"d{port.name}") for port in given]
    if product == "jvp":
        return inputs + directions, [replace(port, name=f"d{port.name}") for port in results]
    if product == "jjvp":
        others = [replace(port, name=f"e{port.name}") for port in given]
        return inputs + directions + others, [replace(port, name=f"de{port.name}") for port in results]
    inputs = inputs + [replace(port, name=f"w{port.name}", role="weight") for port in results]
    letter, size = "g" if product == "vjp" else "h", sum(port.size for port in given)
    outputs = [replace(port, name=f"{letter}{port.name}", role="result") for port in given]
    if product == "hvp":
        inputs += directions
    elif product == "hessian":
        outputs = [Port("hessian", (size, size), "result")]
    return [replace(port, first_order=0) for port in inputs], outputs  # by any input, they contain all results


def number_scalars(ports: Sequence[Port]) -> tuple[Port, ...]:
    """The ports, their scalars numbered one port after the other."""
    starts = accumulate((port.size for port in ports), initial=0)
    return tuple(replace(port, start=start) for port, start in zip(ports, starts, strict=False))
