"""The arrays of an mjModel, whatever version of MuJoCo made it: there, finite, and a name for every part."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from jounce.core.errors import JounceError
from jounce.spatial import lie

UNNAMED = "MuJoCo Model"  # what MuJoCo calls a model without a name
FINITE_ARRAYS = {  # what places and weighs the parts: checked here to be finite, limits and drives where they are read
    "body": ("body_pos", "body_quat", "body_mass", "body_ipos", "body_iquat", "body_inertia"),
    "joint": ("jnt_pos", "jnt_axis"),
    "site": ("site_pos", "site_quat"),
}
REQUIRED_ARRAYS = (
    *(name for names in FINITE_ARRAYS.values() for name in names),
    *("name_bodyadr", "body_parentid", "body_jntadr", "body_jntnum", "body_gravcomp", "body_plugin"),
    *("name_jntadr", "jnt_type", "jnt_qposadr", "jnt_dofadr", "name_siteadr", "site_bodyid", "qpos0", "qpos_spring"),
    *("jnt_limited", "jnt_range", "jnt_actfrclimited", "jnt_actfrcrange"),
    *("jnt_stiffness", "dof_armature", "dof_damping", "dof_frictionloss"),
    *("eq_type", "eq_obj1id", "eq_obj2id", "eq_active0", "eq_data", "eq_objtype"),
    *("actuator_trntype", "actuator_trnid", "actuator_gear", "actuator_forcelimited", "actuator_forcerange"),
    *("tendon_stiffness", "tendon_damping", "tendon_frictionloss", "nflex"),
)
NEWER_ARRAYS = (  # arrays that MuJoCo 3.3 does not have: nothing where they are missing
    *("dof_dampingpoly", "jnt_stiffnesspoly", "jnt_springyield", "tendon_armature"),
    *("actuator_armature", "actuator_damping", "actuator_dampingpoly"),
)


@dataclass(frozen=True, eq=False)
class ModelArrays:
    """The arrays of a model by MuJoCo's names, and the names of its parts."""

    values: Mapping[str, np.ndarray]
    name: str
    place: str  # what messages call the model
    bodies: tuple[str, ...]  # the first is the world
    joints: tuple[str, ...]
    sites: tuple[str, ...]  # "" where they have no name
    gravity: np.ndarray
    fluid: bool  # whether it moves in one
    off: frozenset[str]  # what its flags disable: "GRAVITY", "SPRING", ...

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[name]

    def acts(self, *flags: str) -> bool:
        """Whether none of some flags disables it."""
        return self.off.isdisjoint(flags)

    def pose(self, position: str, quaternion: str, i: int) -> np.ndarray:
        """The pose (4, 4) of a position and a unit quaternion (w, x, y, z)."""
        return lie.pose(lie.from_quaternion(self[quaternion][i]), self[position][i][:, None])


def read_arrays(model: Any, file: Path | None, what: str = "from_mujoco()") -> ModelArrays:
    """Return the arrays of a model; raise `JounceError`, naming `file`, if it is not a model or not finite."""
    try:
        values = {name: np.asarray(getattr(model, name)) for name in REQUIRED_ARRAYS}
        option, texts = model.opt, bytes(model.names)
    except AttributeError as error:
        came = f"{type(model).__name__}, which has no {error.name!r}"
        raise JounceError(f"{what} expects a mujoco.MjModel, got {came}") from None
    values |= {name: np.asarray(getattr(model, name, 0.0)) for name in NEWER_ARRAYS}
    name = _read_text(texts, 0)
    name = file.stem if file and name == UNNAMED else name
    bodies, joints, sites = (
        [_read_text(texts, at) for at in values[f"name_{kind}adr"]] for kind in ("body", "jnt", "site")
    )
    found = ModelArrays(
        values=values,
        name=name,
        place=f"model {name!r}" if file is None else str(file),
        bodies=_fill_names(bodies, "body", first=0),
        joints=_fill_names(joints, "joint", first=1),
        sites=tuple(sites),
        gravity=np.array(option.gravity, dtype=float),
        fluid=bool(option.density or option.viscosity),
        off=_disabled_flags(int(option.disableflags)),
    )
    _check_finite(found)
    return found


def make_distinct(name: str, taken: set[str]) -> str:
    """The name, with a number behind it where it is taken; from then on it is."""
    free = name if name not in taken else next(x for i in count(2) if (x := f"{name}_{i}") not in taken)
    taken.add(free)
    return free


def _read_text(texts: bytes, at: int) -> str:
    return texts[at : texts.index(b"\0", at)].decode(errors="replace")


def _fill_names(given: list[str], stem: str, first: int) -> tuple[str, ...]:
    """The names, those that are missing made of a stem and a number."""
    taken = set(given)
    return tuple(name or make_distinct(f"{stem}{i}", taken) for i, name in enumerate(given, first))


def _disabled_flags(flags: int) -> frozenset[str]:
    if not flags:
        return frozenset()
    from mujoco import mjtDisableBit  # the bits differ between versions

    said = mjtDisableBit.__members__.items()
    return frozenset(name.removeprefix("mjDSBL_") for name, bit in said if flags & int(bit))


def _check_finite(found: ModelArrays) -> None:
    called = {"body": found.bodies, "joint": found.joints, "site": found.sites}
    for kind, names in FINITE_ARRAYS.items():
        for name in names:
            for i in np.argwhere(~np.isfinite(found[name]))[:1, 0]:
                came = f"{name} of {kind} {called[kind][i]!r} is {found[name][i].tolist()}"
                raise JounceError(f"{found.place}: {came}; expected finite numbers")
