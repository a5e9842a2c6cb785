"""Match the entries of a state or load by name, and report all naming errors together.

Every argument that holds something of each joint goes through here, unless it has no names.
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


def values_by_name(given: Any) -> Any:
    """A dict of what is given by name; anything else as it is given."""
    return given if entry_names(given) is None else read_entries(given)


def array_by_name(given: Any, joints: Sequence[str], label: str) -> Array:
    """An array (..., n) of what is given of each joint by name, in their order; anything else as an array."""
    if entry_names(given) is None:
        return asarray(given, label)
    with locate_errors(label):
        return stack_entries(given, joints, {})


def stack_entries(given: Any, joints: Sequence[str], unfit: Mapping[Any, str], asked: str = "") -> Array:
    """Return an array (..., n) of entries (...) with the names of joints, broadcast; see `check_names`."""
    named = read_entries(given)
    check_names(named, joints, unfit, asked)
    parts = [scalars.convert_element(named[joint], repr(joint)) for joint in joints]
    if any(map(is_symbolic, parts)):
        parts = [part if is_symbolic(part) else scalars.restore_integers(part) for part in parts]
    parts = scalars.broadcast(parts, [0] * len(parts), [repr(joint) for joint in joints])
    return scalars.namespace(*parts).stack(parts, axis=-1)


def check_names(given: Collection[Any], expected: Sequence[str], unfit: Mapping[Any, str], asked: str = "") -> None:
    """Raise `JounceError` if the given names are not the expected ones, with all missing, unknown and unfit names.

    `unfit` maps existing names that are not allowed here to the reason; `asked` describes the expected names.
    """
    from difflib import get_close_matches  # imported here to keep start-up fast

    absent = [name for name in expected if name not in given]
    unknown = []
    for name in [name for name in given if name not in expected and name not in unfit]:
        near = get_close_matches(name, absent, n=1) if isinstance(name, str) else []
        unknown.append(quote_value(name) + (f" (did you mean {near[0]!r}?)" if near else ""))
    found = (("missing", [quote_value(name) for name in absent]), ("unknown", unknown))
    wrong = [f"{word} {join_names(names)}" for word, names in found if names]
    wrong += [f"leave out {quote_value(name)}, {unfit[name]}" for name in given if name in unfit]
    if wrong:
        raise JounceError(f"{'; '.join(wrong)}; expected {asked or join_names(expected)}")


def find_followers(mechanism: Mechanism) -> dict[Any, str]:
    """Map the joints that are not coordinates, and so not part of a state, to the joints that they follow."""
    in_loops = [name for name in mechanism.tree.coordinates if name not in mechanism.coordinates]
    follows: dict[Any, str] = dict.fromkeys(in_loops, "which follows others in closed loops")
    for joint, row in zip(mechanism.joints, mechanism.tree.G, strict=True):
        if joint not in mechanism.tree.coordinates:
            leaders = [mechanism.tree.coordinates[j] for j in np.flatnonzero([not is_zero(factor) for factor in row])]
            follows[joint] = f"which follows {join_names(leaders) or 'none'} (mimic)"
    return follows
