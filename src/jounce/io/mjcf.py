"""Robot files in XML: MJCF, compiled by MuJoCo itself, whose model is then read; a URDF by its reader."""

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

from lxml import etree

from jounce.core.errors import JounceError, one_line, optional_import, shorten, warn
from jounce.io import urdf
from jounce.io.files import read_bytes
from jounce.io.models import mujoco as models
from jounce.io.urdf import refuse_declarations
from jounce.model.mechanism import Mechanism

MJCF = ("mujoco", "mujocoinclude")  # root elements


def read(path: Path, gravity: object = None, base: str | None = None, root: str | None = None) -> Mechanism:
    """The mechanism of an .xml file, under its own gravity unless another is given."""
    element = _root_tag(path)
    if element == "robot":
        return urdf.read(path, gravity, base, root)
    if element not in MJCF:
        raise JounceError(f"{path}: the root element is <{shorten(str(element))}>; MJCF has <mujoco>, a URDF <robot>")
    return models.mechanism(compile_model(path), gravity, base, root, file=path)


def compile_model(path: Path) -> Any:
    """Compile a file with MuJoCo, whose errors and warnings are passed on in one line each."""
    with optional_import(f"{path}: MJCF needs MuJoCo", "mujoco"):
        import mujoco
    with collect_mujoco_warnings(mujoco) as said, free_assets(mujoco):
        try:
            model = mujoco.MjModel.from_xml_path(str(path))
        except Exception as error:  # ValueError, and one of MuJoCo's own that is no child of it
            raise JounceError(f"{path}: MuJoCo rejects the file: {one_line(error)}") from None
    for warning in said:
        warn(f"{path}: MuJoCo warns: {one_line(warning)}")
    return model


@contextmanager
def collect_mujoco_warnings(mujoco: Any) -> Iterator[list[str]]:
    """Collect MuJoCo's warnings, which it would print and append to MUJOCO_LOG.TXT in the current folder."""
    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(said.append)
    try:
        yield said
    finally:
        mujoco.set_mju_user_warning(before)


@contextmanager
def free_assets(mujoco: Any) -> Iterator[None]:
    """Free the meshes and textures that MuJoCo caches, up to 500 MB, unless the program has read models by itself."""
    find = getattr(mujoco, "mj_getCache", None)  # which old versions do not have
    cache = find() if find else None
    empty = cache is not None and mujoco.mj_getCacheSize(cache) == 0
    try:
        yield
    finally:
        if empty:
            mujoco.mj_clearCache(cache)


def _root_tag(path: Path) -> object:
    """Return the tag of the root element, before the file is read further."""
    content = read_bytes(path)
    refuse_declarations(content, path)
    parts = etree.iterparse(BytesIO(content), events=("start",), resolve_entities=False, no_network=True)
    try:
        return next(parts)[1].tag
    except etree.XMLSyntaxError as error:
        raise JounceError(f"{path}:{error.lineno or 1}: not XML: {one_line(error.msg)}") from None
