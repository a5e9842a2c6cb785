"""Compute what callers ask of drives and of loads beyond the rows of the table.

`drive_forces` gives the forces of drive terms alone, `regressor` a regressor with columns of drive terms behind its
own, and `wrench_of_load` the wrenches of the generalized convention that a load on a body means, in frames of the
caller's choice. Each is a law of its own, run as those of the table are: on the tree, and closed after it.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from jounce.arguments import loads, rates
from jounce.arguments.base import convert_base_motion
from jounce.arguments.rates import convert_rates
from jounce.core.errors import JounceError
from jounce.core.scalars import Array, broadcast, concatenate
from jounce.core.typing import DriveTerm
from jounce.dynamics import drive_terms
from jounce.dynamics.computation import Computation, Port
from jounce.dynamics.kinematics import load_wrench
from jounce.dynamics.loops import close_law as closed_law
from jounce.dynamics.loops import tree_motion
from jounce.dynamics.quantities import DEFAULT_QUANTITY, QUANTITIES, find_row
from jounce.dynamics.state import State
from jounce.engine import certain_digits, generic_methods
from jounce.engine.engine import Engine
from jounce.engine.plan import compute
from jounce.model.drive_trains import DRIVE_TERMS, LOAD_FRICTION
from jounce.model.mechanism import Mechanism, cast_model
from jounce.spatial.series import Series, rate_name


def drive_forces(mechanism: Mechanism, given: Sequence[Any], terms: Sequence[str], out: Any) -> Any:
    """Compute the forces of drive terms for given rates of the coordinates, whether or not the terms act in Q."""
    if LOAD_FRICTION in terms and mechanism.drives.load_friction.any():
        raise JounceError(f"{LOAD_FRICTION} of {mechanism.name!r} takes Q itself; state terms={list(DRIVE_TERMS)}")

    def law(m: Mechanism, q: Series) -> Series:
        forces = drive_terms.pad_base(m, drive_terms.forces(m, q, terms), (-2,))
        return forces.map(lambda Q: Q[..., 0])

    forces = _compute_drive_part(mechanism, DEFAULT_QUANTITY.name, given, 4 * len(mechanism.joints), law)
    return generic_methods.write_results(tuple(Q[..., -mechanism.n :] for Q in forces), out)


def _compute_drive_part(
    mechanism: Mechanism, name: str, given: Sequence[Any], width: int, law: Callable[[Mechanism, Series], Series]
) -> tuple[Array, ...]:
    """Compute the contribution of drives to a quantity by its law, for given rates of the coordinates."""
    row, (given, whole) = find_row(name), rates.split_rates(mechanism, given)
    q = convert_rates(mechanism, given, row)
    model, asked = cast_model(mechanism, q), Computation(name, len(q) - row.takes.rates)

    def on_tree(m: Mechanism, x: State) -> Series:
        return law(m, x.q)

    of_drives = closed_law(on_tree, row.gives.shape, None)
    arrays, ports = [*q, *rates.dependent_arrays(mechanism, q[0], whole)], asked.signature(model).inputs

    def run(arrays: Sequence[Array]) -> tuple[Array, ...]:
        return generic_methods.evaluate(
            lambda x: of_drives(model, asked.state(model, x)), ports, arrays, asked.count, width
        )

    return certain_digits.compute_certain_results(mechanism, asked, row.names(asked.order), arrays, run) or run(arrays)


def regressor(
    robot: Engine, name: str, given: Sequence[Any], terms: Sequence[DriveTerm], out: Any = None, **options: Any
) -> Any:
    """Compute a regressor for given rates of the coordinates, with columns of drive terms behind its own."""
    if not terms:
        return compute(robot, name, given, out=out, **options)
    own, m = generic_methods.as_tuple(compute(robot, name, given, **options)), robot.mechanism
    of_units: Callable[..., Series] = getattr(drive_terms, name)
    added = _compute_drive_part(m, name, given, len(m.joints) * m.nv * len(terms), lambda m, q: of_units(m, q, terms))
    axes = [len(find_row(name).gives.shape)] * 2
    pairs = (broadcast(pair, axes, ["Y", "drives"]) for pair in zip(own, added, strict=True))
    return generic_methods.write_results(tuple(concatenate(pair, axis=-1) for pair in pairs), out)


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
        on_tree = replace(x, q=tree_motion(model, x))
        return load_wrench(model.tree, on_tree, terms, body=body, axes=frame, point=place)

    def run(arrays: Sequence[Array]) -> tuple[Array, ...]:
        return generic_methods.evaluate(law, ports, arrays, len(q), 6 * model.nb)

    arrays = [*q, *C, *load, *rates.dependent_arrays(mechanism, q[0], whole)]
    asked, names = Computation("twists", len(q) - 1), [rate_name("W", k) for k in range(len(q))]  # as many axes
    return generic_methods.write_results(
        certain_digits.compute_certain_results(mechanism, asked, names, arrays, run) or run(arrays), None
    )
