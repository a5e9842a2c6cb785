"""Options: what code is asked for, every word of it checked before any work is done."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from jounce._codegen.function import OUTPUTS
from jounce._codegen.language import NAMES, Language, language
from jounce._codegen.parametric import Parametric, parametric
from jounce.arguments.rates import checked_order
from jounce.errors import JounceError, one_of, quoted, several, true_or_false
from jounce.robot import Robot

HIGHEST = 4  # order
TRACED = 1500  # bodies times orders squared, up to which a program is traced in seconds
LOADED = "inverse_dynamics"  # the quantity that takes wrenches


@dataclass(frozen=True)
class Options:
    """What code is asked for, checked."""

    robot: Parametric
    language: Language
    order: int
    outputs: tuple[str, ...]
    wrench: bool
    single: bool
    prefix: str


def check_options(
    robot: Robot,
    lang: str,
    order: int,
    outputs: Sequence[str],
    wrench: bool,
    parameters: Sequence[str],
    float32: bool,
    prefix: str | None,
) -> Options:
    """What is asked for, or `JounceError`."""
    target = language(lang)
    true_or_false("wrench", wrench, f"whether {LOADED} takes any")
    true_or_false("float32", float32, "whether the code is in single precision")
    if float32 and not target.single:
        others = languages_where(lambda x: x.single)
        raise JounceError(f"{target.title} has no single precision; float32 is for code that runs: {others}")
    order = checked_order(order, HIGHEST)
    outputs = [one_of("output", name, OUTPUTS) for name in several(outputs)]
    if not outputs or len(set(outputs)) != len(outputs):
        raise JounceError(f"outputs are {quoted(outputs)}; expected one or more different ones of {', '.join(OUTPUTS)}")
    if wrench and LOADED not in outputs:
        raise JounceError(f"{outputs[0]} takes no wrenches; they are for {LOADED}")
    if robot.mechanism.nb * (order + 1) ** 2 > TRACED:
        raise JounceError(
            f"{robot.name} has {robot.mechanism.nb} bodies; code of order {order} is generated for at most"
            f" {TRACED // (order + 1) ** 2}"
        )
    found = parametric(robot.mechanism, parameters)
    for name in found.shapes:
        target.check_name(name, "parameter", len("p_"))
    begins = _prefix(prefix, robot.name, target)
    target.check_prefix(begins, [*(f"_{name}" for name in outputs), *["_parameters"] * bool(found.shapes)])
    return Options(found, target, order, tuple(outputs), wrench, float32, begins)


def languages_where(fit: Callable[[Language], bool]) -> str:
    """The languages that something goes into."""
    return ", ".join(name for name in NAMES if fit(language(name)))


def _prefix(given: str | None, name: str, target: Language) -> str:
    """The prefix that is given, or the robot's name made one."""
    if given is not None:
        return given
    found = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
    odd = not found or found[0].isdigit() or found in f"{target.reserved} {target.taken}".split()
    return f"robot_{found}".rstrip("_") if odd else found
