"""Imports point inwards: a layer imports those before it. This list is the one place that states their order."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import jounce
from jounce.native.cache import CODE_LAYERS

SOURCE = Path(jounce.__file__).parent
LAYERS = (  # from the inside out
    "core",
    "spatial",
    "program",
    "model",
    "dynamics",
    "arguments",
    "native",
    "motion",
    "engine",
    "limits",
    "actuators",
    "identification",
    "live",
    "io",
    "dask",
    "stream",
    "checks",
    "_codegen",
    "cuda",
    "figures",
    "_report",
    "robot",
    "cli",
    "__main__",
)
MODULES = {
    ".".join(path.relative_to(SOURCE).with_suffix("").parts).removesuffix(".__init__"): path
    for path in SOURCE.rglob("*.py")
    if path.parent != SOURCE or path.name != "__init__.py"
}


def imported(module: ast.AST) -> Iterator[str]:
    """The layers that code imports, in functions and for type checkers too."""
    for node in ast.walk(module):
        if isinstance(node, ast.ImportFrom) and node.module == "jounce":
            yield from (name.name for name in node.names if name.name in LAYERS)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("jounce."):
            yield str(node.module).split(".")[1]


def test_every_module_is_in_a_layer():
    assert {name.split(".")[0] for name in MODULES} <= set(LAYERS)


def test_imports_point_inwards():
    outwards = [
        f"{name} imports {layer}"
        for name, path in MODULES.items()
        for layer in imported(ast.parse(path.read_text(encoding="utf-8")))
        if LAYERS.index(layer) > LAYERS.index(name.split(".")[0])
    ]
    assert not outwards


def test_the_key_of_a_kernel_covers_all_layers_that_make_it():
    assert LAYERS[: LAYERS.index("native") + 1] == CODE_LAYERS


def test_no_chain_of_layers_is_longer_than_fifteen():
    """How many there are to read, at most, from a command down to the core."""
    below = {layer: set[str]() for layer in LAYERS}
    for name, path in MODULES.items():
        layer = name.split(".")[0]
        below[layer] |= set(imported(ast.parse(path.read_text(encoding="utf-8")))) - {layer}
    floors: dict[str, int] = {}
    for layer in TopologicalSorter(below).static_order():
        floors[layer] = 1 + max((floors[other] for other in below[layer]), default=0)
    assert max(floors.values()) == floors["__main__"] <= 15


def files_imported(name: str) -> set[str]:
    """The files of the package that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(MODULES[name].read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("jounce."):
            source = str(node.module).removeprefix("jounce.")
            found |= {inner if (inner := f"{source}.{part.name}") in MODULES else source for part in node.names}
    return found - {name}


def test_no_files_import_each_other_in_a_circle():
    TopologicalSorter({name: files_imported(name) for name in MODULES}).prepare()


def test_the_core_is_imported_alone():
    outside = LAYERS[LAYERS.index("engine") + 1 :]
    code = f"""
import importlib, sys
sys.modules |= dict.fromkeys({[f"jounce.{name}" for name in outside]})
for name in {[name for name in MODULES if LAYERS.index(name.split(".")[0]) < LAYERS.index("limits")]}:
    if name != "engine.primitive":  # which imports JAX
        importlib.import_module("jounce." + name)
"""
    subprocess.run([sys.executable, "-c", code], check=True)
