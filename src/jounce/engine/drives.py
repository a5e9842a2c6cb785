"""The contributions of drive terms: forces, and columns of regressors."""

from collections.abc import Callable, Sequence
from typing import Any

from jounce.arguments import rates
from jounce.arguments.rates import convert_rates
from jounce.core.errors import JounceError
from jounce.core.scalars import Array, broadcast, concatenate
from jounce.core.typing import DriveTerm
from jounce.dynamics import drive_terms
from jounce.dynamics.computation import Computation
from jounce.dynamics.loops import close_law as closed_law
from jounce.dynamics.quantities import DEFAULT_QUANTITY, find_row
from jounce.dynamics.state import State
from jounce.engine import certain_digits
from jounce.engine.engine import Engine
from jounce.engine.generic_methods import as_tuple, evaluate, write_results
from jounce.engine.plan import compute
from jounce.model.drives import DRIVE_TERMS, LOAD_FRICTION
from jounce.model.mechanism import Mechanism, cast_model
from jounce.spatial.series import Series


def drive_forces(mechanism: Mechanism, given: Sequence[Any], terms: Sequence[str], out: Any) -> Any:
    """Compute the forces of drive terms for given rates of the coordinates, whether or not the terms act in Q."""
    if LOAD_FRICTION in terms and mechanism.drives.load_friction.any():
        raise JounceError(f"{LOAD_FRICTION} of {mechanism.name!r} takes Q itself; state terms={list(DRIVE_TERMS)}")

    def law(m: Mechanism, q: Series) -> Series:
        forces = drive_terms.pad_base(m, drive_terms.forces(m, q, terms), (-2,))
        return forces.map(lambda Q: Q[..., 0])

    forces = _compute_drive_part(mechanism, DEFAULT_QUANTITY.name, given, 4 * len(mechanism.joints), law)
    return write_results(tuple(Q[..., -mechanism.n :] for Q in forces), out)


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
        return evaluate(lambda x: of_drives(model, asked.state(model, x)), ports, arrays, asked.count, width)

    return certain_digits.compute_certain_results(mechanism, asked, row.names(asked.order), arrays, run) or run(arrays)


def regressor(
    robot: Engine, name: str, given: Sequence[Any], terms: Sequence[DriveTerm], out: Any = None, **options: Any
) -> Any:
    """Compute a regressor for given rates of the coordinates, with columns of drive terms behind its own."""
    if not terms:
        return compute(robot, name, given, out=out, **options)
    own, m = as_tuple(compute(robot, name, given, **options)), robot.mechanism
    of_units: Callable[..., Series] = getattr(drive_terms, name)
    added = _compute_drive_part(m, name, given, len(m.joints) * m.nv * len(terms), lambda m, q: of_units(m, q, terms))
    axes = [len(find_row(name).gives.shape)] * 2
    pairs = (broadcast(pair, axes, ["Y", "drives"]) for pair in zip(own, added, strict=True))
    return write_results(tuple(concatenate(pair, axis=-1) for pair in pairs), out)
