"""`codegen`: a robot's equations as a folder of source code in another language, with its tests."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from jounce._codegen import header
from jounce._codegen.function import Function, trace
from jounce._codegen.options import CodegenOptions, check_options, languages_where
from jounce._codegen.test_vectors import vectors
from jounce.core.errors import JounceError, check_bool, join_names, quote_value, warn
from jounce.core.typing import Language
from jounce.engine.engine import Engine
from jounce.io.files import check_folder, expand_path, write_folder


@dataclass(frozen=True)
class Generated:
    """The result of `Robot.codegen`: its folder, files and numbers of operations."""

    directory: Path
    files: tuple[str, ...]
    operations: dict[str, int] = field(hash=False)  # by function


def codegen(
    robot: Engine,
    lang: Language,
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
    from jounce._codegen import render  # imported here, as only this needs Jinja

    if not isinstance(directory, str | os.PathLike | None):
        raise JounceError(f"directory is {quote_value(directory)}; expected the path of a folder")
    check_bool("overwrite", overwrite, "whether to write into a folder that is not empty")
    options = check_options(robot, lang, order, outputs, wrench, parameters, float32, prefix, moving_base, live)
    folder = expand_path(f"{options.prefix}-{lang}" if directory is None else directory)
    names = render.file_names(options)
    check_folder(folder, header.GENERATED_MARK, names, overwrite)
    functions = trace_functions(options)
    _warn_of_idle(options, functions)
    tests = [vectors(options.robot, function, options.single) for function in functions]
    files = render.render_files(options, functions, tests)
    write_folder(folder, files, header.GENERATED_MARK, overwrite)
    return Generated(folder, tuple(sorted(files)), {f"{options.prefix}_{f.name}": f.operations for f in functions})


def code(robot: Engine, lang: Language, template: str, order: int, outputs: Sequence[str], wrench: bool) -> str:
    """The code of a robot as one text, by the template of a language, without tests."""
    from jounce._codegen import render

    options = check_options(robot, lang, order, outputs, wrench, (), False, None)
    return render.render_template(options, trace_functions(options), template)


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
