"""jounce: native code as users call it, and the two paths in NumPy."""

from collections.abc import Callable
from functools import partial

from benchmarks.machine import cores
from benchmarks.peers import Arrays, Call, Peer, Prepared, alone
from jounce import Robot


def of_method(method: str | None) -> Callable[[Robot, int], Prepared]:
    """`Robot.inverse_dynamics` by a method; it is looked up in each call, as users do."""

    def prepared(robot: Robot, rates: Arrays) -> Call:
        given, options = alone(rates), {} if method is None else {"method": method}
        return lambda: robot.inverse_dynamics(*given, **options)

    return lambda robot, _: lambda rates, _: prepared(robot, rates)


def _kernel(robot: Robot, order: int) -> Prepared:
    kernel = robot.compile(order=order)
    return lambda rates, _: partial(kernel, *alone(rates))


def _bound(robot: Robot, order: int) -> Prepared:
    kernel = robot.compile(order=order)
    return lambda rates, out: kernel.bind(*alone(rates), out=alone(out))


def _threaded(robot: Robot, order: int) -> Prepared:
    kernel = robot.compile(order=order)
    return lambda rates, out: partial(kernel, *rates, out=tuple(out), threads=cores())


DEFAULT = Peer("jounce: robot.inverse_dynamics", of_method(None))
NATIVE = (
    DEFAULT,
    Peer("jounce: kernel(...)", _kernel),
    Peer("jounce: kernel bound to its arrays", _bound),
    Peer(f"jounce: kernel into out=, {cores()} threads", _threaded, batches=(100_000,)),
)
PEERS = (
    *NATIVE,
    Peer("jounce: the recursion in NumPy", of_method("recursion")),
    Peer("jounce: the dense closed form in NumPy", of_method("closed_form")),
)
