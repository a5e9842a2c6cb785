"""Wrenches of the generalized convention from loads on a body, in frames of the caller's choice."""

from collections.abc import Sequence
from typing import Any

from jounce.arguments import loads, rates
from jounce.arguments.base import convert_base_motion
from jounce.arguments.rates import convert_rates
from jounce.core.scalars import Array
from jounce.dynamics.computation import Computation, Port
from jounce.dynamics.kinematics import load_wrench
from jounce.dynamics.loops import tree_motion
from jounce.dynamics.quantities import QUANTITIES
from jounce.engine import certain_digits
from jounce.engine.generic_methods import evaluate, write_results
from jounce.model.mechanism import Mechanism, cast_model
from jounce.spatial.series import Series, rate_name


def wrench_of_load(
    mechanism: Mechanism, given: Sequence[Any], base: Any, body: str, force: Any, torque: Any, frame: str, point: Any
) -> Any:
    """Compute the wrenches W that correspond to a load on a body, for given rates of the coordinates."""
    given, whole = rates.split_rates(mechanism, given)
    q = convert_rates(mechanism, given, QUANTITIES["poses"])
    place, load = loads.convert_load_point(frame, point, force), loads.convert_load(force, torque, len(q) - 1, q)
    moving = base is not None or (mechanism.floats and frame == "world")
    poses = Computation("poses", len(q) - 1, base=moving)
    C = convert_base_motion(mechanism, base, len(q), "wrench") if moving else []
    model = cast_model(mechanism, [*q, *C, *load])
    first, last = len(q) + len(C), len(q) + len(C) + len(load)  # the places of loads among the arrays
    ports = list(poses.signature(model).inputs)
    ports[first:first] = [Port(f"load[{k}]", (1, 6), "load", k) for k in range(len(load))]

    def law(arrays: Sequence[Array]) -> Series:
        terms = Series.of([x.swapaxes(-1, -2) for x in arrays[first:last]])
        x = poses.state(model, [*arrays[:first], *arrays[last:]])
        return load_wrench(model.tree, tree_motion(model, x), x.motion_of_base, terms, body, frame, place)

    def run(arrays: Sequence[Array]) -> tuple[Array, ...]:
        return evaluate(law, ports, arrays, len(q), 6 * model.nb)

    arrays = [*q, *C, *load, *rates.dependent_arrays(mechanism, q[0], whole)]
    asked, names = Computation("twists", len(q) - 1), [rate_name("W", k) for k in range(len(q))]  # as many axes
    return write_results(
        certain_digits.compute_certain_results(mechanism, asked, names, arrays, run) or run(arrays), None
    )
