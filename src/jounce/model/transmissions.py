"""Transmissions: motors that move several joints together, ``phi = A q + phi0`` with constant A and phi0.

Wrists with parallel shafts, differentials, shoulders with cables. A motor is a joint variable of its own, of a rotor
that turns by phi and follows the joints by ``theta = G q + g``, so that limits, armature and friction are stated of it
as of any joint. Robots whose motors are not at their coordinates are closed robots: without loops all followers have
constant ratios, and nothing is solved.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from jounce.core.cures import WITHOUT_TRANSMISSIONS
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.model.drive_trains import UNDRIVEN
from jounce.model.limits import StatedLimit, limits_of_joints
from jounce.model.loops import Closure, FollowerRatios
from jounce.model.mechanism import Mechanism, with_closure


def with_named_leaders(m: Mechanism) -> Mechanism:
    """Return the robot with a joint named after each coordinate.

    The joint moves as the coordinate does, theta = q. Robots with loops or transmissions know coordinates by the names
    of joints; a robot with G may have other names.
    """
    joints, unit = list(m.joints), np.eye(m.n)
    for name, unit_row in zip(m.coordinates, unit, strict=True):
        leaders = [i for i, row in enumerate(m.G) if np.array_equal(row, unit_row) and m.g[i] == 0]
        if len(leaders) == 0:
            came = f"{m.name!r} has no joint that moves as its coordinate {quote_value(name)} does, theta = q"
            raise JounceError(f"{came}; expected coordinates that are joints, among {join_names(m.joints)}")
        # A joint that has the name already keeps it; else the first one that moves so takes it.
        same_name = [i for i in leaders if m.joints[i] == name]
        joints[same_name[0] if len(same_name) > 0 else leaders[0]] = name
    repeated = [name for name in m.coordinates if joints.count(name) > 1]
    if len(repeated) > 0:
        came = f"{m.name!r}: joint {quote_value(repeated[0])} does not move as the coordinate of this name does"
        raise JounceError(f"{came}; rename one of them")
    return m if tuple(joints) == m.joints else replace(m, joints=tuple(joints))


@dataclass(frozen=True, eq=False)
class CoupledRotor:
    """A massless rotor that follows coordinates: ``phi = ratios q + offset``."""

    name: str
    ratios: np.ndarray  # (n,)
    offset: float
    drive: Mapping[str, float] = field(default_factory=dict)  # what is stated of the parameters of `Drives`
    limits: Mapping[str, StatedLimit] = field(default_factory=dict)  # by their keys


def find_rotors(m: Mechanism) -> np.ndarray:
    """Return which bodies (nb,) are rotors that follow coordinates."""
    is_rotor = np.zeros(m.nb, dtype=bool)
    for joint, body in zip(m.joints, m.owners, strict=True):
        is_rotor[body] = m.bodies[body] == f"{joint}_rotor" and not m.M[body].any()
    return is_rotor


def with_rotors(m: Mechanism, rotors: Sequence[CoupledRotor]) -> Mechanism:
    """Return the tree with rotors that follow its coordinates.

    They are on the ground or on the base.
    """
    k = len(rotors)
    drives = {key: [rotor.drive.get(key, none) for rotor in rotors] for key, none in UNDRIVEN.items()}
    limits = limits_of_joints([rotor.limits for rotor in rotors])
    return replace(
        m,
        B=np.concatenate([m.B, np.tile(np.eye(4), (k, 1, 1))]),
        X=np.concatenate([m.X, np.tile([0, 0, 1, 0, 0, 0], (k, 1))]),
        M=np.concatenate([m.M, np.zeros((k, 6, 6))]),
        parent=(*m.parent, *[0 if m.floats else -1] * k),
        owners=(*m.owners, *range(m.nb, m.nb + k)),
        G=np.concatenate([m.G, np.stack([rotor.ratios for rotor in rotors])]),
        g=np.concatenate([m.g, [rotor.offset for rotor in rotors]]),
        bodies=(*m.bodies, *(f"{rotor.name}_rotor" for rotor in rotors)),
        joints=(*m.joints, *(rotor.name for rotor in rotors)),
        limits=replace(m.limits, table=np.concatenate([m.limits.table, limits.table], axis=-1)),
        drives=replace(m.drives, **{key: np.concatenate([x, drives[key]]) for key, x in vars(m.drives).items()}),
    )


def drive_joints(m: Mechanism, motors: Sequence[int], independent: Sequence[int], weights: np.ndarray) -> Mechanism:
    """Return a tree with followers as a closed robot.

    Its joints follow by G; some of them are the coordinates. `motors` are the joints with motors, `independent` those
    whose positions are the coordinates.
    """
    leaders = list(independent)
    # theta = G q + g in terms of the leaders theta_l = G_l q + g_l: R = G G_l^-1 and r = g - R g_l.
    R, r = m.G.astype(float), m.g.astype(float)
    if not np.array_equal(R[leaders], np.eye(m.n)) or r[leaders].any():
        R = np.linalg.solve(R[leaders].T, R.T).T
        r = r - R @ r[leaders]
    following = [j for j in range(len(r)) if j not in leaders]
    # In the tree every joint is a coordinate; the closure says which of them lead.
    tree = replace(m, G=np.eye(len(m.joints)), g=np.zeros(len(m.joints)), coordinates=m.joints)
    closure = Closure(
        coordinates=m.joints,
        G=tree.G,
        g=tree.g,
        independent=tuple(leaders),
        start=np.where(np.isin(range(len(r)), leaders), 0.0, r),
        actuated=tuple(motors),
        weights=weights,
        ratios=FollowerRatios(tuple(following), R[following], r[following]),
    )
    return with_closure(tree, closure)


def describe_followers(m: Mechanism) -> tuple[str, str]:
    """Describe what makes coordinates follow others without loops, and the cure."""
    if not m.has_constant_ratios:
        return "joints that follow by polynomials", ""
    return "motors that move joints together", f"; of a file, load it with {WITHOUT_TRANSMISSIONS}"


def with_followers(m: Mechanism) -> Mechanism:
    """Return a robot without loops as a tree with followers.

    Its joints follow its coordinates by G. Of a robot with loops, or followers by polynomials, it is the tree.
    """
    c = m.closure
    if c is None or len(m.loops) > 0 or not m.has_constant_ratios:
        return m.tree
    # Rows of independent joints are unit rows; those of followers are their ratios.
    G, g = c.G[:, list(c.independent)].copy(), c.start
    G[list(c.ratios.places)] = c.ratios.F
    return replace(m.tree, G=G, g=g, coordinates=m.coordinates)
