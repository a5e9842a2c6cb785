"""Breaks of forces by names: which rates jump, by how much at each joint, and which joints cause it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from jounce.engine.along import ForceBreak
from jounce.motion.motion import Break
from jounce.spatial.series import rate_name


class BreakCause(NamedTuple):
    """Which rate of a joint jumps, and by how much."""

    rate: str
    by: float


@dataclass(frozen=True)
class DescribedBreak:
    """A break of forces by names: which rate of Q jumps, by how much at each joint, which do not exist, and why."""

    t: float
    jumps: str | None
    by: Mapping[str, float] | None
    missing: tuple[str, ...]
    causes: Mapping[str, BreakCause]


def describe_break(found: ForceBreak, joints: Sequence[str], names: Sequence[str]) -> DescribedBreak:
    """A break by the names of forces (nv) and of the rates of Q."""
    jumps = names[found.order] if found.order >= 0 else None
    by = None if found.jump is None else dict(zip(joints, found.jump.tolist(), strict=True))
    causes = {
        str(cause.joint): BreakCause(rate_name(_cause_symbol(cause), cause.order), cause.jump) for cause in found.causes
    }
    return DescribedBreak(found.t, jumps, by, tuple(names[found.order + 1 :]), causes)


def _cause_symbol(cause: Break) -> str:
    """q, W or, of the base, the entry that jumps: x of base.x."""
    return str(cause.joint).rpartition(".")[2] if cause.symbol == "base" else cause.symbol
