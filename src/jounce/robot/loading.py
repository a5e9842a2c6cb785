"""`load`: a robot from a file or by name."""

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import (
    JounceError,
    check_bool,
    door,
    join_names,
    locate_errors,
    quote_value,
    unknown_name_error,
    warn,
)
from jounce.core.scalars import is_numeric
from jounce.core.typing import ArrayLike, Base, DriveTerms, Planar2R
from jounce.dynamics import mobility
from jounce.io import files
from jounce.io.bundled import BUNDLED, check_floating_base
from jounce.model.drive_trains import select_terms
from jounce.model.equivalent_mechanisms import CHAIN
from jounce.model.mechanism import INERTIAS, MASSLESS_TIPS, Mechanism
from jounce.robot import Robot

if TYPE_CHECKING:
    from jounce.io.loop_files import LoopFile


@door
def load(
    source: str | os.PathLike[str],
    /,
    *,
    gravity: ArrayLike | None = None,
    base: Base | None = None,
    root: str | None = None,
    lock: Mapping[str, Any] | None = None,
    drives: DriveTerms | None = False,
    xacro_args: Mapping[str, object] | None = None,
    loops: str | os.PathLike[str] | None = None,
    massless_tips: bool = False,
    transmissions: bool = True,
    **parameters: Unpack[Planar2R],
) -> Robot:
    """Load a robot from a file, or a bundled robot by name.

    Files are URDF, MJCF, YAML or JSON.

    YAML and JSON files contain jounce's own format or a Denavit-Hartenberg table, identified by their keys.

    Links behind fixed joints merge into one body, and their names may be used wherever a body's may; mimic joints
    follow their leaders; several root links are fixed to the ground. Coordinates are in the file's order, depth first.

    Parameters
    ----------
    source : str or path
        Path of a .urdf, .xacro, .xml (MJCF, by MuJoCo; or a URDF), .yaml, .yml or .json file, or the name of a bundled
        robot: "iiwa14", "planar2r", "panda" and others, which `jounce robots` lists.
    gravity : (3,), optional
        Gravity in m/s^2; by default that of the file, else (0, 0, -9.81); for iiwa14 (0, 0, -9.80665).
    base : str, optional
        "floating": the root link, or the link that a floating joint carries on the ground, moves freely, and what is
        fixed to it is part of it; forces, matrices and Jacobians then have 6 + n rows or columns. Bundled robots with
        legs, URDF and MJCF files can float, and files of jounce's own format that state a base; one link without joints
        becomes a free joint of the ground. "fixed": the root stands on the ground, and floating joints there are welded
        at zero, with a warning. By default a floating joint that carries all other joints is an error, and only a file
        of jounce's own format that states a base floats.
    root : str, optional
        Link of a URDF or MJCF file that becomes the base, fixed or floating; links that it does not carry are dropped.
    lock : dict, optional
        Joints to lock, {name: rad or m}: their bodies merge into those that carry them, see `Robot.locked`.
    drives : bool, str or several, optional
        Drive terms of the file to include in Q, see `Robot.with_drives`; by default none.
    xacro_args : dict, optional
        Arguments of a .xacro file.
    loops : str or path, optional
        File of the loops of a URDF or .xacro file: pairs of links and their motors, as example-parallel-robots writes
        it, or the keys of jounce's own format, `loops`, `actuated` and others. The robot is closed, see `Robot.closed`.
    massless_tips : bool, optional
        Whether to accept joints that move no mass at all. By default their forces, which are 0 for lack of inertia,
        leave limits undecided in `Robot.check`, and a warning names the bodies.
    transmissions : bool, optional
        Whether motors of a file move joints together, as transmissions of a URDF and tendons of MJCF say, see
        `Robot.with_transmission`. False: each joint has its own motor.
    **parameters : keywords
        Parameters of planar2r: L1, L2, m1, m2, g; numbers or symbols.

    Returns
    -------
    Robot

    Raises
    ------
    JounceError
        If the file cannot be read, is not a robot, or a parameter is unknown.

    Warns
    -----
    JounceWarning
        If bodies of a file have no mass or a physically inconsistent inertia (see `Robot.audit`), joints are welded by
        `base`, transmissions are of unknown types, two places of a URDF state different limits, or `drives` selects
        terms that the file does not have.

    Examples
    --------
    >>> import jounce
    >>> jounce.load("planar2r", L1=1.1, L2=0.7, m1=2.0, m2=1.5).joint_names
    ('joint1', 'joint2')
    """
    if not isinstance(source, str | os.PathLike):
        raise JounceError(f"load() expects a path or a name, got {type(source).__name__}; names: {', '.join(BUNDLED)}")
    # Arguments are checked before a file is read, which may take long.
    path = files.expand_path(source)
    name = os.fspath(source)
    if drives is not None:
        select_terms(drives)
    if base is not None:
        from jounce.model.tree import check_base  # imported here to keep start-up fast

        with locate_errors(name):
            check_base(base)
    if not isinstance(massless_tips, bool):
        raise JounceError(f"massless_tips is {quote_value(massless_tips)}; expected True or False")
    check_bool("transmissions", transmissions, "whether to read those of a file")
    # Readers have defaults of their own: only what is given reaches them.
    loop_file = None if loops is None else _read_loops(loops, name, path)
    common_parameters = {
        "gravity": gravity,
        "base": base,
        "root": root,
        "xacro_args": xacro_args,
        "loops": loop_file,
        "transmissions": None if transmissions else False,
    }
    reader_parameters = {key: value for key, value in common_parameters.items() if value is not None} | parameters
    robot = Robot(_mechanism(name, path, reader_parameters, (MASSLESS_TIPS,) * massless_tips))
    if lock is not None:
        with locate_errors(name):
            robot = robot.locked(lock)
    # Bundled robots are taken as they are published.
    if name not in BUNDLED:
        _warn_of_massless(robot.mechanism, path)
    return robot if drives is None else robot.with_drives(drives)


def _read_loops(loops: object, name: str, path: Path) -> "LoopFile":
    """Read the file of the loops of a robot.

    Raises `JounceError` if the robot's own file states its loops.
    """
    from jounce.io import loop_files  # imported here to keep start-up fast

    option = loop_files.LOOPS_OPTION
    if not isinstance(loops, str | os.PathLike):
        raise JounceError(f"{option} is {quote_value(loops)}; expected the path of a file")
    if name in BUNDLED or ROBOT_READERS.get(path.suffix.lower()) == "documents":
        owners = "bundled robots" if name in BUNDLED else "files of this format, under the keys 'loops' and 'actuated',"
        raise JounceError(
            f"{name}: {owners} state loops themselves; {option} is for URDF and xacro files: leave it out"
        )
    return loop_files.read(files.expand_path(loops))


def _mechanism(name: str, path: Path, parameters: dict[str, object], accepted: tuple[str, ...]) -> Mechanism:
    """Read the mechanism of a robot, and warn of inconsistent inertias."""
    if name in BUNDLED:
        if parameters.get("base") == "floating":
            check_floating_base(name)
        return replace(_call(BUNDLED[name].build, parameters, name), meant=(MASSLESS_TIPS, INERTIAS))
    if path.suffix.lower() not in ROBOT_READERS:
        from jounce.io import mjcf  # imported here to keep start-up fast

        if path.suffix.lower().removeprefix(".") in mjcf.UNREAD_FORMATS:
            raise mjcf.unread_format_error(path, path.suffix.lower().removeprefix("."))
        suffixes = ", ".join(ROBOT_READERS)
        if not path.suffix:
            raise JounceError(f"{unknown_name_error('robot', name, BUNDLED)}, or a file of type {suffixes}")
        raise JounceError(f"{path}: unknown type of robot file {path.suffix!r}; available: {suffixes}")
    # Values that overflow are refused as not finite, or judged by the audit.
    with np.errstate(all="ignore"):
        mechanism = replace(_call(partial(_reader(path.suffix.lower()), path), parameters, str(path)), meant=accepted)
        _warn_of_inertias(mechanism, path)
    return mechanism


def _reader(suffix: str) -> Callable[..., Mechanism]:
    """Return the reader of files of a suffix.

    It imports lxml, MuJoCo or a reader of YAML.
    """
    reader: Callable[..., Mechanism] = import_module(f"jounce.io.{ROBOT_READERS[suffix]}").read
    return _read_xacro if suffix == ".xacro" else reader


def _read_xacro(
    path: Path,
    /,
    gravity: object = None,
    base: str | None = None,
    root: str | None = None,
    xacro_args: Mapping[str, object] = MappingProxyType({}),
    transmissions: bool = True,
    loops: "LoopFile | None" = None,
) -> Mechanism:
    """Read the URDF of a .xacro file."""
    from jounce.io import urdf, xacro

    parameters = urdf.UrdfParameters(gravity, base, root, transmissions, loops)
    content = xacro.expand(path, xacro_args)
    return urdf.parse(content, f"{path} (expanded)", path.name.partition(".")[0], parameters)


ROBOT_READERS = {
    ".urdf": "urdf", ".xacro": "urdf", ".xml": "mjcf", ".yaml": "documents", ".yml": "documents", ".json": "documents",
}  # fmt: skip
CROSS_ENDS = tuple(f"_{end}" for end in [*CHAIN.values(), "X", "Y", "Z"])  # of names of bodies that no file states
ALWAYS = ("lock", "drives")  # parameters of all robots


def _call(build: Callable[..., Mechanism], parameters: dict[str, object], source: str) -> Mechanism:
    """Call a reader with parameters, all of which it must know."""
    if not parameters:
        return build()
    import inspect  # slow to import, and seldom needed

    known_names = list(inspect.signature(build).parameters)
    for name in parameters:
        if name not in known_names:
            raise unknown_name_error("parameter", name, [*known_names, *ALWAYS], source)
    return build(**parameters)


def _warn_of_massless(mechanism: Mechanism, path: Path) -> None:
    """Warn of bodies without mass.

    They are tips, unless these are accepted, and bodies that carry mass.
    """
    if not is_numeric(mechanism.M):
        return
    # Bodies between the turns of one joint, which has their name, are no bodies of the file.
    is_cross = np.array([_is_between_turns(mechanism, i) for i in range(mechanism.nb)])
    carriers, empty_tips = mobility.find_massless(mechanism)
    carrying, tips = (
        join_names((mechanism.bodies[i] for i in np.flatnonzero(is_massless)), most=8)
        for is_massless in (carriers & ~is_cross, empty_tips)
    )
    sentences = [f"bodies without mass that carry mass: {carrying}"] if carrying != "" else []
    if tips != "" and MASSLESS_TIPS not in mechanism.meant:
        option = Remedy("massless_tips=True", "--massless-tips")
        cure = f"state their inertias, or accept them with {option}"
        sentences.append(f"bodies without mass that carry none, so that their joints need no force: {tips}; {cure}")
    if len(sentences) > 0:
        warn(f"{path}: {'; '.join(sentences)}")


def _is_between_turns(mechanism: Mechanism, i: int) -> bool:
    """Return whether a body stands between the turns of one joint."""
    name, variables = mechanism.bodies[i], [mechanism.joints[j] for j in mechanism.columns[i]]
    return variables == [name] and name.endswith(CROSS_ENDS)


def _warn_of_inertias(mechanism: Mechanism, path: Path) -> None:
    """Warn of bodies whose inertia is physically inconsistent."""
    from jounce.checks.audit import check_inertias

    defects = check_inertias(mechanism) if is_numeric(mechanism.M) else []
    if len(defects) > 0:
        others = f" (and {len(defects) - 1} more)" if len(defects) > 1 else ""
        count = f"{len(defects)} of {mechanism.nb} bodies"
        warn(f"{path}: {count} have a physically inconsistent inertia: {defects[0]}{others}")
