"""`codegen`: a robot's equations as a folder of source code in another language, with its tests."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from jounce._codegen import header
from jounce._codegen.function import Function, trace
from jounce._codegen.options import Options, check_options, languages_where
from jounce._codegen.test_vectors import vectors
from jounce.core.errors import JounceError, listed, quoted, true_or_false, warn
from jounce.core.typing import Language
from jounce.dynamics.quantities import FORCES
from jounce.engine.engine import Engine
from jounce.io import folders
from jounce.io.files import path_of

DEFAULT = (FORCES.name,)  # outputs


@dataclass(frozen=True)
class Generated:
    """The result of `codegen`: its folder, files and numbers of operations."""

    directory: Path
    files: tuple[str, ...]
    operations: dict[str, int] = field(hash=False)  # by function


def codegen(
    robot: Engine,
    lang: Language,
    order: int = 2,
    directory: str | os.PathLike[str] | None = None,
    *,
    outputs: Sequence[str] = DEFAULT,
    wrench: bool = False,
    parameters: Sequence[str] = (),
    float32: bool = False,
    prefix: str | None = None,
    force: bool = False,
    base: bool = False,
) -> Generated:
    """Write a robot's equations as source code that does not depend on jounce, with tests for the user's compiler.

    There is one function for each output, the recursion traced operation by operation for this robot, without loops,
    branches or memory allocation: ``PREFIX_inverse_dynamics(q, qd, q2d, q3d, q4d, Q, Qd, Q2d)``,
    ``PREFIX_jacobian_tool0_world(q, qd, q2d, J, Jd, J2d)``, ... ``make test`` in the folder compares the results with
    the closed form.

    Parameters
    ----------
    robot : Robot
        A robot of numbers, or of SymPy symbols, which become parameters with their names.
    lang : str
        The language: "c" (C99), "cpp" (C++11, and overloads for Eigen), "cuda", "javascript" (ES module), "julia",
        "latex" (a document), "matlab" (and GNU Octave), "python" (NumPy), "rust" (no_std).
    order : int
        The highest time derivative: 2 gives Q, Qd, Q2d.
    directory : str or path
        The output folder, new or empty; by default PREFIX-LANG in the working directory.
    outputs : sequence of str
        Quantities, each with its rates: the names of methods of `Robot`, "skew_coriolis_matrix" for the form "skew".
        A quantity of bodies needs a body and may have a frame: "poses:tool0", "jacobian:tool0:world". Of quantities
        that are vectors, "inverse_dynamics.vjp" and "inverse_dynamics.jvp" are what `Kernel.vjp` and `Kernel.jvp`
        compute.
    wrench : bool
        Whether the functions take wrenches W, Wd, ..., (nb, 6), if their quantity depends on them.
    parameters : sequence of str
        Data that become run-time parameters: "gravity", "masses", "lengths", "payload", "payload:BODY".
    float32 : bool
        Whether to generate single precision.
    prefix : str
        The prefix of all names in the code; by default the robot's name.
    force : bool
        Write into a folder that is not empty: what an earlier run generated is replaced or removed, all else stays.
    base : bool
        Whether the functions take the motion of the base of a robot that is fixed, so that its ground moves: its pose
        base_pose (4, 4), body to inertial frame, its twist base_twist (6) in its own axes, and the rates of it. Those
        of a robot that floats always do.

    Returns
    -------
    Generated : its `directory`, `files`, and `operations`, the number of operations of each function.

    Raises
    ------
    JounceError
        If a language, output or parameter is unknown, an output needs a body, a name is not an identifier, the
        robot is too large, or the folder is not empty. Nothing is written then.

    Examples
    --------
    >>> import tempfile, jounce
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     made = jounce.codegen(jounce.load("iiwa14"), "c", directory=folder)
    >>> made.files
    ('Makefile', 'README.md', 'iiwa14.c', 'iiwa14.h', 'test_iiwa14.c')
    >>> made.operations
    {'iiwa14_inverse_dynamics': 2213}
    """
    from jounce._codegen import render  # where Jinja is needed

    if not isinstance(robot, Engine):
        raise JounceError(f"codegen() expects a jounce.Robot, got {type(robot).__name__}; try jounce.load")
    if not isinstance(directory, str | os.PathLike | None):
        raise JounceError(f"directory is {quoted(directory)}; expected the path of a folder")
    true_or_false("force", force, "whether to write into a folder that is not empty")
    options = check_options(robot, lang, order, outputs, wrench, parameters, float32, prefix, base)
    folder = path_of(f"{options.prefix}-{lang}" if directory is None else directory)
    names = render.names(options)
    folders.check_folder(folder, header.MARK, names, force)
    functions = functions_of(options)
    _warn_of_idle(options, functions)
    tests = [vectors(options.robot, function, options.single) for function in functions]
    files = render.files(options, functions, tests)
    folders.write_folder(folder, files, header.MARK, force)
    return Generated(folder, tuple(sorted(files)), {f"{options.prefix}_{f.name}": f.operations for f in functions})


def code(robot: Engine, lang: Language, template: str, order: int, outputs: Sequence[str], wrench: bool) -> str:
    """The code of a robot as one text, by the template of a language, without tests."""
    from jounce._codegen import render

    options = check_options(robot, lang, order, outputs, wrench, (), False, None)
    return render.code(options, functions_of(options), template)


def functions_of(options: Options) -> list[Function]:
    """The functions of what is asked for, or `JounceError` where one is too large."""
    functions = []
    for name, computation in options.outputs.items():
        made = trace(options.robot, name, computation)
        if made.operations > (most := options.language.largest):
            raise JounceError(
                f"{computation.spelling} of {options.robot.origin.name} to order {options.order} takes"
                f" {made.operations} operations; {options.language.title} is generated for up to {most}{_larger(most)}"
            )
        functions.append(made)
    return functions


def _warn_of_idle(options: Options, functions: Sequence[Function]) -> None:
    """Warn of parameters that are asked for and that no function uses."""
    used: set[str] = set()
    for f in functions:
        numbers = {int(step.value) for step in f.program.steps if step.kind == "input"}
        used |= {port.name for port in f.parameters if numbers & set(range(port.start, port.end))}
    idle = [name for name in options.robot.own if name not in used]
    if idle:
        warn(f"parameters without effect on {listed(options.outputs)}: {listed(idle)}")


def _larger(most: int) -> str:
    """Return the languages that support larger robots, as the end of a sentence."""
    found = languages_where(lambda x: x.largest > most)
    return f"; larger robots go into {found}" if found else ""
