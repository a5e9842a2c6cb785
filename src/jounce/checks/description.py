"""The description of a robot as plain data: for `jounce info`, as text or JSON."""

import numpy as np

from jounce.checks.audit import audit
from jounce.core.typing import JsonObject
from jounce.dynamics.loops import movers
from jounce.model.coordinates import coordinate_units
from jounce.model.limit_kinds import LIMIT_KEYS, LIMIT_KINDS
from jounce.model.mechanism import Mechanism, body_name
from jounce.model.positions import multiscrew_joints, position_names, whole_position_count
from jounce.spatial import inertia

_PITCH_ROUNDING = 1e-12  # of the distance to the axis, m/rad: a pitch of less is that of a hinge


def describe(mechanism: Mechanism) -> JsonObject:
    """Names, tree, joints, inertias and findings of a mechanism of numbers, ready for JSON."""
    return {
        "name": mechanism.name,
        "n": mechanism.n,
        "nq": whole_position_count(mechanism),
        "nv": mechanism.nv,
        "nb": len(mechanism.moving_bodies),
        "gravity": mechanism.gravity.tolist(),
        "mass": float(mechanism.M[:, 3, 3].sum()),
        "base": {"name": mechanism.base_body, **_inertia(mechanism.M[0])} if mechanism.base_body else None,
        "coordinates": [
            {"name": name, "unit": unit}
            for name, unit in zip(mechanism.coordinates, coordinate_units(mechanism), strict=True)
        ],
        "positions": list(position_names(mechanism)),
        "acting": list(mechanism.acting),
        "elastic": None if mechanism.elasticity is None else _elastic(mechanism),
        "loops": [
            {"frames": [loop.a.name, loop.b.name], "joint": loop.joint, "axis": np.asarray(loop.axis).tolist()}
            for loop in mechanism.loops
        ],
        "contacts": [{"frame": contact.frame, "kind": contact.kind} for contact in mechanism.contacts],
        "following": [name for name in mechanism.tree.coordinates if name not in mechanism.coordinates],
        "moved_by": movers(mechanism) if mechanism.is_closed else {},
        "bodies": [_body(mechanism.tree, i) for i in mechanism.moving_bodies],
        "merged_links": {frame.name: body_name(mechanism, frame.body) for frame in mechanism.frames},
        "findings": [finding.as_data() for finding in audit(mechanism)],
    }


def _elastic(mechanism: Mechanism) -> dict[str, dict[str, float | None]]:
    """The springs and motors of each coordinate; None for the infinite stiffness of a rigid joint."""
    arrays = mechanism.elasticity.arrays if mechanism.elasticity else {}
    return {
        name: {key: float(array[j]) if np.isfinite(array[j]) else None for key, array in arrays.items()}
        for j, name in enumerate(mechanism.coordinates)
    }


def _body(mechanism: Mechanism, i: int) -> JsonObject:
    """A body and the joint that moves it."""
    own, several = mechanism.columns[i], multiscrew_joints(mechanism).get(i)
    joint = _variable(mechanism, own[0])
    if several is not None:
        joint = dict.fromkeys(joint) | {"joint": several.name, "type": several.group.name}
    return {
        "name": mechanism.bodies[i],
        "parent": body_name(mechanism, mechanism.parent[i]),
        **joint,
        "nq": 1 if several is None else len(several.group.positions),
        "nv": len(own),
        "velocities": [] if several is None else [_variable(mechanism, j) for j in own],
        **_inertia(mechanism.M[i]),
    }


def _variable(mechanism: Mechanism, j: int) -> JsonObject:
    """A joint variable: all of a joint, or one of the velocities of a joint of several screws."""
    X, kind = mechanism.X[j], joint_kind(mechanism, j)
    turns = bool(X[:3].any())
    return {
        "joint": mechanism.joints[j],
        "type": kind,
        "unit": "rad" if turns else "m",
        "extent": _extent(mechanism, j),
        "axis": (X[:3] if turns else X[3:]).tolist(),
        "pitch": float(X[:3] @ X[3:]) if kind == "helical" else None,
        "follows": _describe_dependence(mechanism, j),
        "limits": dict.fromkeys(LIMIT_KEYS) | mechanism.limits.stated(j),
        "drive": {key: float(array[j]) for key, array in vars(mechanism.drives).items()},
    }


def _extent(mechanism: Mechanism, j: int) -> str | None:
    """What the limits of the position bound in the place of a velocity of a joint of several screws."""
    i = mechanism.owners[j]
    joint = multiscrew_joints(mechanism).get(i)
    return None if joint is None else joint.group.extents[mechanism.columns[i].index(j)]


def joint_kind(mechanism: Mechanism, j: int) -> str:
    """What the joint of a joint variable is: revolute, prismatic, helical, or, of several, ball, planar or free."""
    joint, X = multiscrew_joints(mechanism).get(mechanism.owners[j]), mechanism.X[j]
    if joint is not None:
        return joint.group.name
    if not X[:3].any():
        return "prismatic"
    return "helical" if abs(X[:3] @ X[3:]) > _PITCH_ROUNDING * np.abs(X[3:]).max() else "revolute"


def _inertia(M: np.ndarray) -> JsonObject:
    m, h, _ = inertia.moments(M)
    mass = float(m[0, 0])
    principal = inertia.principal_moments(M) if mass else None
    return {
        "mass": mass,
        "com": (h[:, 0] / mass).tolist() if mass else None,
        "principal_moments": None if principal is None else principal.tolist(),
        "triangle_slack": None if principal is None else inertia.triangle_slack(principal),
    }


def _describe_dependence(mechanism: Mechanism, i: int) -> str | None:
    """The joint variable in the coordinates, where it is not simply one of them."""
    row, offset = mechanism.G[i], float(mechanism.g[i])
    terms = [f"{_factor(row[j])}{mechanism.coordinates[j]}" for j in np.flatnonzero(row)]
    plain = len(terms) == 1 and row.sum() == 1 and offset == 0 and mechanism.joints[i] in mechanism.coordinates
    return None if plain else " + ".join(terms + [f"{offset:g}"] * bool(offset)) or "0"


def _factor(x: float) -> str:
    return {1.0: "", -1.0: "-"}.get(x, f"{x:g} ")


def limit_in_words(body: JsonObject, kind: str) -> str:
    """The limit of the joint of a described body with its unit, "-" where it is not stated."""
    limits = body["limits"] or dict.fromkeys(LIMIT_KEYS)  # those of a joint of several screws are its velocities'
    value = [limits["lower"], limits["upper"]] if kind == "position" else limits[kind]
    if value in (None, [None, None]):
        return "-"
    unit = LIMIT_KINDS[kind].unit(body["unit"])
    ends = zip(value, ("-inf", "inf"), strict=True) if isinstance(value, list) else [(value, "")]
    what = f"{body['extent']} " if kind == "position" and body["extent"] else ""
    return what + " .. ".join(free if x is None else f"{x:.5g}" for x, free in ends) + f" {unit}"
