"""The stubs that type checkers and editors read, written from the table of quantities: ``make stubs``.

A method that returns an array, or with further rates a tuple, has an overload for each number of results up to three;
the last one is for more, and for calls whose number of rates only the program knows.
"""

import inspect
import re
from pathlib import Path
from textwrap import indent

import jounce
from jounce.core import typing as types
from jounce.dynamics.quantities import QUANTITIES
from jounce.robot.docstrings import METHOD_OPTIONS, docstring, list_options
from jounce.robot.methods import Methods
from jounce.spatial.series import rate_name

SOURCE = Path(jounce.__file__).parent
WIDTH = 120
AS_THEY_ARE = ("Array", "ArrayLike", "Floats", "Named", "Rates")
IMPORTS = """from typing import Any, Literal, Never, TypeAlias, overload

from jounce.core import typing as _types
from jounce.core.typing import Array, ArrayLike, Floats, Named, Rates
from jounce.dynamics.quantities.names import QuantityName as _QuantityName
from jounce.native.kernel import Kernel
"""
CLASS = 'class Methods:\n    """What robots compute."""\n\n'
HEAD = '"""Written by `make stubs` from the table of quantities."""\n\n'


def stubs():
    """The texts of all stubs by path."""
    names = "".join(f'    "{name}",\n' for name in QUANTITIES)
    return {
        SOURCE / "dynamics/quantities/names.pyi": (
            f"{HEAD}from typing import Literal, TypeAlias\n\nQuantityName: TypeAlias = Literal[\n{names}]\n"
        ),
        SOURCE / "robot/methods.pyi": _methods(),
    }


def _methods():
    by_hand = {name: x for name, x in vars(Methods).items() if inspect.isfunction(x) and name not in QUANTITIES}
    parts = [*map(_of_row, QUANTITIES.values()), *(_of_function(name, made) for name, made in by_hand.items())]
    body = "\n".join(indent(part, "    ", lambda line: line.strip() != "") for part in parts)
    used = [name for name in vars(types) if name[0].isupper() and re.search(rf"\b{name}\b", _code(body))]
    taken = [name for name in (*used, "QuantityName") if name not in (*AS_THEY_ARE, "Any", "Literal")]
    aliases = "".join(f"{name}: TypeAlias = _{'types.' * hasattr(types, name)}{name} | Nothing\n" for name in taken)
    aliases = f"Nothing: TypeAlias = _types.Nothing[Never]\n{aliases}"
    return f"{HEAD}{IMPORTS}\n{aliases}\nFORMS: dict[str, str]\n\n{CLASS}{body}"


def _code(text):
    """The text without its docstrings."""
    return re.sub(r'""".*?"""', "", text, flags=re.DOTALL)


def _of_row(row):
    path = Path(row.laws["recursion"].__code__.co_filename).relative_to(SOURCE.parent).as_posix()
    declared = [
        f"{name}: {METHOD_OPTIONS[name].annotation} = {METHOD_OPTIONS[name].default}" for name in list_options(row)
    ]
    options = [text.replace("'", '"') for text in declared]
    one, names = "Array" if row.gives.shape else "Any", row.takes.names(row.takes.rates + 3)
    if row.gives.results:
        taken = [*(f"{name}: Named" for name in names[: row.takes.rates]), "*", *options]
        count = len(row.gives.results)
        overloads = [(taken, f"tuple[{', '.join([one] * count)}]" if count > 1 else one)]
    else:
        overloads = _overloads(names, row.takes.rates, options, one)
    return f"# its row: {path}\n{_stub(row.name, overloads, docstring(row))}"


def _of_function(name, made):
    """A method that is written by hand."""
    given = list(inspect.signature(made).parameters.values())[1:]
    options = [_declared(x) for x in given if x.kind is x.KEYWORD_ONLY]
    rates = [x for x in given if x.kind is x.POSITIONAL_OR_KEYWORD]
    if name == "compile":
        overloads = [_to_order(rates, options, k) for k in range(3)]
        overloads.append(([*map(_declared, rates), "*", *options], "Kernel[Any]"))
    else:
        least = sum(x.default is x.empty for x in rates)
        names = [rate_name("q", k) for k in range(least + 3)]
        overloads = _overloads(names, least, options, "Array")
    return f"# by hand\n{_stub(name, overloads, inspect.cleandoc(made.__doc__))}"


def _to_order(given, options, order):
    """An overload of `Robot.compile`."""
    fixed = [f"order: Literal[{order}] = ..." if x.name == "order" else _declared(x) for x in given]
    product = [x if not x.startswith("product") else "product: None = None" for x in options]
    results = f"tuple[{', '.join(['Floats'] * (order + 1))}]" if order else "Floats"
    return [*fixed, "*", *product], f"Kernel[{results}]"


def _declared(x):
    default = "" if x.default is x.empty else f" = {x.default!r}".replace("'", '"')
    return f"{x.name}: {x.annotation}{default}"


def _overloads(names, least, options, one):
    """The parameters and the result for each number of rates; the names are those up to order 3."""
    for order in range(3):
        taken = [f"{name}: Named" for name in names[: least + order]]
        yield [*taken, "*", *options], f"tuple[{', '.join([one] * (order + 1))}]" if order else one
    taken = [f"{name}: Named" for name in names]
    yield [*taken, "/", "*higher: Named", *options], f"tuple[{one}, ...]"


def _stub(name, overloads, text):
    overloads, parts = list(overloads), []
    for k, (taken, result) in enumerate(overloads):
        doc = f'\n    """{indent(text, "    ", lambda line: line.strip() != "").strip()}\n    """' if k == 0 else " ..."
        mark = "@overload\n" if len(overloads) > 1 else ""
        parts.append(f"{mark}{_definition(name, ['self', *taken], result)}{doc}\n")
    return "".join(parts)


def _definition(name, taken, result):
    """As the formatter breaks lines."""
    for inside in (", ".join(taken), f"\n    {', '.join(taken)}\n"):
        text = f"def {name}({inside}) -> {result}:"
        if max(map(len, text.splitlines())) + len("     ...") <= WIDTH:
            return text
    return f"def {name}(\n{''.join(f'    {x},{chr(10)}' for x in taken)}) -> {result}:"


if __name__ == "__main__":
    for path, text in stubs().items():
        path.write_text(text, encoding="utf-8")
