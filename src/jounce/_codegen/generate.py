"""Generate a robot's equations as source code in another language, with tests.

`codegen` is the door of `Robot.codegen`; `code` and `render_template` give one text without tests. The options are
checked and planned (`plan_code`), the functions traced (`trace_functions`), each gets states with their correct results
(`test_vectors`), and the templates of the language are filled in (`render_files`): all files in its folder, one per
function where FUNCTION is in the name of a template. `_context` is what templates name.

`Robot.live` as C and C++ is one template for all robots, in which words are replaced by sizes, constants, types and
names (`spell_code`). `LIVE_CONSTANTS` lists the constants.
"""

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from jounce._codegen import header
from jounce._codegen.function import Function, trace
from jounce._codegen.language import Language, digits
from jounce._codegen.options import CodegenOptions, CodePlan, languages_where, plan_code
from jounce._codegen.printer import PrintedFunction
from jounce._codegen.test_vectors import TEST_TOLERANCES, Vectors, vectors
from jounce.core import errors
from jounce.core.errors import JounceError, join_names, quote_value, warn
from jounce.engine.engine import Engine
from jounce.io import files
from jounce.live import estimator, innovations, settings
from jounce.live.samples import NEW_CLOCK_STAMPS
from jounce.live.settings import Settings
from jounce.model import positions
from jounce.motion.curves import ROUNDING_OF_Q
from jounce.program import operations

if TYPE_CHECKING:
    from jinja2 import Environment


TEMPLATES = Path(__file__).parent
TEMPLATE_SUFFIX = ".jinja"
LIVE_FUNCTIONS = ["sqrt", "exp", "expm1", "pow", "fabs", "fmin", "fmax", "floor"]  # with an f in single precision
LIVE_CONSTANTS: Mapping[str, float] = {  # of `Robot.live`, by the words that stand for them in its template
    "CHOICE_TIME": innovations.CHOICE_TIME,
    "KEPT_SHARE": estimator.KEPT_SHARE,
    "MAX_INNOVATION_RMS": innovations.MAX_INNOVATION_RMS,
    "MAX_REPEAT_TIME": estimator.MAX_REPEAT_TIME,
    "MAX_REST": innovations.MAX_REST,
    "MAX_SLOW_INNOVATION": innovations.MAX_SLOW_INNOVATION,
    "MEMORY_ANGLE": innovations.MEMORY_ANGLE,
    "MIN_JUMP_TIME": settings.MIN_JUMP_TIME,
    "PACE_FACTOR": innovations.PACE_FACTOR,
    "PACE_ORDER": innovations.PACE_ORDER,
    "REPEAT_DEVIATIONS": estimator.REPEAT_DEVIATIONS,
    "REST_PACE": innovations.REST_PACE,
    "ROUNDING_OF_Q": ROUNDING_OF_Q,
    "SETTLING_ANGLE": estimator.SETTLING_ANGLE,
    "START_FACTOR": innovations.START_FACTOR,
    "START_VARIANCE": estimator.START_VARIANCE,
    "TIME_TOLERANCE": estimator.TIME_TOLERANCE,
    "TRUST_TIME": innovations.TRUST_TIME,
    "TURN": 2 * np.pi,
    "USUAL_SLOW_RMS": innovations.USUAL_SLOW_RMS,
}


@dataclass(frozen=True)
class Generated:
    """The result of `Robot.codegen`: its folder, files and numbers of operations."""

    directory: Path
    files: tuple[str, ...]
    operations: dict[str, int] = field(hash=False)  # by function


def codegen(
    robot: Engine, options: CodegenOptions, directory: str | os.PathLike[str] | None, overwrite: bool
) -> Generated:
    """Write a robot's equations as source code with tests, see `Robot.codegen`."""
    if not isinstance(directory, str | os.PathLike | None):
        raise JounceError(f"directory is {quote_value(directory)}; expected the path of a folder")
    errors.check_bool("overwrite", overwrite, "whether to write into a folder that is not empty")
    plan = plan_code(robot, options)

    # The folder is checked before the work: tracing and test vectors may take minutes.
    folder = files.expand_path(f"{plan.prefix}-{options.lang}" if directory is None else directory)
    files.check_folder(folder, header.GENERATED_MARK, file_names(plan), overwrite)

    functions = trace_functions(plan)
    _warn_of_idle(plan, functions)
    tests = [vectors(plan.robot, function, plan.single) for function in functions]
    texts = render_files(plan, functions, tests)
    files.write_folder(folder, texts, header.GENERATED_MARK, overwrite)
    return Generated(folder, tuple(sorted(texts)), {f"{plan.prefix}_{f.name}": f.operations for f in functions})


def code(robot: Engine, options: CodegenOptions, template: str) -> str:
    """Return the code of a robot as one text.

    It is made by a template of the language, without tests.
    """
    plan = plan_code(robot, options)
    return render_template(plan, trace_functions(plan), template)


def trace_functions(plan: CodePlan) -> list[Function]:
    """Trace the functions of a plan.

    Raises `JounceError` if one is too large.
    """
    functions, max_operations = [], plan.language.largest
    for name, computation in plan.outputs.items():
        function = trace(plan.robot, name, computation)
        if function.operations > max_operations:
            others = languages_where(lambda x: x.largest > max_operations)
            larger = f"; larger robots go into {others}" if others else ""
            raise JounceError(
                f"{computation.spelling} of {plan.robot.origin.name} to order {plan.order} takes"
                f" {function.operations} operations; {plan.language.title} is generated for up to"
                f" {max_operations}{larger}"
            )
        functions.append(function)
    return functions


def _warn_of_idle(plan: CodePlan, functions: Sequence[Function]) -> None:
    """Warn of parameters that no function uses."""
    used: set[str] = set()
    for f in functions:
        numbers = {int(step.value) for step in f.program.steps if step.kind == "input"}
        used |= {port.name for port in f.parameters if numbers & set(range(port.start, port.end))}
    idle = [name for name in plan.robot.own if name not in used]
    if len(idle) > 0:
        warn(f"parameters without effect on {join_names(plan.outputs)}: {join_names(idle)}")


def file_names(plan: CodePlan) -> list[str]:
    """Return the names of all files that the language may have."""
    return list(_templates(plan))


def render_files(plan: CodePlan, functions: Sequence[Function], tests: Sequence[Vectors]) -> dict[str, str]:
    """Return the texts of files by name.

    They come from functions and their test vectors. A template that comes out empty makes no file.
    """
    environment, printed = _environment(), _print_functions(plan, functions)
    context, by_name = _context(plan, printed, tests), {f.name: f for f in printed}
    texts = {
        name: environment.get_template(path).render(context, function=by_name.get(function))
        for name, (path, function) in _templates(plan).items()
    }
    return {name: text for name, text in texts.items() if text.strip() != ""}


def render_template(plan: CodePlan, functions: Sequence[Function], template: str) -> str:
    """Return what a template makes of functions, without test vectors."""
    path = f"{plan.language.name}/{template}{TEMPLATE_SUFFIX}"
    tests = [Vectors({}, {}, {}, {}) for _ in functions]
    return _environment().get_template(path).render(_context(plan, _print_functions(plan, functions), tests))


@cache  # which keeps the templates compiled
def _environment() -> "Environment":
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True,
    )  # fmt: skip
    environment.globals["listed"] = _list_in_words
    environment.filters["wrapped"] = _wrap
    environment.filters["packed"] = _pack
    environment.filters["rows"] = _list_states
    return environment


def _list_in_words(words: Iterable[str]) -> str:
    """Return words as a list in a sentence: a, b and c."""
    return " and ".join(", ".join(words).rsplit(", ", 1))


def _list_states(array: np.ndarray) -> Iterator[list[float]]:
    """Yield the numbers of each state, row after row.

    The array is (states, ...).
    """
    return (np.ravel(state).tolist() for state in array)


def _templates(plan: CodePlan) -> dict[str, tuple[str, str]]:
    """Map names of generated files to templates and functions.

    Templates are paths in this package. A template with FUNCTION in its name makes one file per function.
    """
    folder = plan.language.name
    templates = {}
    # Templates whose names begin with _ are parts of others.
    for path in sorted((TEMPLATES / folder).glob(f"[!_]*{TEMPLATE_SUFFIX}")):
        for function in plan.outputs if "FUNCTION" in path.name else ("",):
            name = path.name.removesuffix(TEMPLATE_SUFFIX).replace("FUNCTION", function).replace("PREFIX", plan.prefix)
            templates[name] = f"{folder}/{path.name}", function
    return templates


def _print_functions(plan: CodePlan, functions: Sequence[Function]) -> list[PrintedFunction]:
    return [
        PrintedFunction(f.name, f.computation, f.signature, f.program, plan.language, plan.single) for f in functions
    ]


def _context(plan: CodePlan, functions: Sequence[PrintedFunction], tests: Sequence[Vectors]) -> Mapping[str, object]:
    """Return all that templates name."""
    robot, mechanism, single = plan.robot, plan.robot.origin, plan.single
    # The example of the README states the parameters of the robot itself, where all of them are numbers.
    has_own_numbers = all(name in robot.own and robot.own[name].dtype != object for name in robot.shapes)
    # Headers declare the elementary functions that the code calls; sine and cosine are in every rotation.
    called_kinds = {"sin", "cos"} | {step.kind for function in functions for step in function.program.steps}
    elementary = [kind for kind in operations.FUNCTION_KINDS if kind in called_kinds]
    if plan.live is not None:
        elementary += LIVE_FUNCTIONS
    literal = plan.language.literal
    return {
        **plan.language.helpers,
        "robot": robot,
        "prefix": plan.prefix,
        "real": plan.language.real[single],
        "single": single,
        "live": None if plan.live is None else partial(spell_code, plan=plan),
        "order": plan.order,
        "n": mechanism.n,
        "nq": positions.count(mechanism),
        "nb": mechanism.nb,
        "functions": functions,  # in the order asked for
        "tests": list(zip(functions, tests, strict=True)),  # each with its Vectors
        "parameters": functions[0].parameters,
        "meanings": header.parameters(robot),
        "own": robot.own if has_own_numbers else {},
        "tolerance": TEST_TOLERANCES[single],
        "origin": header.origin(mechanism, plan.order, single),
        "arrays": header.arrays(mechanism, plan.language.first),
        "conventions": header.conventions(mechanism, functions),
        "places": header.places(mechanism, functions),
        "drive_trains": header.drives(mechanism, functions),
        "layouts": header.layouts(functions),
        "moving": any(function.computation.base for function in functions),
        "elementary": elementary,
        "scalars": any(not function.outputs[0].shape for function in functions),
        "number": lambda x: literal(digits(x, single), single),
        "double": lambda x: literal(digits(x, False), False),
    }


def _wrap(text: str, indent: str = "", width: int = 118) -> str:
    """Break a sentence into lines, each but the first behind an indent."""
    from textwrap import wrap

    return f"\n{indent}".join(wrap(text, width - len(indent), break_long_words=False, break_on_hyphens=False))


def _pack(text: str, indent: str = "", end: str = "", width: int = 118) -> str:
    """Break comma-separated items into lines.

    All lines but the first are indented, all but the last end with a suffix.
    """
    lines = [""]
    for item in text.strip().split(", "):
        longer = item if lines[-1] == "" else f"{lines[-1]}, {item}"
        if len(indent) + len(longer) + len(end) < width:
            lines[-1] = longer
        else:
            lines[-1] += ","
            lines.append(item)
    return f"{end}\n{indent}".join(lines)


def spell_code(text: str, plan: CodePlan) -> str:
    """Replace words of the template of `Robot.live`.

    The sizes, constants, types and names of a plan take their places.
    """
    assert plan.live is not None  # as the templates ask
    words = _live_words(plan.live, plan.language, plan.single)
    if plan.language.name == "c":
        # C has no namespaces: what others call has the prefix, and all else is static.
        words |= {"LOCAL": "static", "PUBLIC ": ""}
        words |= {name: f"{plan.prefix}_{name}" for name in ("live_rates", "live_update")}

    def spell(match: re.Match[str]) -> str:
        word = match[0]
        # Numbers and functions of the C library end with an f in single precision.
        if plan.single and (word in LIVE_FUNCTIONS or word[0].isdigit()):
            return words.get(word, f"{word}f")
        return words.get(word, word)

    return re.sub(r"PUBLIC |[A-Za-z_]\w*|\d+\.\d+", spell, text)


def _live_words(s: Settings, target: Language, single: bool) -> dict[str, str]:
    """Return the words of the live template, spelt out.

    They are those of a language and a precision.
    """

    def print_numbers(numbers: Iterable[float]) -> str:
        return ", ".join(target.literal(digits(float(x), single), single) for x in numbers)

    # Numbers of the estimator and of its settings are reals of the precision of the code.
    numbers = {**LIVE_CONSTANTS, "OMEGA": float(s.omega[0]), "DT": s.dt, "LAG": s.lag, "SPACING": s.spacing}
    numbers |= {"LONGEST_GAP": s.longest_gap}
    words = {name: print_numbers([x]) for name, x in numbers.items()}
    # Sizes are integers: of arrays, and of counters.
    words |= {"NEW_CLOCK_STAMPS": str(NEW_CLOCK_STAMPS), "CHOICE_BLOCKS": str(innovations.CHOICE_BLOCKS)}
    words |= {"N": str(s.mechanism.n), "M": str(s.states), "K": str(s.kept)}
    # Arrays have an entry per joint.
    turns = print_numbers(2 * np.pi * s.turns)
    words |= {"NOISE": print_numbers(s.sigma), "FASTEST": print_numbers(s.fastest), "TURNS": turns}
    words |= {"LOCAL": "inline", "PUBLIC ": "inline ", "real": target.real[single]}
    return words
