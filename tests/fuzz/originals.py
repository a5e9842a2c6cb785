"""Good files of every kind that jounce reads, to be mutated: (name, content)."""

import json
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from ruamel.yaml import YAML

import jounce

CORPUS, ROOT = Path(__file__).parent / "corpus", Path(__file__).parents[2]
File = tuple[str, bytes]


def _file(path: Path) -> File:
    return path.name, path.read_bytes()


def _json(path: Path) -> File:
    return f"{path.stem}.json", json.dumps(YAML(typ="safe").load(path)).encode()


def _npz(path: Path) -> File:
    packed = BytesIO()
    names, columns = path.read_text().split(maxsplit=1)[0].split(","), np.loadtxt(path, delimiter=",", skiprows=1).T
    np.savez(packed, **dict(zip(names, columns, strict=True)))
    return f"{path.stem}.npz", packed.getvalue()


def _saved(name: str) -> File:
    with TemporaryDirectory() as folder:
        path = Path(folder, f"{name}-saved.yaml")
        jounce.save(jounce.load(name), path)
        return _file(path)


ROBOTS = {
    "urdf": [_file(CORPUS / "arm.urdf"), _file(ROOT / "examples/panda.urdf")],
    "mjcf": [_file(CORPUS / "arm.xml")],
    "xacro": [_file(CORPUS / "arm.urdf.xacro"), _file(CORPUS / "packages.urdf.xacro")],
    "own": [_file(CORPUS / "robot.yaml"), _json(CORPUS / "robot.yaml"), _saved("planar2r")],
    "dh": [_file(CORPUS / "dh.yaml"), _json(CORPUS / "dh.yaml")],
}
MOTIONS = {  # of planar2r
    "csv": [_file(CORPUS / "samples.csv"), _file(CORPUS / "rates.csv")],
    "npz": [_npz(CORPUS / "samples.csv"), _npz(CORPUS / "rates.csv")],
    "echo": [_file(CORPUS / "echo.yaml")],
    "terms": [_file(CORPUS / "motion.yaml"), _json(CORPUS / "motion.yaml")],
}
LIMITS = [_file(CORPUS / "joint_limits.yaml"), _file(CORPUS / "own_limits.yaml")]  # of planar2r
PACKAGE = {  # beside a file of macros, which finds it
    "fuzz_macros/package.xml": "<package><name>fuzz_macros</name></package>",
    "fuzz_macros/rod.xacro": (CORPUS / "rod.xacro").read_text(),
}
