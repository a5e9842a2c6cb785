"""The contacts of a floating robot as a caller states them, checked."""

from dataclasses import replace

import numpy as np

from jounce.core.errors import JounceError, check_choice, join_names, quote_value
from jounce.core.scalars import is_numeric
from jounce.dynamics.contacts import Stance
from jounce.dynamics.joint_motion import JointMotion
from jounce.dynamics.state import State
from jounce.model.contacts import Contact
from jounce.model.mechanism import Mechanism
from jounce.model.positions import check_single_screws
from jounce.spatial.series import Series

BALANCE_RANK_TOLERANCE = 1e-9  # of singular values, as places have nine digits; moments count per metre
_SAMPLES = 3  # of positions: what is not balanced at any of them is not balanced


def with_contacts(mechanism: Mechanism, contacts: object) -> Mechanism:
    """The robot on contacts; raise `JounceError` unless they can balance what moves its base."""
    name = quote_value(mechanism.name)
    if not mechanism.floats:
        raise JounceError(f"{name} does not float, so its contacts are not known to balance anything; load it with base='floating'")
    if mechanism.closure or mechanism.elasticity:
        raise JounceError(f"{name} has {'closed loops' if mechanism.closure else 'elastic joints'}; contacts take a tree of rigid joints")
    check_single_screws(mechanism, "contacts")
    given = list(contacts) if isinstance(contacts, list | tuple) else [contacts]
    for contact in given:
        if not isinstance(contact, Contact):
            raise JounceError(f"contacts holds {quote_value(contact)}; expected a list of jounce.Contact(frame, kind)")
        check_choice("frame of a contact", contact.frame, mechanism.frame_names)
        if mechanism.frame(contact.frame).body < 0:
            raise JounceError(f"contact {quote_value(contact.frame)} is on the ground; expected a frame that moves with the robot")
    standing = replace(mechanism, contacts=tuple(given))
    if given and all(is_numeric(x) for x in (mechanism.B, mechanism.X, mechanism.G, mechanism.g)):
        q = np.random.default_rng(0).uniform(-1, 1, (_SAMPLES, mechanism.n))
        free = [directions for G in balance_maps(standing, q) if (directions := unbalanced_directions(G)).size]
        if len(free) == _SAMPLES:
            frames = join_names(contact.frame for contact in given)
            raise JounceError(f"{name}: contacts at {frames} never balance {describe_directions(free[0])}; state more contacts, or planes")
    return standing


def check_uncontacted(mechanism: Mechanism, what: str) -> None:
    """Raise `JounceError` if a robot that stands on contacts is to have what only others have."""
    if mechanism.contacts:
        raise JounceError(f"{quote_value(mechanism.name)} has contacts, and {what}; robot.contacts([]) is the robot without them")


def balance_maps(m: Mechanism, q: np.ndarray, base: np.ndarray | None = None) -> np.ndarray:
    """G at positions (N, n) of the robot, and poses of its base where contacts are points: (N, 6, k)."""
    C = np.eye(4) if base is None else base
    moving = JointMotion(C, Series.constant(np.zeros((6, 1))))
    G = Stance(m, State(Series.of([q[..., None]]), base=moving)).G[0]
    return np.broadcast_to(G, (len(q), *G.shape[-2:]))


def unbalanced_directions(G: np.ndarray) -> np.ndarray:
    """Twists of the base that contacts do not hinder, (r, 6): what a wrench along one of them moves, they do not balance."""
    U, sizes, _ = np.linalg.svd(G)
    return U.T[np.append(sizes, np.zeros(6 - len(sizes))) <= BALANCE_RANK_TOLERANCE * sizes[0]]


def describe_directions(directions: np.ndarray) -> str:
    """A turn or a slide of the base as words, and how many more there are."""
    w, v = directions[0, :3], directions[0, 3:]
    size = np.linalg.norm(w)
    if size > BALANCE_RANK_TOLERANCE:
        axis, through = _text(w / size), _text(np.cross(w, v) / size**2)
        text = f"the moment about the axis {axis} through {through}, in the axes of the base"
    else:
        text = f"the force along {_text(v)}, in the axes of the base"
    return text + (f", and {len(directions) - 1} more" if len(directions) > 1 else "")


def _text(x: np.ndarray) -> str:
    return f"({', '.join(f'{value + 0.0:.3g}' for value in np.where(np.abs(x) < 1e-9, 0, x))})"
