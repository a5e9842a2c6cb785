"""Reading skidy's description of a robot: its lists, and the check that they agree."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from jounce.core.errors import JounceError, at
from jounce.io.entries import Entry
from jounce.io.skidy import parts
from jounce.model.frame import Frame
from jounce.model.mechanism import GRAVITY, Mechanism
from jounce.model.screws import from_screws, from_spatial_screws

NEEDED = ("joint_screw_coord", "body_ref_config", "mass_inertia")
TREE = ("parent", "child", "support")
LOADS = ("WEE", "WDEE", "W2DEE")
RATES = ("qd", "q2d", "q3d", "q4d")  # variables of the generated code
OPTIONAL = ("representation", "gravity", "gravity_vector", "ee", "ee_parent", "assignments", *TREE, "q", *RATES, *LOADS)
BUILDERS: dict[str, Callable[..., Mechanism]] = {"spatial": from_spatial_screws, "body_fixed": from_screws}


def read(robot: Entry, gravity: object = None) -> Mechanism:
    """The mechanism of a file's content, under its own gravity unless another is given."""
    robot.keys(NEEDED, OPTIONAL)
    number = parts.assigned(robot)
    screws, poses, inertias = (robot.get(key).items(least=1) for key in NEEDED)
    _check_lengths(robot, {key: len(entries) for key, entries in zip(NEEDED, (screws, poses, inertias), strict=True)})
    _check_loads(robot)
    representation = robot.get("representation", "spatial")
    if representation.value not in tuple(BUILDERS):
        raise representation.error(" or ".join(BUILDERS))
    key = "gravity_vector" if robot.alone("gravity_vector", ("gravity",)) else "gravity"
    own = robot.get(key, list(GRAVITY)).numbers((3,), read=number)
    A = [parts.pose(entry, number) for entry in poses]
    Y = [parts.screw(entry, number) for entry in screws]
    com = [_says_com(entry) for entry in inertias]
    M = [parts.inertia(entry, number, any(com[:i])) for i, entry in enumerate(inertias)]
    parent, names = _parents(robot, len(poses)), _joint_names(robot, len(poses))
    with at(robot.path):
        built = BUILDERS[representation.value](
            np.stack(A),
            np.stack(Y),
            np.stack(M),
            parent,
            gravity=own if gravity is None else gravity,
            joint_names=names,
            name=robot.path.stem,
        )
    return replace(built, frames=_frames(robot, len(poses), number))


def _check_lengths(robot: Entry, lengths: dict[str, int]) -> None:
    if len(set(lengths.values())) > 1:
        came = ", ".join(f"{count} of {key}" for key, count in lengths.items())
        raise JounceError(f"{robot.place}: the robot has {came}; expected one of each per body")


def _says_com(inertia: Entry) -> bool:
    return isinstance(inertia.value, dict) and inertia.value.get("frame") == "com"


def _check_loads(robot: Entry) -> None:
    """Refuse loads of numbers, which skidy adds to Q: here they belong to a motion, not to the robot."""
    for key in LOADS:
        entry = robot.get(key, [])
        rows = [row.items() if isinstance(row.value, list) else [row] for row in entry.items()]
        for component in (component for row in rows for component in row):
            if not isinstance(component.value, str) and component.number() != 0:
                raise component.error("0 or a symbol: loads belong to a motion, wrench=")


def _parents(robot: Entry, nb: int) -> list[int]:
    """The parent of each body, from 0; -1 is the ground."""
    chain = list(range(-1, nb - 1))
    if not robot.value.get("parent"):  # skidy writes the key of a chain with nothing under it
        return chain
    entry = robot.get("parent")
    parents = [_whole(parent, 0, i) - 1 for i, parent in enumerate(entry.items())]
    if len(parents) != nb:
        raise entry.error(f"{nb} numbers, one per body")
    if not robot.value.get("support"):
        if parents != chain:
            raise JounceError(f"{entry.place}: {entry.what} is a tree without 'support', which skidy reads as a chain")
        return parents
    rows = robot.get("support")
    paths: list[list[int]] = []
    for i, p in enumerate(parents):
        paths.append([*(paths[p] if p >= 0 else []), i + 1])
    if rows.value != paths:
        raise rows.error(f"the path from the world to each body according to 'parent', {paths!r:.120}")
    return parents


def _whole(entry: Entry, least: int, most: int) -> int:
    """A whole number of a body."""
    if isinstance(entry.value, bool) or entry.value not in range(least, most + 1):
        raise entry.error(f"the whole number of a body, {least} .. {most}")
    return int(entry.value)


def _joint_names(robot: Entry, nb: int) -> Sequence[str] | None:
    """The symbols of q."""
    if "q" not in robot.value:
        return None
    entry = robot.get("q")
    names = [symbol.text() for symbol in entry.items()]
    if len(set(names)) != nb or len(names) != nb or not all(name.isidentifier() for name in names):
        raise entry.error(f"{nb} different symbols, one per joint")
    return names


def _frames(robot: Entry, nb: int, number: parts.Number) -> tuple[Frame, ...]:
    """The end-effectors, called `ee`, or `ee1` and so on, each on the body that `ee_parent` says, else on the last."""
    if "ee" not in robot.value:
        return ()
    ee = robot.get("ee")
    poses = ee.items(least=1) if isinstance(ee.value, list) and not _is_matrix(ee.value) else [ee]
    given = robot.get("ee_parent", nb)
    parents = given.items() if isinstance(given.value, list) else [given]
    if len(parents) != len(poses):
        raise given.error(f"{len(poses)} bodies, one for each of ee")
    names = ["ee"] if len(poses) == 1 else [f"ee{i + 1}" for i in range(len(poses))]
    bodies = [_whole(parent, 1, nb) - 1 for parent in parents]
    return tuple(Frame(n, i, parts.pose(pose, number)) for n, i, pose in zip(names, bodies, poses, strict=True))


def _is_matrix(given: list[object]) -> bool:
    """Whether a list is one of rows of numbers, not one of poses."""
    first = given[0] if given else None
    return isinstance(first, list) and not any(isinstance(x, list) for x in first)
