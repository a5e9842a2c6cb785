"""Mutations of files: of their elements and entries, of their words and lines, of their bytes.

Each takes a random generator, of hypothesis, which shrinks what it chooses.
"""

import json
import warnings
from collections.abc import Callable
from copy import deepcopy
from functools import lru_cache
from io import BytesIO
from random import Random
from typing import Any
from zipfile import ZipFile

import numpy as np
from lxml import etree
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

Mutation = Callable[[Random, bytes], bytes]

NUMBERS = (
    "nan", "inf", "-inf", "Infinity", "1e400", "-1e400", "1e-400", "5e-324", "1e308", "-0", "-0.0", "+1", "9" * 400,
    "1" * 5000, "18446744073709551616", "-2147483649", "1_000", "\u0661\u0662", "\uff11", "\xbd", "0x1F", "0o17",
    "010", "1,5", "1e", "-", ".", "1 2 3", "1e3", "0", "-1", "2",
)  # fmt: skip
WORDS = (
    "", " ", "true", "null", "~", "yes", "2024-06-31", "x" * 3000, "\u0142\xf3d\u017a", "\u202egnp", "a\u2028b", "\x85",
    "\ufeff", "\U0001f916", "e\u0301", "a\nb", "\t", "'", '"', "<", "&lt;", "&#0;", "&#x202e;", "&e;", "]]>", "<!--",
    "{", "[", "}", ":", "- ", "#", "%s", "{0}", "../..", "/dev/zero", "C:\\", "$(arg a)", "${1/0}", "${x}", "*a", "&a",
    "$(find nowhere)", "<<: *a", "!!python/object/apply:os.abort []", "!!binary aGk=", "!!set {a}", "? a", "|",
    "!degrees 90", "!degrees 1e999", "!radians", "!degrees [1]", "!turns 1", "\n---\n", "\n...\n",
    "$(find fuzz_macros)",
    "ground", "base", "__proto__", "t", "name", "nan.q",
)  # fmt: skip
HEADS = (
    '<!DOCTYPE robot [<!ENTITY e "1">]>', '<!DOCTYPE robot [<!ENTITY e SYSTEM "/etc/hostname">]>',
    '<!DOCTYPE robot [<!ATTLIST mass value CDATA "7">]>', '<?xml version="1.0" encoding="ascii"?>', "%YAML 1.1\n---\n",
    "--- &a\n", "# coding: utf-16\n", "\ufeff", "\n\n", "PK\x03\x04",
)  # fmt: skip
ENCODINGS = ("utf-8-sig", "utf-16", "utf-16-le", "utf-32", "latin-1", "cp1252", "utf-7")
ALPHABET = "0123456789.-+eE"  # of numbers
BYTES = b'\0\t\n\r\x1a"0<\x7f\x80\xc3\xed\xfe\xff'


def mutated(rng: Random, suffix: str, content: bytes) -> bytes:
    """The content of a file, mutated up to three times: most often in its structure, sometimes in its bytes."""
    structure = {".npz": mutate_archive, ".csv": mutate_rows}.get(
        suffix, mutate_data if suffix in (".yaml", ".yml", ".json") else elements
    )
    kinds = (structure, raw) if suffix == ".npz" else (structure, structure, mutate_text, raw)
    with warnings.catch_warnings(action="ignore"):  # of members twice, of numbers that are none
        for _ in range(rng.randint(0, 3)):
            content = rng.choice(kinds)(rng, content)
    return content


def hostile(rng: Random) -> str:
    """A text to put in place of another."""
    return rng.choice(rng.choice((NUMBERS, WORDS)))


def mutate_text(rng: Random, content: bytes) -> bytes:
    """Words and lines replaced, deleted, repeated, swapped; texts put in; other encodings."""
    said = content.decode("utf-8", "replace")
    kind = rng.choice(("token", "token", "token", "lines", "insert", "cut", "head", "nest", "encoding"))
    if kind == "token":
        tokens = list(_tokens(said))
        i = rng.randrange(len(tokens))
        tokens[i] = rng.choice((hostile(rng), rng.choice(tokens), ""))
        said = "".join(tokens)
    elif kind == "lines":
        said = "\n".join(_rearranged(rng, said.split("\n")))
    elif kind == "insert":
        i = rng.randint(0, len(said))
        said = said[:i] + hostile(rng) + said[i:]
    elif kind == "cut":
        i, j = sorted((rng.randint(0, len(said)), rng.randint(0, len(said))))
        said = rng.choice((said[:i], said[:i] + said[j:], said[:j] + said[i:]))
    elif kind == "head":
        said = rng.choice(HEADS) + said
    elif kind == "nest":
        i, mark = rng.randint(0, len(said)), rng.choice(("[", "{", "{a: ", "<a>", "- ", "(", "-", "&a ["))
        said = said[:i] + mark * rng.choice((9, 300, 20_000)) + said[i:]
    else:
        return said.encode(rng.choice(ENCODINGS), "replace")
    return said.encode("utf-8", "replace")


@lru_cache(maxsize=16)
def _tokens(said: str) -> tuple[str, ...]:
    """Words, numbers and what lies between, which make up the text."""
    found: list[str] = [""]
    for mark in said:
        alike = found[-1] and mark.isalnum() == found[-1][-1].isalnum()
        if alike or (mark in ALPHABET and found[-1] and found[-1][-1] in ALPHABET):
            found[-1] += mark
        else:
            found.append(mark)
    return tuple(found)


def _rearranged(rng: Random, items: list[Any]) -> list[Any]:
    """One item deleted, repeated, moved, or all in another order."""
    if not items:
        return items
    i, j = rng.randrange(len(items)), rng.randrange(len(items))
    moved = items[:i] + items[i + 1 :]
    swapped = list(items)
    swapped[i], swapped[j] = swapped[j], swapped[i]
    repeated = [*items[:j], deepcopy(items[i]), *items[j:]]
    return rng.choice((moved, swapped, repeated, [*moved[:j], items[i], *moved[j:]], items[:i]))


def raw(rng: Random, content: bytes) -> bytes:
    """Bytes changed, put in, taken out, cut off, often at an end."""
    i = rng.choice((0, len(content), *(rng.randint(0, len(content)) for _ in range(4))))
    put = bytes(rng.choice(BYTES) for _ in range(rng.randint(1, 3)))
    before, after, less = content[:i], content[i:], content[i + len(put) :]
    return rng.choice((before + put + after, before + put + less, before + less, before, after, content + put))


def elements(rng: Random, content: bytes) -> bytes:
    """Elements and attributes of XML; what is no XML any more stays as it is."""
    try:
        root = etree.fromstring(content, etree.XMLParser(resolve_entities=False, no_network=True))
    except etree.XMLSyntaxError:
        return content
    found = [element for element in root.iter(etree.Element) if element is not root]
    if not found:
        return content
    one, other = rng.choice(found), rng.choice(found)
    attributed = [element for element in root.iter(etree.Element) if element.attrib] or [one]
    kind = rng.choice(("value", "value", "value", "copy", "rename", "attribute", "delete", "repeat", "move", "tag"))
    holder, giver = rng.choice(attributed), rng.choice(attributed)
    key = rng.choice(sorted(holder.attrib) or ["name"])
    try:
        if kind == "value":
            holder.set(key, _in_place_of_a_number(rng, holder.get(key, "")))
        elif kind == "copy":  # names twice, joints in a circle
            holder.set(key, giver.get(key) or rng.choice(sorted(giver.attrib.values()) or [""]))
        elif kind == "rename":
            name = rng.choice((hostile(rng), rng.choice(sorted(giver.attrib) or ["a"])))
            holder.set(name, holder.attrib.pop(key, ""))
        elif kind == "attribute":
            holder.attrib.pop(key, None)
        elif kind == "delete":
            one.getparent().remove(one)
        elif kind == "repeat":
            other.append(deepcopy(one))
        elif kind == "move":
            other.getparent().append(one)
        else:
            one.tag = rng.choice((other.tag, hostile(rng)))
    except ValueError:  # control characters, loops, tags that are none
        return content
    return etree.tostring(root, encoding="utf-8")


def _in_place_of_a_number(rng: Random, value: str) -> str:
    """The text with one of its words replaced, or all of it."""
    words = value.split() or [""]
    words[rng.randrange(len(words))] = hostile(rng)
    return rng.choice((" ".join(words), hostile(rng)))


def mutate_data(rng: Random, content: bytes) -> bytes:
    """Entries of YAML or JSON, at any depth; written as JSON, which YAML is too; or whole documents of several."""
    documents = content.split(b"\n---\n")
    if len(documents) > 1 and rng.random() < 0.5:
        return b"\n---\n".join(_rearranged(rng, documents))
    if len(documents) > 1:
        k = rng.randrange(len(documents))
        documents[k] = mutate_data(rng, documents[k])
        return b"\n---\n".join(documents)
    try:
        robot = deepcopy(_parsed(content))
    except (YAMLError, TypeError, ValueError, RecursionError):  # TypeError: lists of mappings as keys
        return content
    places = _places(robot)
    if not places:
        return content
    (holder, key), (giver, other) = rng.choice(places), rng.choice(places)
    kind = rng.choice(("value", "value", "value", "copy", "delete", "rename", "wrap", "rearrange"))
    if kind == "value":
        holder[key] = rng.choice((_value(rng), _of_its_kind(rng, holder[key])))
    elif kind == "copy":
        holder[key] = deepcopy(giver[other])
    elif kind == "delete":
        del holder[key]
    elif kind == "rename" and isinstance(holder, dict):
        holder[str(other) if rng.random() < 0.5 else hostile(rng)] = holder.pop(key)
    elif kind == "rearrange" and isinstance(holder, list):
        holder[:] = _rearranged(rng, holder)
    else:
        holder[key] = rng.choice(([holder[key]], {"name": holder[key]}, [[[holder[key]] * 2] * 2] * 2))
    try:
        return json.dumps(robot, default=str, ensure_ascii=rng.random() < 0.5).encode("utf-8", "surrogatepass")
    except (RecursionError, TypeError, ValueError):  # of keys that JSON does not have, of a list within itself
        return content


@lru_cache(maxsize=16)  # of the originals, most often
def _parsed(content: bytes) -> Any:
    return YAML(typ="safe", pure=True).load(content)


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Every list or mapping in a value with each of its keys; aliases are gone through once."""
    found, waiting, seen = [], [value], set()
    while waiting:
        holder = waiting.pop()
        if not isinstance(holder, dict | list) or id(holder) in seen:
            continue
        seen.add(id(holder))
        keys = list(holder) if isinstance(holder, dict) else range(len(holder))
        found += [(holder, key) for key in keys]
        waiting += [holder[key] for key in keys]
    return found


def _value(rng: Random) -> Any:
    return rng.choice((
        None, True, [], {}, [[]], "", 0, -0.0, -1, 7, 1e308, 5e-324, float("nan"), float("inf"), 10**400, 2**64,
        -(2**31), "1", "\ud800", hostile(rng), [hostile(rng)], {hostile(rng): 1},
    ))  # fmt: skip


def _of_its_kind(rng: Random, value: Any) -> Any:
    """A value as it might have been meant: of the same kind, and wrong."""
    if isinstance(value, bool | str) or value is None:
        return hostile(rng)
    if isinstance(value, int | float):
        return rng.choice((-value, 0, 1e300, 1e-300, value + 1, str(value)))
    return type(value)()


def mutate_rows(rng: Random, content: bytes) -> bytes:
    """Cells, rows and columns of CSV."""
    lines = [line.split(",") for line in content.decode("utf-8", "replace").split("\n")]
    i = rng.choice((0, rng.randrange(len(lines))))
    j = rng.randrange(len(lines[i]))
    kind = rng.choice(("cell", "cell", "row", "rows", "column"))
    if kind == "cell":
        lines[i][j] = rng.choice((hostile(rng), rng.choice(rng.choice(lines)), f'"{hostile(rng)}"'))
    elif kind == "row":
        lines[i] = _rearranged(rng, lines[i])
    elif kind == "rows":
        lines = _rearranged(rng, lines)
    else:
        lines = [line[:j] + line[j + 1 :] for line in lines]
    return "\n".join(map(",".join, lines)).encode("utf-8", "replace")


def mutate_archive(rng: Random, content: bytes) -> bytes:
    """Members of an NPZ file: other names, kinds, shapes and numbers; a member twice."""
    try:
        members = [(name, ZipFile(BytesIO(content)).read(name)) for name in ZipFile(BytesIO(content)).namelist()]
        arrays = [(name, np.load(BytesIO(member), allow_pickle=True)) for name, member in members]
    except Exception:  # cut or changed before
        return content
    if not arrays:
        return content
    i = rng.randrange(len(arrays))
    name, array = arrays[i]
    kind = rng.choice(("array", "array", "array", "name", "members", "damage"))
    if kind == "array":
        arrays[i] = (name, _array(rng, np.array(array)))
    elif kind == "name":
        arrays[i] = (rng.choice((hostile(rng) or "x", name.removesuffix(".npy"), rng.choice(arrays)[0])), array)
    elif kind == "members":
        arrays = _rearranged(rng, arrays)
    packed = BytesIO()
    with ZipFile(packed, "w") as file:
        for name, array in arrays:
            member = BytesIO()
            np.save(member, array, allow_pickle=True)
            written = member.getvalue()
            with file.open(name.replace("\n", " ") or "x", "w") as place:
                place.write(raw(rng, written) if kind == "damage" and rng.random() < 0.5 else written)
    return packed.getvalue()


def _array(rng: Random, array: np.ndarray) -> np.ndarray:
    numbers = array.astype(float).ravel() if array.dtype.kind in "fiub" else np.ones(3)
    other = numbers.copy()
    if other.size:
        other[rng.randrange(other.size)] = rng.choice((np.nan, np.inf, 1e308, -0.0, 5e-324))
    kind = rng.choice(("f4", "i8", "c16", "O", "U8", "?"))
    return rng.choice((
        other, numbers[:0], numbers[:-1], numbers[None], numbers[::-1], numbers.astype(kind), np.array(7.0),
        np.zeros(0), np.array({"a": 1}, object), np.zeros(3, [("q", float), ("t", float)]),
    ))  # fmt: skip
