"""Match the entries of a state or load by name.

All naming errors are reported together. Every argument that holds something of each joint goes through here, unless it
has no names.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from jounce.core import scalars
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, locate_errors, quote_value
from jounce.core.named_entries import entry_names, read_entries
from jounce.core.scalars import Array, asarray, is_symbolic, is_zero
from jounce.model.mechanism import Mechanism

LOCK_CURE = Remedy(
    "lock= of jounce.load, or Robot.locked, holds joints without a value", "--lock JOINT=VALUE holds joints at a value"
)


def values_by_name(values: Any) -> Any:
    """Return a dict of values by name; others stay as they are."""
    return values if entry_names(values) is None else read_entries(values)


def array_by_name(values: Any, joints: Sequence[str], label: str) -> Array:
    """Return an array (..., n) of values by name of joints.

    Values without names become an array as they are.
    """
    if entry_names(values) is None:
        return asarray(values, label)
    with locate_errors(label):
        return stack_entries(values, joints, {})


def stack_entries(entries: Any, joints: Sequence[str], unfit: Mapping[Any, str], expectation: str = "") -> Array:
    """Return an array (..., n) of entries (...) by joint name.

    Entries are broadcast; for the other arguments see `check_names`.
    """
    named = read_entries(entries)
    check_names(named, joints, unfit, expectation)
    parts = [scalars.convert_element(named[joint], repr(joint)) for joint in joints]
    if any(map(is_symbolic, parts)):
        parts = [part if is_symbolic(part) else scalars.restore_integers(part) for part in parts]
    parts = scalars.broadcast(parts, [0] * len(parts), [repr(joint) for joint in joints])
    return scalars.namespace(*parts).stack(parts, axis=-1)


def check_names(
    given_names: Collection[Any], expected: Sequence[str], unfit: Mapping[Any, str], expectation: str = ""
) -> None:
    """Raise `JounceError` if the given names are not the expected ones.

    The error lists all missing, unknown and unfit names. `unfit` maps existing names that are not allowed here to the
    reason; `expectation` describes the expected names, which are listed by default.
    """
    from difflib import get_close_matches  # imported here to keep start-up fast

    # A name that is unknown may be a missing one with a typing error.
    missing = [name for name in expected if name not in given_names]
    unknown = []
    for name in given_names:
        if name in expected or name in unfit:
            continue
        similar = get_close_matches(name, missing, n=1) if isinstance(name, str) else []
        hint = f" (did you mean {similar[0]!r}?)" if len(similar) > 0 else ""
        unknown.append(f"{quote_value(name)}{hint}")
    problems = []
    if len(missing) > 0:
        problems.append(f"missing {join_names(map(quote_value, missing))}")
    if len(unknown) > 0:
        problems.append(f"unknown {join_names(unknown)}")
    problems += [f"leave out {quote_value(name)}, {unfit[name]}" for name in given_names if name in unfit]
    if len(problems) > 0:
        raise JounceError(
            f"{'; '.join(problems)}; expected {expectation if expectation != '' else join_names(expected)}"
        )


def find_followers(mechanism: Mechanism) -> dict[Any, str]:
    """Map joints that are no coordinates to those they follow.

    They are not part of a state.
    """
    in_loops = [name for name in mechanism.tree.coordinates if name not in mechanism.coordinates]
    follows: dict[Any, str] = dict.fromkeys(in_loops, "which follows others in closed loops")
    for joint, row in zip(mechanism.joints, mechanism.tree.G, strict=True):
        if joint not in mechanism.tree.coordinates:
            leaders = [mechanism.tree.coordinates[j] for j in np.flatnonzero([not is_zero(factor) for factor in row])]
            follows[joint] = f"which follows {join_names(leaders) or 'none'} (mimic)"
    return follows
