"""The tree of an mjModel: its bodies as links, its joints between them.

The joints of a body act one after another: the last moves the body, those before it massless links, BODY:JOINT by name.
Bodies without a joint are welded, and so are named sites, as massless links, unless a body has their name, and the ends
of constraints.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, locate_errors
from jounce.io.models.mujoco import constraints, ignored_features, joints
from jounce.io.models.mujoco.arrays import ModelArrays, make_distinct, read_arrays
from jounce.model import tree
from jounce.model.mechanism import Mechanism
from jounce.spatial.inertia import inertia_matrix


def mechanism(
    model: Any, gravity: object = None, base: str | None = None, root: str | None = None, file: Path | None = None
) -> Mechanism:
    """The mechanism of an mjModel, under its own gravity unless another is given; `file` is what messages call it."""
    m = read_arrays(model, file)
    with locate_errors(m.place):
        tree.check_base(base)
    if not m.joints:
        raise JounceError(f"{m.place}: no joint; expected at least one movable joint")
    mimics = constraints.find_mimics(m)
    active = constraints.active_constraints(m)
    tied = constraints.find_ties(m, active, {*m.bodies, *m.joints, *m.sites})
    links, between = _build_bodies(m, mimics, [end for tie in tied for end in (tie.a, tie.b)], welded=base == "fixed")
    ignored_features.warn_of_ignored(m, ties=len(active) - len(mimics) - len(tied), floats=base != "fixed")
    own = m.gravity * m.acts("GRAVITY")
    given = own if gravity is None else gravity
    built = tree.build_mechanism(links, between, given, m.name, m.place, base=base, root=root, world=m.bodies[0])
    return constraints.close_ties(m, built, tied)


def _build_bodies(
    m: ModelArrays, mimics: dict[int, tree.Mimic], ends: Sequence[constraints.LoopEnd], welded: bool
) -> tuple[list[tree.Link], list[tree.Joint]]:
    links = []
    for i, body in enumerate(m.bodies):
        principal, theta = m.pose("body_ipos", "body_iquat", i), np.diag(m["body_inertia"][i])
        M = inertia_matrix(m["body_mass"][i], principal[:3, 3], theta, rotation=principal[:3, :3])
        links.append(tree.Link(body, M, m.place))
    between: list[tree.Joint] = []
    taken, called = set(m.bodies), set(m.joints)

    def weld(link: str, parent: str, B: np.ndarray) -> None:
        between.append(tree.Joint(make_distinct(link, called), parent, link, B, None, None, {}, {}, m.place))

    def massless(link: str) -> str:
        links.append(tree.Link(link, np.zeros((6, 6)), m.place))
        return link

    for i, body in enumerate(m.bodies[1:], 1):
        carrier, B = m.bodies[m["body_parentid"][i]], m.pose("body_pos", "body_quat", i)
        own = range(m["body_jntadr"][i], m["body_jntadr"][i] + m["body_jntnum"][i])
        for j in own:
            if m["jnt_type"][j] == joints.FREE_JOINT_TYPE and not welded:
                B = np.eye(4)  # its q is the pose in the world, wherever the file has the body
            child = body if j == own[-1] else massless(make_distinct(f"{body}:{m.joints[j]}", taken))
            between.append(joints.build_joint(m, j, carrier, child, B, mimics.get(j)))
            carrier, B = child, np.eye(4)
        if not own:
            weld(body, carrier, B)
    for i, site in enumerate(m.sites):
        if site and site not in taken:
            weld(massless(site), m.bodies[m["site_bodyid"][i]], m.pose("site_pos", "site_quat", i))
    for end in ends:
        weld(massless(end.frame), end.body, end.T)
    return links, between
