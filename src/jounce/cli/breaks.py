"""Breaks of forces and motor torques along a motion, in words."""

from collections.abc import Sequence
from typing import Any

from jounce.core.errors import listed

MAX_BREAKS_SHOWN = 4  # as of notes; --json has all


def breaks_in_words(breaks: Sequence[dict[str, Any]]) -> list[str]:
    """Describe the first breaks, one per line, and the number of all."""
    lines = []
    for found in breaks[:MAX_BREAKS_SHOWN]:
        joints: dict[str, list[str]] = {}
        for joint, cause in found["causes"].items():
            joints.setdefault(cause["rate"], []).append(joint)
        causes = " and ".join(f"{rate} of {listed(names)}" for rate, names in joints.items())
        missing = found["missing"]
        then = [f"{found['jumps']} jumps"] if found["jumps"] else []
        then += [f"{', '.join(missing)} do{'es' * (len(missing) == 1)} not exist"] if missing else []
        lines.append(f"break at t = {found['t']:.9g} s: {causes} jumps; {', '.join(then)}")
    rest = len(breaks) - MAX_BREAKS_SHOWN
    if rest > 0:
        lines.append(f"and {rest} more break{'s' * (rest > 1)}; --json lists them, --blend replaces them")
    return lines
