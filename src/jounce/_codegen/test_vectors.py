"""Compute test vectors of generated code: states and correct results, in other ways than the generated program.

`vectors` is the door: random states of short decimals, and the outputs by the closed form in extended precision,
rounded at the end. Gradients and tangents are those of the complex step [1], ``f(x + i h d) = f(x) + i h J d + ...``:
no difference is taken, so that a tiny h gives all digits, and nothing is shared with accumulation on programs.

[1] W. Squire, G. Trapp, Using complex variables to estimate derivatives of real functions, SIAM Review 40 (1998).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import prod

import numpy as np

from jounce._codegen.function import Function, ParametricRobot
from jounce.checks.magnitudes import magnitudes, scale
from jounce.core.errors import JounceError
from jounce.dynamics import loop_closure
from jounce.dynamics.computation import DEPENDENT_INPUT, Computation, Port, change
from jounce.dynamics.loop_branches import scales
from jounce.dynamics.loops import closure_of
from jounce.engine import generic_methods
from jounce.model import positions
from jounce.model.mechanism import Mechanism, with_extended_precision
from jounce.spatial import lie

MAX_BODY_STATES = 100  # bodies times states of a test: the closed form is dense
MAX_TEST_STATES = 10  # of a function, so that tests stay short
STEPS_PER_UNIT = 1000  # states are multiples of 1/1000: short to write, the same in every language
INTEGER_QUATERNIONS = [[8, 6, 0, 0], [8, 4, 4, 2], [7, 5, 5, 1]]  # of norm 10: entries of rotations have two decimals
INTEGER_TURNS = {4: INTEGER_QUATERNIONS, 2: [[8, 6]]}  # of joints, by the count of their numbers: 2 are cosine and sine
MAX_WAY_FROM_START = 0.2  # rad or sizes of the robot; halved until the loops close
TEST_TOLERANCES = {
    False: 1e-13,
    True: 2e-4,
}  # relative, by "single": hundreds of rounding errors
# Terms that cancel leave their rounding errors, so errors are compared with terms, up to this multiple of the values:
# then a wrong ninth digit of the values is noticed. Magnitudes of terms are estimates, some of which, as of gradients
# and of products with inverses, are a million times the values.
MAX_TERMS_OVER_VALUES = 100.0
ZERO_OVER_TERMS = 1e-11  # smaller values are 0 in exact arithmetic: rounding leaves 1e-16 of the terms, or less


@dataclass(frozen=True, eq=False)
class Vectors:
    """Arrays (states, ...) by name: parameters, q, qd, ..., W, ..., the outputs expected and their magnitudes."""

    parameters: Mapping[str, np.ndarray]
    inputs: Mapping[str, np.ndarray]
    outputs: Mapping[str, np.ndarray]
    magnitudes: Mapping[str, np.ndarray]

    @property
    def count(self) -> int:
        """The number of states."""
        return len(self.inputs["q"])

    def scale(self, name: str) -> float:
        """Return what errors of an output are divided by, over all states.

        It has three digits, which are the same on every machine. It is the largest value, or terms that are larger and
        cancel, as far as 9 digits of the values still count.
        """
        terms, value = scale(self.outputs[name], self.magnitudes[name]), float(np.abs(self.outputs[name]).max())
        if value > ZERO_OVER_TERMS * terms:
            terms = min(terms, MAX_TERMS_OVER_VALUES * value)
        return float(f"{terms:.3g}")

    def parameter_sets(self) -> Iterator[dict[str, np.ndarray]]:
        """Return the parameters of one state after the other."""
        return ({name: values[k] for name, values in self.parameters.items()} for k in range(self.count))


def vectors(
    robot: ParametricRobot, function: Function, single: bool, count: int | None = None, method: str = "closed_form"
) -> Vectors:
    """Return random states and their outputs in extended precision.

    Outputs are rounded at the end. For single precision the inputs are numbers of that precision. A quantity that lacks
    the method takes its first.
    """
    methods = function.computation.quantity.laws
    method = method if method in methods else next(iter(methods))
    # The closed form is dense, so that large robots have few states.
    rng = np.random.default_rng(0)
    count = max(1, min(MAX_TEST_STATES, MAX_BODY_STATES // len(robot.origin.joints))) if count is None else count

    def random(port: Port) -> np.ndarray:
        if port.is_pose:
            return np.stack([_random_pose(rng) for _ in range(count)])
        x = rng.integers(-2 * STEPS_PER_UNIT, 2 * STEPS_PER_UNIT, (count, *port.shape)) / STEPS_PER_UNIT
        # Numbers of rotations among those of q have to be turns.
        if port.directions:
            for joint in positions.multiscrew_joints(robot.origin).values():
                turns = x[:, joint.turn]
                turns[:] = [_random_turn(rng, turns.shape[1]) for _ in turns]
        return x

    def round_to_precision(x: np.ndarray) -> np.ndarray:
        return x.astype(np.float32).astype(float) if single else x

    # Inputs come before parameters, in the order in which the generator of random numbers serves them.
    inputs = {port.name: round_to_precision(random(port)) for port in function.inputs}
    if robot.origin.takes_dependent:
        closed = states_near_start(robot.origin, inputs["q"] / 2)
        inputs |= {name: round_to_precision(x) for name, x in zip(("q", DEPENDENT_INPUT), closed, strict=True)}
    # Up to MAX_TEST_STATES sets of parameters; states of one batch share theirs, as each set makes a mechanism.
    batch = -(-count // MAX_TEST_STATES) if len(function.parameters) > 0 else count
    starts = np.arange(count) // batch * batch
    parameters = {
        port.name: round_to_precision(_values_near(robot.own.get(port.name), random(port)))[starts]
        for port in function.parameters
    }
    # Once per batch: the mechanism in long doubles, the outputs, and the magnitudes of their terms.
    results: list[Sequence[np.ndarray]] = []
    sizes: list[Sequence[np.ndarray]] = []
    for k in range(0, count, batch):
        values = {name: np.asarray(x[k].astype(np.longdouble), dtype=object) for name, x in parameters.items()}
        mechanism = with_extended_precision(robot.mechanism(values))
        states = {name: x[k : k + batch].astype(np.longdouble) for name, x in inputs.items()}
        computation, state = function.computation, list(states.values())
        if computation.product is not None:
            results.append(derivative_product(computation, method, mechanism, state))
            sizes.append(product_magnitudes(mechanism, computation, state))
        else:
            results.append(generic_methods.compute_by_method(computation, method, mechanism, state))
            sizes.append(magnitudes(mechanism, computation, state))
    return Vectors(parameters, inputs, _outputs_by_name(function, results), _outputs_by_name(function, sizes))


def states_near_start(m: Mechanism, way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return independent and dependent coordinates (k, ...) with closed loops.

    They are ways (k, n) from the start of the closure. Ways are halved, up to nine times, until loops close; they are
    not where lengths are parameters, and where no way closes them the start itself is returned for all dependent
    coordinates.
    """
    c = closure_of(m)
    independent, dependent = list(c.independent), list(c.dependent)
    for size in MAX_WAY_FROM_START * 0.5 ** np.arange(10):
        u = np.round(c.start[independent] + size * way * scales(m).coordinates[independent], 6)
        try:
            return u, loop_closure.close_loops(m, u)[:, dependent]
        except JounceError:
            continue
    return u, c.start[dependent] + 0 * u[:, :1]


def _random_pose(rng: np.random.Generator) -> np.ndarray:
    """Return a pose of short decimals.

    Its rotation is that of a quaternion of integers, whose squares add up to 100.
    """
    # R = ((a^2 - v . v) I + 2 v v^T + 2 a v~) / 100
    a, x, y, z = rng.permutation(INTEGER_QUATERNIONS[rng.integers(len(INTEGER_QUATERNIONS))])
    v = np.array([x, y, z]) * rng.choice([-1, 1], 3)
    R = (a * a - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * a * np.cross(np.eye(3), v)
    r = rng.integers(-2 * STEPS_PER_UNIT, 2 * STEPS_PER_UNIT, (3, 1)) / STEPS_PER_UNIT
    return lie.pose(R / 100, r)


def _random_turn(rng: np.random.Generator, size: int) -> np.ndarray:
    """Return the numbers of a turn of a joint: short decimals.

    Their length is from 0.5 to 2, and does not matter.
    """
    numbers = rng.permutation(INTEGER_TURNS[size][rng.integers(len(INTEGER_TURNS[size]))])
    return numbers * rng.choice([-1, 1], size) * rng.integers(5, 21) / 100


def _values_near(own: np.ndarray | None, random: np.ndarray) -> np.ndarray:
    """Return values of a parameter near its own, with three decimals.

    They are between 0 and 1 where the parameter is zero or has no value.
    """
    values = 0.5 + random / 4  # from 0 to 1
    if own is not None and own.dtype != object:
        values = np.where(own == 0, values, own * (0.5 + values))
    return np.round(values, 3)


def _outputs_by_name(function: Function, results: Sequence[Sequence[np.ndarray]]) -> dict[str, np.ndarray]:
    """Return the outputs by name.

    Results come from one group of states after the other.
    """
    arrays = [np.concatenate(terms).astype(float) for terms in zip(*results, strict=True)]
    return {x.name: array.reshape((-1, *x.shape)) for x, array in zip(function.outputs, arrays, strict=True)}


_COMPLEX_STEP = 1e-100  # its square vanishes, and it is no difference: no digits cancel


def derivative_product(
    computation: Computation, method: str, mechanism: Mechanism, arrays: Sequence[np.ndarray]
) -> list[np.ndarray]:
    """Return the gradients or tangents of a quantity by a method.

    All arrays have the same batch axes.
    """
    values = replace(computation, product=None)
    ports = values.signature(mechanism).inputs
    x, others = arrays[: len(ports)], arrays[len(ports) :]  # the state, then directions or weights
    free = [port for port in ports if port.is_free]

    def differentiate_along(directions: Sequence[np.ndarray]) -> list[np.ndarray]:
        # Changes of the inputs by displacements, and of dependent coordinates, which follow those of q.
        rates = [change(mechanism, port, a, d) for port, a, d in zip(free, x, directions, strict=False)]
        if mechanism.takes_dependent:
            rates += _follower_rates(mechanism, x[0], rates[0], x[-1])
        stepped = [a + 1j * _COMPLEX_STEP * d for a, d in zip(x, rates, strict=True)]
        return [y.imag / _COMPLEX_STEP for y in generic_methods.compute_by_method(values, method, mechanism, stepped)]

    if computation.product == "jvp":
        return differentiate_along(others)
    # Gradients: tangents along each unit direction (size, *batch, *displacement), times the weights, added up.
    batch = x[0].shape[:-1]
    gradients = []
    for port in free:
        size = prod(port.displacement)
        units = np.eye(size).reshape(size, *[1] * len(batch), *port.displacement)  # a direction for each scalar
        tangents = differentiate_along([units if port is other else np.zeros(other.displacement) for other in free])
        sums = [(dy * w).reshape(size, *batch, -1).sum(axis=-1) for dy, w in zip(tangents, others, strict=True)]
        gradients.append(np.moveaxis(sum(sums), 0, -1).reshape((*batch, *port.displacement)))
    return gradients


def _follower_rates(mechanism: Mechanism, q: np.ndarray, dq: np.ndarray, dependent: np.ndarray) -> list[np.ndarray]:
    """Return the rates of the dependent coordinates.

    The others have the rates dq.
    """
    rates = generic_methods.compute_by_method(
        Computation("coordinates", 1), "recursion", mechanism, [q, dq, dependent]
    )[1]
    return [rates[..., list(closure_of(mechanism).dependent)]]


def product_magnitudes(
    mechanism: Mechanism, computation: Computation, arrays: Sequence[np.ndarray]
) -> list[np.ndarray]:
    """Return the magnitudes of gradients or tangents.

    They are those of the results, as derivatives are of the size of their terms.
    """
    values = replace(computation, product=None)
    ports = values.signature(mechanism).inputs
    x, others = arrays[: len(ports)], arrays[len(ports) :]
    sizes = magnitudes(mechanism, values, x)
    if computation.product == "jvp":
        return [*sizes]
    batch = x[0].shape[:-1]
    squares = [np.square(size * w).reshape(*batch, -1).sum(axis=-1) for size, w in zip(sizes, others, strict=True)]
    total = np.sqrt(sum(squares).astype(float))
    return [
        np.broadcast_to(total.reshape(*batch, *[1] * len(port.displacement)), (*batch, *port.displacement))
        for port in ports
        if port.is_free
    ]
