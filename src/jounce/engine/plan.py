"""Plans: how one robot serves calls of one form, decided once and kept with the robot.

Problem: a call of a method may give arrays, lists, names, symbols, arrays of JAX, wrenches, a base; a robot may float,
close loops, stand on contacts. A control loop calls with arrays of one kind a thousand times a second.

Algorithm: the form of a call is its quantity, its options and the types of what it gives. The first call of a form
makes a `Plan`: arguments are converted and checked (`arguments.convert`), and the way that this robot needs computes
(`engine.checked_calls`). Where native code takes such arguments as they are, further calls go the short way: the steps
that only some robots need (`_find_steps`), then the ufunc of the kernel.

Invariants: the short way gives what the long one gives, to the last bit, or nothing; then the long way computes, or
explains what is wrong. It depends on types alone, which are in the form; NumPy checks shapes and kinds of numbers.
"""

from collections.abc import Callable, Iterator, Sequence
from types import NoneType
from typing import Any

import numpy as np

from jounce.arguments.convert import NATIVE, Conversion, Given, Request
from jounce.core.errors import JounceError
from jounce.core.scalars import FLOAT
from jounce.dynamics.computation import Computation
from jounce.engine import certain_digits
from jounce.engine.backends import Call, closing_step, is_available, with_constraints
from jounce.engine.checked_calls import find_way, is_searched_on_contacts, needs_inverse
from jounce.engine.engine import Engine, Form
from jounce.engine.generic_methods import is_fit
from jounce.model.positions import multiscrew_joints, whole_position_count
from jounce.native.kernel import Kernel
from jounce.native.poses import are_poses, pose_of_numbers
from jounce.spatial.groups import FREE

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
    """Compute a quantity for given rates of the coordinates, by the plan for calls of this form."""
    loads = wrench, base, stiffness
    form: Form = (name, body, frame, method, threads, type(threads), *map(type, given), *map(type, loads))
    if type(wrench) is tuple:
        form += ("wrench", *_types(wrench))
    if type(base) is tuple:
        form += ("base", *_types(base))
    try:
        plan = robot._plans.get(form)
    except Exception:  # the hash of an option may raise anything
        plan, form = None, ()
    try:
        if plan is None:
            request = Request(name, body, frame, method)
            return _serve_first(robot, form, request, Given(given, *loads), out, threads)
        found = plan.short(given, loads, out)
        return plan.compute(robot, Given(given, *loads), out) if found is None else found
    except JounceError as error:
        raise error.with_traceback(None)  # noqa: B904 - the same error, at the caller's line rather than at ours


def _serve_first(robot: Engine, form: Form, request: Request, given: Given, out: Any, threads: int) -> Any:
    """Serve the first call of a form, and keep its plan."""
    plan = Plan(robot, request, given, threads)
    results = plan.compute(robot, given, out)
    if form:
        robot._plans[form] = plan
    return results


class Plan:
    """How one robot serves calls of one form: `short` computes or declines, `compute` is the long way of all calls."""

    __slots__ = "_conversion", "_may_be_short", "_threads", "_way", "short"  # no robot, which keeps its plans

    def __init__(self, robot: Engine, request: Request, given: Given, threads: int) -> None:
        m, method = robot.mechanism, request.method
        natively = isinstance(method, str | None) and method in (None, NATIVE) and m.is_numeric
        step = closing_step(robot) if m.closure and natively else None
        pose = pose_of_numbers if m.floats and natively and is_available() else FREE.pose
        self._conversion = Conversion.of(m, request, given, step, pose)
        asked = self._conversion.asked
        self._way = find_way(robot, asked, method)
        self._threads = threads
        self._may_be_short = natively and type(threads) is int and threads == 1 and _is_plain(robot, asked, given)
        self.short: Short = _decline

    def compute(self, robot: Engine, given: Given, out: Any) -> Any:
        """Convert and check what a caller gives, and compute."""
        asked, method = self._conversion.asked, self._conversion.request.method
        arrays = self._conversion.arrays(given)
        results = self._way(Call(robot, asked, arrays, method, out, self._threads))
        if self._may_be_short:
            kernel, _ = robot._kernels.known.get(asked, (None, None))
            if kernel is not None:  # native code has served a call
                self._may_be_short = False
                self.short = _find_short(robot, kernel, given)
        return results


def _types(terms: tuple[Any, ...]) -> tuple[type, ...]:
    return tuple(map(type, terms))


def _decline(given: Sequence[Any], loads: Loads, out: Any) -> None:
    """The short way of plans that have none."""


def _is_plain(robot: Engine, asked: Computation, given: Given) -> bool:
    """Whether native code alone computes a quantity, from arrays as they are, or lists of numbers."""
    m = robot.mechanism
    types = {type(x) for x in (*given.rates, *_terms(given.wrench), *_terms(given.base))}
    if given.stiffness is not None or not types <= {np.ndarray, NoneType, list}:
        return False
    if m.takes_dependent and (list in types or closing_step(robot) is None):
        return False
    if with_constraints(robot, asked) is not m or is_searched_on_contacts(robot, asked):
        return False
    if multiscrew_joints(m):  # whose quaternions of zeros are refused
        return False
    return not needs_inverse(robot, asked) and not certain_digits.is_steep(m, asked)


def _terms(given: Any) -> tuple[Any, ...]:
    """The arrays of a load with its rates, or of one alone."""
    if given is None:
        return ()
    return given if type(given) is tuple else (given,)


class _KernelCalls:
    """Calls that give the first arrays of a kernel by position, and no others."""

    __slots__ = "_count", "_kernel", "_shapes", "_ufunc"

    def __init__(self, kernel: Kernel, count: int) -> None:
        self._kernel, self._ufunc, self._count, self._shapes = kernel, kernel.ufunc, count, kernel.shapes[1]

    def compute(self, given: Sequence[Any], loads: Loads, out: Any) -> Any:
        """Compute the results, or return None where NumPy refuses what is given."""
        results: Any = ()
        if out is not None:
            results = self._results_into(given[0], out)
            if results is None:
                return None
        try:
            return self._ufunc(*given[: self._count], *results)
        except (ValueError, TypeError, OverflowError):  # the last for integers beyond the floats, in lists
            return None

    def _results_into(self, q: Any, out: Any) -> Any:
        """The arrays of `out`, or None where they do not fit as far as NumPy does not check it."""
        into = tuple(out) if type(out) in (tuple, list) else (out,)
        batch = q.shape[:-1] if type(q) is np.ndarray else ()
        return into if is_fit(into, batch, self._shapes) else None


class _PreparedCalls(_KernelCalls):
    """Calls with loads, or on robots that take steps before their kernel."""

    __slots__ = "_rates", "_steps"

    def __init__(self, kernel: Kernel, rates: int, steps: Sequence[Step]) -> None:
        super().__init__(kernel, len(kernel.shapes[0]))
        self._rates, self._steps = rates, tuple(steps)

    def compute(self, given: Sequence[Any], loads: Loads, out: Any) -> Any:
        """Compute the results, or return None where a step or NumPy refuses what is given."""
        wrench, base, _ = loads
        arrays: Arrays = (*given[: self._rates], *_terms(wrench), *_terms(base))
        for step in self._steps:
            prepared = step(arrays)
            if prepared is None:
                return None
            arrays = prepared
        return super().compute(arrays, loads, out)


def _find_short(robot: Engine, kernel: Kernel, given: Given) -> Short:
    """The short way of calls like one that native code has served."""
    rates, steps = kernel.computation.rates, list(_find_steps(robot, kernel.computation, given))
    if steps or given.wrench is not None or given.base is not None:
        return _PreparedCalls(kernel, rates, steps).compute
    return _KernelCalls(kernel, rates).compute


def _find_steps(robot: Engine, asked: Computation, given: Given) -> Iterator[Step]:
    """The steps from what calls give to the arrays of the kernel, in their order."""
    m = robot.mechanism
    arrays = (*given.rates[: asked.rates], *_terms(given.wrench), *_terms(given.base))
    listed = [k for k, x in enumerate(arrays) if type(x) is list]
    if listed:
        yield _check_lists(listed)
    of_base = len(arrays) - len(_terms(given.base))
    if given.base is not None:
        yield _check_base(of_base, asked.base)
    elif m.floats and np.shape(given.rates[0])[-1:] == (whole_position_count(m),):
        yield _separate_base(m.nv, whole_position_count(m), asked)
    if m.takes_dependent:
        yield _close_loops(robot, asked)


def _check_lists(places: Sequence[int]) -> Step:
    """The step that declines lists of anything but numbers: NumPy would make some of texts and truths."""

    def step(arrays: Arrays) -> Arrays | None:
        for k in places:
            if not NUMBERS.issuperset(map(type, arrays[k])):
                return None
        return arrays

    return step


def _check_base(place: int, enters: bool) -> Step:
    """The step that checks the motion of a base, C, V, ..., from a place on, and drops it where it does not enter."""

    def step(arrays: Arrays) -> Arrays | None:
        if not are_poses(arrays[place]):
            return None
        if enters:
            return arrays
        for V in arrays[place + 1 :]:
            if V.shape[-1:] != (6,) or V.dtype != FLOAT:
                return None
        return arrays[:place]

    return step


def _separate_base(nv: int, whole: int, asked: Computation) -> Step:
    """The step that separates the base from the state of a whole robot, as `arguments.joints.separate_base` does."""
    behind, rates = len(FREE.positions), asked.rates
    own = asked.quantity.coordinate_inputs(rates)

    def step(arrays: Arrays) -> Arrays | None:
        q, moving = arrays[0], arrays[1:own]
        if q.shape[-1:] != (whole,) or q.dtype != FLOAT:
            return None
        for x in moving:
            if x.shape[-1:] != (nv,) or x.dtype != FLOAT:
                return None
        state = (q[..., behind:], *[x[..., 6:] for x in moving], *arrays[own:])
        if not asked.base:
            return state
        C = pose_of_numbers(q[..., :behind])
        if not are_poses(C):
            return None
        return (*state, C, *[x[..., :6] for x in moving])

    return step


def _close_loops(robot: Engine, asked: Computation) -> Step:
    """The step that closes loops that are nearly closed, far from singular positions."""
    closing, limit = closing_step(robot), certain_digits.max_condition(asked)
    assert closing is not None

    def step(arrays: Arrays) -> Arrays | None:
        found = closing.close(arrays[0], limit)
        return None if found is None else (found[0], *arrays[1:], found[1])

    return step
