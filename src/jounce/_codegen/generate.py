"""Generate a robot's equations as a folder of source code in another language, with its tests.

`codegen` is the door of `Robot.codegen`; `code` and `render_template` give one text without tests. The options are
checked, the functions traced (`trace_functions`), each gets states with their correct results (`test_vectors`), and the
templates of the language are filled in (`render_files`): all files in its folder, one per function where FUNCTION is in
the name of a template. `_context` is what templates name.

`Robot.live` as C and C++ is one template for all robots, in which words are replaced by sizes, constants, types and
names (`spell_code`).
"""

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from jounce._codegen import header
from jounce._codegen.function import Function, trace
from jounce._codegen.language import Language, digits
from jounce._codegen.options import CodegenOptions, check_options, languages_where
from jounce._codegen.printer import PrintedFunction
from jounce._codegen.test_vectors import TEST_TOLERANCES, Vectors, vectors
from jounce.core import errors, scalars
from jounce.core.errors import JounceError, join_names, quote_value, warn
from jounce.core.typing import Language as LanguageName
from jounce.engine.engine import Engine
from jounce.io import files
from jounce.live import estimator, innovations, settings
from jounce.live.estimator import START_VARIANCE
from jounce.live.samples import NEW_CLOCK_STAMPS
from jounce.live.settings import Settings
from jounce.model import positions
from jounce.program import operations

if TYPE_CHECKING:
    from jinja2 import Environment


TEMPLATES = Path(__file__).parent
TEMPLATE_SUFFIX = ".jinja"
LIVE_FUNCTIONS = ["sqrt", "exp", "expm1", "pow", "fabs", "fmin", "fmax", "floor"]  # with an f in single precision


@dataclass(frozen=True)
class Generated:
    """The result of `Robot.codegen`: its folder, files and numbers of operations."""

    directory: Path
    files: tuple[str, ...]
    operations: dict[str, int] = field(hash=False)  # by function


def codegen(
    robot: Engine,
    lang: LanguageName,
    order: int,
    directory: str | os.PathLike[str] | None,
    outputs: Sequence[str],
    wrench: bool,
    parameters: Sequence[str],
    float32: bool,
    prefix: str | None,
    overwrite: bool,
    moving_base: bool,
    live: object,
) -> Generated:
    """Write a robot's equations as source code with tests, see `Robot.codegen`."""

    if not isinstance(directory, str | os.PathLike | None):
        raise JounceError(f"directory is {quote_value(directory)}; expected the path of a folder")
    errors.check_bool("overwrite", overwrite, "whether to write into a folder that is not empty")
    options = check_options(robot, lang, order, outputs, wrench, parameters, float32, prefix, moving_base, live)
    folder = files.expand_path(f"{options.prefix}-{lang}" if directory is None else directory)
    names = file_names(options)
    files.check_folder(folder, header.GENERATED_MARK, names, overwrite)
    functions = trace_functions(options)
    _warn_of_idle(options, functions)
    tests = [vectors(options.robot, function, options.single) for function in functions]
    texts = render_files(options, functions, tests)
    files.write_folder(folder, texts, header.GENERATED_MARK, overwrite)
    return Generated(folder, tuple(sorted(texts)), {f"{options.prefix}_{f.name}": f.operations for f in functions})


def code(robot: Engine, lang: LanguageName, template: str, order: int, outputs: Sequence[str], wrench: bool) -> str:
    """The code of a robot as one text, by the template of a language, without tests."""

    options = check_options(robot, lang, order, outputs, wrench, (), False, None)
    return render_template(options, trace_functions(options), template)


def trace_functions(options: CodegenOptions) -> list[Function]:
    """The functions of what is asked for, or `JounceError` where one is too large."""
    functions, most = [], options.language.largest
    for name, computation in options.outputs.items():
        made = trace(options.robot, name, computation)
        if made.operations > most:
            others = languages_where(lambda x: x.largest > most)
            larger = f"; larger robots go into {others}" if others else ""
            raise JounceError(
                f"{computation.spelling} of {options.robot.origin.name} to order {options.order} takes"
                f" {made.operations} operations; {options.language.title} is generated for up to {most}{larger}"
            )
        functions.append(made)
    return functions


def _warn_of_idle(options: CodegenOptions, functions: Sequence[Function]) -> None:
    """Warn of parameters that are asked for and that no function uses."""
    used: set[str] = set()
    for f in functions:
        numbers = {int(step.value) for step in f.program.steps if step.kind == "input"}
        used |= {port.name for port in f.parameters if numbers & set(range(port.start, port.end))}
    idle = [name for name in options.robot.own if name not in used]
    if idle:
        warn(f"parameters without effect on {join_names(options.outputs)}: {join_names(idle)}")


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
        "nq": positions.count(mechanism),
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
        "drive_trains": header.drives(mechanism, functions),
        "layouts": header.layouts(functions),
        "moving": any(function.computation.base for function in functions),
        "elementary": [kind for kind in operations.FUNCTION_KINDS if kind in used] + LIVE_FUNCTIONS * bool(s),
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


def spell_code(text: str, s: Settings, target: Language, single: bool, prefix: str) -> str:
    """The template with words replaced by sizes, constants of `jounce.live`, types and names."""

    def listed(numbers: Iterable[float]) -> str:
        return ", ".join(target.literal(digits(float(x), single), single) for x in numbers)

    constants = (
        vars(innovations) | vars(settings) | vars(estimator) | {"START_VARIANCE": START_VARIANCE, "TURN": 2 * np.pi}
    )
    constants |= {"OMEGA": float(s.omega[0]), "DT": s.dt, "LAG": s.lag, "SPACING": s.spacing}
    constants |= {"LONGEST_GAP": s.longest_gap}
    words = {name: listed([x]) for name, x in constants.items() if name.isupper() and scalars.is_finite(x)}
    words |= {"NEW_CLOCK_STAMPS": str(NEW_CLOCK_STAMPS), "CHOICE_BLOCKS": str(innovations.CHOICE_BLOCKS)}
    words |= {"N": str(s.mechanism.n), "M": str(s.states), "K": str(s.kept)}
    words |= {"NOISE": listed(s.sigma), "FASTEST": listed(s.fastest), "TURNS": listed(2 * np.pi * s.turns)}
    words |= {"LOCAL": "inline", "PUBLIC ": "inline ", "real": target.real[single]}
    if target.name == "c":
        words |= {"LOCAL": "static", "PUBLIC ": ""} | {x: f"{prefix}_{x}" for x in ("live_rates", "live_update")}

    def replace(found: re.Match[str]) -> str:
        single_form = single and (found[0] in LIVE_FUNCTIONS or found[0][0].isdigit())
        return words.get(found[0], found[0] + "f" * single_form)

    return re.sub(r"PUBLIC |[A-Za-z_]\w*|\d+\.\d+", replace, text)
