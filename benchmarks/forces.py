"""Q, Qd, ... of the iiwa by every peer, of a general arm by jounce, of smaller robots; batches of several sizes."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from benchmarks.measure import LONGEST, Case, roughly
from benchmarks.peers import Arrays, Call, Peer, casadi, folder, generated, jax, ours, pinocchio, skidy
from benchmarks.robots import ARMS, load, start_of_iiwa, states
from jounce import JounceError, Robot
from jounce.core.errors import one_line

PEERS = (*ours.PEERS, *generated.PEERS, *casadi.PEERS, *folder.PEERS, *jax.PEERS, *pinocchio.PEERS)
SMALL_PEERS = (ours.DEFAULT, *generated.PEERS, *skidy.PEERS)
SMALL = (2, 3)  # joints
ORDERS, BATCHES = range(5), (1, 1_000, 100_000)
WRONG = 1e-5  # differentiating numerically leaves less; whoever is further off computes something else
COMPARED = 20  # states, with the closed form


@dataclass
class Gathered:
    """What there is to measure, how far the highest rates are from the closed form's, and what is left out."""

    cases: list[Case] = field(default_factory=list)
    errors: dict[tuple[str, str, int], float] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)


def gathered() -> Gathered:
    """Every peer on the iiwa, ours on a general arm, some on the iiwa's first joints.

    They are keyed (robot, name, order, states), the robot one of `ARMS`, or "first 2" and so on.
    """
    found = Gathered()
    for arm, peers in zip(ARMS, (PEERS, ours.NATIVE), strict=True):
        for peer in peers:
            _gather(found, arm, load(arm), peer, ORDERS, BATCHES)
    for n in SMALL:
        for peer in SMALL_PEERS:
            _gather(found, f"first {n}", start_of_iiwa(n), peer, (2,), (1_000,))
    return found


def _gather(found: Gathered, key: str, robot: Robot, peer: Peer, orders: Iterable[int], batches: Iterable[int]) -> None:
    for order in orders:
        if order not in peer.orders:
            continue
        try:
            prepared = peer.build(robot, order)
        except (JounceError, ImportError) as error:
            found.left_out.append(f"{peer.name}: {one_line(error)}")
            return
        expected = 0.0  # s; large batches take as long as their size says
        for count in batches:
            if count not in peer.batches:
                continue
            if expected * count > LONGEST:
                break
            rates = states(robot.n, count, order)
            out = [np.empty_like(rates[0]) for _ in range(order + 1)]
            call = prepared(rates, out)
            results = computed(call, out)  # a first call, which compiles
            error = _error(robot, rates, results, peer.name)
            found.errors[key, peer.name, order] = max(error, found.errors.get((key, peer.name, order), 0.0))
            took = roughly(call)
            if took > LONGEST:
                break
            expected = took / count if count >= 1_000 else 0.0
            found.cases.append(Case((key, peer.name, order, count), call, count))


def computed(call: Call, out: Arrays) -> Arrays:
    """What a call computes, returned or written into `out`: each (states, n)."""
    found = call()
    found = out if found is None else found if isinstance(found, tuple | list) else [found]
    return [np.reshape(x, out[0].shape) for x in found]


def _error(robot: Robot, rates: Arrays, results: Arrays, name: str) -> float:
    """Of the highest rate: the largest difference to the closed form, as a share of its largest value."""
    exact = robot.inverse_dynamics(*(x[:COMPARED] for x in rates), method="closed_form")
    highest = exact[-1] if isinstance(exact, tuple) else exact
    error = float(np.abs(results[-1][:COMPARED] - highest).max() / np.abs(highest).max())
    if not error < WRONG:
        raise JounceError(f"{name}: its results are {error:.1g} from those of the closed form")
    return error
