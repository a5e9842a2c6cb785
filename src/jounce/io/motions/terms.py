"""YAML motions: analytic terms per joint, every key and number checked."""

import math
from collections.abc import Sequence

import numpy as np

from jounce.errors import JounceError, at, quoted
from jounce.io.entries import Entry
from jounce.model.mechanism import Mechanism
from jounce.motion import Motion
from jounce.motion.analytic import Cosine, Description, Terms, motion_of
from jounce.motion.base import COLUMNS
from jounce.motion.curves import COMPONENTS

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
        _components(motion.get("base").named("base"), COLUMNS) if "base" in motion.members() else None,
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
