"""Make channels of a robot's quantities along a motion.

Channels have names, units and windows. A window is the time between which a quantity is known well.
"""

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
    """Return the names of the entries of a quantity with one axis.

    Entries belong to coordinates, to the base first, or to motors.
    """
    [axis] = row.gives.shape
    # Closed robots have more joints in their tree, and more motors, than coordinates.
    if m.closure is not None and axis in ("tree", "motors"):
        names = m.closure.coordinates
        return names if axis == "tree" else tuple(names[j] for j in m.closure.force_places)
    return coordinates.force_names(m) if axis == "nv" else m.coordinates


def quantity_units(m: Mechanism, row: Quantity) -> tuple[str, ...]:
    """Return the unit of each entry of a quantity with one axis."""
    # The unit of each coordinate, rad or m, by name.
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
    """Return the channels of q with its rates, (N, n) each.

    With joints of several screws, numbers of q are no integrals of velocities: q and qd are two channels.
    """
    names, units = positions.names(m), coordinates.position_units(m)
    if names == m.coordinates:
        return (Channel("q", names, tuple(units), t, rates, deviations, (), breaks),)
    of_positions, of_velocities = (None, None) if deviations is None else (deviations[:1], deviations[1:])
    q = Channel("q", names, tuple(units), t, rates[:1], of_positions, (), breaks)
    if len(rates) == 1:
        return (q,)
    velocity_units = tuple(f"{unit}/s" for unit in coordinates.units(m))
    return q, Channel("qd", m.coordinates, velocity_units, t, rates[1:], of_velocities, (), breaks)


def quantity_channel(
    m: Mechanism,
    row: Quantity,
    t: np.ndarray,
    rates: Rates,
    deviations: Rates | None = None,
    windows: tuple[Span, ...] = (),
) -> Channel:
    """Return the channel of a quantity with one axis.

    Its rates are given at times (N,).
    """
    names, units = quantity_names(m, row), quantity_units(m, row)
    return Channel(row.gives.symbol, names, units, t, rates, deviations, windows)


def base_channels(t: np.ndarray, base: Rates) -> tuple[Channel, ...]:
    """Return the channels of a base.

    They are the pose C (N, 1, 4, 4) and the twist V (N, 1, 6) with rates.
    """
    pose = Channel("C", ("base",), ("1 and m",), t, (base[0][:, None],))
    if len(base) == 1:
        return (pose,)
    return pose, Channel("V", ("base",), ("rad/s and m/s",), t, tuple(x[:, None] for x in base[1:]))


def contact_channel(m: Mechanism, t: np.ndarray, rates: Rates) -> Channel:
    """Return the channel of contact wrenches, (N, contacts, 6), with rates."""
    frames = tuple(contact.frame for contact in m.contacts)
    return Channel("Wc", frames, ("N m and N",) * len(frames), t, rates)


def find_windows(motion: Motion, order: int, force_rate: int) -> tuple[Span, ...]:
    """Return the times between which rates of q are known well.

    They are listed by rate, up to an order. Q and its rates are known as well as the highest rates that they take,
    whose deviations are most of theirs. Q takes the rate `force_rate` of q: from there on loads count too, and a
    base at all rates.
    """
    times = motion.times
    t = times[np.unique(np.linspace(0, len(times) - 1, min(len(times), reliability.MAX_WINDOW_TIMES)).astype(int))]
    # Curves of the motion, each with the rate of q to which its own value belongs.
    curves = [(motion.curve, 0), *((load, force_rate) for load in motion.loads.values())]
    if motion.base_curve is not None:
        curves.append((motion.base_curve, 0))
    # Each curve with deviations has windows of its own. What all know well is their intersection.
    spans = [[(motion.start, motion.stop)] for _ in range(order + 1)]
    for curve, first in curves:
        deviations = curve.deviations(t, order - first) if order >= first else None
        if deviations is None:
            continue
        rates = curve.rates(t, order - first)
        for spans_of_rate, x, deviation in zip(spans[first:], rates, deviations, strict=False):
            spans_of_rate.append(reliability.find_window(t, deviation, x))
    return tuple((max(start for start, _ in parts), min(stop for _, stop in parts)) for parts in spans)
