"""JAX: order 0 differentiated along the motion by nested forward mode, compiled over the batch."""

from collections.abc import Callable
from typing import Any

from benchmarks.peers import Arrays, Call, Peer, Prepared
from jounce import Robot


def _differentiated(forces: Callable[..., tuple[Any, ...]]) -> Callable[..., tuple[Any, ...]]:
    """The same forces, and the time derivative of the last of them: of one more rate."""
    import jax

    def both(*rates: Any) -> tuple[Any, ...]:
        found, derivatives = jax.jvp(forces, rates[:-1], rates[1:])
        return (*found, derivatives[-1])

    return both


def _build(robot: Robot, order: int) -> Prepared:
    import jax

    jax.config.update("jax_enable_x64", True)
    forces: Callable[..., tuple[Any, ...]] = lambda *rates: (robot.inverse_dynamics(*rates, method="recursion"),)  # noqa: E731
    for _ in range(order):
        forces = _differentiated(forces)
    compiled = jax.jit(jax.vmap(forces))

    def prepared(rates: Arrays, _: Arrays) -> Call:
        given = [jax.numpy.asarray(x) for x in rates]
        return lambda: jax.block_until_ready(compiled(*given))

    return prepared


PEERS = (Peer("JAX, nested jvp of order 0, jit and vmap", _build, orders=range(3)),)
