"""The files of generated code: the templates of a language, filled in."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jounce._codegen import notes
from jounce._codegen.language import digits
from jounce._codegen.parametric import Parametric
from jounce._codegen.printer import Printed
from jounce._codegen.request import Request
from jounce._codegen.routine import Routine
from jounce._codegen.vectors import TOLERANCE, vectors
from jounce.program.operations import FUNCTIONS

HERE = Path(__file__).parent
SUFFIX = ".jinja"


def names(request: Request) -> list[str]:
    """The names of the files that there may be."""
    return list(_templates(request))


def files(request: Request, routines: Sequence[Routine], **tested: Any) -> dict[str, str]:
    """The files by name; `tested` is how many states, and by which method, the test vectors hold.

    A template that comes out empty makes no file.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(HERE), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True,
    )  # fmt: skip
    environment.globals["listed"] = lambda words: " and ".join(", ".join(words).rsplit(", ", 1))
    environment.filters["wrapped"] = _wrapped
    environment.filters["packed"] = _packed
    environment.filters["rows"] = _rows
    context = _context(request, routines, tested)
    functions = {f.name: f for f in context["routines"]}
    made = {
        name: environment.get_template(path).render(context, function=functions.get(function))
        for name, (path, function) in _templates(request).items()
    }
    return {name: text for name, text in made.items() if text.strip()}


def _templates(request: Request) -> dict[str, tuple[str, str]]:
    """By the names of the files that they make the templates, as paths in this package.

    One with FUNCTION in its name makes a file for each function, which stands beside the path.
    """
    folder = request.language.name
    made = {}
    for path in sorted((HERE / folder).glob(f"[!_]*{SUFFIX}")):
        for function in request.outputs if "FUNCTION" in path.name else ("",):
            name = path.name.removesuffix(SUFFIX).replace("FUNCTION", function).replace("PREFIX", request.prefix)
            made[name] = f"{folder}/{path.name}", function
    return made


def _context(request: Request, routines: Sequence[Routine], tested: Mapping[str, Any]) -> dict[str, Any]:
    """What templates are given."""
    mechanism, single = request.robot.origin, request.single
    printed = [Printed(routine, request.language, single) for routine in routines]
    found = [vectors(request.robot, routine, single, **tested) for routine in routines]
    literal = request.language.literal
    return {
        **request.language.helpers,
        "robot": request.robot,
        "prefix": request.prefix,
        "real": request.language.real[single],
        "single": single,
        "order": request.order,
        "n": mechanism.n,
        "nb": mechanism.nb,
        "routines": printed,  # Printed, in the order asked for
        "tests": list(zip(printed, found, strict=True)),  # each with its Vectors
        "parameters": routines[0].parameters,
        "meanings": notes.parameters(request.robot),
        "own": _own(request.robot),
        "tolerance": TOLERANCE[single],
        "origin": notes.origin(mechanism, request.order, single),
        "arrays": notes.arrays(mechanism, request.language.first),
        "conventions": notes.conventions(mechanism, routines),
        "drive_trains": notes.drive_trains(mechanism, request.outputs),
        "functions": _functions(routines),
        "matrices": any("matrix" in routine.name for routine in routines),
        "number": lambda x: literal(digits(x, single), single),
        "double": lambda x: literal(digits(x, False), False),
    }


def _functions(routines: Sequence[Routine]) -> list[str]:
    """The functions of one operand that code calls: sines and cosines of any robot, others where there are some."""
    used = {step.kind for routine in routines for step in routine.program.steps}
    return [kind for kind in FUNCTIONS if kind in ("sin", "cos") or kind in used]


def _wrapped(text: str, indent: str = "", width: int = 118) -> str:
    """A sentence in lines, each but the first behind an indent."""
    from textwrap import wrap

    return f"\n{indent}".join(wrap(text, width - len(indent), break_long_words=False, break_on_hyphens=False))


def _own(robot: Parametric) -> dict[str, np.ndarray]:
    """The robot's own values of all parameters; none where one has no number."""
    numbers = all(name in robot.own and robot.own[name].dtype != object for name in robot.shapes)
    return robot.own if numbers else {}


def _packed(text: str, indent: str = "", end: str = "", width: int = 118) -> str:
    """What commas separate in lines, each but the first behind an indent, each but the last with an end."""
    lines = [""]
    for item in text.strip().split(", "):
        longer = f"{lines[-1]}, {item}" if lines[-1] else item
        if len(indent) + len(longer) + len(end) < width:
            lines[-1] = longer
        else:
            lines[-1] += ","
            lines.append(item)
    return f"{end}\n{indent}".join(lines)


def _rows(array: np.ndarray) -> Iterator[list[float]]:
    """An array (states, ...) as flat lists, one a state."""
    return (np.ravel(state).tolist() for state in array)
