"""Imports point inwards: a layer imports those before it; facades import what lies outside them in their methods."""

import ast
from collections.abc import Iterator
from pathlib import Path

import jounce

SOURCE = Path(jounce.__file__).parent
LAYERS = (  # from the inside out
    "core",
    "errors",
    "_version",
    "_parts",
    "_typing",
    "_scalars",
    "spatial",
    "program",
    "model",
    "dynamics",
    "arguments",
    "native",
    "motion",
    "engine",
    "robot",
    "limits",
    "actuators",
    "models",
    "audit",
    "identification",
    "io",
    "dask",
    "stream",
    "checks",
    "_symbolic",
    "_codegen",
    "cuda",
    "_casadi",
    "figures",
    "demo",
    "_report",
    "_view",
    "cli",
    "__main__",
)
FACADES = (  # methods that pass their arguments on, and displays
    "robot.robot", "motion.motion", "limits.check", "limits.slowdown", "limits.retime", "io.loading",
)  # fmt: skip
MODULES = {
    ".".join(path.relative_to(SOURCE).with_suffix("").parts).removesuffix(".__init__"): path
    for path in SOURCE.rglob("*.py")
    if path.parent != SOURCE or path.name != "__init__.py"
}


def imported(node: ast.AST, late: bool = False) -> Iterator[tuple[str, bool]]:
    """The layers that the code below a node imports, and whether in a function or for type checkers only."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.ImportFrom) and child.module == "jounce":
            yield from ((name.name, late) for name in child.names if name.name in LAYERS)
        elif isinstance(child, ast.ImportFrom) and (child.module or "").startswith("jounce."):
            yield str(child.module).split(".")[1], late
        typed = isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"
        yield from imported(child, late or typed or isinstance(child, ast.FunctionDef))


def test_every_module_is_in_a_layer():
    assert {name.split(".")[0] for name in MODULES} <= set(LAYERS)


def test_imports_point_inwards():
    outwards = [
        f"{name} imports {layer}"
        for name, path in MODULES.items()
        for layer, late in imported(ast.parse(path.read_text(encoding="utf-8")))
        if LAYERS.index(layer) > LAYERS.index(name.split(".")[0]) and not (late and name in FACADES)
    ]
    assert not outwards
