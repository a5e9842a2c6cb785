"""Pinocchio's recursive Newton-Euler algorithm: exact at order 0, differentiated numerically beyond."""

from functools import partial
from math import factorial

import numpy as np

from benchmarks.peers import Arrays, Call, MissingError, Peer, Prepared, alone
from jounce import Robot
from jounce.spatial.lie import hat, position, rotation

STEP = 2.0**-6  # s; near the best for Q2d of these states
WEIGHTS = (  # of the values at t + j STEP, j = -2 .. 2: for Q itself, Qd and Q2d; error O(STEP^4)
    (0, 0, 1, 0, 0),
    tuple(w / (12 * STEP) for w in (1, -8, 0, 8, -1)),
    tuple(w / (12 * STEP**2) for w in (-1, 16, -30, 16, -1)),
)


def _model(robot: Robot):  # type: ignore[no-untyped-def]
    """The robot in Pinocchio: joints about the z axes of their bodies."""
    import pinocchio

    m = robot.mechanism
    if not np.array_equal(m.X, np.tile([0, 0, 1, 0, 0, 0], (m.nb, 1))):
        raise MissingError("only joints about z axes are handed over")
    model = pinocchio.Model()
    model.gravity.linear = np.array(robot.gravity)
    for i, (B, M, p) in enumerate(zip(m.B, m.M, m.parent, strict=True)):
        mass, c = M[3, 3], np.array([M[2, 4], M[0, 5], M[1, 3]]) / M[3, 3]
        inertia = pinocchio.Inertia(mass, c, M[:3, :3] + mass * hat(c) @ hat(c))
        frame = pinocchio.SE3(np.array(rotation(B), dtype=float), np.array(position(B)[:, 0], dtype=float))
        joint = model.addJoint(p + 1, pinocchio.JointModelRZ(), frame, f"joint{i}")
        model.appendBodyToJoint(joint, inertia, pinocchio.SE3.Identity())
    return model


def _exact(robot: Robot, order: int) -> Prepared:
    import pinocchio

    model = _model(robot)
    data = model.createData()

    def prepared(rates: Arrays, _: Arrays) -> Call:
        if len(rates[0]) == 1:
            return partial(pinocchio.rnea, model, data, *alone(rates))
        return lambda: np.array([pinocchio.rnea(model, data, *state) for state in zip(*rates, strict=True)])

    return prepared


def _differences(robot: Robot, order: int) -> Prepared:
    import pinocchio

    model = _model(robot)
    data, weights = model.createData(), np.array(WEIGHTS[: order + 1])

    def differentiated(rates: Arrays) -> Arrays:
        around = [
            [sum(x * (j * STEP) ** k / factorial(k) for k, x in enumerate(rates[i:])) for j in range(-2, 3)]
            for i in range(3)
        ]
        Q = [[pinocchio.rnea(model, data, *s) for s in zip(*at, strict=True)] for at in zip(*around, strict=True)]
        return list(np.einsum("kj,jsn->ksn", weights, np.array(Q)))

    return lambda rates, _: partial(differentiated, rates)


PEERS = (
    Peer("pin.rnea, called from Python (order 0 only)", _exact, orders=(0,)),
    Peer("five-point differences of pin.rnea", _differences, orders=(1, 2)),
)
