"""Motions of a robot on contacts: whether what touches stays where it is."""

from itertools import pairwise

import numpy as np

from jounce.core.errors import JounceError, quote_value
from jounce.dynamics.quantities import QUANTITIES
from jounce.engine.engine import Engine
from jounce.engine.motion_states import MotionStates, are_present
from jounce.engine.plan import compute
from jounce.model.coordinates import force_units
from jounce.model.mechanism import Mechanism, robot_size
from jounce.motion.motion import Motion
from jounce.spatial.lie import Ad, inverse, rotation

_CONTACT_SAMPLES, _SPACING = 200, 0.01  # even times at least, and s between them at most, at which contacts are seen
SLIDING_TOLERANCE = 1e-3  # of the fastest turn or slide of a body: contact wrenches have that little of the power
FREE_FALL_TOLERANCE = 1e-3  # of the weight, or of the largest force without any: what a base in flight may lack
_TWIST_COMPONENTS = ("about x", "about y", "about z", "along x", "along y", "along z")
_STILL = 1e-9  # rad/s, and sizes of the robot per s: rounding of a robot at rest


def _even_times(start: float, stop: float) -> np.ndarray:
    return np.linspace(start, stop, max(_CONTACT_SAMPLES, int((stop - start) / _SPACING) + 2))


def refuse_sliding(m: Mechanism, path: Motion) -> None:
    """Raise `JounceError` if a contact moves in a direction in which it transmits a force or moment."""
    t = np.concatenate([_even_times(*ends) for ends in pairwise(path.stance_ends)])
    rates, base, engine = path(t, 1), path.base(t, 1), Engine(m)
    assert base is not None, m.name
    moving = np.abs(compute(engine, "twists", rates, base=base, method="recursion"))
    fastest = np.repeat([moving[..., :3].max(), moving[..., 3:].max()], 3)
    sizes, worst = np.repeat([1.0, robot_size(m)], 3), []
    for contact, present in zip(m.contacts, are_present(m, path, t).T, strict=True):
        held = contact.held
        V = compute(engine, "twists", rates, base=base, body=contact.frame, method="recursion")
        V = Ad(inverse(contact.place)) @ V[..., None]
        if contact.ground_axes is not None:
            H = compute(engine, "poses", rates[:1], base=base[:1], body=contact.frame, method="recursion")
            V = np.kron(np.eye(2), contact.ground_axes.T @ rotation(H @ contact.place)) @ V
        V = V * present[:, None, None]
        speeds = np.abs(V[:, held, 0])
        excess = speeds - SLIDING_TOLERANCE * fastest[held] - _STILL * sizes[held]
        i, j = np.unravel_index(np.argmax(excess), excess.shape)
        far = np.abs(np.trapezoid(V[:, held[j], 0], t))
        unit = "rad" if held[j] < 3 else "m"
        name = f"{quote_value(contact.frame)} {_TWIST_COMPONENTS[held[j]]}"
        text = f"contact {name} by up to {speeds[i, j]:.3g} {unit}/s, at t = {t[i]:.6g} s, and {far:.3g} {unit} in all"
        worst.append((excess[i, j], text))
    beyond, text = max(worst)
    if beyond > 0:
        raise JounceError(
            f"the motion moves {text}; contacts stay where they are. Plan the base from a foot that stays,"
            " with_base(t, C), or project(motion), or leave this contact out while it moves"
        )


def refuse_hovering(robot: Engine, motion: Motion) -> None:
    """Raise `JounceError` if the base does not fall freely while no contact is there."""
    m, row = robot.mechanism, QUANTITIES["inverse_dynamics"]
    if not m.contacts or motion.presence is None:
        return
    even = _even_times(motion.start, motion.stop)
    t = even[~are_present(m, motion, even).any(axis=1)]
    if not t.size:
        return
    forces = np.abs(MotionStates.sample(robot, motion, t, [(row, 0)]).compute(robot, row.name)[0])
    levers = np.where(np.isin(force_units(m), ("N m",)), robot_size(m), 1.0)
    weight = float(np.linalg.norm(m.gravity) * np.asarray(m.M)[:, 3, 3].sum())
    lacks = (forces / levers)[:, :6].max(axis=1)
    if lacks.max() > FREE_FALL_TOLERANCE * (weight or (forces / levers).max()):
        raise JounceError(
            f"no contact is there at t = {t[lacks.argmax()]:.6g} s, and the base takes {lacks.max():.3g} N, or N m per"
            " size of the robot, that nothing exerts; expected a base that falls freely, or a stance with contacts"
        )
