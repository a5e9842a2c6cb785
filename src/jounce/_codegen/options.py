"""Options of code generation, all checked before any work is done.

`CodegenOptions` are the options as a caller gives them. It checks what depends on no robot, once, at the door.
`plan_code` checks the others with the robot, and makes the `CodePlan` that tracing and templates read.
"""

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


@dataclass(frozen=True, kw_only=True)
class CodegenOptions:
    """The options of `Robot.codegen` as a caller gives them.

    Language, order and switches are checked when it is made.
    """

    lang: str
    order: int
    outputs: Sequence[str]
    wrench: bool = False
    parameters: Sequence[str] = ()
    float32: bool = False
    prefix: str | None = None
    moving_base: bool = False
    live: object = None

    def __post_init__(self) -> None:
        target = self.target
        errors.check_bool("wrench", self.wrench, "whether functions take any")
        errors.check_bool("moving_base", self.moving_base, "whether functions take the motion of the base")
        errors.check_bool("float32", self.float32, "whether the code is in single precision")
        if self.float32 and not target.single:
            others = languages_where(lambda x: x.single)
            raise JounceError(f"{target.title} has no single precision; float32 works with {others}")
        object.__setattr__(self, "order", check_order(self.order, HIGHEST_CODE_ORDER))

    @property
    def target(self) -> Language:
        """The language of the code."""
        return language(self.lang)


@dataclass(frozen=True)
class CodePlan:
    """What code generation does: the functions to trace for a robot, and how they are printed."""

    robot: ParametricRobot
    language: Language
    order: int
    outputs: Mapping[str, Computation]  # by the names of their functions
    single: bool
    prefix: str
    live: Settings | None = None


def plan_code(robot: Engine, options: CodegenOptions) -> CodePlan:
    """Check the options with the robot; raise `JounceError` if one is invalid."""
    target = options.target
    computations = _computations(robot.mechanism, options)
    check_size(robot.mechanism, options.order)

    # Parameters become members of a structure, or of a module: their names must be free in the language.
    parametric = make_parametric(robot.mechanism, options.parameters)
    for name in parametric.shapes:
        target.check_name(name, "parameter", len("params_"))

    # The prefix begins every name of the code, so that it is checked with the longest ending.
    names = function_names(computations)
    prefix = _choose_prefix(options.prefix, robot.name, target)
    endings = [f"_{name}" for name in names]
    if len(parametric.shapes) > 0:
        endings.append("_parameters")
    target.check_prefix(prefix, endings)

    settings = None if options.live is None else check_live(robot, options.live, target)
    outputs = dict(zip(names, computations, strict=True))
    return CodePlan(parametric, target, options.order, outputs, options.float32, prefix, settings)


def check_size(mechanism: Mechanism, order: int) -> None:
    """Raise `JounceError` if a robot is too large.

    The size depends on the order of the code.
    """
    check_order(order, HIGHEST_CODE_ORDER)
    bodies = len(mechanism.moving_bodies)  # behind joints
    if bodies * (order + 1) ** 2 > MAX_TRACED_SIZE:
        raise JounceError(
            f"{mechanism.name} has {bodies} bodies; code of order {order} is generated for at most"
            f" {MAX_TRACED_SIZE // (order + 1) ** 2}"
        )


def _computations(mechanism: Mechanism, options: CodegenOptions) -> list[Computation]:
    """Return the computations of the outputs.

    They take wrenches and the motion of the base where the options ask for them and the quantity depends on them.
    """
    texts, order, wrench, moving_base = (
        errors.as_list(options.outputs),
        options.order,
        options.wrench,
        options.moving_base,
    )
    computations = [requests.parse_computation(mechanism, text, order) for text in texts]
    if len(computations) == 0 or len(set(computations)) != len(computations):
        raise JounceError(
            f"outputs are {quote_value(options.outputs)}; expected one or more different NAME[.PRODUCT][:BODY[:FRAME]]"
        )
    for asked in computations:
        if asked.product is not None:
            _check_product(asked, options.target)
        if asked.quantity.of_bodies and asked.body is None:
            frames = f", or {asked.name}:BODY:FRAME with a FRAME of {join_names(asked.quantity.gives.frames)}"
            raise JounceError(
                f"generated code holds {asked.name} of one body: expected {asked.name}:BODY"
                f"{frames if asked.quantity.gives.frames else ''}; available: {join_names(mechanism.frame_names)}"
            )
    # A switch without effect on any output is a mistake of the caller.
    if wrench and not any(asked.quantity.takes.wrenches for asked in computations):
        requests.parse_computation(mechanism, texts[0], order, wrench)  # says which ones do
    moving = [asked.base or (moving_base and requests.takes_base(asked.name, asked.frame)) for asked in computations]
    if moving_base and not any(moving):
        raise JounceError(f"moving_base=True has no effect: the motion of the base does not enter {join_names(texts)}")
    return [
        replace(asked, wrench=wrench and asked.quantity.takes.wrenches, base=moves)
        for asked, moves in zip(computations, moving, strict=True)
    ]


def _check_product(asked: Computation, target: Language) -> None:
    """Raise `JounceError` if there is no code of a product of derivatives."""
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


def _choose_prefix(prefix: str | None, robot_name: str, target: Language) -> str:
    """Return the caller's prefix, or the robot's name turned into an identifier."""
    if prefix is not None:
        return prefix
    stem = re.sub(r"\W+", "_", robot_name, flags=re.ASCII).strip("_")
    is_invalid = stem == "" or stem[0].isdigit() or stem in f"{target.reserved} {target.taken}".split()
    return f"robot_{stem}".rstrip("_") if is_invalid else stem


def check_live(robot: Engine, live: object, target: Language) -> Settings:
    """Return the settings of an estimator with code.

    There is code of an estimator of this robot with one filter and known noise.
    """
    s = live.settings if isinstance(live, LiveRates) and target.name in ("c", "cpp") else None
    if s is None or s.mechanism is not robot.mechanism or len(s.omega) > 1 or np.isnan(s.sigma).any():
        expected = "that of robot.live(dt, bandwidth=HZ, noise=RAD) of this robot, in c or cpp"
        raise JounceError(f"live in {target.title} is a {type(live).__name__}; expected {expected}")
    return s
