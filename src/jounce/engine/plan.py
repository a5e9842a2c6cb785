"""Plan once how a robot serves calls of one form.

Problem: a call of a method may give arrays, lists, names, symbols, arrays of JAX, wrenches, a base; a robot may float,
close loops, stand on contacts. A control loop calls with arrays of one kind a thousand times a second.

Algorithm: the form of a call is its quantity, its options and the types of what it gives. The first call of a form
makes a `Plan`, which is kept with the robot: arguments are converted and checked (`arguments.convert`), and the way
that this robot needs computes (`find_way`): accelerations of robots whose mass matrix may be singular are marked where
it is; closed robots, and steep drives, take results at displaced inputs too, which determine the digits that are
certain; contacts that may not balance the base take a search for the active rows of their limits. Where native code
takes such arguments as they are, further calls go the short way: the steps that only some robots need (`_find_steps`),
then the ufunc of the kernel.

Invariants: the short way gives what the long one gives, to the last bit, or nothing; then the long way computes, or
explains what is wrong. It depends on types alone, which are in the form; NumPy checks shapes and kinds of numbers.

Order of this file: plans, of which each call takes one; the short way, found once per form; the long way, decided once
per computation.
"""

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from types import NoneType
from typing import Any

import numpy as np

from jounce.arguments import requests
from jounce.arguments.convert import NATIVE, Conversion, Given, QuantityRequest
from jounce.core.errors import JounceError
from jounce.core.scalars import FLOAT, Array, is_numeric
from jounce.dynamics import mobility
from jounce.dynamics.computation import Computation
from jounce.engine import certain_digits, contact_limits, generic_methods
from jounce.engine.backends import Call, closing_step, is_available, run_by_backend, with_constraints
from jounce.engine.engine import Engine, with_mechanism
from jounce.model import positions
from jounce.native.kernel import Kernel
from jounce.native.laws import are_poses, is_within_tolerance, place_base, pose_of_numbers
from jounce.spatial import groups

Request = tuple[str, str | None, str, str | None, int, type]  # name, body, frame, method, threads and their type
Loads = tuple[Any, Any, Any]  # wrench, motion of the base and stiffness, as a caller gives them
Arrays = tuple[Any, ...]
Step = Callable[[Arrays], Arrays | None]  # from arrays to those of the kernel, or None: the long way
Short = Callable[[Sequence[Any], Loads, Any], Any]  # results, or None
NUMBERS = frozenset((float, int, np.float64))  # in lists: what NumPy converts as `asarray` does


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
    """Compute a quantity for given rates of the coordinates.

    It takes what a method of a robot takes, by the same keywords, for code below `Robot` that knows a quantity by name.
    """
    loads = wrench, base, stiffness
    request = name, body, frame, method, threads, type(threads)
    return serve(robot, request, kinds((*given, *loads)), given, loads, out)


def kinds(given: tuple[Any, ...]) -> tuple[type, ...]:
    """Return the types of what a call gives."""
    return tuple(map(type, given))


def serve(robot: Engine, request: Request, types: tuple[Any, ...], given: Sequence[Any], loads: Loads, out: Any) -> Any:
    """Serve a call by the plan for its form.

    The form is what is requested and the types of rates and loads. Methods of robots write them down one by one, as
    nothing else is as fast. This runs once per call; a plan is made by the first call of its form.
    """
    # The hash of an option may raise anything: such a call has a plan of its own, which is not kept.
    is_hashable = True
    try:
        plan = robot._plans.get((request, types))
    except Exception:
        plan, is_hashable = None, False
    try:
        # The first call takes the long way. A plan is kept only once a call has passed all checks.
        if plan is None:
            first = Given(given, *loads)
            plan = Plan(robot, request, first)
            results = plan.compute(robot, first, out)
            if is_hashable:
                robot._plans[request, types] = plan
            return results
        # Others take the short way, which declines what it does not compute or would refuse.
        results = plan.short(given, loads, out)
        return plan.compute(robot, Given(given, *loads), out) if results is None else results
    except JounceError as error:
        # A copy, as of `door`: users see their line, the method and this one.
        raise copy(error) from None


class Plan:
    """How one robot serves calls of one form.

    `short` computes, or declines by None; `compute` is the long way, which serves all calls or raises.
    """

    __slots__ = (
        "_conversion",
        "_may_be_short",
        "_method",
        "_threads",
        "_way",
        "short",
    )  # no robot, which keeps its plans

    def __init__(self, robot: Engine, request: Request, given: Given) -> None:
        name, body, frame, method, threads, _ = request
        m = robot.mechanism
        # Where native code may serve, loops are closed and poses of a base are made natively too.
        natively = isinstance(method, str | None) and method in (None, NATIVE) and m.is_numeric
        step = closing_step(robot) if natively else None
        pose = pose_of_numbers if natively and m.base_body is not None and is_available() else groups.FREE.pose
        self._conversion = Conversion.of(m, QuantityRequest(name, body, frame, method), given, step, pose)
        computation = self._conversion.asked
        self._way = find_way(robot, computation, method)
        self._method, self._threads = method, threads
        # The short way is prepared only once native code has served a call: it may still take too long to compile.
        self._may_be_short = natively and type(threads) is int and threads == 1 and _is_plain(robot, computation, given)
        self.short: Short = _decline

    def compute(self, robot: Engine, given: Given, out: Any) -> Any:
        """Convert and check what a caller gives, and compute."""
        computation = self._conversion.asked
        arrays = self._conversion.arrays(given)
        results = self._way(Call(robot, computation, arrays, self._method, out, self._threads))
        # Without an error, this call was served. If by a kernel, further calls take the short way.
        if self._may_be_short:
            kernel, _ = robot._kernels.known.get(computation, (None, None))
            if kernel is not None:
                self._may_be_short = False
                self.short = _find_short(robot, kernel, given)
        return results


def _decline(given: Sequence[Any], loads: Loads, out: Any) -> None:
    """Decline: the short way of plans that have none."""


def _is_plain(robot: Engine, computation: Computation, given: Given) -> bool:
    """Return whether native code alone serves plain arrays or lists."""
    m = robot.mechanism
    rate_types, load_types = set(map(type, given.rates)), set(map(type, (*_terms(given.wrench), *_terms(given.base))))
    # Names, symbols and other types take a conversion.
    if given.stiffness is not None or not rate_types <= {np.ndarray, NoneType, list} or not load_types <= {np.ndarray}:
        return False
    # Loops are closed by a native step, which takes arrays.
    if m.takes_dependent and (list in rate_types or closing_step(robot) is None):
        return False
    # These need more than one run of a kernel, or one of another robot.
    if with_constraints(robot, computation) is not m or is_searched_on_contacts(robot, computation):
        return False
    # Quaternions may be zeros, which the long way refuses.
    if len(positions.multiscrew_joints(m)) > 0:
        return False
    # Results are checked for singular M and for lost digits.
    return not needs_inverse(robot, computation) and not certain_digits.is_steep(m, computation)


def _terms(load: Any) -> tuple[Any, ...]:
    """Return the arrays of a load: a tuple is one with its rates, anything else one array."""
    if load is None:
        return ()
    return load if type(load) is tuple else (load,)


class _KernelCalls:
    """Calls that native code serves.

    Steps lead from what they give to the arrays of the kernel. `compute` runs once per call of a control loop:
    types are compared by identity, and loops are plain ones.
    """

    __slots__ = "_count", "_is_direct", "_kernel", "_rates", "_shapes", "_steps", "_ufunc"

    def __init__(self, kernel: Kernel, steps: Sequence[Step], loaded: bool) -> None:
        self._kernel, self._ufunc, self._steps = kernel, kernel.ufunc, tuple(steps)
        self._count, self._shapes = len(kernel.shapes[0]), tuple(kernel.shapes[1])
        self._rates, self._is_direct = kernel.computation.rates, not (steps or loaded)

    def compute(self, given: Sequence[Any], loads: Loads, out: Any) -> Any:
        """Compute the results, or decline by None.

        It declines what a step or NumPy refuses.
        """
        # Methods take more rates than the order needs, None for the others.
        arrays: Any = given[: self._rates]
        if not self._is_direct:
            arrays = self._prepare(arrays, loads)
            if arrays is None:
                return None
        if out is not None:
            results = self._results_into(arrays[0], out)
            if results is None:
                return None
            arrays = (*arrays, *results)
        # What NumPy refuses, the long way refuses in words. Integers beyond the floats, in lists, overflow.
        try:
            return self._ufunc(*arrays)
        except (ValueError, TypeError, OverflowError):
            return None

    def _prepare(self, rates: Sequence[Any], loads: Loads) -> Arrays | None:
        """Return the arrays of the kernel, or None."""
        wrench, base, _ = loads
        terms = _terms(wrench) + _terms(base)
        # The form of a call has the types of rates. Of a load with rates it has only that it is a tuple.
        for x in terms:
            if type(x) is not np.ndarray:
                return None
        arrays = (*rates, *terms)
        for step in self._steps:
            prepared = step(arrays)
            if prepared is None:
                return None
            arrays = prepared
        # NumPy would write into what is one too many
        return arrays if len(arrays) == self._count else None

    def _results_into(self, q: Any, out: Any) -> tuple[np.ndarray, ...] | None:
        """Return the arrays of `out`, or None where they do not fit.

        NumPy itself checks their types.
        """
        results = tuple(out) if type(out) in (tuple, list) else (out,)
        shapes = self._shapes
        if type(q) is np.ndarray and q.ndim > 1:
            shapes = tuple(q.shape[:-1] + shape for shape in shapes)
        return results if generic_methods.are_fit(results, shapes) else None


def _find_short(robot: Engine, kernel: Kernel, given: Given) -> Short:
    """Return the short way of calls that native code serves."""
    loaded = given.wrench is not None or given.base is not None
    return _KernelCalls(kernel, list(_find_steps(robot, kernel.computation, given)), loaded).compute


def _find_steps(robot: Engine, computation: Computation, given: Given) -> Iterator[Step]:
    """Yield the steps to the arrays of the kernel, in order."""
    m, whole = robot.mechanism, positions.whole_count(robot.mechanism)
    if list in map(type, given.rates):
        yield _check_lists
    if given.base is not None:
        first = computation.rates + len(_terms(given.wrench))
        yield _check_base(first, first + len(_terms(given.base)), computation.base)
    # A floating base may also be the first numbers of q, qd, ... of the whole robot.
    elif m.base_body is not None and np.shape(given.rates[0])[-1:] == (whole,):
        yield _separate_base(m.nv, whole, computation)
    if m.takes_dependent:
        yield _close_loops(robot, computation)


def _check_lists(arrays: Arrays) -> Arrays | None:
    """Decline lists of anything but numbers: NumPy would make numbers of texts."""
    for x in arrays:
        if type(x) is list and not NUMBERS.issuperset(map(type, x)):
            return None
    return arrays


def _check_base(first: int, stop: int, enters: bool) -> Step:
    """Return the step that checks the motion of a base.

    C, V, ... are the last arrays. It drops them if the base does not enter the quantity.
    """

    def step(arrays: Arrays) -> Arrays | None:
        # C has to be a pose, which native code trusts.
        if len(arrays) != stop or not are_poses(arrays[first]):
            return None
        if enters:
            return arrays
        # NumPy does not see what is dropped: wrong arrays are declined here.
        for V in arrays[first + 1 :]:
            if V.shape[-1:] != (6,) or V.dtype != FLOAT:
                return None
        return arrays[:first]

    return step


def _separate_base(nv: int, whole: int, computation: Computation) -> Step:
    """Return the step that separates the base from the state.

    The state is that of a whole robot. It does what `arguments.rates.separate_base` does.
    """
    # q has place and quaternion of the base before the joints, (..., 7 + n); qd, ... its twist, (..., 6 + n).
    base_size, coordinate_count = len(groups.FREE.positions), computation.quantity.takes.coordinates(computation.rates)

    def step(arrays: Arrays) -> Arrays | None:
        q, q_rates = arrays[0], arrays[1:coordinate_count]
        if type(q) is not np.ndarray or q.shape[-1:] != (whole,) or q.dtype != FLOAT:
            return None
        for x in q_rates:
            if type(x) is not np.ndarray or x.shape[-1:] != (nv,) or x.dtype != FLOAT:
                return None
        state = (q[..., base_size:], *[x[..., 6:] for x in q_rates], *arrays[coordinate_count:])
        if not computation.base:
            return state
        # A quaternion that is not of length 1 gives no pose.
        C, missed = place_base(q[..., :base_size])
        if not is_within_tolerance(missed):
            return None
        return (*state, C, *[x[..., :6] for x in q_rates])

    return step


def _close_loops(robot: Engine, computation: Computation) -> Step:
    """Return the step that closes loops that are nearly closed.

    It declines positions so near to singular ones that digits may be lost.
    """
    closing = closing_step(robot)
    assert closing is not None
    max_measures = closing.max_measures(certain_digits.max_condition(computation))

    def step(arrays: Arrays) -> Arrays | None:
        # All coordinates (..., N) become the independent ones, first, and the dependent ones, last.
        closed = closing.close(arrays[0], max_measures)
        return None if closed is None else (closed[0], *arrays[1:], closed[1])

    return step


Way = Callable[[Call], Any]  # from a call on checked arrays to its results


def find_way(robot: Engine, computation: Computation, method: str | None) -> Way:
    """Return how a robot computes a quantity from checked arrays."""
    if is_searched_on_contacts(robot, computation):
        return _search_on_contacts
    way = _mark_singular if needs_inverse(robot, computation) else run_by_backend
    if certain_digits.may_be_lost(robot.mechanism, computation):
        return _with_certain_digits(robot, computation, method, way)
    return way


def _search_on_contacts(call: Call) -> Any:
    return contact_limits.compute_on_contacts(call, run_by_backend)


def is_searched_on_contacts(robot: Engine, computation: Computation) -> bool:
    """Return whether a quantity needs a search on contacts.

    Wrenches within the limits of contacts are searched for, also where contacts may not balance the base at all.
    """
    m, row = robot.mechanism, computation.quantity
    return len(m.contacts) > 0 and row.on_contacts and not contact_limits.is_always_balanced(m)


def needs_inverse(robot: Engine, computation: Computation) -> bool:
    """Return whether a quantity inverts a possibly singular mass matrix."""
    m = robot.mechanism
    if not computation.quantity.inverts or not m.is_numeric:
        return False
    return mobility.may_be_singular(requests.inverted_mechanism(m, computation.name))


def _with_certain_digits(robot: Engine, computation: Computation, method: str | None, way: Way) -> Way:
    """Return the way to results that are checked for lost digits.

    They are compared with those at displaced inputs.
    """
    m, names = with_constraints(robot, computation), computation.quantity.names(computation.order)
    # The native step closes the loops of the robot itself, not those of one with other constraints.
    step = closing_step(robot) if method in (None, NATIVE) and m is robot.mechanism else None

    def compute(call: Call) -> Any:
        def run(arrays: Sequence[Array]) -> tuple[Array, ...]:
            return generic_methods.as_tuple(way(call._replace(arrays=arrays, out=None)))

        # None means that no digits can be lost at these positions: then one run, straight into `out`, is enough.
        results = certain_digits.compute_certain_results(m, computation, names, call.arrays, run, step)
        return way(call) if results is None else generic_methods.write_results(results, call.out)

    return compute


def _mark_singular(call: Call) -> Any:
    """Return results that are infinite where the mass matrix is singular.

    There its pivots are only rounding. NumPy warns of the division by zero.
    """
    results = run_by_backend(call)
    # Symbols have no pivots to look at.
    if not all(map(is_numeric, call.arrays)):
        return results
    m, computation = call.robot.mechanism, call.computation
    inverted = requests.inverted_mechanism(m, computation.name)
    plant = call.robot if inverted is m else with_mechanism(call.robot, inverted)
    # M depends on the positions alone: q first, and the dependent coordinates last.
    positions_of_call = [call.arrays[0], *(call.arrays[-1:] if m.takes_dependent else [])]
    M = run_by_backend(Call(plant, Computation("mass_matrix", 0), positions_of_call))
    # 1 at regular positions, 0 at singular ones, by which results are divided in place: (...) -> (..., 1, 1).
    regular = 1.0 - mobility.is_singular(inverted, np.asarray(call.arrays[0]), M)
    if not regular.all():
        for array, port in zip(generic_methods.as_tuple(results), computation.signature(m).outputs, strict=True):
            np.divide(array, regular.reshape(regular.shape + (1,) * len(port.shape)), out=array)
    return results
