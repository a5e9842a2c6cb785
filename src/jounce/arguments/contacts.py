"""The contacts of a floating robot as a caller states them, checked."""

from dataclasses import replace

import numpy as np

from jounce.core.cures import FLOATING_BASE, Remedy
from jounce.core.errors import JounceError, as_list, check_choice, join_names, quote_value
from jounce.core.scalars import is_numeric
from jounce.dynamics.contacts import Stance
from jounce.dynamics.state import JointMotion, State
from jounce.model import positions
from jounce.model.contacts import Contact
from jounce.model.mechanism import Mechanism, robot_size
from jounce.spatial.series import Series

MAX_BALANCE_CONDITION = 1e4  # of G, moments in sizes of the robot: it enters squared, half of the digits are left
_SAMPLES = 3  # of positions: what is not balanced at any of them is not balanced


def with_contacts(mechanism: Mechanism, contacts: object) -> Mechanism:
    """The robot on contacts; raise `JounceError` unless they can balance what moves its base."""
    name, given = quote_value(mechanism.name), as_list(contacts)
    if not mechanism.floats:
        raise JounceError(f"{name} does not float, as what stands on contacts does; load it with {FLOATING_BASE}")
    if mechanism.closure or mechanism.elasticity:
        has = "closed loops" if mechanism.closure else "elastic joints"
        raise JounceError(f"{name} has {has}; contacts take a tree of rigid joints")
    positions.check_single_screws(mechanism, "contacts")
    for contact in given:
        if not isinstance(contact, Contact):
            raise JounceError(f"contacts holds {quote_value(contact)}; expected a list of jounce.Contact(frame, kind)")
        check_choice("frame of a contact", contact.frame, mechanism.frame_names)
        if mechanism.frame(contact.frame).body < 0:
            raise JounceError(f"frame {quote_value(contact.frame)} is on the ground; expected one that moves")
    standing = replace(mechanism, contacts=tuple(given))
    if given and all(map(is_numeric, (mechanism.B, mechanism.X, mechanism.G, mechanism.g))):
        q = np.random.default_rng(0).uniform(-1, 1, (_SAMPLES, mechanism.n))
        lost, directions = find_unbalanced(standing, balance_maps(standing, q))
        if len(lost) == _SAMPLES:
            frames, what = join_names(contact.frame for contact in given), describe_direction(standing, directions[0])
            raise JounceError(f"{name}: contacts at {frames} never balance {what}; state more contacts, or planes")
    return standing


def refuse_contacts(mechanism: Mechanism, what: str) -> None:
    """Raise `JounceError` if a robot that stands on contacts is to have what only others have."""
    if mechanism.contacts:
        name = quote_value(mechanism.name)
        raise JounceError(f"{name} has contacts, and {what}{Remedy('; robot.contacts([]) is the robot without them')}")


def balance_maps(m: Mechanism, q: np.ndarray, base: np.ndarray | None = None) -> np.ndarray:
    """G at positions (N, n) of the robot, and poses of its base where contacts are points: (N, 6, k)."""
    moving = JointMotion(np.eye(4) if base is None else base, Series.constant(np.zeros((6, 1))))
    G = Stance(m, State(Series.of([q[..., None]]), base=moving)).G[0]
    return np.broadcast_to(G, (len(q), *G.shape[-2:]))


def wrench_sizes(m: Mechanism) -> np.ndarray:
    """What each component (6,) of a wrench is divided by to be a force: the size of the robot, or 1."""
    return np.repeat([robot_size(m), 1.0], 3)


def moment_sizes(m: Mechanism) -> np.ndarray:
    """The same of each component (k,) that contacts transmit."""
    return np.concatenate([wrench_sizes(m)[contact.held] for contact in m.contacts])


def find_unbalanced(m: Mechanism, G: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The states in which contacts hardly balance a wrench on the base, and the twists on which this does work.

    Moments are in sizes of the robot, so that N are not compared with N m; twists turn by rad, or slide by sizes.
    """
    G = G * moment_sizes(m) / wrench_sizes(m)[:, None]
    missing = ~np.isfinite(G).all(axis=(1, 2), keepdims=True)  # NaN, as what follows from it is
    U, sizes, _ = np.linalg.svd(np.where(missing, np.eye(*G.shape[1:]), G))
    least = sizes[:, 5] if sizes.shape[1] == 6 else 0 * sizes[:, 0]
    lost = np.flatnonzero((least * MAX_BALANCE_CONDITION < sizes[:, 0]) & ~missing[:, 0, 0])
    return lost, U[lost, :, 5]


def describe_direction(m: Mechanism, twist: np.ndarray) -> str:
    """What a wrench moves that does work on a twist of the base, which slides by sizes of the robot, in words."""
    (w, v), size = np.split(twist, 2), np.linalg.norm(twist[:3])
    turns = size * MAX_BALANCE_CONDITION > 1
    pair = (w / size, np.cross(w, v) / size**2) if turns else (v,)
    lengths = 1.0, robot_size(m)
    rounded = [vector.round(9) * length + 0.0 for vector, length in zip(pair, lengths, strict=False)]
    axis, *through = (f"({', '.join(f'{x:.3g}' for x in vector)})" for vector in rounded)
    what = f"the moment about the axis {axis} through {through[0]}" if turns else f"the force along {axis}"
    return f"{what}, in the axes of the base"
