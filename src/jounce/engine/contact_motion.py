"""Motions of a robot on contacts: whether what touches stays where it is."""

from itertools import pairwise

import numpy as np

from jounce.core.errors import JounceError, quote_value
from jounce.engine.dispatch import compute
from jounce.engine.engine import Engine
from jounce.engine.motion_states import are_present
from jounce.model.mechanism import Mechanism
from jounce.motion.motion import Motion
from jounce.spatial.lie import Ad, inverse, rotation

_CONTACT_SAMPLES = 200  # even times of a motion at which its contacts are looked at
SLIDING_TOLERANCE = 1e-3  # of the fastest body: contact wrenches then have that little power beside that of joints
_TWIST_COMPONENTS = ("about x", "about y", "about z", "along x", "along y", "along z")
_STILL = 1e-9  # rad/s and m/s: rounding of a robot at rest


def refuse_sliding(m: Mechanism, path: Motion) -> None:
    """Raise `JounceError` if a contact moves in a direction in which it transmits a force or moment."""
    t = np.concatenate([np.linspace(*ends, _CONTACT_SAMPLES) for ends in pairwise(path.stance_ends)])
    rates, base, engine = path(t, 1), path.base(t, 1), Engine(m)
    assert base is not None, m.name
    fastest = np.abs(compute(engine, "twists", rates, base=base, method="recursion")).max()
    worst = []
    for contact, present in zip(m.contacts, are_present(m, path, t).T, strict=True):
        held = contact.held
        V = compute(engine, "twists", rates, base=base, body=contact.frame, method="recursion")
        V = Ad(inverse(contact.place)) @ V[..., None]
        if contact.ground_axes is not None:
            H = compute(engine, "poses", rates[:1], base=base[:1], body=contact.frame, method="recursion")
            V = np.kron(np.eye(2), contact.ground_axes.T @ rotation(H @ contact.place)) @ V
        V = V * present[:, None, None]
        speeds = np.abs(V[:, held, 0])
        i, j = np.unravel_index(np.argmax(speeds), speeds.shape)
        far = np.abs(np.trapezoid(V[:, held[j], 0], t))
        unit = "rad" if held[j] < 3 else "m"
        name = f"{quote_value(contact.frame)} {_TWIST_COMPONENTS[held[j]]}"
        text = f"contact {name} by up to {speeds[i, j]:.3g} {unit}/s, at t = {t[i]:.6g} s, and {far:.3g} {unit} in all"
        worst.append((speeds[i, j], text))
    speed, text = max(worst)
    if speed > SLIDING_TOLERANCE * fastest + _STILL:
        raise JounceError(
            f"the motion moves {text}; contacts stay where they are. Plan the base from a foot that stays,"
            " with_base(t, C), or leave this contact out while it moves"
        )


def find_flights(m: Mechanism, motion: Motion) -> list[tuple[float, float]]:
    """The spans in which no contact is there, of a robot that has some."""
    ends = motion.stance_ends
    stands = are_present(m, motion, (ends[1:] + ends[:-1]) / 2)
    return [span for span, there in zip(pairwise(ends.tolist()), stands, strict=True) if m.contacts and not there.any()]
