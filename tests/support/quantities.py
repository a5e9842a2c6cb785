"""Every quantity of the table as tests ask for it: of all bodies, of one, of a merged link, in every frame."""

from dataclasses import replace

import numpy as np

import jounce
from jounce.dynamics.quantities import QUANTITIES
from jounce.dynamics.quantities.row import CLOSED, ON_CONTACTS
from jounce.model.drive_trains import AMOUNTS, DRIVE_TERMS
from jounce.model.frame import Frame
from support.robots import random_mechanism, random_pose, springs


def requests():
    """(quantity, keywords): what may be asked of every quantity."""
    own = [  # have tests of their own
        row
        for row in QUANTITIES.values()
        if CLOSED in row.needs or ON_CONTACTS in row.needs or row.name == "feedback_linearization"
    ]
    for quantity in (row for row in QUANTITIES.values() if row not in own):
        for body in (None, "body3", "tool", "stand") if quantity.of_bodies else (None,):
            for frame in quantity.gives.frames or (None,):
                chosen = {"body": body, "frame": frame}
                yield quantity, {key: value for key, value in chosen.items() if value is not None}


def ids(asked):
    return [":".join([quantity.name, *keywords.values()]) for quantity, keywords in asked]


def rate_of(quantity, below, above):
    """The time derivative of a result, from it and from the next one.

    Partial derivatives of the next rate are those of the rate, and have one more: d(dx/dt)/dq^(j) = d/dt (dx/dq^(j)) +
    dx/dq^(j - 1).
    """
    if "rates" not in quantity.gives.shape:
        return above
    np.testing.assert_array_equal(above[-1], below[-1])
    return above[:-1] - np.concatenate([0 * below[:1], below[:-1]])


def affordable(quantity, order, partials=0):
    """The order to which a test asks for a quantity: partial derivatives and regressors take long to compile."""
    large = {"rates", "parameters"} & set(quantity.gives.shape)
    return min(partials, quantity.highest(order)) if large else quantity.highest(order)


def tupled(x):
    """The results of a quantity, of which one alone is an array."""
    return x if isinstance(x, tuple) else (x,)


REQUESTS = list(requests())
IDS = ids(REQUESTS)


def served(robot, quantity):
    """The robot, or one with springs at all joints where the quantity needs these."""
    e = robot.mechanism.elasticity
    if not quantity.obstacle(robot.mechanism):
        return robot
    soft = replace(e, stiffness=np.where(e.is_rigid, 4000.0, e.stiffness))
    return jounce.Robot(replace(robot.mechanism, elasticity=soft))


def rigid(robot):
    """The robot with rigid joints."""
    return jounce.Robot(replace(robot.mechanism, elasticity=None))


def branched(parent=(-1, 0, 1, 0, -1)):
    """A forest with all kinds of joints, one of which follows another, drives, springs, and merged links."""
    rng, nb = np.random.default_rng(5), len(parent)
    kinds = ["revolute", "helical", "prismatic", "revolute", "revolute"]
    m = random_mechanism(rng, list(parent), kinds[:nb], [1, 2, 3, 1, 0.5][:nb], mimic=True)
    drives = {name: rng.uniform(0.1, 1, nb) for name in (*(AMOUNTS[term] for term in DRIVE_TERMS), "rest")}
    drives["stribeck_velocity"] = np.ones(nb)
    data = {"gravity": m.gravity, "G": m.G, "g": m.g, "drives": drives}
    robot = jounce.Robot.from_screws(m.B, m.X, m.M, m.parent, **data)
    frames = (Frame("tool", nb - 2, random_pose(rng)), Frame("stand", -1, random_pose(rng)))
    driven = robot.with_drives(eps=0.5).mechanism
    return jounce.Robot(replace(driven, frames=frames, elasticity=springs(driven.n)))
