"""Check the contacts of a floating robot as a caller states them."""

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
from jounce.model.transmissions import describe_followers
from jounce.spatial.series import Series

MAX_BALANCE_CONDITION = 1e4  # of G, moments in sizes of the robot: it enters squared, half of the digits are left
_SAMPLES = 3  # of positions: what is not balanced at any of them is not balanced


def with_contacts(mechanism: Mechanism, contacts: object) -> Mechanism:
    """Return the robot on contacts.

    Raises `JounceError` unless they can balance what moves its base.
    """
    name, stated_contacts = quote_value(mechanism.name), as_list(contacts)
    if not mechanism.floats:
        raise JounceError(f"{name} does not float, as what stands on contacts does; load it with {FLOATING_BASE}")
    if mechanism.closure is not None or mechanism.elasticity is not None:
        has, cure = "closed loops" if len(mechanism.loops) > 0 else "elastic joints", ""
        if mechanism.closure is not None and len(mechanism.loops) == 0:
            has, cure = describe_followers(mechanism)
        raise JounceError(f"{name} has {has}; contacts take a tree of rigid joints{cure}")
    positions.check_single_screws(mechanism, "contacts")
    for contact in stated_contacts:
        if not isinstance(contact, Contact):
            raise JounceError(f"contacts holds {quote_value(contact)}; expected a list of jounce.Contact(frame, kind)")
        check_choice("frame of a contact", contact.frame, mechanism.frame_names)
        if mechanism.frame(contact.frame).body < 0:
            raise JounceError(f"frame {quote_value(contact.frame)} is on the ground; expected one that moves")
    standing = replace(mechanism, contacts=tuple(stated_contacts))
    if len(stated_contacts) == 0 or not all(map(is_numeric, (mechanism.B, mechanism.X, mechanism.G, mechanism.g))):
        return standing
    # Contacts that balance no position of a few balance none: two points, for example, leave the moment about the line
    # between them.
    q = np.random.default_rng(0).uniform(-1, 1, (_SAMPLES, mechanism.n))
    unbalanced, directions = find_unbalanced(standing, balance_maps(standing, q))
    if len(unbalanced) == _SAMPLES:
        frames = join_names(contact.frame for contact in stated_contacts)
        what = describe_direction(standing, directions[0])
        raise JounceError(f"{name}: contacts at {frames} never balance {what}; state more contacts, or planes")
    return standing


def refuse_contacts(mechanism: Mechanism, what: str) -> None:
    """Raise `JounceError` if a robot stands on contacts.

    `what` says what only robots without contacts have.
    """
    if len(mechanism.contacts) > 0:
        name = quote_value(mechanism.name)
        raise JounceError(f"{name} has contacts, and {what}{Remedy('; robot.contacts([]) is the robot without them')}")


def balance_maps(m: Mechanism, q: np.ndarray, base: np.ndarray | None = None) -> np.ndarray:
    """Return G (N, 6, k) at positions (N, n) of the robot.

    `base` are the poses of its base, which matter where contacts are points.
    """
    moving = JointMotion(np.eye(4) if base is None else base, Series.constant(np.zeros((6, 1))))
    G = Stance(m, State(Series.of([q[..., None]]), base=moving)).G[0]
    return np.broadcast_to(G, (len(q), *G.shape[-2:]))


def wrench_sizes(m: Mechanism) -> np.ndarray:
    """Return the sizes (6,) by which components of a wrench become forces.

    Moments are divided by the size of the robot, forces by 1.
    """
    return np.repeat([robot_size(m), 1.0], 3)


def moment_sizes(m: Mechanism) -> np.ndarray:
    """Return these sizes (k,) for the components that contacts transmit."""
    return np.concatenate([wrench_sizes(m)[contact.held] for contact in m.contacts])


def find_unbalanced(m: Mechanism, G: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the states in which contacts hardly balance the base, and twists.

    The wrench that is not balanced does work on the twist. Moments are in sizes of the robot, so that N are not
    compared with N m; twists turn by rad, or slide by sizes.
    """
    G = G * moment_sizes(m) / wrench_sizes(m)[:, None]
    # States that are NaN are left out: what follows from them is NaN too.
    is_missing = ~np.isfinite(G).all(axis=(1, 2), keepdims=True)
    # A wrench on the base is balanced where G (6, k) has rank 6; the last left singular vector is the weakest twist.
    U, sizes, _ = np.linalg.svd(np.where(is_missing, np.eye(*G.shape[1:]), G))
    smallest = sizes[:, 5] if sizes.shape[1] == 6 else 0 * sizes[:, 0]
    unbalanced = np.flatnonzero((smallest * MAX_BALANCE_CONDITION < sizes[:, 0]) & ~is_missing[:, 0, 0])
    return unbalanced, U[unbalanced, :, 5]


def describe_direction(m: Mechanism, twist: np.ndarray) -> str:
    """Return in words the moment or force that works on a twist.

    The twist is that of the base, and slides by sizes of the robot.
    """
    (w, v), size = np.split(twist, 2), np.linalg.norm(twist[:3])
    turns = size * MAX_BALANCE_CONDITION > 1
    # A twist that turns has an axis, along w and through the point w x v / |w|^2; one that slides has a direction.
    pair = (w / size, np.cross(w, v) / size**2) if turns else (v,)
    lengths = 1.0, robot_size(m)
    rounded = [vector.round(9) * length + 0.0 for vector, length in zip(pair, lengths, strict=False)]
    axis, *through = (f"({', '.join(f'{x:.3g}' for x in vector)})" for vector in rounded)
    what = f"the moment about the axis {axis} through {through[0]}" if turns else f"the force along {axis}"
    return f"{what}, in the axes of the base"
