"""Where vectors are in scratch memory: parts one behind the other, and places that are used again."""

from collections.abc import Iterable
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import accumulate

from jounce.model.mechanism import Mechanism


@dataclass(frozen=True)
class VectorLayout:
    """Vectors one behind the other: by part, how many rates of how many scalars; and how many rates are unknown."""

    parts: tuple[tuple[str, int, int], ...]
    unknown: int = 0

    def places(self, name: str) -> list[range]:
        """Return the positions of the known rates of a part."""
        starts = accumulate((rates * scalars for _, rates, scalars in self.parts), initial=0)
        for (part, rates, scalars), start in zip(self.parts, starts, strict=False):
            if part == name:
                known = range(max(1, rates - self.unknown))
                return [range(start + k * scalars, start + (k + 1) * scalars) for k in known]
        raise KeyError(name)

    def start(self, name: str) -> int:
        """Return the position of a part."""
        return self.places(name)[0].start

    @property
    def size(self) -> int:
        """The number of vectors."""
        return sum(rates * scalars for _, rates, scalars in self.parts)


def carriers(mechanism: Mechanism) -> list[int]:
    """The joint on which each joint hangs; -1 is the ground, or the base that moves in its place."""
    return [mechanism.parent[i] - mechanism.floats if mechanism.parent[i] >= 0 else -1 for i in mechanism.owners]


def reuse_places(spans: Iterable[tuple[int, int]]) -> list[int]:
    """Assign places to values that are kept from a first time to a last; they come in the order of the first.

    This is linear-scan register allocation without spilling: the lowest free place, or a new one without any. No other
    assignment needs fewer places.
    """
    places, free, taken, count = list[int](), list[int](), list[tuple[int, int]](), 0
    for first, last in spans:
        while taken and taken[0][0] < first:
            heappush(free, heappop(taken)[1])
        if not free:
            free, count = [count], count + 1
        places.append(heappop(free))
        heappush(taken, (last, places[-1]))
    return places
