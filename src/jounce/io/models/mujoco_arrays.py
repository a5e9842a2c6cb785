"""The arrays of MuJoCo's models, mjModel, whatever version of MuJoCo made them.

`read_arrays` checks that they are there and finite, and names every part.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from jounce.core.errors import JounceError
from jounce.spatial import lie

FREE_JOINT_TYPE, BALL_JOINT_TYPE, SLIDE_JOINT_TYPE = 0, 1, 2  # mujoco.mjtJoint
FREE_JOINT_KINDS = {FREE_JOINT_TYPE: "floating", BALL_JOINT_TYPE: "spherical"}
JOINT_TRANSMISSION_TYPES = (0, 1)  # mujoco.mjtTrn, in a joint's frame or its parent's: the same for one axis


@dataclass(frozen=True, eq=False)
class ModelArrays:
    """The arrays of a model by MuJoCo's names, and its parts' names."""

    values: Mapping[str, np.ndarray]
    name: str
    place: str  # what messages call the model
    bodies: tuple[str, ...]  # the first is the world
    joints: tuple[str, ...]
    sites: tuple[str, ...]  # "" where they have no name
    tendons: tuple[str, ...]
    actuators: tuple[str, ...]
    gravity: np.ndarray
    fluid: bool  # whether it moves in one
    disabled: frozenset[str]  # what its flags disable: "GRAVITY", "SPRING", ...

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[name]

    def acts(self, *flags: str) -> bool:
        """Return whether no flag of these disables it."""
        return self.disabled.isdisjoint(flags)

    def nonzero_rows(self, *names: str) -> np.ndarray:
        """Return which rows of arrays of equal length have a nonzero entry.

        Arrays that this version of MuJoCo does not have are skipped.
        """
        arrays = [self[name] for name in names if self[name].ndim > 0]
        return np.any([array.any(axis=tuple(range(1, array.ndim))) for array in arrays], axis=0)

    def pose(self, position: str, quaternion: str, i: int) -> np.ndarray:
        """Return the pose (4, 4) of a position and a quaternion.

        The quaternion is (w, x, y, z), of unit length.
        """
        return lie.pose(lie.from_quaternion(self[quaternion][i]), self[position][i][:, None])


def moves_along_one_screw(m: ModelArrays, j: int) -> bool:
    """Return whether a joint is a hinge or a slide."""
    return int(m["jnt_type"][j]) not in FREE_JOINT_KINDS


# The arrays of a model.
UNNAMED = "MuJoCo Model"  # what MuJoCo calls a model without a name
# Positions, axes and inertias are checked here to be finite; limits and drives are checked where they are read.
FINITE_ARRAYS = {
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
    *("name_actuatoradr", "name_tendonadr", "tendon_adr", "tendon_num", "wrap_type", "wrap_objid", "wrap_prm"),
    *("tendon_stiffness", "tendon_damping", "tendon_frictionloss", "tendon_lengthspring"),
    *("tendon_limited", "tendon_range", "nflex"),
)
NEWER_ARRAYS = (  # arrays that MuJoCo 3.3 does not have: nothing where they are missing
    *("dof_dampingpoly", "jnt_stiffnesspoly", "jnt_springyield", "tendon_armature"),
    *("tendon_stiffnesspoly", "tendon_dampingpoly", "tendon_springyield", "tendon_actfrclimited", "tendon_actfrcrange"),
    *("actuator_armature", "actuator_damping", "actuator_dampingpoly"),
)


def read_arrays(model: Any, file: Path | None, what: str = "from_mujoco()") -> ModelArrays:
    """Return the arrays of a model.

    Raises `JounceError`, naming `file`, if it is not a model, or positions, axes or inertias are not finite.
    """
    try:
        values = {name: np.asarray(getattr(model, name)) for name in REQUIRED_ARRAYS}
        option, texts = model.opt, bytes(model.names)
    except AttributeError as error:
        came = f"{type(model).__name__}, which has no {error.name!r}"
        raise JounceError(f"{what} expects a mujoco.MjModel, got {came}") from None
    values |= {name: np.asarray(getattr(model, name, 0.0)) for name in NEWER_ARRAYS}
    name = _read_text(texts, 0)
    name = file.stem if file is not None and name == UNNAMED else name
    # All names stand one behind another in `texts`; addresses say where each begins.
    bodies, joints, sites, tendons, actuators = (
        [_read_text(texts, address) for address in values[f"name_{kind}adr"]]
        for kind in ("body", "jnt", "site", "tendon", "actuator")
    )
    arrays = ModelArrays(
        values=values,
        name=name,
        place=f"model {name!r}" if file is None else str(file),
        bodies=_fill_names(bodies, "body", first=0),
        joints=_fill_names(joints, "joint", first=1),
        sites=tuple(sites),
        tendons=_fill_names(tendons, "tendon", first=1),
        actuators=_fill_names(actuators, "motor", first=1),
        gravity=np.array(option.gravity, dtype=float),
        fluid=bool(option.density or option.viscosity),
        disabled=_disabled_flags(int(option.disableflags)),
    )
    _check_finite(arrays)
    return arrays


def make_distinct(name: str, used_names: set[str]) -> str:
    """Return a name, with a number behind it if it is used.

    From then on the name is used.
    """
    distinct = name
    numbers = count(2)
    while distinct in used_names:
        distinct = f"{name}_{next(numbers)}"
    used_names.add(distinct)
    return distinct


def _read_text(texts: bytes, address: int) -> str:
    return texts[address : texts.index(b"\0", address)].decode(errors="replace")


def _fill_names(names: list[str], stem: str, first: int) -> tuple[str, ...]:
    """Return names, with missing ones made of a stem and a number."""
    used_names = set(names)
    return tuple(make_distinct(f"{stem}{i}", used_names) if name == "" else name for i, name in enumerate(names, first))


def _disabled_flags(flags: int) -> frozenset[str]:
    """Return the names of disabled flags, without their prefix.

    Their bits are those of the version that is installed.
    """
    if flags == 0:
        return frozenset()
    from mujoco import mjtDisableBit  # the bits differ between versions

    bits = mjtDisableBit.__members__.items()
    return frozenset(name.removeprefix("mjDSBL_") for name, bit in bits if flags & int(bit))


def _check_finite(m: ModelArrays) -> None:
    """Raise `JounceError` if positions, axes or inertias are not finite."""
    names_of_kind = {"body": m.bodies, "joint": m.joints, "site": m.sites}
    for kind, array_names in FINITE_ARRAYS.items():
        for name in array_names:
            bad_rows = np.argwhere(~np.isfinite(m[name]))[:, 0]
            if bad_rows.size > 0:
                i = bad_rows[0]
                came = f"{name} of {kind} {names_of_kind[kind][i]!r} is {m[name][i].tolist()}"
                raise JounceError(f"{m.place}: {came}; expected finite numbers")


@contextmanager
def collect_mujoco_warnings(mujoco: Any) -> Iterator[list[str]]:
    """Collect MuJoCo's warnings within this context.

    Otherwise it would print them, and append them to MUJOCO_LOG.TXT in the current folder.
    """
    warnings: list[str] = []
    former_handler = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(warnings.append)
    try:
        yield warnings
    finally:
        mujoco.set_mju_user_warning(former_handler)


@contextmanager
def free_assets(mujoco: Any) -> Iterator[None]:
    """Free the meshes and textures that MuJoCo caches within this context.

    They take up to 500 MB. The cache stays if the program has read models by itself before.
    """
    get_cache = getattr(mujoco, "mj_getCache", None)  # which old versions do not have
    cache = None if get_cache is None else get_cache()
    was_empty = cache is not None and mujoco.mj_getCacheSize(cache) == 0
    try:
        yield
    finally:
        if was_empty:
            mujoco.mj_clearCache(cache)
