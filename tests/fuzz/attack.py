"""An attack: a check of inputs that hypothesis draws, and shrinks where the check fails."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from math import ceil
from time import monotonic

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis.strategies import SearchStrategy

QUICK = 0.1  # of a round, where no seconds are given: `make test` shows that the attacks work, `make fuzz` attacks


@dataclass(frozen=True)
class Budget:
    """Rounds of examples from a seed on: as many as the seconds allow, or without any a part of one."""

    seed: int
    seconds: float = 0

    def attack(self, check: Callable[..., None], examples: int, **inputs: SearchStrategy) -> None:
        """Run `check` on inputs, so many examples a round; a failure says which seed finds it in the first round."""
        end = monotonic() + self.seconds
        plan = settings(
            max_examples=examples if self.seconds else ceil(QUICK * examples),
            phases=(Phase.generate, Phase.shrink),
            database=None,
            deadline=None,
            suppress_health_check=list(HealthCheck),
        )
        for start in count(self.seed):
            try:
                seed(start)(plan(given(**inputs)(check)))()
            except BaseException as error:
                error.add_note(f"again: make fuzz SEED={start}")
                raise
            if monotonic() >= end:
                return
