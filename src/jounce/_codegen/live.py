"""`Robot.live` as C and C++: one template for all robots, in which words are replaced."""

import re
from collections.abc import Iterable

import numpy as np

from jounce._codegen.language import Language, digits
from jounce.core.errors import JounceError
from jounce.core.scalars import is_finite
from jounce.engine.engine import Engine
from jounce.live import estimator, innovations, settings
from jounce.live.estimator import LiveRates
from jounce.live.filter import START_VARIANCE
from jounce.live.samples import NEW_CLOCK_STAMPS
from jounce.live.settings import Settings

LIVE_FUNCTIONS = ["sqrt", "exp", "expm1", "pow", "fabs", "fmin", "fmax", "floor"]  # with an f in single precision


def check_live(robot: Engine, live: object, target: Language) -> Settings:
    """The settings of an estimator for which there is code: of this robot, one filter, known noise."""
    s = live.settings if isinstance(live, LiveRates) and target.name in ("c", "cpp") else None
    if s is None or s.mechanism is not robot.mechanism or len(s.omega) > 1 or np.isnan(s.sigma).any():
        expected = "that of robot.live(dt, bandwidth=HZ, noise=RAD) of this robot, in c or cpp"
        raise JounceError(f"live in {target.title} is a {type(live).__name__}; expected {expected}")
    return s


def spell_code(text: str, s: Settings, target: Language, single: bool, prefix: str) -> str:
    """The template with words replaced by sizes, constants of `jounce.live`, types and names."""

    def listed(numbers: Iterable[float]) -> str:
        return ", ".join(target.literal(digits(float(x), single), single) for x in numbers)

    constants = (
        vars(innovations) | vars(settings) | vars(estimator) | {"START_VARIANCE": START_VARIANCE, "TURN": 2 * np.pi}
    )
    constants |= {"OMEGA": float(s.omega[0]), "DT": s.dt, "LAG": s.lag, "SPACING": s.spacing}
    constants |= {"LONGEST_GAP": s.longest_gap}
    words = {name: listed([x]) for name, x in constants.items() if name.isupper() and is_finite(x)}
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
