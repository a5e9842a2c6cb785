"""Reads YAML and JSON files as entries: values with a name and a line.

`read` and `read_documents` give the entries of a file. Each method of an `Entry` checks its value, and raises an error
with FILE:LINE and what was expected.

`parse_documents` reads YAML text with tags of angles and without anything that fills the memory. ``!degrees 90`` and
``!radians 1.57`` are what xacro and the limits of MoveIt know. A value with such a tag is not a number, so that only
readers of angles take it.
"""

import json
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import radians
from pathlib import Path
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, join_names, one_line, quote_value, shorten, unknown_name_error
from jounce.core.scalars import is_finite
from jounce.core.typing import JsonObject
from jounce.io import files

DOCUMENT_SUFFIXES = (".yaml", ".yml", ".json")


@dataclass(frozen=True)
class Entry:
    """A value in a file, with its name and its line.

    Every method checks it and raises a `JounceError` with its place and name.
    """

    value: Any
    what: str
    path: Path
    line: int | None = None
    node: Any = None  # what ruamel.yaml made the value of: it knows the lines of its parts

    @property
    def place(self) -> str:
        """FILE:LINE, or FILE alone if the line is not known."""
        return f"{self.path}" if self.line is None else f"{self.path}:{self.line}"

    def error(self, expected: str) -> JounceError:
        """Return the error for an invalid value."""
        return JounceError(f"{self.place}: {self.what} is {quote_value(self.value)}; expected {expected}")

    def named(self, what: str) -> "Entry":
        """Return the entry with another name for messages."""
        return replace(self, what=what)

    def keys(self, needed: Sequence[str], optional: Sequence[str] = ()) -> "Entry":
        """Return the entry, whose keys are checked.

        It has all needed keys, and no others except the optional ones.
        """
        keys = [*needed, *optional]
        for key in self._mapping():
            if key not in keys:
                raise JounceError(f"{self.get(key).place}: {unknown_name_error('key', key, keys, self.what)}")
        for key in needed:
            self.need(key, needed)
        return self

    def need(self, key: str, needed: Sequence[str] = ()) -> "Entry":
        """Return the value of a required key; `needed` are all required keys."""
        if key not in self._mapping():
            expected = needed if len(needed) > 0 else [key]
            raise JounceError(f"{self.place}: {self.what} has no {quote_value(key)}; expected {join_names(expected)}")
        return self.get(key)

    def alone(self, key: str, excluded_keys: Sequence[str]) -> bool:
        """Return whether a key is present without keys that it excludes.

        Raises `JounceError` if such a key is present too.
        """
        for other in excluded_keys:
            if key in self._mapping() and other in self.value:
                came = f"both {quote_value(key)} and {quote_value(other)}"
                raise JounceError(f"{self.place}: {self.what} has {came}; expected one of them")
        return key in self.value

    def get(self, key: Any, default: Any = None) -> "Entry":
        """Return the value of a key, or the default."""
        value = self._mapping().get(key, default)
        # The node of the key knows its line; a default has the line of the whole.
        pairs = self.node.value if self.node is not None and self.node.id == "mapping" else []
        key_node, value_node = next(((k, v) for k, v in pairs if k.value == str(key)), (None, None))
        line = self.line if key_node is None else key_node.start_mark.line + 1
        return Entry(value, f"{shorten(str(key))} of {self.what}", self.path, line, value_node)

    def members(self) -> dict[str, "Entry"]:
        """Return the values of all keys by name.

        A key that YAML reads as a number is still a name.
        """
        entries = {str(key): self.get(key) for key in self._mapping()}
        if len(entries) < len(self.value):
            raise self.error("keys with distinct names; 5 and '5' are the same name")
        return entries

    def items(self, name: str = "", least: int = 0) -> list["Entry"]:
        """Return the entries of a list.

        Messages call each by `name`, or ``entry 1 of ...`` and so on.

        """
        if not isinstance(self.value, list):
            raise self.error("a list")
        if len(self.value) < least:
            raise JounceError(f"{self.place}: {self.what} is empty; expected at least {least} entry")
        nodes = self.node.value if self.node is not None else [None] * len(self.value)
        lines = [self.line if node is None else node.start_mark.line + 1 for node in nodes]
        return [
            Entry(value, f"entry {i} of {self.what}" if name == "" else name, self.path, line, node)
            for i, (value, line, node) in enumerate(zip(self.value, lines, nodes, strict=True), start=1)
        ]

    def text(self) -> str:
        """Return the value, which is a text."""
        if not isinstance(self.value, str):
            raise self.error("a text")
        return self.value

    def choice(self, choices: Collection[str]) -> str:
        """Return the value, which is one of the known texts."""
        if self.text() not in choices:
            raise JounceError(f"{self.place}: {unknown_name_error(self.what, self.value, choices)}")
        return str(self.value)

    def number(self) -> float:
        """Return the value, which is a finite number."""
        if not is_finite(self.value):
            raise self.error("a finite number")
        return float(self.value)

    def angle(self, factor: float = 1.0) -> float:
        """Return a finite number in rad.

        Its tag may state its unit; without one the number is multiplied by a factor.
        """
        if isinstance(self.value, TaggedAngle):
            value, factor = self.value.rad, 1.0
        else:
            value = self.value
        if not is_finite(value):
            raise self.error("a finite number, as it is or behind !degrees or !radians")
        return float(value) * factor

    def numbers(self, *shapes: tuple[int, ...]) -> np.ndarray:
        """Return finite numbers in one of the shapes.

        The value is a list, or a list of rows.
        """
        words = " or ".join(" rows of ".join(map(str, shape)) + " numbers" for shape in shapes)
        # The first shape of as many items; what is left of it is the shape of each item.
        length = len(self.value) if isinstance(self.value, list) else None
        item_shapes = [tuple(item_shape) for count, *item_shape in shapes if count == length]
        if len(item_shapes) == 0:
            raise self.error(words)
        if item_shapes[0] == ():
            return np.array([item.number() for item in self.items()])
        return np.array([item.numbers(item_shapes[0]) for item in self.items()])

    def _mapping(self) -> Mapping[Any, Any]:
        if not isinstance(self.value, Mapping):
            raise self.error("keys and values")
        return self.value


def read(path: Path, what: str) -> Entry:
    """Return the entry of a file of one document, YAML or JSON.

    A JSON file is known by its suffix; messages call the entry `what`.
    """
    return only_document(read_documents(path, what))


def only_document(documents: Sequence[Entry]) -> Entry:
    """Return the only one of the documents of a file.

    Raises `JounceError` if there are more.
    """
    if len(documents) > 1:
        raise JounceError(f"{documents[1].place}: document 2 of {len(documents)}, separated by ---; expected one")
    return documents[0]


def read_documents(path: Path, what: str) -> list[Entry]:
    """Return the documents of a YAML or JSON file.

    A JSON file has one. There is at least one, which may be empty.
    """
    content = files.read_bytes(path)
    kind = "JSON" if path.suffix.lower() == ".json" else "YAML"
    try:
        if kind == "JSON":
            return [Entry(json.loads(content, object_pairs_hook=_refuse_repeated_keys), what, path)]
        documents = [
            Entry(value, what, path, node.start_mark.line + 1, node) for value, node in parse_documents(content)
        ]
        return documents if len(documents) > 0 else [Entry(None, what, path)]
    # Not only errors of parsers: numbers of 5,000 digits, the 31st of June, 9,999 brackets raise others.
    except Exception as error:
        mark = getattr(error, "problem_mark", None)
        line = getattr(error, "lineno", None) if mark is None else mark.line + 1
        problem = getattr(error, "problem", None) or error
        words = one_line(problem) or type(error).__name__
        cause = words if isinstance(error, TagError) else f"not {kind}: {words}"
        raise JounceError(f"{path}{'' if line is None else f':{line}'}: {cause}") from None


def _refuse_repeated_keys(pairs: list[tuple[str, Any]]) -> JsonObject:
    """Return the object of pairs, whose keys are distinct."""
    data = dict(pairs)
    if len(data) < len(pairs):
        [(key, _)] = Counter(key for key, _ in pairs).most_common(1)
        raise ValueError(f"key {quote_value(key)} occurs twice")
    return data


ANGLE_TAGS = {"!degrees": radians, "!radians": float}


@dataclass(frozen=True, repr=False)
class TaggedAngle:
    """An angle in rad, or its rate, with the text stating it."""

    rad: float
    text: str

    def __repr__(self) -> str:
        return self.text


class TagError(ValueError):
    """A tag, or what stands behind one, that jounce does not know."""

    def __init__(self, problem: str, node: Any) -> None:
        super().__init__(problem)
        self.problem, self.problem_mark = problem, node.start_mark


def parse_documents(content: bytes) -> Iterator[tuple[Any, Any]]:
    """Yield value and node of each document that is not empty.

    `ros2 topic echo`, for example, separates documents by ``---``.
    """
    from ruamel.yaml import YAML  # YAML 1.2: 1e-3 is a number, a repeated key an error

    # A safe reader refuses tags that name code. Merge keys are not expanded: they could make ten lines fill the memory.
    yaml = YAML(typ="safe", pure=True)
    constructor = yaml.constructor
    constructor.flatten_mapping = lambda _: None
    tag_constructors = dict.fromkeys(ANGLE_TAGS, _construct_angle) | {None: _refuse_tag}
    constructor.yaml_constructors = {**constructor.yaml_constructors, **tag_constructors}
    for node in yaml.compose_all(content):
        value = constructor.construct_document(node)
        if value is not None:
            yield value, node


def _construct_angle(_: Any, node: Any) -> TaggedAngle:
    came = quote_value(node.value) if node.id == "scalar" else f"a {node.id}"
    try:
        return TaggedAngle(ANGLE_TAGS[node.tag](float(node.value)), f"{node.tag} {node.value}")
    except (TypeError, ValueError):
        raise TagError(f"{node.tag} stands before {came}; expected a number", node) from None


def _refuse_tag(_: Any, node: Any) -> None:
    raise TagError(f"unknown tag {quote_value(str(node.tag))}; available: {', '.join(ANGLE_TAGS)}", node)
