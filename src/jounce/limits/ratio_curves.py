"""Ratios to limits at the times of a motion, to be drawn."""

from typing import TYPE_CHECKING

import numpy as np

from jounce.engine.engine import Engine
from jounce.limits.motion_polynomials import evaluate_polynomials, split_motion
from jounce.limits.validation import validate_limits

if TYPE_CHECKING:
    from jounce.motion import Motion


def ratios_along(robot: Engine, motion: "Motion") -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times (N,), those of breaks twice, and the ratios (N, n) by kind, as far as each is known well, or else NaN.

    They are -inf where a coordinate has no such limit.
    """
    b = validate_limits(robot, motion)
    times: list[np.ndarray] = []
    found: dict[str, list[np.ndarray]] = {kind: [] for kind in b.kinds}
    for pieces in split_motion(b):
        times.append(np.column_stack([pieces.start, (pieces.start + pieces.stop) / 2, pieces.stop]).ravel())
        for kind in set(b.kinds) - set(pieces.kinds):
            found[kind].append(np.full((3 * len(pieces.start), len(b.joints)), np.nan))
        for kind in pieces.kinds:
            left, right = pieces.left[kind], pieces.right[kind]
            middle = evaluate_polynomials(pieces.polynomials[kind], np.array(0.5)) if pieces.width.all() else left
            values = np.stack([left, middle, right], axis=1).reshape(-1, len(b.joints))
            found[kind].append(b.scales[kind].largest(values))
    return np.concatenate(times), {kind: np.concatenate(parts) for kind, parts in found.items()}
