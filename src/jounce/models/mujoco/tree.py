"""The tree of an mjModel: its bodies as links, its joints between them.

The joints of a body act one after another: the last moves the body, those before it massless links, BODY:JOINT by name.
Bodies without a joint are welded, and so are named sites, as massless links, unless a body has their name.
"""

from pathlib import Path
from typing import Any

import numpy as np

from jounce.errors import JounceError, at
from jounce.model import tree
from jounce.model.mechanism import Mechanism
from jounce.models.mujoco import couplings, joints, outside
from jounce.models.mujoco.arrays import Arrays, arrays, distinct
from jounce.spatial import lie
from jounce.spatial.inertia import inertia_matrix


def mechanism(
    model: Any, gravity: object = None, base: str | None = None, root: str | None = None, file: Path | None = None
) -> Mechanism:
    """The mechanism of an mjModel, under its own gravity unless another is given; `file` is what messages call it."""
    m = arrays(model, file)
    with at(m.place):
        tree.check_base(base)
    if not m.joints:
        raise JounceError(f"{m.place}: no joint; expected at least one movable joint")
    mimics = couplings.mimics(m)
    links, between = _bodies(m, mimics)
    outside.warn_of(m, ties=couplings.active(m) - len(mimics), floats=base == "floating")
    own = m.gravity * m.acts("GRAVITY")
    given = own if gravity is None else gravity
    return tree.mechanism(links, between, given, m.name, m.place, base=base, root=root, world=m.bodies[0])


def _bodies(m: Arrays, mimics: dict[int, tree.Mimic]) -> tuple[list[tree.Link], list[tree.Joint]]:
    links = [tree.Link(body, _inertia(m, i), m.place) for i, body in enumerate(m.bodies)]
    between: list[tree.Joint] = []
    taken, called = set(m.bodies), set(m.joints)

    def weld(link: str, parent: str, B: np.ndarray) -> None:
        between.append(tree.Joint(distinct(link, called), parent, link, B, None, None, {}, {}, m.place))

    def massless(link: str) -> str:
        links.append(tree.Link(link, np.zeros((6, 6)), m.place))
        return link

    for i, body in enumerate(m.bodies[1:], 1):
        carrier, B = m.bodies[m.of["body_parentid"][i]], _pose(m, "body_pos", "body_quat", i)
        own = range(m.of["body_jntadr"][i], m.of["body_jntadr"][i] + m.of["body_jntnum"][i])
        for j in own:
            child = body if j == own[-1] else massless(distinct(f"{body}:{m.joints[j]}", taken))
            between.append(joints.joint(m, j, carrier, child, B, mimics.get(j)))
            carrier, B = child, np.eye(4)
        if not own:
            weld(body, carrier, B)
    for i, site in enumerate(m.sites):
        if site and site not in taken:
            weld(massless(site), m.bodies[m.of["site_bodyid"][i]], _pose(m, "site_pos", "site_quat", i))
    return links, between


def _inertia(m: Arrays, i: int) -> np.ndarray:
    principal = _pose(m, "body_ipos", "body_iquat", i)
    theta = np.diag(m.of["body_inertia"][i])
    return inertia_matrix(m.of["body_mass"][i], principal[:3, 3], theta, rotation=principal[:3, :3])


def _pose(m: Arrays, position: str, quaternion: str, i: int) -> np.ndarray:
    """The pose of a position and a unit quaternion (w, x, y, z)."""
    return lie.pose(lie.from_quaternion(m.of[quaternion][i]), m.of[position][i][:, None])
