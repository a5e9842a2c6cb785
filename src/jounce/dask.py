"""Compute quantities in a graph of Dask, block by block.

Arrays and data frames may be larger than memory. Arguments are checked at once, on arrays of one state; each block then
calls the function of a process (`BlockFunction`) on arrays of NumPy. Objects that many tasks share are pickled once:
every process unpickles them once and keeps them, with the native code of robots (`Pickled`).

Dask is imported by `apply`, never by this module.
"""

import pickle
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from operator import getitem
from typing import Any, Generic, TypeVar

import numpy as np

from jounce.arguments import names, requests
from jounce.arguments.convert import Given, QuantityRequest, convert_arguments
from jounce.core import errors, named_entries
from jounce.core.errors import JounceError, door
from jounce.core.typing import Frame, Method
from jounce.dynamics.quantities import QUANTITIES, find_row
from jounce.dynamics.quantities.names import QuantityName
from jounce.engine import generic_methods
from jounce.engine.engine import Engine
from jounce.engine.plan import compute
from jounce.model import positions
from jounce.model.mechanism import Mechanism

Shape = tuple[int, ...]
Pattern = int | dict[Any, Any] | tuple[Any, ...] | None  # an argument with the numbers of its arrays in their places


# A public door: its arguments are those of the methods of `Robot`, for which no object stands in between.
@door
def apply(
    robot: Engine,
    quantity: QuantityName,
    *rates: Any,
    wrench: Any = None,
    base: Any = None,
    body: str | None = None,
    frame: Frame = "body",
    method: Method | None = None,
) -> Any:
    """Compute a quantity of a robot on arrays of Dask, lazily.

    Each block is what the method of `Robot` computes. A process compiles native code once, or reads it from its cache
    on disk, and keeps it.

    Parameters
    ----------
    robot : Robot
        A robot. It is sent to other processes, functions in it included.
    quantity : str
        The name of the method: "inverse_dynamics", "mass_matrix", "jacobian", "motor_torques", ...
    *rates : (..., n)
        q, qd, ..., as the method takes them: arrays of Dask or NumPy, dicts of them by joint name, or data frames of
        Dask with a column per joint. Arrays of Dask are chunked along the batch axes, which broadcast.
    wrench : (..., nb, 6), or dict of body names to (..., 6), or tuple of such, optional
        W, Wd, ..., that the bodies exert.
    base : (..., 4, 4), or tuple of this and (..., 6), optional
        C, V, Vd, ..., the motion of the base.
    body, frame : str, optional
        Body or merged link, and frame, of poses, twists and Jacobians; all bodies by default.
    method : str, optional
        The method of the computation: "kernel", "recursion", "closed_form" or "paper".

    Returns
    -------
    array of Dask, or for orders above 0 a tuple of arrays
        The quantity and its rates as the method returns them, float64, chunked as the states are. If the states are
        data frames, results with an entry per joint are data frames with the same index.

    Raises
    ------
    JounceError
        If Dask is missing, or an argument is wrong, as in the method. Values are checked when blocks are computed.

    Examples
    --------
    >>> import dask.array as da, jounce, jounce.dask
    >>> q, qd, q2d, q3d = da.ones((4, 1_000_000, 7), chunks=(1, 100_000, 7))
    >>> Q, Qd = jounce.dask.apply(jounce.load("iiwa14"), "inverse_dynamics", q, qd, q2d, q3d)
    >>> Qd.shape, Qd.chunksize
    ((1000000, 7), (100000, 7))
    >>> Qd[:2].compute().shape
    (2, 7)
    """
    with errors.optional_import("jounce.dask needs Dask", "cluster"):
        import dask.array  # noqa: F401
    if not isinstance(robot, Engine):
        raise JounceError(f"jounce.dask.apply() expects a jounce.Robot, got {type(robot).__name__}; try jounce.load")
    # The arrays of all arguments, by number: `patterns` are the arguments with numbers in place of their arrays.
    arrays = _Arrays()
    frames = [x for x in rates if _is_frame(x)]
    columns = [_frame_columns(x, robot.mechanism, k) if _is_frame(x) else x for k, x in enumerate(rates)]
    rate_patterns = tuple(arrays.pattern(x, 1) for x in columns)
    patterns = rate_patterns, arrays.pattern_of_rates(wrench, 2, 2), arrays.pattern_of_rates(base, 2, 1)
    errors.check_choice("quantity", quantity, QUANTITIES)
    row = find_row(quantity, requests.count_more_rates(robot.mechanism, quantity))
    if len(rates) < row.takes.rates:
        takes = ", ".join(row.takes.names(row.takes.rates))
        raise JounceError(f"{quantity} of {robot.name!r} takes {takes}, and further rates; got {len(rates)} of them")
    # Check the arguments once, on arrays of one state. Positions are not known yet: NaN keep loops from being closed,
    # and rotations from being checked.
    q, W, C = (fill(pattern, arrays.samples()) for pattern in patterns)
    if robot.mechanism.takes_dependent or len(positions.multiscrew_joints(robot.mechanism)) > 0:
        q = (_missing_positions(q[0]), *q[1:])
    asked, _ = convert_arguments(robot.mechanism, QuantityRequest(quantity, body, frame, method), Given(q, W, C))
    # One task per block computes all results; further tasks take them apart.
    shapes = [port.shape for port in asked.signature(robot.mechanism).outputs]
    blocks = arrays.blocks(BlockFunction(pickle_object(robot), quantity, *patterns, body, frame, method))
    results = [_result(blocks, k, shape) for k, shape in enumerate(shapes)]
    if len(frames) > 0:
        results = [_to_frame(x, frames[0], robot) for x in results]
    return tuple(results) if len(results) > 1 else results[0]


T = TypeVar("T")


@dataclass(frozen=True)
class Pickled(Generic[T]):
    """An object as bytes.

    `value` is the same object for all tasks of a process, as long as the process uses few others.
    """

    data: bytes

    @property
    def value(self) -> T:
        """The object."""
        loaded: T = _load(self.data)
        return loaded


@dataclass(frozen=True)
class BlockFunction:
    """The function of a block.

    It puts the arrays into their places, and calls the robot that its process keeps.
    """

    robot: Pickled[Engine]
    quantity: str
    rates: Pattern
    wrench: Pattern
    base: Pattern
    body: str | None
    frame: str
    method: str | None

    def __call__(self, *arrays: np.ndarray) -> tuple[np.ndarray, ...]:
        """Compute the results of a block."""
        rates, wrench, base = (fill(pattern, arrays) for pattern in (self.rates, self.wrench, self.base))
        robot, body, frame, method = self.robot.value, self.body, self.frame, self.method
        results = compute(robot, self.quantity, rates, wrench=wrench, base=base, body=body, frame=frame, method=method)
        return generic_methods.as_tuple(results)


def _missing_positions(q: Any) -> Any:
    """Return positions, or a dict of them, that are missing."""
    return {name: x * np.nan for name, x in q.items()} if isinstance(q, dict) else q * np.nan


def fill(pattern: Pattern, arrays: Sequence[Any]) -> Any:
    """Return the argument of a pattern, filled with arrays."""
    if isinstance(pattern, dict):
        return {name: fill(x, arrays) for name, x in pattern.items()}
    if isinstance(pattern, tuple):
        return tuple(fill(x, arrays) for x in pattern)
    return None if pattern is None else arrays[pattern]


@dataclass(frozen=True)
class _Arrays:
    """The arrays of all arguments, each with the shape of one state."""

    numbered: list[tuple[Any, Shape]] = field(default_factory=list)

    def pattern(self, argument: Any, axes: int) -> Pattern:
        """Return the pattern of an argument.

        Its arrays have some axes that are not batch axes. Arrays in a dict have one of these axes less.
        """
        if argument is None:
            return None
        if not hasattr(argument, "dask") and named_entries.entry_names(argument) is not None:
            return {name: self.number(x, axes - 1) for name, x in named_entries.read_entries(argument).items()}
        return self.number(argument, axes)

    def number(self, array: Any, axes: int) -> int:
        """Return the number of an array.

        An array of Dask is one chunk along the axes that are not batch axes.
        """
        x: Any = array.to_dask_array() if hasattr(array, "to_dask_array") else array  # a column of a data frame
        lazy = hasattr(x, "dask")
        x = x if lazy else np.asarray(x)
        within = range(max(0, x.ndim - axes), x.ndim)
        if lazy and any(x.numblocks[axis] > 1 for axis in within):
            x = x.rechunk(dict.fromkeys(within, -1))
        self.numbered.append((x, tuple(x.shape[axis] for axis in within)))
        return len(self.numbered) - 1

    def pattern_of_rates(self, argument: Any, first: int, others: int) -> Pattern:
        """Return the pattern of an argument with rates.

        It may be a tuple. The first of the tuple has other axes than the rates.
        """
        if not isinstance(argument, tuple):
            return self.pattern(argument, first)
        return tuple(self.pattern(x, others if k > 0 else first) for k, x in enumerate(argument))

    def samples(self) -> list[np.ndarray]:
        """Return an array with one state for each: zeros, or the unit matrix, which is a pose."""
        samples = []
        for x, core in self.numbered:
            state = np.eye(*core, dtype=x.dtype) if len(core) == 2 else np.zeros(core, x.dtype)
            samples.append(state.reshape((1,) * (x.ndim - len(core)) + core))
        return samples

    def blocks(self, block: BlockFunction) -> Any:
        """Return an array of Dask over the batch.

        Its blocks are tuples of results.
        """
        import dask.array as da

        # Lengths of data frames may be unknown, NaN: these broadcast with anything here.
        shapes = [x.shape[: x.ndim - len(core)] for x, core in self.numbered]
        try:
            np.broadcast_shapes(*(tuple(1 if n != n else n for n in shape) for shape in shapes))
        except ValueError:
            raise JounceError(f"batch axes of shapes {', '.join(map(str, shapes))} do not broadcast") from None
        # `blockwise` takes pairs of an array and the numbers of its axes: batch axes are shared, aligned at the last
        # one, and each array has further axes of its own, which no result has.
        batch = range(max(map(len, shapes)))
        pairs: list[Any] = []
        next_axis = len(batch)
        for x, core in self.numbered:
            own_axes = range(next_axis, next_axis + len(core))
            pairs += [da.asarray(x), (*batch[len(batch) - x.ndim + len(core) :], *own_axes)]
            next_axis += len(core)
        try:
            return da.blockwise(block, tuple(batch), *pairs, concatenate=True, meta=np.empty((0,) * len(batch)))
        except ValueError as error:  # lengths of blocks may be unknown
            raise JounceError(
                f"chunks of the states do not match: {errors.one_line(error)}; rechunk them alike"
            ) from None


def _result(blocks: Any, k: int, shape: Shape) -> Any:
    """Return the k-th result of blocks of tuples.

    It has a shape for each state.
    """
    import dask.array as da

    batch = range(blocks.ndim)
    state = range(blocks.ndim, blocks.ndim + len(shape))
    meta = np.empty((0,) * (blocks.ndim + len(shape)))
    new = dict(zip(state, shape, strict=True))
    return da.blockwise(getitem, (*batch, *state), blocks, tuple(batch), k, None, new_axes=new, meta=meta)


def _is_frame(x: Any) -> bool:
    """Return whether an argument is a data frame of Dask."""
    return hasattr(x, "to_dask_array") and hasattr(x, "columns")


def _frame_columns(x: Any, mechanism: Mechanism, k: int) -> Any:
    """Return the columns of a data frame of Dask.

    They are an array in the order of the joints. It is the k-th argument: that of q has a column for each number.
    """
    joints = list(mechanism.coordinates if k else positions.names(mechanism))
    with errors.locate_errors("data frame"):
        names.check_names(list(x.columns), joints, names.find_followers(mechanism))
    return x[joints].to_dask_array()


def _to_frame(x: Any, source: Any, robot: Engine) -> Any:
    """Return a result per joint as a data frame.

    It is one of Dask; any other result stays as it is. The data frame has the index of another.
    """
    import dask.dataframe as dd

    if x.shape[1:] != (robot.n,):
        return x
    return dd.from_dask_array(x, columns=list(robot.joint_names), index=source.index)


def pickle_object(value: T) -> Pickled[T]:
    """Pickle an object, with functions that only this process knows.

    Raises `JounceError` if that is impossible.
    """
    import cloudpickle

    try:
        return Pickled(cloudpickle.dumps(value))
    except Exception as error:  # foreign types may raise anything
        raise JounceError(
            f"{type(value).__name__} cannot be sent to other processes: {errors.one_line(error)}; functions in it, such"
            " as laws of springs, may refer to what can be pickled alone"
        ) from None


@lru_cache(maxsize=32)
def _load(data: bytes) -> Any:
    return pickle.loads(data)
