"""YAML motions: analytic terms per joint, every key and number checked."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jounce.errors import JounceError, no_such, one_line
from jounce.io.files import read_bytes
from jounce.mechanism import Mechanism
from jounce.motion import Motion
from jounce.motion.analytic import Cosine, Curve, Terms, along
from jounce.motion.states import COMPONENTS


def read(path: Path, mechanism: Mechanism, highest: int) -> Motion:
    """The motion of a YAML file for a mechanism, with rates up to the one of order `highest`."""
    terms = of_file(path)
    try:
        return along(terms, mechanism, highest)
    except JounceError as error:
        raise JounceError(f"{path}: {error}") from None


def of_file(path: Path) -> Terms:
    """``time: {start, stop, count}``, ``joints: {NAME: {offset, cosines, polynomial}}`` and, where bodies or merged
    links exert wrenches, ``wrenches: {NAME: {mx: {offset, cosines, polynomial}, ..., fz: {...}}}``."""
    data = _loaded(path)
    try:
        _keys(data, "the motion", {"time", "joints"}, {"name", "wrenches"})
        joints = {
            str(name): _curve(terms, f"joint {name!r}") for name, terms in _mapping(data["joints"], "joints").items()
        }
        wrenches = {
            str(body): _wrench(terms, f"the wrench of {body!r}")
            for body, terms in _mapping(data.get("wrenches", {}), "wrenches").items()
        }
        return Terms(joints, wrenches, _times(data["time"]))
    except JounceError as error:
        raise JounceError(f"{path}: {error}") from None


def _loaded(path: Path) -> Any:
    from ruamel.yaml import YAML  # YAML 1.2: 1e-3 is a number, a repeated key an error
    from ruamel.yaml.error import YAMLError

    try:
        return YAML(typ="safe", pure=True).load(read_bytes(path))
    except (YAMLError, UnicodeError) as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark is not None else ""
        raise JounceError(f"{path}{line}: not YAML: {one_line(getattr(error, 'problem', None) or error)}") from None


def _times(given: Any) -> np.ndarray:
    _keys(given, "time", {"stop", "count"}, {"start"})
    start, stop = _number(given.get("start", 0), "start of time"), _number(given["stop"], "stop of time")
    count = given["count"]
    if not isinstance(count, int) or isinstance(count, bool) or count < 2 or not stop > start:
        raise JounceError(f"time runs from {start:g} to {stop:g} in {count!r} states; expected stop > start, count > 1")
    return np.linspace(start, stop, count)


def _wrench(given: Any, what: str) -> dict[str, Curve]:
    _keys(given, what, set(), set(COMPONENTS))
    return {name: _curve(terms, f"{name} of {what}") for name, terms in given.items()}


def _curve(given: Any, what: str) -> Curve:
    _keys(given, what, set(), {"offset", "cosines", "polynomial"})
    powers = [
        _number(c, f"polynomial of {what}") for c in _sequence(given.get("polynomial", [0]), f"polynomial of {what}")
    ]
    powers[0] += _number(given.get("offset", 0), f"offset of {what}")
    cosines = [_cosine(c, f"cosine of {what}") for c in _sequence(given.get("cosines", ()), f"cosines of {what}", 0)]
    return Curve(tuple(powers), tuple(cosines))


def _cosine(given: Any, what: str) -> Cosine:
    _keys(given, what, {"amplitude", "frequency"}, {"phase"})
    return Cosine(*(_number(given.get(key, 0), f"{key} of {what}") for key in ("amplitude", "frequency", "phase")))


def _keys(given: Any, what: str, needed: set[str], optional: set[str]) -> None:
    for key in _mapping(given, what):
        if key not in needed | optional:
            raise no_such(f"key in {what}", key, sorted(needed | optional))
    for key in sorted(needed - set(given)):
        raise JounceError(f"{what} has no {key!r}; expected {', '.join(sorted(needed))}")


def _checked(kind: type, name: str) -> Callable[[Any, str], Any]:
    def check(given: Any, what: str) -> Any:
        if not isinstance(given, kind) or isinstance(given, str):
            raise JounceError(f"{what} is {given!r}; expected {name}")
        return given

    return check


_mapping = _checked(Mapping, "keys and values")


def _sequence(given: Any, what: str, least: int = 1) -> Sequence[Any]:
    items: Sequence[Any] = _checked(Sequence, "a list")(given, what)
    if len(items) < least:
        raise JounceError(f"{what} is empty; expected at least {least} entry")
    return items


def _number(given: Any, what: str) -> float:
    if isinstance(given, bool) or not isinstance(given, int | float) or not np.isfinite(given):
        raise JounceError(f"{what} is {given!r}; expected a finite number")
    return float(given)
