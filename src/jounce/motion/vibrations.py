"""Vibrations that stand out of the noise of a log, and what to say of them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from jounce.motion.lines import Line

MASS_MATRIX_TIMES = 50  # of a vibration, at which mass matrices are taken


@dataclass(frozen=True)
class Vibration:
    """A vibration of a joint, by its name and number, whose largest q4d is `peak`.

    If the fit does not follow it, its standard deviations hold it.
    """

    line: Line
    name: str
    joint: int
    peak: float
    followed: bool

    @property
    def fourth(self) -> float:
        """Its amplitude in q4d."""
        return float(self.line.amplitude * (2 * np.pi * self.line.frequency) ** 4)

    def __str__(self) -> str:
        when = "" if self.line.lasts else f" from t = {self.line.span[0]:.4g} to {self.line.span[1]:.4g} s"
        followed = "the fit follows it, unless a lower bandwidth makes it noise"
        return (
            f"{self.name} vibrates at {self.line.frequency:.4g} Hz by {self.line.amplitude:.2g} rad or m{when}, which"
            f" is {self.fourth:.2g} in q4d, whose peak is {self.peak:.2g}: "
            + (followed if self.followed else "the fit leaves it out, and its deviations hold it")
        )


def notes_of(vibrations: Sequence[Vibration]) -> tuple[str, ...]:
    """A note of each that lasts, and one of those in parts of the log: of the largest, and how many there are."""
    lasting = [str(v) for v in vibrations if v.line.lasts]
    bursts = [v for v in vibrations if not v.line.lasts]
    if bursts:
        largest = max(bursts, key=lambda v: v.fourth)
        more = f"; {len(bursts) - 1} more such parts, of this or other joints" if len(bursts) > 1 else ""
        lasting.append(f"{largest}{more}")
    return tuple(lasting)


def note_of_encoder(name: str, count: int) -> str:
    """A note of a joint whose encoder errs by a wave over its angle."""
    return (
        f"{name} is off by a wave of about {count} per turn, as an encoder's interpolation is; the fit follows it as"
        " motion as far as its band reaches"
    )


def in_forces(
    vibration: Vibration, mass_matrices: Callable[[np.ndarray], np.ndarray], coordinates: Sequence[str]
) -> str:
    """A note of the largest Q2d that a vibration means to the first order, M (T, n, n) at times (T,) times its q4d."""
    M = mass_matrices(np.linspace(*vibration.line.span, MASS_MATRIX_TIMES))
    most = np.abs(M[:, :, coordinates.index(vibration.name)]).max(axis=0) * vibration.fourth
    largest = int(np.argmax(most))
    return (
        f"the vibration of {vibration.name} at {vibration.line.frequency:.4g} Hz means up to {most[largest]:.2g} in Q2d"
        f" of {coordinates[largest]}, N m/s^2 or N/s^2, to the first order"
    )
