"""Reads robot files in XML: MJCF, or a URDF.

MJCF is compiled by MuJoCo itself, whose model is then read; a URDF is left to its reader.
"""

from io import BytesIO
from pathlib import Path
from typing import Any

from lxml import etree

from jounce.core.errors import JounceError, one_line, optional_import, shorten, warn
from jounce.io import files, urdf
from jounce.io.loop_files import LOOPS_OPTION, LoopFile
from jounce.io.models import mujoco as models
from jounce.io.models.mujoco_arrays import collect_mujoco_warnings, free_assets
from jounce.io.urdf import refuse_declarations
from jounce.model.mechanism import Mechanism

MJCF = ("mujoco", "mujocoinclude")  # root elements
# Formats that jounce does not read, by root element or suffix: their names, and the programs that convert them.
_SDF = (
    "SDF",
    "sdf2mjcf of the package sdformat-mjcf writes MJCF, sdf2urdf of sdformat_tools writes URDF (gz sdf -p only writes"
    " SDF, from URDF)",
)
_USD = (
    "USD",
    "usd_to_urdf of the package nvidia-srl-usd-to-urdf and the exporter of Isaac Sim write URDF (urdf-usd-converter and"
    " mujoco-usd-converter only write USD)",
)
UNREAD_FORMATS = {"sdf": _SDF, "usd": _USD, "usda": _USD, "usdc": _USD, "usdz": _USD}


def read(
    path: Path,
    gravity: object = None,
    base: str | None = None,
    root: str | None = None,
    transmissions: bool = True,
    loops: LoopFile | None = None,
) -> Mechanism:
    """Return the mechanism of an .xml file.

    It is under its own gravity unless another is given. `transmissions` is whether motors move joints together.
    """
    element = _root_tag(path)
    if element == "robot":
        return urdf.read(path, gravity, base, root, transmissions, loops)
    if element in UNREAD_FORMATS:
        raise unread_format_error(path, str(element))
    if loops is not None and element in MJCF:
        place = "MJCF states its loops itself, as <connect> and <weld> in <equality>"
        raise JounceError(f"{path}: {place}; {LOOPS_OPTION} is for URDF and xacro files: leave it out")
    if element not in MJCF:
        raise JounceError(f"{path}: the root element is <{shorten(str(element))}>; MJCF has <mujoco>, a URDF <robot>")
    return models.mechanism(compile_model(path), gravity, base, root, file=path, transmissions=transmissions)


def unread_format_error(path: Path, kind: str) -> JounceError:
    """Return the error for a format of `UNREAD_FORMATS`, with converters."""
    name, converters = UNREAD_FORMATS[kind]
    return JounceError(f"{path}: jounce does not read {name}; convert it to URDF or MJCF: {converters}")


def compile_model(path: Path) -> Any:
    """Compile a file with MuJoCo.

    Its errors and warnings are passed on in one line each.
    """
    with optional_import(f"{path}: MJCF needs MuJoCo", "mujoco"):
        import mujoco
    with collect_mujoco_warnings(mujoco) as warnings, free_assets(mujoco):
        try:
            model = mujoco.MjModel.from_xml_path(str(path))
        except Exception as error:  # ValueError, and one of MuJoCo's own that is no child of it
            raise JounceError(f"{path}: MuJoCo rejects the file: {one_line(error)}") from None
    for warning in warnings:
        warn(f"{path}: MuJoCo warns: {one_line(warning)}")
    return model


def _root_tag(path: Path) -> object:
    """Return the tag of the root element; nothing further is read."""
    content = files.read_bytes(path)
    refuse_declarations(content, path)
    parts = etree.iterparse(BytesIO(content), events=("start",), resolve_entities=False, no_network=True)
    try:
        return next(parts)[1].tag
    except etree.XMLSyntaxError as error:
        raise JounceError(f"{path}:{error.lineno or 1}: not XML: {one_line(error.msg)}") from None
