"""Options of code generation, all checked before any work is done."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jounce._codegen.function import ParametricRobot, function_names, make_parametric
from jounce._codegen.language import Language
from jounce._codegen.languages import LANGUAGE_NAMES, language
from jounce.arguments import requests
from jounce.arguments.rates import check_order
from jounce.core import errors
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.dynamics import computation
from jounce.dynamics.computation import Computation
from jounce.dynamics.quantities import QUANTITIES
from jounce.engine.engine import Engine
from jounce.live.estimator import LiveRates
from jounce.live.settings import Settings
from jounce.model.mechanism import Mechanism

HIGHEST_CODE_ORDER = 4  # the highest rate of forces: code grows with its square
MAX_TRACED_SIZE = 1500  # bodies times (order + 1)^2: a program of this size is traced in seconds


@dataclass(frozen=True)
class CodegenOptions:
    """The checked options of code generation."""

    robot: ParametricRobot
    language: Language
    order: int
    outputs: Mapping[str, Computation]  # by the names of their functions
    single: bool
    prefix: str
    live: Settings | None = None


def check_options(
    robot: Engine,
    lang: str,
    order: int,
    outputs: Sequence[str],
    wrench: bool,
    parameters: Sequence[str],
    float32: bool,
    prefix: str | None,
    moving_base: bool = False,
    live: object = None,
) -> CodegenOptions:
    """Check the arguments of `codegen`; raise `JounceError` if one is invalid."""
    target = language(lang)
    errors.check_bool("wrench", wrench, "whether functions take any")
    errors.check_bool("moving_base", moving_base, "whether functions take the motion of the base")
    errors.check_bool("float32", float32, "whether the code is in single precision")
    if float32 and not target.single:
        others = languages_where(lambda x: x.single)
        raise JounceError(f"{target.title} has no single precision; float32 works with {others}")
    order = check_order(order, HIGHEST_CODE_ORDER)
    computations = _computations(robot.mechanism, target, outputs, order, wrench, moving_base)
    check_size(robot.mechanism, order)
    found = make_parametric(robot.mechanism, parameters)
    for name in found.shapes:
        target.check_name(name, "parameter", len("params_"))
    names = function_names(computations)
    begins = _prefix(prefix, robot.name, target)
    target.check_prefix(begins, [*(f"_{name}" for name in names), *["_parameters"] * bool(found.shapes)])
    settings = None if live is None else check_live(robot, live, target)
    return CodegenOptions(found, target, order, dict(zip(names, computations, strict=True)), float32, begins, settings)


def check_size(mechanism: Mechanism, order: int) -> None:
    """Raise `JounceError` if a robot has too many bodies for code of an order, or the order is too high."""
    check_order(order, HIGHEST_CODE_ORDER)
    bodies = len(mechanism.moving_bodies)  # behind joints
    if bodies * (order + 1) ** 2 > MAX_TRACED_SIZE:
        raise JounceError(
            f"{mechanism.name} has {bodies} bodies; code of order {order} is generated for at most"
            f" {MAX_TRACED_SIZE // (order + 1) ** 2}"
        )


def _computations(
    mechanism: Mechanism, target: Language, outputs: Sequence[str], order: int, wrench: bool, moving_base: bool
) -> list[Computation]:
    """Return the computations of the outputs, with wrenches and the motion of the base if they depend on them."""
    texts = errors.as_list(outputs)
    found = [requests.parse_computation(mechanism, text, order) for text in texts]
    if not found or len(set(found)) != len(found):
        raise JounceError(
            f"outputs are {quote_value(outputs)}; expected one or more different NAME[.PRODUCT][:BODY[:FRAME]]"
        )
    for asked in found:
        if asked.product:
            _check_product(asked, target)
        if asked.quantity.of_bodies and asked.body is None:
            frames = f", or {asked.name}:BODY:FRAME with a FRAME of {join_names(asked.quantity.gives.frames)}"
            raise JounceError(
                f"generated code holds {asked.name} of one body: expected {asked.name}:BODY"
                f"{frames if asked.quantity.gives.frames else ''}; available: {join_names(mechanism.frame_names)}"
            )
    if wrench and not any(asked.quantity.takes.wrenches for asked in found):
        requests.parse_computation(mechanism, texts[0], order, wrench)  # says which ones do
    moving = [asked.base or (moving_base and requests.takes_base(asked.name, asked.frame)) for asked in found]
    if moving_base and not any(moving):
        raise JounceError(f"moving_base=True has no effect: the motion of the base does not enter {join_names(texts)}")
    return [
        replace(asked, wrench=wrench and asked.quantity.takes.wrenches, base=moves)
        for asked, moves in zip(found, moving, strict=True)
    ]


def _check_product(asked: Computation, target: Language) -> None:
    if target.name == "latex":
        raise JounceError(f"{asked.spelling} is not written as equations; expected a quantity, or another language")
    if asked.product not in computation.FIRST_PRODUCTS:
        raise JounceError(
            f"code of {asked.spelling} is not generated; expected a product of"
            f" {join_names(computation.FIRST_PRODUCTS)}."
            f" robot.compile({asked.name!r}, {asked.order}, product={asked.product!r}) compiles it"
        )
    if len(asked.quantity.gives.shape) != 1:
        vectors = join_names(row.name for row in QUANTITIES.values() if len(row.gives.shape) == 1)
        raise JounceError(f"code of {asked.product} is generated for vectors: {vectors}; not for {asked.name}")


def languages_where(fit: Callable[[Language], bool]) -> str:
    """Return the titles of the languages that satisfy a condition."""
    return ", ".join(name for name in LANGUAGE_NAMES if fit(language(name)))


def _prefix(given: str | None, name: str, target: Language) -> str:
    """Return the given prefix, or the robot's name turned into an identifier."""
    if given is not None:
        return given
    found = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
    odd = not found or found[0].isdigit() or found in f"{target.reserved} {target.taken}".split()
    return f"robot_{found}".rstrip("_") if odd else found


def check_live(robot: Engine, live: object, target: Language) -> Settings:
    """The settings of an estimator for which there is code: of this robot, one filter, known noise."""
    s = live.settings if isinstance(live, LiveRates) and target.name in ("c", "cpp") else None
    if s is None or s.mechanism is not robot.mechanism or len(s.omega) > 1 or np.isnan(s.sigma).any():
        expected = "that of robot.live(dt, bandwidth=HZ, noise=RAD) of this robot, in c or cpp"
        raise JounceError(f"live in {target.title} is a {type(live).__name__}; expected {expected}")
    return s
