"""Motor positions and torques of robots that have joints with two motors: a wanted stiffness goes with each state."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from jounce.arguments.rates import rates_in, rates_of
from jounce.arguments.wrenches import wrenches_of
from jounce.core.errors import JounceError, listed, one_of
from jounce.core.scalars import Array, asarray
from jounce.dynamics import elastic
from jounce.dynamics.computation import Computation, Port
from jounce.dynamics.quantities import FORCES, row_of
from jounce.dynamics.stretch import SpringInputs, elasticity_of
from jounce.engine.engine import Engine
from jounce.engine.generic import evaluate, results_into
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series, rate_name

LAWS = {"motor_positions": elastic.motor_positions, "motor_torques": elastic.motor_torques}


def compute(robot: Engine, name: str, given: Sequence[Any], stiffness: Any, wrench: Any, method: Any, out: Any) -> Any:
    """Motor positions or torques (..., m) and their rates, from q, qd, ... and S, Sd, ..."""
    m, e = robot.mechanism, elasticity_of(robot.mechanism)
    if not e.pairs:
        raise JounceError(
            "stiffness is given; expected None, as no joint has two motors: spring=AntagonisticSprings(...)"
        )
    row = row_of(name, e.more_rates)
    way = one_of("method", method or "recursion", row.methods, f"{name} of joints with two motors")
    q = rates_of(given, row.rates, m, row.input_names)
    order = len(q) - row.rates
    count = row.wrench_rates + order  # as many as of Q
    W, S = wrenches_of(m, wrench, order, q, row.wrench_rates), stiffnesses_of(m, stiffness, count)
    asked = Computation(name, order, bool(W), more_rates=e.more_rates)
    ports = [*asked.signature(m).inputs]
    ports += [Port(rate_name("stiffness", k), (len(e.pairs),), "state", k) for k in range(len(S))]

    def law(arrays: Sequence[Array]) -> Series:
        x = asked.state(m, arrays[: len(q) + len(W)])
        Q = FORCES.law(way, m)(m, x).map(lambda Q: Q[..., None])
        found = LAWS[name](m, x.q, lambda _: Q, spring_inputs(m, arrays[len(q) + len(W) :]))
        return found.map(lambda x: x[..., 0])

    return results_into(evaluate(law, ports, [*q, *W, *S], order + 1, 36 * m.nb), out)


def stiffnesses_of(m: Mechanism, given: Any, count: int) -> list[np.ndarray]:
    """S, Sd, ... (..., k) of the k joints with two motors, by name or in their order: `count` of them."""
    names = [m.coordinates[j] for j in elasticity_of(m).pairs]
    if given is None:
        raise JounceError(f"stiffness is None; expected the stiffness of the joints with two motors: {listed(names)}")
    terms = rates_in(given)
    terms = (given,) if terms is None else terms
    if len(terms) < count:
        takes = ", ".join(rate_name("S", k) for k in range(count))
        raise JounceError(f"stiffness has {len(terms)} terms; expected a tuple ({takes}), one for each rate of Q")
    return [_of_joints(term, names, rate_name("stiffness", k)) for k, term in enumerate(terms[:count])]


def spring_inputs(m: Mechanism, S: Sequence[Array]) -> SpringInputs:
    """What decides the deflections together with the forces, from S, Sd, ... (..., k)."""
    pairs = elasticity_of(m).pairs
    return SpringInputs(stiffness={j: Series.of([s[..., i : i + 1, None] for s in S]) for i, j in enumerate(pairs)})


def _of_joints(given: Any, names: Sequence[str], label: str) -> np.ndarray:
    if isinstance(given, Mapping):
        for name in given:
            one_of("joint with two motors", name, names)
        if lacking := [name for name in names if name not in given]:
            raise JounceError(f"{label} has no joint {listed(lacking)}; expected {listed(names)}")
        parts = np.broadcast_arrays(*(asarray(given[name], label) for name in names))
        return np.stack(parts, axis=-1)
    array = np.asarray(asarray(given, label))
    array = np.broadcast_to(array, (len(names),)) if array.ndim == 0 else array
    if array.shape[-1] != len(names):
        raise JounceError(f"{label} has shape {array.shape}; expected (..., {len(names)}), for {listed(names)}")
    return array
