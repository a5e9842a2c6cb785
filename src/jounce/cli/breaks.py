"""Breaks of forces and motor torques along a motion, as plain data and in words."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from jounce.core.errors import listed

if TYPE_CHECKING:
    from jounce.engine.along import ForceBreak
    from jounce.motion.motion import Break

SHOWN = 4  # in words


def break_data(found: "ForceBreak", joints: Sequence[str], names: Sequence[str]) -> dict[str, Any]:
    """Return a break as plain data: the rate of Q that jumps, by how much, and the joints and rates that cause it."""
    from jounce.spatial.series import rate_name

    causes = {cause.joint: {"rate": rate_name(_symbol(cause), cause.order), "by": cause.jump} for cause in found.causes}
    jump = None if found.jump is None else dict(zip(joints, found.jump.tolist(), strict=True))
    return {
        "t": found.t,
        "jumps": names[found.order] if found.order >= 0 else None,
        "by": jump,
        "missing": list(names[found.order + 1 :]),
        "causes": causes,
    }


def _symbol(cause: "Break") -> str:
    """q, W or, of the base, the entry that jumps: x of base.x."""
    return str(cause.joint).rpartition(".")[2] if cause.symbol == "base" else cause.symbol


def breaks_in_words(breaks: Sequence[dict[str, Any]]) -> list[str]:
    """Describe the first breaks, one per line, and the number of all."""
    lines = []
    for found in breaks[:SHOWN]:
        joints: dict[str, list[str]] = {}
        for joint, cause in found["causes"].items():
            joints.setdefault(cause["rate"], []).append(joint)
        causes = " and ".join(f"{rate} of {listed(names)}" for rate, names in joints.items())
        missing = found["missing"]
        then = [f"{found['jumps']} jumps"] if found["jumps"] else []
        then += [f"{', '.join(missing)} do{'es' * (len(missing) == 1)} not exist"] if missing else []
        lines.append(f"break at t = {found['t']:.9g} s: {causes} jumps; {', '.join(then)}")
    rest = len(breaks) - SHOWN
    if rest > 0:
        lines.append(f"and {rest} more break{'s' * (rest > 1)}; --json lists them, --blend replaces them")
    return lines
