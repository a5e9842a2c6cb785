"""Plans: how one robot serves calls of one form, decided once and kept with the robot.

Problem: a call of a method may give arrays, lists, names, symbols, arrays of JAX, wrenches, a base; a robot may float,
close loops, stand on contacts. A control loop calls with arrays of one kind a thousand times a second.

Algorithm: the form of a call is its quantity, its options and the types of what it gives. The first call of a form
makes a `Plan`: arguments are converted and checked (`arguments.convert`), and the way that this robot needs computes
(`find_way`): accelerations of robots whose mass matrix may be singular are marked where it is; closed robots, and steep
drives, take results at displaced inputs too, which determine the digits that are certain; contacts that may not balance
the base take a search for the active rows of their limits. Where native code takes such arguments as they are, further
calls go the short way: the steps that only some robots need (`_find_steps`), then the ufunc of the kernel.

Invariants: the short way gives what the long one gives, to the last bit, or nothing; then the long way computes, or
explains what is wrong. It depends on types alone, which are in the form; NumPy checks shapes and kinds of numbers.

Order of this file: plans, of which each call takes one; the short way, found once per form; the long way, decided once
per computation.
"""

from collections.abc import Callable, Iterator, Sequence
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

Options = tuple[str, str | None, str, str | None, int, type]  # name, body, frame, method, threads and their type
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
    """Compute a quantity for given rates of the coordinates."""
    loads = wrench, base, stiffness
    request = name, body, frame, method, threads, type(threads)
    return serve(robot, request, kinds((*given, *loads)), given, loads, out)


def kinds(given: tuple[Any, ...]) -> tuple[type, ...]:
    """The types of what a call gives."""
    return tuple(map(type, given))


def serve(robot: Engine, request: Options, types: tuple[Any, ...], given: Sequence[Any], loads: Loads, out: Any) -> Any:
    """Serve a call by the plan for its form, which its first call makes.

    The form is what is requested and the types of rates and loads. Methods of robots write them down one by one, as
    nothing else is as fast.
    """
    kept = True
    try:
        plan = robot._plans.get((request, types))
    except Exception:  # the hash of an option may raise anything
        plan, kept = None, False
    try:
        if plan is None:
            first = Given(given, *loads)
            plan = Plan(robot, request, first)
            results = plan.compute(robot, first, out)
            if kept:
                robot._plans[request, types] = plan
            return results
        found = plan.short(given, loads, out)
        return plan.compute(robot, Given(given, *loads), out) if found is None else found
    except JounceError as error:
        raise error.with_traceback(None)  # noqa: B904 - the same error, at the caller's line rather than at ours


class Plan:
    """How one robot serves calls of one form: `short` computes or declines, `compute` is the long way of all calls."""

    __slots__ = (
        "_conversion",
        "_may_be_short",
        "_method",
        "_threads",
        "_way",
        "short",
    )  # no robot, which keeps its plans

    def __init__(self, robot: Engine, request: Options, given: Given) -> None:
        name, body, frame, method, threads, _ = request
        m = robot.mechanism
        natively = isinstance(method, str | None) and method in (None, NATIVE) and m.is_numeric
        step = closing_step(robot) if natively else None
        pose = pose_of_numbers if natively and m.base_body is not None and is_available() else groups.FREE.pose
        self._conversion = Conversion.of(m, QuantityRequest(name, body, frame, method), given, step, pose)
        asked = self._conversion.asked
        self._way = find_way(robot, asked, method)
        self._method, self._threads = method, threads
        self._may_be_short = natively and type(threads) is int and threads == 1 and _is_plain(robot, asked, given)
        self.short: Short = _decline

    def compute(self, robot: Engine, given: Given, out: Any) -> Any:
        """Convert and check what a caller gives, and compute."""
        asked = self._conversion.asked
        arrays = self._conversion.arrays(given)
        results = self._way(Call(robot, asked, arrays, self._method, out, self._threads))
        if self._may_be_short:
            kernel, _ = robot._kernels.known.get(asked, (None, None))
            if kernel is not None:  # native code has served a call
                self._may_be_short = False
                self.short = _find_short(robot, kernel, given)
        return results


def _decline(given: Sequence[Any], loads: Loads, out: Any) -> None:
    """The short way of plans that have none."""


def _is_plain(robot: Engine, asked: Computation, given: Given) -> bool:
    """Whether native code alone computes a quantity, from arrays as they are, or lists of numbers."""
    m = robot.mechanism
    types, of_loads = set(map(type, given.rates)), set(map(type, (*_terms(given.wrench), *_terms(given.base))))
    if given.stiffness is not None or not types <= {np.ndarray, NoneType, list} or not of_loads <= {np.ndarray}:
        return False
    if m.takes_dependent and (list in types or closing_step(robot) is None):
        return False
    if with_constraints(robot, asked) is not m or is_searched_on_contacts(robot, asked):
        return False
    if positions.multiscrew_joints(m):  # whose quaternions of zeros are refused
        return False
    return not needs_inverse(robot, asked) and not certain_digits.is_steep(m, asked)


def _terms(given: Any) -> tuple[Any, ...]:
    """The arrays of a load with its rates, or of one alone."""
    if given is None:
        return ()
    return given if type(given) is tuple else (given,)


class _KernelCalls:
    """Calls that native code serves: rates by position, wrenches and a base, and steps from them to its arrays."""

    __slots__ = "_count", "_is_direct", "_kernel", "_rates", "_shapes", "_steps", "_ufunc"

    def __init__(self, kernel: Kernel, steps: Sequence[Step], loaded: bool) -> None:
        self._kernel, self._ufunc, self._steps = kernel, kernel.ufunc, tuple(steps)
        self._count, self._shapes = len(kernel.shapes[0]), tuple(kernel.shapes[1])
        self._rates, self._is_direct = kernel.computation.rates, not (steps or loaded)

    def compute(self, given: Sequence[Any], loads: Loads, out: Any) -> Any:
        """Compute the results, or return None where a step or NumPy refuses what is given."""
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
        try:
            return self._ufunc(*arrays)
        except (ValueError, TypeError, OverflowError):  # the last for integers beyond the floats, in lists
            return None

    def _prepare(self, rates: Sequence[Any], loads: Loads) -> Arrays | None:
        """The arrays of the kernel, or None."""
        wrench, base, _ = loads
        terms = _terms(wrench) + _terms(base)
        for x in terms:
            if type(x) is not np.ndarray:  # the form states the types of rates alone
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
        """The arrays of `out`, or None where they do not fit as far as NumPy does not check it."""
        results = tuple(out) if type(out) in (tuple, list) else (out,)
        shapes = self._shapes
        if type(q) is np.ndarray and q.ndim > 1:
            shapes = tuple(q.shape[:-1] + shape for shape in shapes)
        return results if generic_methods.are_fit(results, shapes) else None


def _find_short(robot: Engine, kernel: Kernel, given: Given) -> Short:
    """The short way of calls like one that native code has served."""
    loaded = given.wrench is not None or given.base is not None
    return _KernelCalls(kernel, list(_find_steps(robot, kernel.computation, given)), loaded).compute


def _find_steps(robot: Engine, asked: Computation, given: Given) -> Iterator[Step]:
    """The steps from what calls give to the arrays of the kernel, in their order."""
    m, whole = robot.mechanism, positions.whole_count(robot.mechanism)
    if list in map(type, given.rates):
        yield _check_lists
    if given.base is not None:
        first = asked.rates + len(_terms(given.wrench))
        yield _check_base(first, first + len(_terms(given.base)), asked.base)
    elif m.base_body is not None and np.shape(given.rates[0])[-1:] == (whole,):
        yield _separate_base(m.nv, whole, asked)
    if m.takes_dependent:
        yield _close_loops(robot, asked)


def _check_lists(arrays: Arrays) -> Arrays | None:
    """The step that declines lists of anything but numbers: NumPy would make some of texts."""
    for x in arrays:
        if type(x) is list and not NUMBERS.issuperset(map(type, x)):
            return None
    return arrays


def _check_base(first: int, stop: int, enters: bool) -> Step:
    """The step that checks the motion of a base, C, V, ..., the last arrays, and drops it where it does not enter."""

    def step(arrays: Arrays) -> Arrays | None:
        if len(arrays) != stop or not are_poses(arrays[first]):
            return None
        if enters:
            return arrays
        for V in arrays[first + 1 :]:
            if V.shape[-1:] != (6,) or V.dtype != FLOAT:
                return None
        return arrays[:first]

    return step


def _separate_base(nv: int, whole: int, asked: Computation) -> Step:
    """The step that separates the base from the state of a whole robot, as `arguments.rates.separate_base` does."""
    behind, own = len(groups.FREE.positions), asked.quantity.takes.coordinates(asked.rates)

    def step(arrays: Arrays) -> Arrays | None:
        q, moving = arrays[0], arrays[1:own]
        if type(q) is not np.ndarray or q.shape[-1:] != (whole,) or q.dtype != FLOAT:
            return None
        for x in moving:
            if type(x) is not np.ndarray or x.shape[-1:] != (nv,) or x.dtype != FLOAT:
                return None
        state = (q[..., behind:], *[x[..., 6:] for x in moving], *arrays[own:])
        if not asked.base:
            return state
        C, missed = place_base(q[..., :behind])
        if not is_within_tolerance(missed):
            return None
        return (*state, C, *[x[..., :6] for x in moving])

    return step


def _close_loops(robot: Engine, asked: Computation) -> Step:
    """The step that closes loops that are nearly closed, far from singular positions."""
    closing = closing_step(robot)
    assert closing is not None
    most = closing.max_measures(certain_digits.max_condition(asked))

    def step(arrays: Arrays) -> Arrays | None:
        found = closing.close(arrays[0], most)
        return None if found is None else (found[0], *arrays[1:], found[1])

    return step


Way = Callable[[Call], Any]  # from a call on checked arrays to its results


def find_way(robot: Engine, asked: Computation, method: str | None) -> Way:
    """How a robot computes a quantity from checked arrays."""
    if is_searched_on_contacts(robot, asked):
        return lambda call: contact_limits.compute_on_contacts(call, run_by_backend)
    way = _mark_singular if needs_inverse(robot, asked) else run_by_backend
    if certain_digits.may_be_lost(robot.mechanism, asked):
        return _with_certain_digits(robot, asked, method, way)
    return way


def is_searched_on_contacts(robot: Engine, asked: Computation) -> bool:
    """Whether active rows of limits of contacts are sought for a quantity, or contacts may not balance the base."""
    m, row = robot.mechanism, asked.quantity
    return bool(m.contacts) and row.on_contacts and not contact_limits.is_always_balanced(m)


def needs_inverse(robot: Engine, asked: Computation) -> bool:
    """Whether a quantity takes the inverse of a mass matrix that may be singular at some positions."""
    m = robot.mechanism
    return (
        asked.quantity.inverts and m.is_numeric and mobility.may_be_singular(requests.inverted_mechanism(m, asked.name))
    )


def _with_certain_digits(robot: Engine, asked: Computation, method: str | None, way: Way) -> Way:
    """The way to results that are compared with those at displaced inputs where digits may be lost."""
    m, names = with_constraints(robot, asked), asked.quantity.names(asked.order)
    step = closing_step(robot) if method in (None, NATIVE) and m is robot.mechanism else None

    def compute(call: Call) -> Any:
        def run(arrays: Sequence[Array]) -> tuple[Array, ...]:
            return generic_methods.as_tuple(way(call._replace(arrays=arrays, out=None)))

        results = certain_digits.compute_certain_results(m, asked, names, call.arrays, run, step)
        return way(call) if results is None else generic_methods.write_results(results, call.out)

    return compute


def _mark_singular(call: Call) -> Any:
    """Results with infinite entries, and NumPy's warning, where pivots of the mass matrix are only rounding."""
    found = run_by_backend(call)
    if not all(map(is_numeric, call.arrays)):
        return found
    m, asked = call.robot.mechanism, call.computation
    inverted = requests.inverted_mechanism(m, asked.name)
    plant = call.robot if inverted is m else with_mechanism(call.robot, inverted)
    at = [call.arrays[0], *(call.arrays[-1:] if m.takes_dependent else [])]
    M = run_by_backend(Call(plant, Computation("mass_matrix", 0), at))
    regular = 1.0 - mobility.is_singular(inverted, np.asarray(call.arrays[0]), M)
    if not regular.all():
        for array, port in zip(generic_methods.as_tuple(found), asked.signature(m).outputs, strict=True):
            np.divide(array, regular.reshape(regular.shape + (1,) * len(port.shape)), out=array)
    return found
