"""Channels of a robot along a motion: the names and units of its quantities, and between which times they are known."""

from collections.abc import Sequence

import numpy as np

from jounce.dynamics.quantities import Quantity
from jounce.model import coordinates, positions
from jounce.model.mechanism import Mechanism
from jounce.motion import reliability
from jounce.motion.channel import Channel, Discontinuity, Rates, Span
from jounce.motion.motion import Motion

IN_METRES = " or, for coordinates in m, "  # of the unit of a quantity: before it that of coordinates in rad
_BASE_UNITS = ("rad",) * 3 + ("m",) * 3  # of the velocities of a base that floats


def quantity_names(m: Mechanism, row: Quantity) -> tuple[str, ...]:
    """The names of the entries of a quantity with one axis: of coordinates, of the base first, or of motors."""
    [axis] = row.gives.shape
    if m.closure is not None and axis in ("tree", "motors"):
        names = m.closure.coordinates
        return names if axis == "tree" else tuple(names[j] for j in m.closure.force_places)
    return coordinates.force_names(m) if axis == "nv" else m.coordinates


def quantity_units(m: Mechanism, row: Quantity) -> tuple[str, ...]:
    """The unit of each entry of a quantity with one axis."""
    owners = dict(zip(coordinates.BASE_FORCES, _BASE_UNITS, strict=True))
    owners |= dict(zip(m.tree.coordinates, coordinates.units(m.tree), strict=True))
    owners |= dict(zip(m.coordinates, coordinates.units(m), strict=True))
    in_radians, _, in_metres = row.gives.unit.partition(IN_METRES)
    return tuple(in_metres if in_metres and owners[name] == "m" else in_radians for name in quantity_names(m, row))


def coordinate_channels(
    m: Mechanism,
    t: np.ndarray,
    rates: Rates,
    deviations: Rates | None = None,
    breaks: Sequence[Discontinuity] = (),
) -> tuple[Channel, ...]:
    """q with its rates; with joints of several screws q alone, whose numbers are no velocities, and qd with its own."""
    names, units = positions.names(m), coordinates.position_units(m)
    if names == m.coordinates:
        return (Channel("q", names, tuple(units), t, rates, deviations, (), breaks),)
    q = Channel("q", names, tuple(units), t, rates[:1], deviations and deviations[:1], (), breaks)
    if len(rates) == 1:
        return (q,)
    of_velocities = tuple(f"{unit}/s" for unit in coordinates.units(m))
    return q, Channel("qd", m.coordinates, of_velocities, t, rates[1:], deviations and deviations[1:], (), breaks)


def quantity_channel(
    m: Mechanism,
    row: Quantity,
    t: np.ndarray,
    rates: Rates,
    deviations: Rates | None = None,
    windows: tuple[Span, ...] = (),
) -> Channel:
    """A quantity with one axis and its rates at times (N,)."""
    names, units = quantity_names(m, row), quantity_units(m, row)
    return Channel(row.gives.symbol, names, units, t, rates, deviations, windows)


def base_channels(t: np.ndarray, base: Rates) -> tuple[Channel, ...]:
    """The pose C (N, 1, 4, 4) and the twist V (N, 1, 6) of a base with its rates."""
    pose = Channel("C", ("base",), ("1 and m",), t, (base[0][:, None],))
    if len(base) == 1:
        return (pose,)
    return pose, Channel("V", ("base",), ("rad/s and m/s",), t, tuple(x[:, None] for x in base[1:]))


def contact_channel(m: Mechanism, t: np.ndarray, rates: Rates) -> Channel:
    """The wrenches of contacts, (N, contacts, 6), with rates."""
    frames = tuple(contact.frame for contact in m.contacts)
    return Channel("Wc", frames, ("N m and N",) * len(frames), t, rates)


def find_windows(motion: Motion, order: int, force_rate: int) -> tuple[Span, ...]:
    """By rate of q up to an order, the times between which it is known well, and what loads and the base add to Q.

    Q and its rates are known as well as the highest rates that they take, whose deviations are most of theirs; Q takes
    the rate `force_rate` of q, from which on loads count.
    """
    times = motion.times
    t = times[np.unique(np.linspace(0, len(times) - 1, min(len(times), reliability.MAX_WINDOW_TIMES)).astype(int))]
    curves = [(motion.curve, 0), *((load, force_rate) for load in motion.loads.values())]
    curves += [(motion.base_curve, 0)] if motion.base_curve else []
    spans = [[(motion.start, motion.stop)] for _ in range(order + 1)]
    for curve, first in curves:
        off = curve.deviations(t, order - first) if order >= first else None
        rates = curve.rates(t, order - first) if off else ()
        for of, x, deviations in zip(spans[first:], rates, off or (), strict=False):
            of.append(reliability.find_window(t, deviations, x))
    return tuple((max(start for start, _ in of), min(stop for _, stop in of)) for of in spans)
