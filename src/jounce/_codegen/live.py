"""`Robot.live` as C and C++: one template for all robots, in which words are replaced."""

import re
from collections.abc import Iterable

import numpy as np

from jounce._codegen.language import Language, digits
from jounce.core.errors import JounceError, quote_value
from jounce.core.scalars import is_finite
from jounce.engine.engine import Engine
from jounce.live import estimator, innovations
from jounce.live.estimator import LiveRates
from jounce.live.filter import START_VARIANCE
from jounce.live.settings import Settings

PUBLIC_NAMES = ("live_rates", "live_update")
WITH_SUFFIX = re.compile(r"sqrt|exp|expm1|pow|fabs|fmin|fmax|floor|\d+\.\d+")  # f in single precision


def check_live(robot: Engine, live: object, target: Language) -> Settings:
    """The settings of an estimator for which there is code."""
    if not isinstance(live, LiveRates) or live.settings.mechanism is not robot.mechanism:
        raise JounceError(f"live is {quote_value(live)}; expected robot.live(dt, bandwidth=..., noise=...) of it")
    if target.name not in ("c", "cpp") or len(live.settings.omega) > 1 or np.isnan(live.settings.sigma).any():
        raise JounceError(
            "code of live() is C or C++, with one filter and known noise; expected lang 'c' or 'cpp',"
            " and live(dt, bandwidth=HZ, noise=RAD)"
        )
    return live.settings


def spell_code(text: str, s: Settings, target: Language, single: bool, prefix: str) -> str:
    """The template with words replaced by sizes, constants of `jounce.live`, types and names."""

    def listed(numbers: Iterable[float]) -> str:
        return ", ".join(target.literal(digits(float(x), single), single) for x in numbers)

    constants = vars(innovations) | vars(estimator) | {"START_VARIANCE": START_VARIANCE, "TURN": 2 * np.pi}
    constants |= {"OMEGA": float(s.omega[0]), "DT": s.dt, "LAG": s.lag, "SPACING": s.spacing}
    words = {name: listed([x]) for name, x in constants.items() if name.isupper() and is_finite(x)}
    words |= {"N": str(s.mechanism.n), "M": str(s.states), "K": str(s.kept)}
    words |= {"NOISE": listed(s.sigma), "FASTEST": listed(s.fastest), "TURNS": listed(2 * np.pi * s.turns)}
    words |= {"LOCAL": "inline", "PUBLIC ": "inline ", "real": target.real[single]}
    if target.name == "c":
        words |= {"LOCAL": "static", "PUBLIC ": ""} | {name: f"{prefix}_{name}" for name in PUBLIC_NAMES}

    def replace(found: re.Match[str]) -> str:
        return words.get(found[0], found[0] + "f" * (single and bool(WITH_SUFFIX.fullmatch(found[0]))))

    return re.sub(r"PUBLIC |[A-Za-z_]\w*|\d+\.\d+", replace, text)
