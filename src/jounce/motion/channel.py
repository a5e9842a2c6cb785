"""Hold a quantity of named joints over time: of forces, motors, limits, tables, pictures and reports."""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, Self

import numpy as np

from jounce.core.display import MAX_LINES_PRINTED, MAX_NOTES_PRINTED, HtmlDisplay, Row, print_table
from jounce.core.errors import JounceError, door, join_names, optional_import, shorten
from jounce.motion import reliability
from jounce.spatial.series import RATE_SUFFIX, rate_name

Rates = tuple[np.ndarray, ...]
Span = tuple[float, float]

DEVIATION = "_sd"  # what follows the name of a quantity in that of a column of its standard deviations
RATE = re.compile(f"(.*?){RATE_SUFFIX}", re.DOTALL)
BETWEEN_UNITS = re.compile(r" (?:and|or) ")  # of entries that differ in it: of a twist, or of joints not known


class Discontinuity(Protocol):
    """A time at which a quantity is not smooth: the rate of this order jumps there."""

    @property
    def t(self) -> float:
        """The time, s."""

    @property
    def order(self) -> int:
        """The order of the rate that jumps, 0 for the quantity itself."""


@door
@dataclass(frozen=True, eq=False, repr=False)
class Channel(HtmlDisplay):
    """A quantity of named joints over time, with its rates.

    Attributes
    ----------
    symbol : str
        The symbol of the quantity, "Q"; its rates are Q, Qd, Q2d, ... Empty where the names hold those of columns.
    names : tuple of str
        The joints, motors or contacts (k) whose quantity it is: one column each.
    units : tuple of str
        The unit of the quantity in each column, "N m"; that of a rate is per s, per s^2, ... Empty if not known.
    times : (N,)
        Times in s.
    rates : tuple of (N, k)
        The quantity and its rates; (N, k, ...) where each entry is an array, such as the wrench of a contact.
    deviations : tuple of (N, k), or None
        Standard deviations of these, NaN where they are not known; None where the quantity is exact.
    windows : tuple of (start, stop)
        The times, s, between which each rate is known well; empty where all are all the time.
    breaks : tuple of Break or ForceBreak
        Where the quantity or one of its rates jumps.
    bounds : tuple of (2, k)
        The lower and upper bounds of each rate, infinite where it has none; empty where no limit bounds it.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r")
    >>> motion = jounce.Motion.polynomial([[0, 1], [0, 0.5]], duration=1.0)
    >>> Q = robot.forces_along(motion, order=1).efforts
    >>> Q.symbol, Q.names, Q.units, Q.rate(1).symbol
    ('Q', ('joint1', 'joint2'), ('N m', 'N m'), 'Qd')
    """

    symbol: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    times: np.ndarray
    rates: Rates
    deviations: Rates | None = None
    windows: tuple[Span, ...] = ()
    breaks: Sequence[Discontinuity] = ()
    bounds: Rates = ()

    def __post_init__(self) -> None:
        shape = len(self.times), len(self.names)
        for values in (*self.rates, *(self.deviations or ())):
            if values.shape[:2] != shape:
                raise JounceError(
                    f"values of {self.symbol} have shape {values.shape}; expected {shape}: a row per time, a column per"
                    " name"
                )
        if len(self.units) != len(self.names):
            raise JounceError(f"{self.symbol} has {len(self.units)} units; expected {len(self.names)}, one per name")

    @property
    def values(self) -> np.ndarray:
        """The quantity itself, (N, k)."""
        return self.rates[0]

    @property
    def rate_names(self) -> tuple[str, ...]:
        """The names of the quantity and its rates: Q, Qd, Q2d."""
        return tuple(name_rate(self.symbol, k) for k in range(len(self.rates)))

    def rate(self, k: int) -> "Channel":
        """Return the k-th time derivative as a channel of its own.

        It has the rates that follow.

        Parameters
        ----------
        k : int
            The order of the rate, 0 for the quantity itself.

        Returns
        -------
        Channel
            The rate; its unit is per s, per s^2, ...

        Examples
        --------
        >>> import numpy as np, jounce
        >>> t, q, qd = np.array([0.0, 1.0]), np.array([[0.0, 1.0], [2.0, -3.0]]), np.array([[2.0, -4.0], [2.0, -4.0]])
        >>> q = jounce.Channel("q", ("turn", "slide"), ("rad", "m"), t, (q, qd))
        >>> q.rate(1).symbol, q.rate(1).units
        ('qd', ('rad/s', 'm/s'))
        """
        if not 0 <= k < len(self.rates):
            raise JounceError(f"{self.symbol} has no rate of order {k}; available: {', '.join(self.rate_names)}")
        return replace(
            self,
            symbol=name_rate(self.symbol, k),
            units=tuple(divide_by_seconds(unit, k) for unit in self.units),
            rates=self.rates[k:],
            deviations=self.deviations and self.deviations[k:],
            windows=self.windows[k:],
            bounds=self.bounds[k:],
        )

    def upto(self, order: int) -> Self:
        """Return the quantity and its rates up to an order.

        Parameters
        ----------
        order : int
            The order of the highest rate; all rates where it is higher than theirs.

        Returns
        -------
        Channel
            The same quantity with fewer rates.

        Examples
        --------
        >>> import numpy as np, jounce
        >>> t, q, qd = np.array([0.0, 1.0]), np.array([[0.0, 1.0], [2.0, -3.0]]), np.array([[2.0, -4.0], [2.0, -4.0]])
        >>> q = jounce.Channel("q", ("turn", "slide"), ("rad", "m"), t, (q, qd))
        >>> q.upto(0).rate_names
        ('q',)
        """
        if order < 0:
            raise JounceError(f"order is {order}; expected 0 or more, as {self.symbol} itself is of order 0")
        count = order + 1
        return replace(
            self,
            rates=self.rates[:count],
            deviations=self.deviations and self.deviations[:count],
            windows=self.windows[:count],
            bounds=self.bounds[:count],
        )

    def rows(self, which: slice | np.ndarray) -> Self:
        """Return the channel at some of its times, by their indices.

        Parameters
        ----------
        which : slice or (K,)
            Indices of times, or whether each is kept.

        Returns
        -------
        Channel
            The same quantity at these times.

        Raises
        ------
        IndexError
            If there is no such row.

        Examples
        --------
        >>> import numpy as np, jounce
        >>> t, q, qd = np.array([0.0, 1.0]), np.array([[0.0, 1.0], [2.0, -3.0]]), np.array([[2.0, -4.0], [2.0, -4.0]])
        >>> q = jounce.Channel("q", ("turn", "slide"), ("rad", "m"), t, (q, qd))
        >>> q.rows(slice(1, None)).values
        array([[ 2., -3.]])
        """
        return self._with_arrays(lambda x: x[which], self.times[which])

    def columns(self, which: Sequence[int]) -> Self:
        """Select columns by their indices.

        Parameters
        ----------
        which : (K,)
            Indices of names.

        Returns
        -------
        Channel
            The same quantity of these names, in their order.

        Raises
        ------
        IndexError
            If there is no such column.

        Examples
        --------
        >>> import numpy as np, jounce
        >>> t, q, qd = np.array([0.0, 1.0]), np.array([[0.0, 1.0], [2.0, -3.0]]), np.array([[2.0, -4.0], [2.0, -4.0]])
        >>> q = jounce.Channel("q", ("turn", "slide"), ("rad", "m"), t, (q, qd))
        >>> q.columns([1]).names, q.columns([1]).units
        (('slide',), ('m',))
        """
        at = list(which)
        return replace(
            self,
            names=tuple(self.names[j] for j in at),
            units=tuple(self.units[j] for j in at),
            rates=tuple(x[:, at] for x in self.rates),
            deviations=self.deviations and tuple(x[:, at] for x in self.deviations),
            bounds=tuple(x[:, at] for x in self.bounds),
        )

    def map(self, change: Callable[[np.ndarray], np.ndarray]) -> Self:
        """Return the channel with its arrays changed by a function.

        Values and deviations are changed alike.

        Parameters
        ----------
        change : callable
            A function of an array (N, k) that returns one of the same shape.

        Returns
        -------
        Channel
            The same names and times with other arrays.

        Examples
        --------
        >>> import numpy as np, jounce
        >>> t, q, qd = np.array([0.0, 1.0]), np.array([[0.0, 1.0], [2.0, -3.0]]), np.array([[2.0, -4.0], [2.0, -4.0]])
        >>> q = jounce.Channel("q", ("turn", "slide"), ("rad", "m"), t, (q, qd))
        >>> q.map(np.abs).values
        array([[0., 1.],
               [2., 3.]])
        """
        return self._with_arrays(change, self.times)

    def _with_arrays(self, change: Callable[[np.ndarray], np.ndarray], times: np.ndarray) -> Self:
        off = self.deviations and tuple(map(change, self.deviations))
        return replace(self, times=times, rates=tuple(map(change, self.rates)), deviations=off)

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Return the channel of all times of parts that follow each other.

        Parameters
        ----------
        parts : sequence of Channel
            Channels of one quantity of the same names, up to the same rate.

        Returns
        -------
        Channel
            The first one with the times of all; its breaks, windows and bounds are those of the first.

        Raises
        ------
        JounceError
            If a part is of another quantity or of other names, has more or fewer rates, or lacks deviations.

        Examples
        --------
        >>> import numpy as np, jounce
        >>> t, q, qd = np.array([0.0, 1.0]), np.array([[0.0, 1.0], [2.0, -3.0]]), np.array([[2.0, -4.0], [2.0, -4.0]])
        >>> q = jounce.Channel("q", ("turn", "slide"), ("rad", "m"), t, (q, qd))
        >>> jounce.Channel.join([q.rows([0]), q.rows([1])]).times
        array([0., 1.])
        """
        first = parts[0]
        for part in parts[1:]:
            if part._kind != first._kind:
                raise JounceError(
                    f"{', '.join(part.rate_names)} of {part.names} do not go on {', '.join(first.rate_names)} of"
                    f" {first.names}; expected parts of one quantity of the same joints, up to the same rate, all with"
                    " deviations or none"
                )
        if len(parts) == 1:
            return first
        deviations = None if first.deviations is None else _join_rates([part.deviations or () for part in parts])
        times = np.concatenate([part.times for part in parts])
        return replace(first, times=times, rates=_join_rates([part.rates for part in parts]), deviations=deviations)

    def surest_peaks(self, k: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Return the largest absolute value of a rate in each column.

        Values at uncertain ends of samples are left out.

        Parameters
        ----------
        k : int, optional
            The order of the rate.

        Returns
        -------
        (K,) and (K,)
            Of each column the index of the time, and the absolute value there: the one that stands most out of its band
            of 95 %, NaN where nothing is known.

        Raises
        ------
        IndexError
            If the channel has no such rate.

        Examples
        --------
        >>> import numpy as np, jounce
        >>> t, q, qd = np.array([0.0, 1.0]), np.array([[0.0, 1.0], [2.0, -3.0]]), np.array([[2.0, -4.0], [2.0, -4.0]])
        >>> q = jounce.Channel("q", ("turn", "slide"), ("rad", "m"), t, (q, qd))
        >>> q.surest_peaks()
        (array([1, 1]), array([2., 3.]))
        """
        off = np.zeros_like(self.rates[k]) if self.deviations is None else self.deviations[k]
        # Of columns without deviations any value is sure.
        off = np.where(np.isnan(off).all(axis=0), 0.0, off)
        rows = reliability.find_surest_rows(self.rates[k], off)
        return rows, np.abs(self.rates[k][rows, np.arange(len(self.names))])

    def to_columns(self) -> dict[str, np.ndarray]:
        """Return the columns of a table by name.

        They are ``joint1.Q, joint1.Qd, ..., joint1.Q_sd, ...``, then those of the next joint.

        Returns
        -------
        dict of (N,)
            Values of each rate of each name, and standard deviations.

        Raises
        ------
        JounceError
            If two names are the same, of whose columns one would be lost.

        Examples
        --------
        >>> import numpy as np, jounce
        >>> t, q, qd = np.array([0.0, 1.0]), np.array([[0.0, 1.0], [2.0, -3.0]]), np.array([[2.0, -4.0], [2.0, -4.0]])
        >>> q = jounce.Channel("q", ("turn", "slide"), ("rad", "m"), t, (q, qd))
        >>> list(q.to_columns())
        ['turn.q', 'turn.qd', 'slide.q', 'slide.qd']
        """
        repeated = [name for name, count in Counter(self.names).items() if count > 1]
        if len(repeated) > 0:
            raise JounceError(f"{self.symbol} has several columns of {join_names(repeated, 3)}; expected other names")
        return {name: values for name, _, values in self._columns()}

    def to_pandas(self) -> Any:
        """Return the channel as a data frame of pandas.

        It has a row per time, and columns ``joint1.Q, joint1.Qd, ...``.

        Its ``attrs["units"]`` are the units of the columns. Standard deviations are columns ``joint1.Q_sd``, ...; of
        arrays such as wrenches each entry has its column, ``foot[0].Wc``, ...

        Returns
        -------
        pandas.DataFrame
            The values by name, over the index "t" of times in s.

        Raises
        ------
        JounceError
            If pandas is not installed.

        Examples
        --------
        >>> import numpy as np, jounce
        >>> t, q, qd = np.array([0.0, 1.0]), np.array([[0.0, 1.0], [2.0, -3.0]]), np.array([[2.0, -4.0], [2.0, -4.0]])
        >>> q = jounce.Channel("q", ("turn", "slide"), ("rad", "m"), t, (q, qd))
        >>> frame = q.to_pandas()
        >>> list(frame.columns), frame.attrs["units"]["slide.qd"]
        (['turn.q', 'turn.qd', 'slide.q', 'slide.qd'], 'm/s')
        """
        with optional_import("to_pandas() needs pandas", "frames"):
            import pandas
        frame = pandas.DataFrame(self.to_columns(), index=pandas.Index(self.times, name="t"))
        frame.attrs["units"] = {name: unit for name, unit, _ in self._columns()}
        return frame

    def to_xarray(self) -> Any:
        """Return the channel as a dataset of xarray.

        It has a variable per rate, with dimensions t and joint, and units in its attrs.

        Standard deviations are variables ``Q_sd``, ...

        Returns
        -------
        xarray.Dataset
            The rates by name.

        Raises
        ------
        JounceError
            If xarray is not installed.

        Examples
        --------
        >>> import numpy as np, jounce
        >>> t, q, qd = np.array([0.0, 1.0]), np.array([[0.0, 1.0], [2.0, -3.0]]), np.array([[2.0, -4.0], [2.0, -4.0]])
        >>> q = jounce.Channel("q", ("turn", "slide"), ("rad", "m"), t, (q, qd))
        >>> float(q.to_xarray().q.sel(t=1.0, joint="slide"))
        -3.0
        """
        with optional_import("to_xarray() needs xarray", "frames"):
            import xarray
        variables = {}
        for k, name in enumerate(self.rate_names):
            units = list(dict.fromkeys(divide_by_seconds(unit, k) for unit in self.units))
            about = {"units": " or ".join(units)}
            variables[name] = self._dimensions(self.rates[k]), self.rates[k], about
            if self.deviations is not None:
                variables[name + DEVIATION] = self._dimensions(self.rates[k]), self.deviations[k], about
        return xarray.Dataset(variables, {"t": ("t", self.times, {"units": "s"}), "joint": list(self.names)})

    @property
    def _kind(self) -> tuple[object, ...]:
        """The fields that all parts of one channel share."""
        return self.symbol, self.names, self.units, len(self.rates), self.deviations is None

    def _columns(self) -> Iterator[tuple[str, str, np.ndarray]]:
        """Yield the name, unit and values of each column of a table."""
        for j, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            # Of arrays, such as wrenches, each entry has its column.
            for index in np.ndindex(*self.values.shape[2:]):
                entry = name + (str(list(index)) if len(index) > 0 else "")
                for ending, arrays in (("", self.rates), (DEVIATION, self.deviations or ())):
                    for k, values in enumerate(arrays):
                        column = f"{entry}.{name_rate(self.symbol, k)}" if self.symbol else rate_name(entry, k)
                        yield column + ending, divide_by_seconds(unit, k), values[(..., j, *index)]

    @staticmethod
    def _dimensions(values: np.ndarray) -> tuple[str, ...]:
        """Return the names of the dimensions of an array."""
        return ("t", "joint", *(f"axis{i}" for i in range(1, values.ndim - 1)))

    def __repr__(self) -> str:
        """Return at most twelve lines, with the largest values of each column.

        They say what the channel is of, and when each rate is largest.
        """
        return print_table(self.summary, *self.peak_table)

    @property
    def summary(self) -> str:
        """The quantity, its columns and its times in one line."""
        units, names, n = dict.fromkeys(self.units), self.names, len(self.times)
        owners = f"of {shorten(names[0])}" if len(names) == 1 else f"of {len(names)} columns"
        span = f"t = {self.times[0]:g} .. {self.times[-1]:g} s" if n > 0 else "no times"
        breaks = f", {len(self.breaks)} break{'s' * (len(self.breaks) > 1)}" if len(self.breaks) > 0 else ""
        unit = f" [{' or '.join(units)}]" if any(units) else ""
        return f"{', '.join(self.rate_names)}{unit} {owners}, {n} time{'s' * (n != 1)}, {span}{breaks}"

    @property
    def peak_table(self) -> tuple[Row, list[Row]]:
        """The titles and rows of a table of the largest values.

        Per column they are the largest absolute value of each rate, and when. Deviations follow values that have them.
        There are no rows without times, nor of arrays such as wrenches.
        """
        titles = ["", *(x for name in self.rate_names for x in (f"largest |{name}|", "at t, s"))]
        if len(self.times) == 0 or self.values.ndim > 2:
            return tuple(titles), []
        peaks = [self.surest_peaks(k) for k in range(len(self.rates))]
        rows: list[Row] = []
        for j, name in enumerate(self.names):
            cells = [name]
            for k, (peak_rows, sizes) in enumerate(peaks):
                cells += self._describe_peak(k, j, peak_rows[j], sizes[j])
            rows.append(tuple(cells))
        return tuple(titles), rows

    def _list_largest(self, order: int) -> list[Row]:
        """Return rows of a table: of each rate up to an order, and each unit.

        They are the name of the rate, its largest absolute value with its deviation, the unit, the column and the time.
        """
        rows: list[Row] = []
        if len(self.times) == 0 or self.values.ndim != 2:
            return rows
        for k in range(min(order + 1, len(self.rates))):
            peak_rows, sizes = self.surest_peaks(k)
            # Values in rad and in m are not compared with each other.
            for unit in dict.fromkeys(self.units):
                columns = [j for j, own_unit in enumerate(self.units) if own_unit == unit and not np.isnan(sizes[j])]
                if len(columns) > 0:
                    j = max(columns, key=lambda j: float(sizes[j]))
                    value, t = self._describe_peak(k, j, peak_rows[j], sizes[j])
                    rows.append((name_rate(self.symbol, k), value, divide_by_seconds(unit, k), self.names[j], t))
        return rows

    def _describe_peak(self, k: int, j: int, row: int, size: float) -> tuple[str, str]:
        """Return a rate's absolute value in a column, and its time.

        The value has its deviation; both are dashes for NaN.
        """
        if np.isnan(size):
            return "-", "-"
        off = np.nan if self.deviations is None else self.deviations[k][row, j]
        deviation = f" ± {off:.2g}" if off > 0 else ""
        return f"{size:.5g}{deviation}", f"{self.times[row]:.5g}"


LARGEST_TITLES: Row = ("", "largest", "unit", "of", "at t, s")


def list_largest(channels: Sequence[Channel], most: int) -> tuple[list[Row], list[str]]:
    """Return rows of the largest values of channels, and a note.

    The channels are at the same times. Of more than `most` rows the highest rates are left out.
    """
    highest = max((len(channel.rates) for channel in channels), default=1) - 1
    for order in range(highest, -1, -1):
        rows = [row for channel in channels for row in channel._list_largest(order)]
        if len(rows) <= most:
            break
    # The note names rates that are left out, and channels of arrays, which have no rows.
    absent = []
    higher = [name for channel in channels if channel.values.ndim == 2 for name in channel.rate_names[order + 1 :]]
    if len(higher) > 0:
        absent.append(", ".join(higher))
    absent += [f"{', '.join(x.rate_names)} of {join_names(x.names, 3)}" for x in channels if x.values.ndim > 2]
    return rows, [f"also: {'; '.join(absent)}"] if len(absent) > 0 else []


def print_channels(title: str, channels: Sequence[Channel], notes: Sequence[str] = ()) -> str:
    """Return the largest values of channels, in at most twelve lines.

    The channels are at the same times.
    """
    rows, also = list_largest(channels, MAX_LINES_PRINTED - 3 - min(len(notes), MAX_NOTES_PRINTED))
    return print_table(f"{title}: {describe_times(channels)}", LARGEST_TITLES, rows, [*also, *notes])


def describe_times(channels: Sequence[Channel]) -> str:
    """Describe the times and breaks of channels at the same times."""
    t = channels[0].times
    if len(t) == 0:
        return "no times"
    count = len({one_break.t for channel in channels for one_break in channel.breaks})
    breaks = f", breaks at {count} time{'s' * (count > 1)}" if count > 0 else ""
    return f"{len(t)} time{'s' * (len(t) != 1)}, t = {t[0]:g} .. {t[-1]:g} s{breaks}"


def name_rate(symbol: str, k: int) -> str:
    """Return the name of the k-th rate of a quantity.

    The quantity may be a rate itself: it is Q2d of Q for k = 2, and of Qd for k = 1.
    """
    if k == 0:
        return symbol
    stem, suffix = RATE.fullmatch(symbol).groups()  # type: ignore[union-attr]  # any symbol matches
    order = 0 if suffix is None else int(suffix.removesuffix("d") or 1)
    return rate_name(stem, order + k)


def divide_by_seconds(unit: str, k: int) -> str:
    """Return the unit of the k-th rate of a quantity.

    It is N m/s^2 of N m for k = 2, rad/s^2 of rad/s for k = 1. Of several units, ``rad/s and m/s``, it is that of each;
    a unit that is not known, "", stays so.
    """
    between = BETWEEN_UNITS.search(unit)
    if between is not None:
        parts = (divide_by_seconds(part, k) for part in (unit[: between.start()], unit[between.end() :]))
        return between[0].join(parts)
    if k == 0 or unit == "":
        return unit
    stem, per, power = unit.partition("/s")
    order = int(power.removeprefix("^") or 1) if per else 0
    return f"{stem}/s^{order + k}" if order + k > 1 else f"{stem}/s"


def _join_rates(parts: Sequence[Rates]) -> Rates:
    """Return the rates of parts that follow each other."""
    return tuple(np.concatenate(terms) for terms in zip(*parts, strict=True))
