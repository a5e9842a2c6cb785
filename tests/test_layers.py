"""Imports point inwards, and few names cross. This file is the one place that states the order of the rooms.

A room is a folder of the package, a storey some rooms next to each other. Counts are upper bounds, kept at what was
reached: whoever merges or moves lowers them, and who has to raise one says why in the commit.
"""

import re
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from jounce.native.cache import CODE_LAYERS
from support.imports import (
    SOURCE,
    arrows_inside,
    floors,
    importers_of_modules,
    importers_of_names,
    imports,
    module_paths,
    room_of,
)

EQUATIONS = "core", "spatial", "program", "model", "dynamics", "arguments", "native"
MOTIONS = "motion", "engine", "io"
ANSWERS = (
    "limits", "actuators", "identification", "live", "dask", "stream", "checks", "_codegen", "cuda", "figures",
    "_report",
)  # fmt: skip
DOORS = "robot", "cli", "__main__"
LAYERS = *EQUATIONS, *MOTIONS, *ANSWERS, *DOORS  # from the inside out
INSIDE = *EQUATIONS, *MOTIONS

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "code.md").read_text(encoding="utf-8")
STOREYS = {"equations": EQUATIONS, "motions": MOTIONS, "answers": ANSWERS, "doors": DOORS}

MOST_MODULES = 321
MOST_MODULES_OF_ONE_IMPORTER = 52  # a module that serves one other is mostly a part of it
MOST_NAMES = 1332  # that cross from a module to another
MOST_NAMES_IMPORTED_ONCE = 619
MOST_ARROWS_INSIDE = 760  # between modules of one room
MOST_FLOORS_INSIDE = {"limits": 9, "native": 7}  # how many modules there are to read, at most, to the lowest one
MOST_NAMES_OF_ANSWERS_FROM_BELOW = 226
MOST_NAMES_OF_MOTIONS_FROM_EQUATIONS = 213
MOST_FLOORS = 14  # rooms to read, at most, from a command down to the core
MOST_ARROWS_BETWEEN_ROOMS = 162


def list_of_rooms() -> set[str]:
    return {room_of(name) for name in module_paths() if name}


def between_rooms() -> set[tuple[str, str]]:
    """Pairs of a room and one that it imports from."""
    return {
        (room_of(one.importer), room_of(one.source))
        for one in imports()
        if one.importer and one.source and room_of(one.importer) != room_of(one.source)
    }


def test_every_module_is_in_a_layer():
    assert list_of_rooms() == set(LAYERS)


def test_imports_point_inwards():
    outwards = [(room, other) for room, other in between_rooms() if LAYERS.index(other) > LAYERS.index(room)]
    assert not outwards


def test_the_key_of_a_kernel_covers_all_layers_that_make_it():
    assert EQUATIONS == CODE_LAYERS


def test_chains_of_layers_are_short():
    assert floors(between_rooms()) <= MOST_FLOORS


def test_no_files_import_each_other_in_a_circle():
    below: dict[str, set[str]] = {name: set() for name in module_paths()}
    for one in imports():
        if one.importer and one.source != one.importer:
            below[one.importer].add(one.source)
    TopologicalSorter(below).prepare()


def names_from(below: tuple[str, ...], above: tuple[str, ...]) -> set[tuple[str, str]]:
    """The names that layers import from others below them."""
    return {
        (one.source, one.name) for one in imports() if room_of(one.importer) in above and room_of(one.source) in below
    }


def test_modules_and_the_names_between_them_are_few():
    names = importers_of_names(imports())
    alone = [
        name
        for name, importers in importers_of_modules(imports()).items()
        if len(importers) == 1 and module_paths()[name].name != "__init__.py"
    ]
    counts = {
        "modules": (len(module_paths()), MOST_MODULES),
        "modules of one importer": (len(alone), MOST_MODULES_OF_ONE_IMPORTER),
        "names": (len(names), MOST_NAMES),
        "names imported once": (sum(len(found) == 1 for found in names.values()), MOST_NAMES_IMPORTED_ONCE),
        "arrows inside rooms": (sum(map(len, arrows_inside(imports()).values())), MOST_ARROWS_INSIDE),
        "names of answers from below": (len(names_from(INSIDE, ANSWERS)), MOST_NAMES_OF_ANSWERS_FROM_BELOW),
        "names of motions": (len(names_from(EQUATIONS, MOTIONS)), MOST_NAMES_OF_MOTIONS_FROM_EQUATIONS),
        "arrows between rooms": (len(between_rooms()), MOST_ARROWS_BETWEEN_ROOMS),
    }
    assert {what: pair for what, pair in counts.items() if pair[0] > pair[1]} == {}


@pytest.mark.parametrize(("room", "most"), MOST_FLOORS_INSIDE.items())
def test_chains_of_modules_within_a_room_are_short(room, most):
    assert floors(arrows_inside(imports())[room]) <= most


def test_the_page_on_the_code_draws_the_storeys():
    lines = (line.split() for line in PAGE.splitlines() if line.startswith("    "))
    assert {storey: tuple(rooms) for storey, *rooms in lines} == STOREYS


def test_the_page_on_the_code_lists_what_each_room_imports():
    rows = re.findall(r"^\| `(\w+)` \|.*\|([^|]*)\|$", PAGE.partition("| layer |")[2], re.MULTILINE)
    listed = {(room, other) for room, others in rows for other in re.findall(r"`(\w+)`", others)}
    assert listed == between_rooms()
    assert {room for room, _ in rows} == list_of_rooms()


def test_files_that_the_page_on_the_code_names_exist():
    files = re.findall(r"`(\w+/[\w/]+\.py)`", PAGE)
    assert len(files) > 15
    assert [file for file in files if not any((root / file).exists() for root in (SOURCE, ROOT))] == []


def test_the_core_is_imported_alone():
    outside = [room for room in LAYERS if room not in INSIDE or room == "io"]
    inside = [name for name in module_paths() if room_of(name) in INSIDE and room_of(name) != "io"]
    code = f"""
import importlib, sys
sys.modules |= dict.fromkeys({[f"jounce.{name}" for name in outside]})
for name in {[name for name in inside if name != "engine.primitive"]}:  # which imports JAX
    importlib.import_module("jounce." + name)
"""
    subprocess.run([sys.executable, "-c", code], check=True)
