"""Calls of a robot's methods: arguments are checked, and the first backend that accepts a call runs it."""

from collections.abc import Sequence
from types import NoneType
from typing import Any

import numpy as np

from jounce.arguments import loads, positions, requests
from jounce.arguments.base import convert_base_motion
from jounce.arguments.joints import separate_base
from jounce.arguments.rates import convert_rates
from jounce.arguments.stiffness import convert_stiffness
from jounce.core.errors import JounceError, check_choice
from jounce.core.scalars import Array, is_numeric
from jounce.dynamics.computation import Computation
from jounce.dynamics.loop_newton import NewtonStep
from jounce.dynamics.mobility import is_singular, may_be_singular
from jounce.dynamics.quantities import find_row
from jounce.engine import certain_digits, direct_methods
from jounce.engine.backends import BACKENDS, NATIVE, Call, closing_step, default_method, with_constraints
from jounce.engine.contact_limits import compute_on_contacts, is_always_balanced
from jounce.engine.engine import Engine, with_mechanism
from jounce.engine.generic_methods import as_tuple, is_fit, write_results
from jounce.model.mechanism import Mechanism
from jounce.model.positions import multiscrew_joints as of_several_screws
from jounce.native.pose_check import are_poses


def compute(
    robot: Engine,
    name: str,
    given: Sequence[Any],
    *,
    wrench: Any = None,
    base: Any = None,
    body: str | None = None,
    frame: str = "body",
    stiffness: Any = None,
    method: str | None = None,
    out: Any = None,
    threads: int = 1,
) -> Any:
    """Compute a quantity for given rates of the coordinates with the first backend that accepts the call."""
    terms: Sequence[Any] = wrench if type(wrench) is tuple else () if wrench is None else (wrench,)
    moved: Sequence[Any] = base if type(base) is tuple else () if base is None else (base,)
    form = (name, body, frame, method, type(threads), threads, *map(type, given), type(wrench), *map(type, terms))
    if moved:
        form = (*form, type(base), *map(type, moved))
    if stiffness is not None:
        form = ()  # no native code takes it
    try:  # the short way, of calls like an earlier one: NumPy itself checks shapes and kinds of numbers
        kernel, count, limit = robot._kernels.ready[form]
        arrays = (*given[:count], *terms, *moved)
        if robot.mechanism.takes_dependent:
            arrays = _with_dependent(robot, arrays, limit)
        if moved and not are_poses(moved[0]):
            raise LookupError  # NaN, or what `check_pose` refuses
        alone = type(arrays[0]) is list or arrays[0].ndim == 1  # batches load no code for one state
        if alone and not robot._kernels.forms.get(form, True):
            direct_methods.serve(robot, kernel.computation, form, len(moved))
        into = tuple(out) if type(out) in (tuple, list) else (out,)
        found = None
        if alone:
            found = kernel.attempt(*arrays) if out is None else kernel.attempt(*arrays, out=into)
        if found is not None:
            return found
        if list in form:
            raise LookupError  # NumPy would make numbers of texts and truths
        if out is None:
            return kernel.ufunc(*arrays)
        if is_fit(into, arrays[0].shape[:-1], kernel.shapes[1]):
            return kernel.ufunc(*arrays, out=into)
    except (FloatingPointError, Warning):  # where np.errstate or a filter asks for it
        raise
    except Exception:  # all other calls take the long way, which reports what is wrong
        pass
    plain = bool(form) and {type(x) for x in (*given, *terms, *moved)} <= _plain_types(robot.mechanism)
    plain = plain and type(threads) is int
    natively = isinstance(method, str | None) and method in (None, NATIVE)
    step = closing_step(robot) if robot.mechanism.closure and natively else None
    asked, given = check_arguments(robot.mechanism, name, given, wrench, base, body, frame, method, step, stiffness)
    lasting = plain and threads == 1 and not _needs_inverse(robot, asked)
    lasting = lasting and not certain_digits.is_steep(robot.mechanism, asked)
    lasting = lasting and (not robot.mechanism.contacts or is_always_balanced(robot.mechanism))
    lasting = lasting and not of_several_screws(robot.mechanism)  # quaternions of zeros are refused on the long way
    ready = form if lasting and asked.base == bool(moved) else None
    results = _run(Call(robot, asked, given, method, out, threads, ready))
    if lasting and natively and asked.base <= bool(moved) and given[0].ndim == 1:
        direct_methods.serve(robot, asked, form, len(moved))
    return results


def _plain_types(mechanism: Mechanism) -> set[type]:
    """The types of arguments that native code takes as they are: of lists, those of one state of an open robot."""
    return {np.ndarray, NoneType} if mechanism.takes_dependent else {np.ndarray, NoneType, list}


def _with_dependent(robot: Engine, arrays: Sequence[Any], limit: float) -> tuple[Any, ...]:
    """Return the arrays of a plain call of a closed robot with the independent coordinates first, the others last.

    Raises
    ------
    LookupError : if the condition number of the constraints exceeds a limit.
    """
    step, q = closing_step(robot), arrays[0]
    try:
        if step is None:
            raise LookupError
        u, d = step.close(q, limit)
    except LookupError:
        u, whole = positions.split_positions(robot.mechanism, q)
        d = positions.dependent_coordinates(robot.mechanism, u, whole, step)
        if certain_digits.displace_dependent(robot.mechanism, u, d, limit, step) is not None:
            raise
    return u, *arrays[1:], d


def check_arguments(
    mechanism: Mechanism,
    name: str,
    given: Sequence[Any],
    wrench: Any,
    base: Any,
    body: str | None,
    frame: str,
    method: str | None,
    step: NewtonStep | None = None,
    stiffness: Any = None,
) -> tuple[Computation, list[Array]]:
    """Check the arguments of a call, and return its computation and input arrays; `step` closes the loops."""
    more, moves = requests.count_more_rates(mechanism, name), base is not None or mechanism.floats
    quantity, enters = find_row(name, more), moves and requests.takes_base(name, frame)
    requests.check_existence(mechanism, name, moves)
    given, base = separate_base(mechanism, given, base, quantity)
    given, whole = positions.split_rates(mechanism, given)
    q = convert_rates(mechanism, given, quantity, more)
    order = len(q) - quantity.takes.rates
    requests.check_rates(name, order)
    W = loads.convert_wrenches(mechanism, wrench, order, q, quantity.takes.wrench_rates)
    if method is not None:
        check_choice("method", method, [*quantity.laws, NATIVE], name)
    if body is not None or frame != "body":
        requests.check_place(mechanism, name, body, frame)
    if quantity.inverts:
        requests.check_invertible(mechanism, name)
    asked = requests.cached_computation(name, order, bool(W), body, frame, more, enters)
    d = positions.dependent_arrays(mechanism, q[0], whole, step)
    if quantity.takes_stiffness:
        d = [*convert_stiffness(mechanism, stiffness, asked.loads), *d]
    if base is None and not enters:
        return asked, [*q, *W, *d]
    C = convert_base_motion(
        mechanism, base, asked.base_terms(mechanism), f"{name} of order {order}"
    )  # wrong ones never pass
    return asked, [*q, *W, *C, *d] if enters else [*q, *W, *d]


def _run(call: Call) -> Any:
    """Run a call; near singular positions, and where drives are steep, again, to determine which digits are certain."""
    robot, asked = call.robot, call.computation
    on_contacts = robot.mechanism.contacts and asked.quantity.on_contacts
    if on_contacts and not is_always_balanced(robot.mechanism):
        return compute_on_contacts(call, run_by_backend)
    if robot.mechanism.closure or certain_digits.is_steep(robot.mechanism, asked):
        m, names = with_constraints(robot, asked), asked.quantity.names(asked.order)
        step = closing_step(robot) if call.method in (None, NATIVE) and m is robot.mechanism else None

        def run(arrays: Sequence[Array]) -> tuple[Array, ...]:
            return as_tuple(run_by_backend(call._replace(arrays=arrays, out=None, form=None)))

        results = certain_digits.compute_certain_results(m, asked, names, call.arrays, run, step)
        if results is not None:
            return write_results(results, call.out)
    return run_by_backend(call)


def run_by_backend(call: Call) -> Any:
    """Run a call with the first backend that accepts it."""
    reasons = []
    for backend in BACKENDS:
        ready, refusal = backend.prepare(call)
        if refusal is None:
            found = backend.run(call, ready)
            return _mark_singular(call, found) if _needs_inverse(call.robot, call.computation) else found
        reasons += [refusal] if refusal else []
    cure = f"use method={default_method(call.computation.quantity)!r}" if call.method == NATIVE else "leave threads out"
    raise JounceError(f"{': '.join(reversed(reasons))}; {cure}")


def _needs_inverse(robot: Engine, computation: Computation) -> bool:
    """Whether a quantity takes the inverse of a mass matrix that may be singular at some positions."""
    m, name = robot.mechanism, computation.name
    return computation.quantity.inverts and m.is_numeric and may_be_singular(requests.inverted_mechanism(m, name))


def _mark_singular(call: Call, found: Any) -> Any:
    """Results with infinite entries, and NumPy's warning, where pivots of the mass matrix are only rounding."""
    m = call.robot.mechanism
    at = [call.arrays[0], *(call.arrays[-1:] if m.takes_dependent else [])]
    if not all(map(is_numeric, call.arrays)):
        return found
    plant = (
        with_mechanism(call.robot, requests.inverted_mechanism(m, call.computation.name))
        if call.computation.quantity.takes.motors
        else None
    )
    M = run_by_backend(Call(plant or call.robot, Computation("mass_matrix", 0), at, None, None, 1, None))
    regular = 1.0 - is_singular(requests.inverted_mechanism(m, call.computation.name), np.asarray(call.arrays[0]), M)
    if not regular.all():
        for array, port in zip(as_tuple(found), call.computation.signature(m).outputs, strict=True):
            np.divide(array, regular.reshape(regular.shape + (1,) * len(port.shape)), out=array)
    return found
