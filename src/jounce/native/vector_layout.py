"""Where vectors are in scratch memory: parts one behind the other."""

from dataclasses import dataclass
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
    return [
        mechanism.parent[i] - mechanism.moving_bodies.start if mechanism.parent[i] >= 0 else -1
        for i in mechanism.owners
    ]
