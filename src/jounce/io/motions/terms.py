"""YAML motions: analytic terms per joint, every key and number checked; and those of a motion as such a file."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, at, quoted
from jounce.io import files
from jounce.io.entries import Entry
from jounce.io.native import writing
from jounce.model.mechanism import Mechanism
from jounce.motion import Motion
from jounce.motion.analytic import Analytic, Cosine, Terms
from jounce.motion.base import POSE_COLUMNS
from jounce.motion.curves import COMPONENTS
from jounce.motion.description import Description, motion_of

MOST_STATES = 100_000_000  # states; a slip of the pen asks for more


def read(entry: Entry, mechanism: Mechanism) -> Motion:
    """The motion of a YAML or JSON file for a mechanism."""
    description = terms_in(entry)
    with at(entry.path):
        return motion_of(description, mechanism)


def terms_in(entry: Entry) -> Description:
    """``time: {start, stop, count}``, ``joints: {NAME: {offset, cosines, polynomial}}`` and, where bodies or merged
    links exert wrenches, ``wrenches: {NAME: {mx: {offset, cosines, polynomial}, ..., fz: {...}}}``; where the base
    moves ``base: {x: {offset, ...}, ..., qz: {...}}``."""
    motion = entry.keys(("time", "joints"), ("name", "wrenches", "base"))
    joints = motion.get("joints").named("joints").members()
    wrenches = motion.get("wrenches", {}).named("wrenches").members()
    return Description(
        {name: _curve(terms.named(f"joint {quoted(name)}")) for name, terms in joints.items()},
        {
            body: _components(terms.named(f"the wrench of {quoted(body)}"), COMPONENTS)
            for body, terms in wrenches.items()
        },
        _times(motion.get("time").named("time")),
        _components(motion.get("base").named("base"), POSE_COLUMNS) if "base" in motion.members() else None,
    )


def _times(time: Entry) -> np.ndarray:
    time.keys(("stop", "count"), ("start",))
    start, stop, count = time.get("start", 0).number(), time.get("stop").number(), time.get("count").value
    counts = isinstance(count, int) and not isinstance(count, bool) and 2 <= count <= MOST_STATES
    if not counts or not start < stop or math.isinf(stop - start):
        came = f"time runs from {start:g} to {stop:g} in {quoted(count)} states"
        raise JounceError(f"{time.place}: {came}; expected stop > start, count 2 to {MOST_STATES}")
    return np.linspace(start, stop, count)


def _components(terms: Entry, names: Sequence[str]) -> dict[str, Terms]:
    return {name: _curve(component) for name, component in terms.keys((), names).members().items()}


def _curve(terms: Entry) -> Terms:
    terms.keys((), ("offset", "cosines", "polynomial"))
    powers = [power.number() for power in terms.get("polynomial", [0]).items(least=1)]
    powers[0] += terms.get("offset", 0).number()
    cosines = terms.get("cosines", []).items(f"cosine of {terms.what}")
    return Terms(tuple(powers), tuple(_cosine(cosine) for cosine in cosines))


def _cosine(cosine: Entry) -> Cosine:
    cosine.keys(("amplitude", "frequency"), ("phase",))
    return Cosine(*(cosine.get(key, 0).number() for key in ("amplitude", "frequency", "phase")))


def write(path: Path, motion: Motion, joints: Sequence[str]) -> None:
    """Write a motion of joints in closed form, which is read again with the same bits; it exerts no wrenches."""
    if not isinstance(motion.curve, Analytic):
        raise JounceError(f"{path}: the motion has no analytic terms; expected a table, .csv or .npz")
    time = {"start": motion.start, "stop": motion.stop, "count": len(motion.times)}
    data = {"time": time, "joints": dict(zip(joints, map(_data, motion.curve.terms), strict=True))}
    text = writing.json_of(data) if path.suffix.lower() == ".json" else writing.yaml_of(data)
    with files.written_whole(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


def _data(terms: Terms) -> dict[str, Any]:
    """The terms of a joint as `_curve` reads them."""
    return {"polynomial": list(terms.polynomial), "cosines": [vars(cosine) for cosine in terms.cosines]}
