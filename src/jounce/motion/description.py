"""Motions in closed form as files describe them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from jounce.arguments import names
from jounce.core.errors import JounceError, listed
from jounce.model.mechanism import Mechanism
from jounce.motion.analytic import Analytic, Terms
from jounce.motion.base import COLUMNS
from jounce.motion.curves import COMPONENTS
from jounce.motion.motion import Motion


@dataclass(frozen=True)
class Description:
    """A motion in closed form as a file states it: terms by joint, by body and component of its wrench, and times.

    `base` are the terms of position and quaternion of the base, None if it has none.
    """

    joints: Mapping[str, Terms]
    wrenches: Mapping[str, Mapping[str, Terms]]
    t: np.ndarray
    base: Mapping[str, Terms] | None = None


def motion_of(description: Description, mechanism: Mechanism) -> Motion:
    """The motion that terms describe; components of wrenches and the base that they leave out are zero, qw one."""
    joints, t = mechanism.coordinates, description.t
    names.check(description.joints, joints, names.followers(mechanism), f"terms for each of {listed(joints)}")
    for body in description.wrenches:
        mechanism.frame(body)
    ends = float(t[0]), float(t[-1])
    loads = {
        body: Analytic(tuple(components.get(name, Terms()) for name in COMPONENTS), *ends)
        for body, components in description.wrenches.items()
    }
    q = Analytic(tuple(description.joints[joint] for joint in joints), *ends)
    if mechanism.floats and description.base is None:
        raise JounceError(
            f"{mechanism.name!r} floats, and nothing says where its base is; expected base: with terms of some of"
            f" {listed(COLUMNS)}, position in m and quaternion"
        )
    base = None
    if description.base is not None:
        others = {"qw": Terms((1.0,))} if not {*COLUMNS[3:]} & {*description.base} else {}
        base = Analytic(tuple(description.base.get(name, others.get(name, Terms())) for name in COLUMNS), *ends)
    return Motion(q, joints, "analytic terms, all rates exact", loads, grid=t, base_curve=base)
