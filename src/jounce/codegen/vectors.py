"""Test vectors: states, and what a routine has to give for them by the closed form, not by the program printed."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from jounce.codegen.parametric import Parametric
from jounce.codegen.routine import OUTPUTS, Routine
from jounce.evaluation import evaluate
from jounce.mechanism import in_extended_precision
from jounce.paths import PATHS
from jounce.rates import rate_name

WORK = 200  # bodies times states: the closed form is dense
MOST = 10  # states
STEPS = 1000  # states are whole multiples of 1/STEPS: short to write, the same in every language
TOLERANCE = {False: 1e-13, True: 2e-4}  # of the test, in double and single precision


@dataclass(frozen=True, eq=False)
class Vectors:
    """Arrays (states, ...) by name: parameters, q, qd, ..., W, ..., and the outputs expected."""

    parameters: Mapping[str, np.ndarray]
    inputs: Mapping[str, np.ndarray]
    outputs: Mapping[str, np.ndarray]

    @property
    def count(self) -> int:
        """How many states there are."""
        return len(self.inputs["q"])

    def parameter_sets(self) -> Iterator[dict[str, np.ndarray]]:
        """The parameters of one state after the other."""
        return ({name: values[k] for name, values in self.parameters.items()} for k in range(self.count))


def vectors(
    robot: Parametric, routine: Routine, single: bool, count: int | None = None, method: str = "closed_form"
) -> Vectors:
    """Random states, and the outputs computed in extended precision, rounded at the end.

    For single precision the inputs are numbers of that precision.
    """
    rng = np.random.default_rng(0)
    nb = robot.origin.nb
    count = max(1, min(MOST, WORK // nb)) if count is None else count
    as_given = np.float32 if single else np.float64

    def random(*shape: int) -> np.ndarray:
        return (rng.integers(-2 * STEPS, 2 * STEPS, (count, *shape)) / STEPS).astype(as_given).astype(float)

    inputs = {array.name: random(*array.shape) for array in routine.inputs}
    parameters = {
        array.name: _near(robot.own.get(array.name), random(*array.shape)).astype(as_given).astype(float)
        for array in routine.parameters
    }
    results = (
        [_exact(robot, routine, parameters, inputs, slice(k, k + 1), method) for k in range(count)]
        if parameters
        else [_exact(robot, routine, {}, inputs, slice(None), method)]
    )
    outputs = [np.concatenate(terms).astype(float) for terms in zip(*results, strict=True)]
    return Vectors(parameters, inputs, dict(zip((array.name for array in routine.outputs), outputs, strict=True)))


def _near(own: np.ndarray | None, random: np.ndarray) -> np.ndarray:
    """Values of a parameter near its own, one that is zero or has none being between 0 and 1; three decimals each."""
    near = 0.5 + random / 4  # from 0 to 1
    if own is not None and own.dtype != object:
        near = np.where(own == 0, near, own * (0.5 + near))
    return np.round(near, 3)


def _exact(
    robot: Parametric, routine: Routine, parameters: Mapping[str, np.ndarray], inputs: Mapping[str, np.ndarray],
    states: slice, method: str,
) -> tuple[np.ndarray, ...]:  # fmt: skip
    """The outputs for some states, all of the same parameters."""
    values = {name: value[states][0].astype(np.longdouble).astype(object) for name, value in parameters.items()}
    mechanism = in_extended_precision(robot.mechanism({name: np.asarray(value) for name, value in values.items()}))
    order = len(routine.outputs) - 1
    q = [x[states].astype(np.longdouble) for name, x in inputs.items() if name.startswith("q")]
    W = [x[states].astype(np.longdouble) for name, x in inputs.items() if name.startswith(rate_name("W", 0))]
    path = PATHS[OUTPUTS[routine.name][0]][method]
    return evaluate(lambda q, W: path.law(mechanism, q, W), q, W, order, path.width(mechanism.nb))
