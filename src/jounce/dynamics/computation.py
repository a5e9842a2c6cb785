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
        """The number behind that of the last scalar."""
        return self.start + self.size

    @property
    def is_pose(self) -> bool:
        """Whether it is the pose of the base.

        A pose varies by displacements alone. A displacement by a twist keeps it a pose; a change of its entries does
        not.
        """
        return self.role == "base" and self.shape == (4, 4)

    @property
    def is_free(self) -> bool:
        """Whether it varies by itself: parameters do not, and dependent coordinates follow the others."""
        return self.role not in ("parameter", "dependent")

    @property
    def displacement(self) -> Shape:
        """The shape of derivatives by it.

        Derivatives by a pose C are those of C exp(wedge(d)) by a twist d; so are those by quaternions.
        """
        if self.is_pose:
            return (6,)
        return (self.directions,) if self.directions > 0 else self.shape


@dataclass(frozen=True)
class Signature:
    """The input and output arrays of a computation, in order."""

    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]

    def as_matrices(self) -> "Signature":
        """Return the same signature with results in two axes at most.

        Several matrices stand one below the other, (3, nv, nv) as (3 nv, nv).
        """
        outputs = [
            replace(x, shape=(prod(x.shape[:-1]), *x.shape[-1:])) if len(x.shape) > 2 else x for x in self.outputs
        ]
        return replace(self, outputs=tuple(outputs))

    def of_role(self, role: str) -> tuple[Port, ...]:
        """Return the inputs of a role."""
        return tuple(port for port in self.inputs if port.role == role)


@dataclass(frozen=True)
class Computation:
    """A quantity with its rates, of one body or of all.

    `wrench` is whether wrenches on the bodies are given. `body` is None for all bodies, and for quantities that do not
    belong to bodies. `product` is one of `DERIVATIVE_PRODUCTS`, to be computed instead, or None. `more_rates` are those
    that springs and motors of the robot take in addition. `base` is whether the motion of the base is given.
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
        fields = (self.name, self.order, self.wrench, self.body, self.frame, self.product, self.more_rates, self.base)
        return hash(fields)

    # Computed once, since every call of a robot's method looks its kernel up.
    def __hash__(self) -> int:
        return self._hash

    @property
    def quantity(self) -> Quantity:
        """The row of the quantity."""
        return find_row(self.name, self.more_rates)

    @property
    def rates(self) -> int:
        """The number of arrays q, qd, ..., Q, Qd, ... that it takes."""
        return self.quantity.takes.rates + self.order

    @property
    def loads(self) -> int:
        """The number of arrays W, Wd, ... where given, and of stiffnesses."""
        return self.quantity.takes.wrench_rates + self.order

    @property
    def count(self) -> int:
        """The number of results: the quantity and its rates, or the several results that it has."""
        return len(self.quantity.names(self.order))

    @property
    def spelling(self) -> str:
        """The quantity with its body and frame as one text.

        `arguments.requests` reads it.
        """
        name = f"{self.name}.{self.product}" if self.product else self.name
        parts = [name] if self.body is None else [name, self.body]
        # The end of a name such as 'arm:world' would be read as the frame, if no frame followed.
        ends_as_frame = self.body is not None and self.body.rpartition(":")[2] in self.quantity.gives.frames
        if self.frame != "body" or ends_as_frame:
            parts = [name, self.body or "", self.frame]
        return ":".join(parts)

    def keywords(self) -> list[str]:
        """Return the arguments of `Robot.compile` that compile it, as strings."""
        named = {"wrench": self.wrench, "body": self.body, "frame": self.frame, "product": self.product}
        default = Computation(self.name, self.order)
        options = [f"{key}={value!r}" for key, value in named.items() if value != getattr(default, key)]
        if self.base:
            options.append("moving_base=True")
        return [repr(self.name), f"order={self.order}", *options]

    def describe(self, robot: str) -> str:
        """Return what is computed, of a robot with a name, in words."""
        of_body = f" of {self.body!r} in frame {self.frame!r}" if self.body is not None else ""
        inputs = ", with wrenches" if self.wrench else ""
        inputs += ", with the motion of the base" if self.base else ""
        product = f"{self.product} of " if self.product else ""
        return f"{product}{self.name}{of_body} of {robot!r} to order {self.order}{inputs}"

    def signature(self, m: Mechanism, parameters: Mapping[str, Shape] | None = None) -> Signature:
        """Return the ports for a robot.

        `parameters` are data of the robot that are inputs too.
        """
        inputs = [] if parameters is None else [Port(name, shape, "parameter") for name, shape in parameters.items()]
        inputs += self.state_ports(m)
        # An input that the quantity itself takes is needed from order 0 on; each further rate of it one order later.
        wrench_rates = self.quantity.takes.wrench_rates
        for k in range(self.loads if self.wrench else 0):
            inputs.append(Port(rate_name("W", k), (m.nb, 6), "wrench", k, max(0, k + 1 - wrench_rates)))
        for k in range(self.base_terms(m) if self.base else 0):
            shape: Shape = (6,) if k else (4, 4)
            inputs.append(Port(base_name(k), shape, "base", k, max(0, k + 1 - self.quantity.takes.rates)))
        for k in range(self.loads if self.takes_stiffness(m) else 0):
            pairs = (len(joint_springs.elasticity_of(m).pairs),)
            inputs.append(Port(rate_name("stiffness", k), pairs, "stiffness", k, max(0, k + 1 - wrench_rates)))
        if m.closure and m.takes_dependent:
            inputs.append(Port(DEPENDENT_INPUT, (len(m.closure.dependent),), "dependent"))
        # Several results are no rates of each other: all belong to order 0.
        rates = range(self.count) if len(self.quantity.gives.results) == 0 else [0] * self.count
        names = self.quantity.names(self.order)
        outputs = [Port(name, self.shape(m, k), "result", k) for k, name in zip(rates, names, strict=True)]
        if self.product is not None:
            inputs, outputs = _product_ports(self.product, inputs, outputs)
        return Signature(number_scalars(inputs), number_scalars(outputs))

    def state_ports(self, m: Mechanism) -> list[Port]:
        """Return the ports of the state.

        They are q, qd, ..., and Q, Qd, ... or theta, thetad, ...
        """
        takes = self.quantity.takes
        # After the coordinates come states of motors, of which a joint may have two, or generalized forces.
        coordinate_count, size_behind = takes.coordinates(self.rates), m.nv
        if len(takes.motors) > 0 and m.elasticity is not None:
            size_behind = len(m.elasticity.joints_of_motors)
        ports = []
        for k, name in enumerate(takes.names(self.rates)):
            size = m.n if k < coordinate_count else size_behind
            ports.append(Port(name, (size,), "state", k, max(0, k + 1 - takes.rates)))
        # Positions of joints of several screws, as quaternions, are more numbers than velocities.
        if positions.multiscrew_joints(m):
            ports[0] = replace(ports[0], shape=(positions.count(m),), directions=m.n)
        return ports

    def takes_stiffness(self, m: Mechanism) -> bool:
        """Return whether joints with two motors take their stiffness."""
        return self.quantity.takes_stiffness and m.elasticity is not None and bool(m.elasticity.pairs)

    def base_terms(self, m: Mechanism) -> int:
        """Return the number of terms of the motion of the base.

        The terms are C, V, Vd, ..., as many as q has.
        """
        return self.quantity.takes.coordinates(self.rates) if m.floats else self.rates

    def shape(self, m: Mechanism, k: int = 0) -> Shape:
        """Return the shape of the k-th rate for one state."""
        bodies = m.nb
        sizes = {"n": m.n, "nv": m.nv, "nb": bodies, "bodies": bodies}
        sizes["rates"] = self.quantity.takes.rates + k
        sizes["contacts"] = len(m.contacts)
        sizes["parameters"] = len(INERTIAL_PARAMETERS) * bodies
        closure = m.closure
        if closure is not None:
            sizes |= {"tree": len(closure.coordinates), "loops": len(m.loops), "motors": len(closure.force_places)}
            sizes["passive"] = len(closure.passive)
        # Named axes become sizes; that of the bodies is absent where one body is named.
        axes = (axis for axis in self.quantity.gives.shape if axis != "nb" or self.body is None)
        return tuple(sizes[axis] if isinstance(axis, str) else axis for axis in axes)

    def state(self, m: Mechanism, arrays: Sequence[Array]) -> State:
        """Build the argument of a law from arrays.

        The arrays are in the order of `signature`: q, qd, ..., Q, Qd, ..., then W, Wd, ..., then C, V, Vd, ...;
        then the stiffnesses of joints with two motors, and at last the dependent coordinates of a closed robot.
        """
        # From the end: dependent coordinates, then stiffnesses.
        tree = None
        if m.closure and m.takes_dependent:
            *arrays, dependent = arrays
            tree = all_coordinates(m.closure, arrays[0], dependent)[..., None]
        stiffness = None
        if self.takes_stiffness(m):
            arrays, stiffness = arrays[: -self.loads], column_series(arrays[-self.loads :])
        # From the start: the motion, wrenches, the motion of the base.
        end_of_loads = self.rates + (self.loads if self.wrench else 0)
        rates, W, base = arrays[: self.rates], arrays[self.rates : end_of_loads], arrays[end_of_loads:]
        coordinate_count = self.quantity.takes.coordinates(self.rates)
        q, forces_or_motors = column_series(rates[:coordinate_count]), column_series(rates[coordinate_count:])
        field = "motors" if len(self.quantity.takes.motors) > 0 else "Q"
        moving_base = None
        if self.base:
            # The last row of a pose is (0, 0, 0, 1), whatever array of numbers was given.
            moving_base = JointMotion(pose(rotation(base[0]), position(base[0])), column_series(base[1:]))
        return State(
            q, wrench_columns(W) if len(W) > 0 else None, base=moving_base, body=self.body, frame=self.frame,
            position=tree, stiffness=stiffness, **{field: forces_or_motors},
        )  # fmt: skip

    def series(self, method: str, m: Mechanism, arrays: Sequence[Array]) -> Series:
        """Return the quantity by a method; its terms are the results.

        The arrays are those of `state`.
        """
        return self.quantity.law(method, m)(m, self.state(m, arrays))


def change(m: Mechanism, port: Port, x: Array, d: Array) -> Array:
    """Return the change of an input x by a displacement d.

    d has the shape `port.displacement`.
    """
    if port.is_pose:
        return x @ wedge(d)
    # Positions of joints of several screws change as they do along a motion with the velocities d.
    return (positions.rate_map(m, x) @ d[..., None])[..., 0] if port.directions > 0 else d


def displacement(m: Mechanism, port: Port, x: Array, dx: Array) -> Array:
    """Return the displacement that a change dx of an input x is.

    Changes of the length of a quaternion do not count.
    """
    # wedge(d) = C^-1 dC; `cowedge` adds the two entries of each angle.
    if port.is_pose:
        return cowedge(x.mT @ dx) * np.array([0.5, 0.5, 0.5, 1, 1, 1], dx.dtype)
    if port.directions == 0:
        return dx
    # The least-squares solution of N d = dx, whose columns are orthogonal.
    N = positions.rate_map(m, x)
    return (N.mT @ dx[..., None])[..., 0] / (N * N).sum(axis=-2)


def commutator(m: Mechanism, port: Port, d: Array) -> Array:
    """Return A, by which displacements d and e do not commute.

    A is (..., k, k). ``x(d + e) = x(d)(e) = x(e)(d + A e)`` up to higher orders: [d, e] of twists. Zero where
    displacements are sums.
    """
    if port.is_pose:
        return ad(d)
    total = d[..., None] * np.zeros(port.displacement, dtype=int)
    if port.directions == 0:
        return total
    for joint in positions.multiscrew_joints(m).values():
        # X^T ad(X d_j) X of the displacements d_j of the joint, in their places.
        places = np.eye(m.n, dtype=int)[:, joint.coordinates]
        twist = (joint.group.X @ (places.T @ d[..., None]))[..., 0]
        total = total + places @ (joint.group.X.T @ ad(twist) @ joint.group.X) @ places.T
    return total


def base_name(k: int) -> str:
    """Return the name of a term of the motion of the base: its pose, twist, and rates of that."""
    return rate_name("base_twist", k - 1) if k else "base_pose"


def _product_ports(product: str, inputs: list[Port], results: list[Port]) -> tuple[list[Port], list[Port]]:
    """Return the inputs and outputs of a product of derivatives.

    They have names by letter: weights wQ, ... and gradients gq, ..., directions dq, ... and tangents dQ, ...
    """
    # Displacements of all inputs by which there are derivatives.
    displacements = [replace(port, shape=port.displacement, directions=0) for port in inputs if port.is_free]
    directions = [replace(port, name=f"d{port.name}") for port in displacements]
    # Products with directions keep the results and their orders.
    if product == "jvp":
        return inputs + directions, [replace(port, name=f"d{port.name}") for port in results]
    if product == "jjvp":
        second_directions = [replace(port, name=f"e{port.name}") for port in displacements]
        return inputs + directions + second_directions, [replace(port, name=f"de{port.name}") for port in results]
    # Products with weights sum up all results. Their outputs are derivatives by the inputs.
    inputs = inputs + [replace(port, name=f"w{port.name}", role="weight") for port in results]
    letter, size = "g" if product == "vjp" else "h", sum(port.size for port in displacements)
    outputs = [replace(port, name=f"{letter}{port.name}", role="result") for port in displacements]
    if product == "hvp":
        inputs += directions
    elif product == "hessian":
        outputs = [Port("hessian", (size, size), "result")]
    # A derivative by any input contains all results: no input is needed at higher orders alone.
    return [replace(port, first_order=0) for port in inputs], outputs


def number_scalars(ports: Sequence[Port]) -> tuple[Port, ...]:
    """Return the ports with their scalars numbered one port after the other."""
    starts = accumulate((port.size for port in ports), initial=0)
    return tuple(replace(port, start=start) for port, start in zip(ports, starts, strict=False))
