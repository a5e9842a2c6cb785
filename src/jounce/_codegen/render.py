"""The files of generated code: the templates of a language, filled in."""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from jounce._codegen import header
from jounce._codegen.function import Function
from jounce._codegen.language import digits
from jounce._codegen.live import LIVE_FUNCTIONS, spell_code
from jounce._codegen.options import CodegenOptions
from jounce._codegen.printer import PrintedFunction
from jounce._codegen.test_vectors import TEST_TOLERANCES, Vectors
from jounce.model.positions import position_count
from jounce.program.operations import FUNCTION_KINDS

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATES = Path(__file__).parent
TEMPLATE_SUFFIX = ".jinja"


def file_names(options: CodegenOptions) -> list[str]:
    """The names of the files that there may be."""
    return list(_templates(options))


def render_files(options: CodegenOptions, functions: Sequence[Function], tests: Sequence[Vectors]) -> dict[str, str]:
    """The files by name, from functions and the test vectors of each; a template that comes out empty makes no file."""
    environment, printed = _environment(), _print_functions(options, functions)
    context, by_name = _context(options, printed, tests), {f.name: f for f in printed}
    made = {
        name: environment.get_template(path).render(context, function=by_name.get(function))
        for name, (path, function) in _templates(options).items()
    }
    return {name: text for name, text in made.items() if text.strip()}


def render_template(options: CodegenOptions, functions: Sequence[Function], template: str) -> str:
    """What a template of the language makes of functions without test vectors."""
    path = f"{options.language.name}/{template}{TEMPLATE_SUFFIX}"
    tests = [Vectors({}, {}, {}, {}) for _ in functions]
    return _environment().get_template(path).render(_context(options, _print_functions(options, functions), tests))


@cache  # which keeps the templates compiled
def _environment() -> "Environment":
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True,
    )  # fmt: skip
    environment.globals["listed"] = lambda words: " and ".join(", ".join(words).rsplit(", ", 1))
    environment.filters["wrapped"] = _wrap
    environment.filters["packed"] = _pack
    environment.filters["rows"] = lambda array: (np.ravel(state).tolist() for state in array)  # one per state
    return environment


def _templates(options: CodegenOptions) -> dict[str, tuple[str, str]]:
    """Map the names of the generated files to their templates, as paths in this package, and functions.

    A template with FUNCTION in its name makes one file per function.
    """
    folder = options.language.name
    made = {}
    for path in sorted((TEMPLATES / folder).glob(f"[!_]*{TEMPLATE_SUFFIX}")):
        for function in options.outputs if "FUNCTION" in path.name else ("",):
            name = (
                path.name.removesuffix(TEMPLATE_SUFFIX).replace("FUNCTION", function).replace("PREFIX", options.prefix)
            )
            made[name] = f"{folder}/{path.name}", function
    return made


def _print_functions(options: CodegenOptions, functions: Sequence[Function]) -> list[PrintedFunction]:
    return [PrintedFunction(**vars(f), language=options.language, single=options.single) for f in functions]


def _context(
    options: CodegenOptions, functions: Sequence[PrintedFunction], tests: Sequence[Vectors]
) -> Mapping[str, object]:
    """What templates name."""
    robot, mechanism, single, s = options.robot, options.robot.origin, options.single, options.live
    known = all(name in robot.own and robot.own[name].dtype != object for name in robot.shapes)  # all have numbers
    used = {"sin", "cos"} | {step.kind for function in functions for step in function.program.steps}
    literal = options.language.literal
    return {
        **options.language.helpers,
        "robot": robot,
        "prefix": options.prefix,
        "real": options.language.real[single],
        "single": single,
        "live": s and (lambda text: spell_code(text, s, options.language, single, options.prefix)),
        "order": options.order,
        "n": mechanism.n,
        "nq": position_count(mechanism),
        "nb": mechanism.nb,
        "functions": functions,  # in the order asked for
        "tests": list(zip(functions, tests, strict=True)),  # each with its Vectors
        "parameters": functions[0].parameters,
        "meanings": header.parameters(robot),
        "own": robot.own if known else {},
        "tolerance": TEST_TOLERANCES[single],
        "origin": header.origin(mechanism, options.order, single),
        "arrays": header.arrays(mechanism, options.language.first),
        "conventions": header.conventions(mechanism, functions),
        "places": header.places(mechanism, functions),
        "drive_trains": header.drive_trains(mechanism, functions),
        "layouts": header.layouts(functions),
        "moving": any(function.computation.base for function in functions),
        "elementary": [kind for kind in FUNCTION_KINDS if kind in used] + LIVE_FUNCTIONS * bool(s),
        "scalars": any(not function.outputs[0].shape for function in functions),
        "number": lambda x: literal(digits(x, single), single),
        "double": lambda x: literal(digits(x, False), False),
    }


def _wrap(text: str, indent: str = "", width: int = 118) -> str:
    """A sentence in lines, each but the first behind an indent."""
    from textwrap import wrap

    return f"\n{indent}".join(wrap(text, width - len(indent), break_long_words=False, break_on_hyphens=False))


def _pack(text: str, indent: str = "", end: str = "", width: int = 118) -> str:
    """Wrap comma-separated items: all lines but the first are indented, all but the last have a suffix."""
    lines = [""]
    for item in text.strip().split(", "):
        longer = f"{lines[-1]}, {item}" if lines[-1] else item
        if len(indent) + len(longer) + len(end) < width:
            lines[-1] = longer
        else:
            lines[-1] += ","
            lines.append(item)
    return f"{end}\n{indent}".join(lines)
