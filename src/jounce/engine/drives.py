"""Compute forces of drives, and wrenches of loads.

They are no rows of the table of quantities. `drive_forces` gives the forces of drive terms alone, `regressor` a
regressor with columns of drive terms behind its own, and `wrench_of_load` the wrenches of the generalized convention
that a load on a body means, in frames of the caller's choice. Each is a law of its own, run as those of the table are:
on the tree, and closed after it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from jounce.arguments import loads, rates
from jounce.arguments.base import convert_base_motion
from jounce.arguments.rates import convert_rates
from jounce.core.errors import JounceError, door
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
from jounce.model.drive_trains import DRIVE_TERMS, LOAD_FRICTION, select_terms
from jounce.model.mechanism import Mechanism, cast_model
from jounce.spatial.series import Series, rate_name


@dataclass(frozen=True)
class BodyLoad:
    """A load on a body, as a caller gives it: force and torque, their axes, and where the force acts.

    `force` and `torque` are vectors, or tuples of them with rates. `wrench_of_load` converts and checks them.
    """

    body: str
    force: Any = None
    torque: Any = None
    frame: str = "world"
    point: Any = None


def drive_forces(mechanism: Mechanism, given: Sequence[Any], terms: Sequence[str], out: Any) -> Any:
    """Compute the forces of drive terms.

    They are computed whether or not the terms act in Q.
    """
    if LOAD_FRICTION in terms and mechanism.drives.load_friction.any():
        raise JounceError(f"{LOAD_FRICTION} of {mechanism.name!r} takes Q itself; state terms={list(DRIVE_TERMS)}")

    def law(m: Mechanism, q: Series) -> Series:
        """Return the forces (..., nv) of the terms, 0 on a base."""
        forces = drive_terms.pad_base(m, drive_terms.forces(m, q, terms), (-2,))
        return forces.map(lambda Q: Q[..., 0])

    forces = _compute_drive_part(mechanism, DEFAULT_QUANTITY.name, given, 4 * len(mechanism.joints), law)
    # Drives act on joints alone: (..., nv) -> (..., n).
    return generic_methods.write_results(tuple(Q[..., -mechanism.n :] for Q in forces), out)


def _compute_drive_part(
    mechanism: Mechanism, name: str, given: Sequence[Any], width: int, law: Callable[[Mechanism, Series], Series]
) -> tuple[Array, ...]:
    """Compute the contribution of drives to a quantity, by its law."""
    # Callers may give all coordinates of a closed robot as q: the independent ones are split off.
    row, (given_rates, whole) = find_row(name), rates.split_rates(mechanism, given)
    q = convert_rates(mechanism, given_rates, row)
    model, computation = cast_model(mechanism, q), Computation(name, len(q) - row.takes.rates)

    def law_on_tree(m: Mechanism, x: State) -> Series:
        return law(m, x.q)

    # Forces of the tree become those of the closed robot, as those of the quantity itself do.
    closed = closed_law(law_on_tree, row.gives.shape, None)
    arrays, ports = [*q, *rates.dependent_arrays(mechanism, q[0], whole)], computation.signature(model).inputs

    def run(arrays: Sequence[Array]) -> tuple[Array, ...]:
        return generic_methods.evaluate(
            lambda x: closed(model, computation.state(model, x)), ports, arrays, computation.count, width
        )

    names = row.names(computation.order)
    results = certain_digits.compute_certain_results(mechanism, computation, names, arrays, run)
    return run(arrays) if results is None else results


@door
def regressor(robot: Engine, name: str, given: Sequence[Any], drives: object, out: Any = None, **options: Any) -> Any:
    """Compute a regressor for a caller who selects drive terms, each once."""
    return compute_regressor(robot, name, given, select_terms(drives, DRIVE_TERMS), out, **options)


def compute_regressor(
    robot: Engine, name: str, given: Sequence[Any], terms: Sequence[DriveTerm], out: Any = None, **options: Any
) -> Any:
    """Compute a regressor, with columns of drive terms behind its own.

    A term may occur twice: identification takes two frictions of different smoothing velocities.
    """
    if len(terms) == 0:
        return compute(robot, name, given, out=out, **options)
    inertial_columns, m = generic_methods.as_tuple(compute(robot, name, given, **options)), robot.mechanism
    # Columns of drives are their forces for parameters of one unit each. The law has the name of the quantity.
    unit_forces: Callable[..., Series] = getattr(drive_terms, name)
    drive_columns = _compute_drive_part(
        m, name, given, len(m.joints) * m.nv * len(terms), lambda m, q: unit_forces(m, q, terms)
    )
    # Both parts may have different batch axes: drives take no wrenches and no base.
    axes = [len(find_row(name).gives.shape)] * 2
    pairs = (broadcast(pair, axes, ["Y", "drives"]) for pair in zip(inertial_columns, drive_columns, strict=True))
    return generic_methods.write_results(tuple(concatenate(pair, axis=-1) for pair in pairs), out)


def wrench_of_load(mechanism: Mechanism, given: Sequence[Any], base: Any, load: BodyLoad) -> Any:
    """Compute the wrenches W that correspond to a load on a body."""
    given_rates, whole = rates.split_rates(mechanism, given)
    q = convert_rates(mechanism, given_rates, QUANTITIES["poses"])
    place = loads.convert_load_point(load.frame, load.point, load.force)
    terms = loads.convert_load(load.force, load.torque, len(q) - 1, q)
    # Only a load in axes of the world needs the pose of a base that floats.
    moving = base is not None or (mechanism.floats and load.frame == "world")
    poses = Computation("poses", len(q) - 1, base=moving)
    C = convert_base_motion(mechanism, base, len(q), "wrench") if moving else []
    model = cast_model(mechanism, [*q, *C, *terms])
    # The terms of the load are arrays behind those of the state, before dependent coordinates.
    first, last = len(q) + len(C), len(q) + len(C) + len(terms)
    ports = list(poses.signature(model).inputs)
    ports[first:first] = [Port(f"load[{k}]", (1, 6), "load", k) for k in range(len(terms))]

    def law(arrays: Sequence[Array]) -> Series:
        """Return W with its rates, (..., nb, 6), from arrays."""
        load_with_rates = Series.of([x.swapaxes(-1, -2) for x in arrays[first:last]])
        x = poses.state(model, [*arrays[:first], *arrays[last:]])
        on_tree = replace(x, q=tree_motion(model, x))
        return load_wrench(model.tree, on_tree, load_with_rates, body=load.body, axes=load.frame, point=place)

    def run(arrays: Sequence[Array]) -> tuple[Array, ...]:
        return generic_methods.evaluate(law, ports, arrays, len(q), 6 * model.nb)

    arrays = [*q, *C, *terms, *rates.dependent_arrays(mechanism, q[0], whole)]
    # Digits are judged as those of twists, which have as many axes.
    twists, names = Computation("twists", len(q) - 1), [rate_name("W", k) for k in range(len(q))]
    results = certain_digits.compute_certain_results(mechanism, twists, names, arrays, run)
    return generic_methods.write_results(run(arrays) if results is None else results, None)
