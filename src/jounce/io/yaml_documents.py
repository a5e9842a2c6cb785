"""YAML text: the documents of a file, with tags of angles and without anything that fills the memory.

``!degrees 90`` and ``!radians 1.57`` are what xacro and the limits of MoveIt know. A value with such a tag is not a
number, so that only readers of angles take it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import radians
from typing import Any

from jounce.core.errors import quote_value

ANGLE_TAGS = {"!degrees": radians, "!radians": float}


@dataclass(frozen=True, repr=False)
class TaggedAngle:
    """An angle, or a rate of one, in rad, and the text that states it."""

    rad: float
    text: str

    def __repr__(self) -> str:
        return self.text


class TagError(ValueError):
    """A tag, or what stands behind one, that jounce does not know."""

    def __init__(self, problem: str, node: Any) -> None:
        super().__init__(problem)
        self.problem, self.problem_mark = problem, node.start_mark


def read_documents(content: bytes) -> Iterator[tuple[Any, Any]]:
    """The value and the node of each document that is not empty, such as `ros2 topic echo` separates by ``---``."""
    from ruamel.yaml import YAML  # YAML 1.2: 1e-3 is a number, a repeated key an error

    yaml = YAML(typ="safe", pure=True)  # safe: a tag that names code is refused
    constructor = yaml.constructor
    constructor.flatten_mapping = lambda _: None  # merge keys, which could make ten lines fill the memory
    of_tags = dict.fromkeys(ANGLE_TAGS, _construct_angle) | {None: _refuse_tag}
    constructor.yaml_constructors = {**constructor.yaml_constructors, **of_tags}
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
