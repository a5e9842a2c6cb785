"""Options and summaries of commands on one motion or many.

A `RunRequest` states what a command computes: as a whole, or part by part, here or on a cluster. `LargestValues` are
the largest values of several motions, with their deviations.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import wraps
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.cli.motion_options import MotionRequest
from jounce.cli.output import align_columns, check_distinct
from jounce.core.errors import JounceError, collect_warnings, quote_value, warn
from jounce.core.progress import stage

if TYPE_CHECKING:
    from jounce.core.typing import JsonObject
    from jounce.engine.hidden_vibrations import HiddenVibration
    from jounce.io.motions.table_parts import Reading
    from jounce.motion.extremes import Extremes, Peak, PeaksByJoint
    from jounce.stream.jobs import Job
    from jounce.stream.run import RunSummary


MAX_NOTES_SHOWN = 8  # notes, warnings and sources: more would hide the results; --json lists all
UNCERTAIN_MARK = "* uncertain, near an end of the samples: the deviation exceeds 5 % and ten times the median"
SUMMARY_SCHEMA = 1  # of the JSON of `run`, `motors` and `check`: raised when a key goes or changes its meaning
VERBOSE = click.option(
    "--verbose", is_flag=True, help="Print what the samples do not show for every joint, instead of the worst one."
)
CLUSTER = click.option(
    "--cluster",
    metavar="ADDRESS",
    help="Compute the parts on Dask: local for all cores of this machine, or tcp://HOST:PORT of a scheduler.",
)


@dataclass(frozen=True)
class StreamRequest:
    """The options of tables that are read by parts: aggregates, and the cluster that computes them."""

    reduce: tuple[str, ...]
    cluster: str | None

    def reading(self, motion: MotionRequest) -> "Reading":
        """Return how the table of a motion is read."""
        from jounce.io.motions.table_parts import Reading
        from jounce.motion.spline import select_smoothing
        from jounce.motion.table_columns import ColumnOptions

        table_options = dict(motion.options)
        smoothing = select_smoothing(
            *(table_options[name] for name in ("degree", "intervals", "bandwidth", "allow_noise", "as_"))
        )
        # The reader has names of its own for two options.
        table_options["pattern"], table_options["skip"] = table_options["columns"], table_options["on_error"] == "skip"
        options = ColumnOptions(**{field.name: table_options[field.name] for field in fields(ColumnOptions)})
        return Reading(options, smoothing, motion.blend, motion.step)


def add_stream_options_without_reduce(verb: Callable[..., None]) -> Callable[..., None]:
    """Add --cluster to a command that writes no aggregates, see `add_stream_options`."""

    @wraps(verb)
    def command(cluster: str | None, reduce: Sequence[str] = (), **arguments: Any) -> None:
        verb(stream=StreamRequest(_check_kinds(reduce), cluster), **arguments)

    return CLUSTER(command)


def _check_kinds(names: Sequence[str]) -> tuple[str, ...]:
    """Return the kinds of --reduce, each once."""
    known = ("peak", "rms")
    unknown = [name for name in names if name not in known]
    if len(unknown) > 0:
        expected = f"{', '.join(known)}, or several of them separated by commas"
        raise JounceError(f"--reduce is {quote_value(unknown[0])}; expected {expected}")
    return tuple(dict.fromkeys(names))


@dataclass(frozen=True)
class RunRequest:
    """The job that a command computes: of a motion, into an output, as a whole or by parts."""

    job: "Job"
    motion: MotionRequest
    output: Path | None
    stream: StreamRequest
    label: str
    verbose: bool = False  # whether to print a line per joint about what samples hide

    @property
    def is_by_parts(self) -> bool:
        """Whether the motion is read by parts.

        This is requested by a folder, by aggregates, by skipped rows or by a cluster, or needed by the size of a table.
        """
        from jounce.io.motions.logs import is_bag
        from jounce.io.motions.table_parts import is_by_parts
        from jounce.io.tables import ROW_FORMATS

        path = self.motion.path
        is_episode = self.motion.options["episode"] is not None
        reads_folder = path.is_dir() and not is_bag(path) and not is_episode
        writes_folder = self.output is not None and not self.output.suffix
        skips = self.job.reading.skip and path.suffix.lower() in ROW_FORMATS and not is_episode
        reduces, on_cluster = len(self.stream.reduce) > 0, self.stream.cluster is not None
        is_requested = reads_folder or writes_folder or reduces or skips or on_cluster
        return is_requested or (not is_episode and is_by_parts(self.job, path))

    def run_whole(self, compute: "Callable[[], RunSummary]") -> "RunSummary":
        """Compute a motion as a whole, and pass its warnings on."""
        from jounce.io import tables

        if self.output is not None:
            tables.check_writable(self.output)
            check_distinct(self.output, self.motion.path)
        with collect_warnings() as warnings:
            summary = compute()
        return warned(replace(summary, warnings=(*dict.fromkeys(warnings),)))

    def run_by_parts(self) -> "RunSummary":
        """Compute tables by parts, and pass their warnings on."""
        from jounce.stream.run import Runner, run_here, run_tables

        if self.motion.options["topic"] is not None:
            raise JounceError("--topic is for ROS bags, which are not read by parts; leave it out")
        if self.motion.options["episode"] is not None:
            came = "--episode selects one motion, which is read as a whole"
            raise JounceError(f"{came}; leave it out for aggregates, folders and clusters")
        for name in ("duration", "tolerance"):
            if self.motion.options[name] is not None:
                raise JounceError(
                    f"--{name} is for one file of way points, which is read as a whole; leave it out, or name that file"
                    " without options for tables that are read by parts"
                )
        if self.motion.options["measured"] == "motors":
            raise JounceError(
                "--measured motors needs the whole motion, but this one is read by parts; write the motion of the links"
                " first: jounce motion ROBOT MOTION --measured motors -o links.csv"
            )
        runner: Runner = run_here
        if self.stream.cluster is not None:
            from jounce.stream.cluster import cluster_runner

            runner = cluster_runner(self.stream.cluster)
        with stage(self.label) as show:
            return warned(run_tables(self.job, self.motion.path, self.output, self.stream.reduce, runner, show))

    @property
    def where_skipped(self) -> str:
        """The path of the table of skipped rows."""
        from jounce.io.motions import part_rows

        return "" if self.output is None else str(part_rows.skipped_path(self.output))

    def span(self, summary: "RunSummary") -> list[float]:
        """Return the earliest and the latest time of all motions, s."""
        spans = [result.span for result in summary.results.values()]
        return [min(start for start, _ in spans), max(stop for _, stop in spans)]


def warned(summary: "RunSummary") -> "RunSummary":
    """Pass the first warnings of a summary on, and return it."""
    for text in summary.warnings[:MAX_NOTES_SHOWN]:
        warn(text)
    hidden_count = len(summary.warnings) - MAX_NOTES_SHOWN
    if hidden_count > 0:
        warn(f"and {hidden_count} more warnings; --json lists them")
    return summary


def common_json(request: RunRequest, summary: "RunSummary") -> "JsonObject":
    """Return the part of the JSON that all commands on motions share."""
    has_table = summary.skipped > 0 and request.where_skipped != ""
    skipped = {"rows": summary.skipped, "table": request.where_skipped if has_table else None}
    hidden = [
        asdict(vibration) | {"motion": name}
        for name, result in summary.results.items()
        for vibration in result.facts.hidden
    ]
    return {
        "schema": SUMMARY_SCHEMA, "robot": request.job.robot.name, "motion": str(request.motion.path),
        "output": None if request.output is None else str(request.output), "states": summary.rows,
        "motions": len(summary.results), "t": request.span(summary), "parts": summary.parts,
        "parts_computed": summary.computed, "skipped": skipped, "notes": list(summary.notes),
        "warnings": list(summary.warnings), "hidden_vibrations": hidden,
    }  # fmt: skip


@dataclass(frozen=True)
class LargestValues:
    """The largest values of all motions, by joint and quantity.

    `certain` are the largest values among those that are known well. Each value is a pair: the name of its motion, and
    the peak.
    """

    largest: "Mapping[str, Mapping[str, tuple[str, Peak]]]"
    certain: "Mapping[str, Mapping[str, tuple[str, Peak]]]"
    units: Mapping[str, Mapping[str, str]]

    @classmethod
    def of(cls, motions: "Mapping[str, PeaksByJoint]", unit: Callable[[str], str]) -> "LargestValues":
        """Collect the largest values; `unit` returns the unit of a column."""
        largest = _find_largest(motions, lambda extremes: extremes.largest)
        certain = _find_largest(motions, lambda extremes: extremes.certain)
        units = {joint: {name: unit(f"{joint}.{name}") for name in named} for joint, named in largest.items()}
        return cls(largest, certain, units)

    def json(self) -> "JsonObject":
        """Return the largest values as plain data."""

        def plain(values: "Mapping[str, Mapping[str, tuple[str, Peak]]]") -> "JsonObject":
            return {
                joint: {name: peak._asdict() | {"motion": motion} for name, (motion, peak) in peaks.items()}
                for joint, peaks in values.items()
            }

        units = {joint: dict(units_by_name) for joint, units_by_name in self.units.items()}
        return {"largest": plain(self.largest), "certain": plain(self.certain), "units": units}

    def table(self, several: bool = False) -> list[str]:
        """Return a table of the largest values with their times.

        Of `several` motions it has their names too. Below a row with uncertain values, another row has the largest
        certain values.
        """
        # Two columns per quantity; the unit of the first stands in a column, the further ones per s, s^2, ...
        names = list(next(iter(self.largest.values())))
        per = ["", " /s", *(f" /s^{k}" for k in range(2, len(names)))]
        heads = (cell for name, unit in zip(names, per, strict=False) for cell in (f"|{name}|{unit}", "at t"))
        rows: list[tuple[str, ...]] = [("largest", "unit", *heads)]

        def cells(motion: str, peak: "Peak", mark: str = "") -> tuple[str, str]:
            place = f" of {motion}" if several else ""
            return format_with_deviation(peak.value, peak.deviation) + mark, f"{peak.t:.6g}{place}"

        for joint, peaks in self.largest.items():
            # A value is uncertain where the largest certain value is another one.
            certain_peaks = {name: x for name, x in self.certain[joint].items() if x != peaks[name]}
            cells_of_joint = (cells(*peaks[name], " *" if name in certain_peaks else "") for name in names)
            rows.append((joint, self.units[joint][names[0]], *chain(*cells_of_joint)))
            if len(certain_peaks) > 0:
                cells_of_joint = (cells(*certain_peaks[x]) if x in certain_peaks else ("", "") for x in names)
                rows.append(("  certain", "", *chain(*cells_of_joint)))
        has_uncertain = any(row[0] == "  certain" for row in rows)
        return [*align_columns(rows), *([UNCERTAIN_MARK] if has_uncertain else [])]


def _find_largest(
    motions: "Mapping[str, PeaksByJoint]", select: "Callable[[Extremes], Peak]"
) -> dict[str, dict[str, "tuple[str, Peak]"]]:
    """Return the largest peaks and their motions, by joint and quantity."""
    from jounce.motion.extremes import surest_peak

    candidates: dict[str, dict[str, list[tuple[Peak, str]]]] = {}
    for motion, joints in motions.items():
        for joint, named in joints.items():
            for name, extremes in named.items():
                candidates.setdefault(joint, {}).setdefault(name, []).append((select(extremes), motion))
    largest: dict[str, dict[str, tuple[str, Peak]]] = {}
    for joint, candidates_by_name in candidates.items():
        for name, peaks_and_motions in candidates_by_name.items():
            # The surest peak is the one that is largest less its uncertainty band.
            peak = surest_peak([peak for peak, _ in peaks_and_motions])
            motion = next(motion for other, motion in peaks_and_motions if other is peak)
            largest.setdefault(joint, {})[name] = motion, peak
    return largest


def hidden_in_words(summary: "RunSummary", verbose: bool) -> list[str]:
    """Describe the vibrations that the samples of all motions hide."""
    hidden = [vibration for result in summary.results.values() for vibration in result.facts.hidden]
    return vibrations_in_words(hidden, verbose)


def vibrations_in_words(hidden: "Sequence[HiddenVibration]", verbose: bool) -> list[str]:
    """Describe the vibrations that smoothed samples hide: one line, or if `verbose` one line per joint.

    Of many motions each line is about the one whose vibration adds most.
    """
    from jounce.engine.hidden_vibrations import describe_hidden_vibration, describe_worst_vibration

    if len(hidden) == 0:
        return []
    if not verbose:
        return ["", describe_worst_vibration(hidden)]
    worst: dict[str, HiddenVibration] = {}
    for vibration in hidden:
        worst[vibration.joint] = max(vibration, worst.get(vibration.joint, vibration), key=lambda x: x.adds)
    return ["", *map(describe_hidden_vibration, worst.values())]


def format_with_deviation(value: float, deviation: float) -> str:
    """Format a value with its standard deviation, unless it is exact."""
    if deviation == 0:
        return f"{value:.6g}"
    rounded = float(f"{deviation:.2g}")
    return f"{value:.6g} ± {rounded:g}"


def notes_in_words(request: RunRequest, summary: "RunSummary") -> list[str]:
    """List the first notes, and count skipped rows and finished parts."""
    lines = list(summary.notes[:MAX_NOTES_SHOWN])
    hidden_count = len(summary.notes) - MAX_NOTES_SHOWN
    if hidden_count > 0:
        lines.append(f"and {hidden_count} more notes; --json lists them")
    if summary.skipped > 0:
        where = f", see {request.where_skipped}" if request.where_skipped != "" else ""
        lines.append(f"{summary.skipped} bad rows, motions or files left out{where}")
    finished_before = summary.parts - summary.computed
    if finished_before > 0:
        lines.append(f"{finished_before} of {summary.parts} parts were finished before")
    return lines
