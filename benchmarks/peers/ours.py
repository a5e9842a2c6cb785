"""jounce: native code as users call it, and the two paths in NumPy."""

from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.machine import cores
from benchmarks.peers import Call, Peer, Prepared
from jounce import Robot


def _results(found: object) -> Sequence[np.ndarray]:
    return found if isinstance(found, tuple) else (found,)  # type: ignore[return-value]


def of_method(method: str | None) -> Callable[[Robot, int], Prepared]:
    """`Robot.inverse_dynamics` by a method."""
    return lambda robot, order: lambda rates: lambda: _results(robot.inverse_dynamics(*rates, method=method))


def _kernel(robot: Robot, order: int) -> Prepared:
    kernel = robot.compile(order)
    return lambda rates: lambda: _results(kernel(*rates))


def _bound(robot: Robot, order: int) -> Prepared:
    kernel = robot.compile(order)

    def prepared(rates: Sequence[np.ndarray]) -> Call:
        given = [x[0] for x in rates] if len(rates[0]) == 1 else rates
        out = [np.empty_like(rates[0]) for _ in range(order + 1)]
        run = kernel.bind(*given, out=[x[0] for x in out] if len(rates[0]) == 1 else out)

        def call() -> Sequence[np.ndarray]:
            run()
            return out

        return call

    return prepared


def _threaded(robot: Robot, order: int) -> Prepared:
    kernel = robot.compile(order)

    def prepared(rates: Sequence[np.ndarray]) -> Call:
        out = tuple(np.empty_like(rates[0]) for _ in range(order + 1))
        return lambda: _results(kernel(*rates, out=out, threads=cores()))

    return prepared


DEFAULT = Peer("jounce: robot.inverse_dynamics", of_method(None))
PEERS = (
    DEFAULT,
    Peer("jounce: kernel(...)", _kernel),
    Peer("jounce: kernel bound to its arrays", _bound),
    Peer(f"jounce: kernel into out=, {cores()} threads", _threaded, batches=(100_000,)),
    Peer("jounce: the recursion in NumPy", of_method("recursion")),
    Peer("jounce: the dense closed form in NumPy", of_method("closed_form")),
)
