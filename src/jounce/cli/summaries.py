"""Commands over a motion or many, that fit into memory or not: their options, and what all their summaries say.

A `RunRequest` is what a command was asked to compute: as a whole, or part by part, here or on a cluster.
`LargestValues` are those of several motions, with deviations.
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


MAX_NOTES_SHOWN = 8  # notes, warnings and sources: more would hide the results; --json has all
UNCERTAIN_MARK = "* uncertain, towards an end of the samples: its deviation is over 5 %, and over ten times the median"
SUMMARY_SCHEMA = 1  # of the JSON of `run`, `motors` and `check`: raised where a key goes or changes its meaning
CLUSTER = click.option(
    "--cluster",
    metavar="ADDRESS",
    help="Compute the parts on Dask: local for all cores of this machine, or the scheduler's tcp://HOST:PORT.",
)


@dataclass(frozen=True)
class StreamRequest:
    """How a command treats tables that it reads by parts, and where it computes them: here, or on a cluster."""

    reduce: tuple[str, ...]
    cluster: str | None

    def reading(self, motion: MotionRequest) -> "Reading":
        """How the table of a motion is read."""
        from jounce.io.motions.table_parts import Reading
        from jounce.motion.spline import select_smoothing
        from jounce.motion.table_columns import ColumnOptions

        asked = dict(motion.options)
        way = select_smoothing(*(asked[name] for name in ("degree", "intervals", "bandwidth", "allow_noise", "as_")))
        asked["pattern"], asked["skip"] = asked["columns"], asked["on_error"] == "skip"
        options = ColumnOptions(**{field.name: asked[field.name] for field in fields(ColumnOptions)})
        return Reading(options, way, motion.blend, motion.step)


def add_stream_options_without_reduce(verb: Callable[..., None]) -> Callable[..., None]:
    """`add_stream_options` of a command without aggregates of its own."""

    @wraps(verb)
    def asked(cluster: str | None, reduce: str | None = None, **others: Any) -> None:
        verb(stream=StreamRequest(_parse_kinds(reduce), cluster), **others)

    return CLUSTER(asked)


def _parse_kinds(given: str | None) -> tuple[str, ...]:
    known = ("peak", "rms")
    kinds = tuple(given.split(",")) if given is not None else ()
    if wrong := [kind for kind in kinds if kind not in known]:
        raise JounceError(f"--reduce {quote_value(wrong[0])}; expected {', '.join(known)}, or several with commas")
    return tuple(dict.fromkeys(kinds))


@dataclass(frozen=True)
class RunRequest:
    """What a command was asked to compute: a job, of a motion, into an output, by parts or not."""

    job: "Job"
    motion: MotionRequest
    output: Path | None
    stream: StreamRequest
    label: str

    @property
    def is_by_parts(self) -> bool:
        """Whether a motion is read by parts: for its size, or as asked by a folder, `reduce`, skipping or a cluster."""
        from jounce.io.motions.logs import is_bag
        from jounce.io.motions.table_parts import is_by_parts
        from jounce.io.tables import ROW_FORMATS

        path = self.motion.path
        of_folder = path.is_dir() and not is_bag(path)
        into_folder = self.output is not None and not self.output.suffix
        skips = self.job.reading.skip and path.suffix.lower() in ROW_FORMATS
        asked = of_folder or into_folder or self.stream.reduce or skips or self.stream.cluster is not None
        return bool(asked) or is_by_parts(self.job, path)

    def run_whole(self, compute: "Callable[[], RunSummary]") -> "RunSummary":
        """Compute what is read as a whole, and pass warnings on."""
        from jounce.io import tables

        if self.output is not None:
            tables.check_writable(self.output)
            check_distinct(self.output, self.motion.path)
        with collect_warnings() as caught:
            found = compute()
        return warned(replace(found, warnings=(*dict.fromkeys(caught),)))

    def run_by_parts(self) -> "RunSummary":
        """Compute tables part by part, here or on a cluster, and pass warnings on."""
        from jounce.stream.run import Runner, run_here, run_tables

        if self.motion.options["topic"] is not None:
            raise JounceError("--topic is for bags of ROS, which are not read by parts: leave it out")
        if self.motion.options["measured"] == "motors":
            raise JounceError(
                "--measured motors needs the whole motion, and this one is read by parts;"
                " jounce motion ROBOT MOTION --measured motors -o links.csv writes that of the links"
            )
        runner: Runner = run_here
        if self.stream.cluster is not None:
            from jounce.stream.cluster import cluster_runner

            runner = cluster_runner(self.stream.cluster)
        with stage(self.label) as show:
            return warned(run_tables(self.job, self.motion.path, self.output, self.stream.reduce, runner, show))

    @property
    def where_skipped(self) -> str:
        """The table of the rows that are left out."""
        from jounce.io.motions import part_rows

        return "" if self.output is None else str(part_rows.skipped_path(self.output))

    def span(self, found: "RunSummary") -> list[float]:
        """The times between which all motions lie, s."""
        spans = [of.span for of in found.results.values()]
        return [min(start for start, _ in spans), max(stop for _, stop in spans)]


def warned(found: "RunSummary") -> "RunSummary":
    """A summary, whose first warnings are passed on."""
    for text in found.warnings[:MAX_NOTES_SHOWN]:
        warn(text)
    if (more := len(found.warnings) - MAX_NOTES_SHOWN) > 0:
        warn(f"and {more} more warnings; --json lists them")
    return found


def common_json(request: RunRequest, found: "RunSummary") -> "JsonObject":
    """What the JSON of all commands on motions says."""
    skipped = {"rows": found.skipped, "table": (found.skipped and request.where_skipped) or None}
    hidden = [asdict(one) | {"motion": name} for name, of in found.results.items() for one in of.facts.hidden]
    return {
        "schema": SUMMARY_SCHEMA, "robot": request.job.robot.name, "motion": str(request.motion.path),
        "output": None if request.output is None else str(request.output), "states": found.rows,
        "motions": len(found.results), "t": request.span(found), "parts": found.parts,
        "parts_computed": found.computed, "skipped": skipped, "notes": list(found.notes),
        "warnings": list(found.warnings), "hidden_vibrations": hidden,
    }  # fmt: skip


@dataclass(frozen=True)
class LargestValues:
    """By joint and quantity the largest value of all motions, the largest certain one, and the unit.

    Each is the name of its motion and the peak.
    """

    largest: "Mapping[str, Mapping[str, tuple[str, Peak]]]"
    certain: "Mapping[str, Mapping[str, tuple[str, Peak]]]"
    units: Mapping[str, Mapping[str, str]]

    @classmethod
    def of(cls, motions: "Mapping[str, PeaksByJoint]", unit: Callable[[str], str]) -> "LargestValues":
        """Those of several motions; a function gives the unit of a column."""
        largest, certain = (_find_largest(motions, of) for of in (lambda x: x.largest, lambda x: x.certain))
        units = {joint: {name: unit(f"{joint}.{name}") for name in named} for joint, named in largest.items()}
        return cls(largest, certain, units)

    def json(self) -> "JsonObject":
        """The largest values as plain data."""
        return {
            key: {joint: {name: peak._asdict() | {"motion": motion} for name, (motion, peak) in of.items()}
                  for joint, of in found.items()}
            for key, found in (("largest", self.largest), ("certain", self.certain))
        } | {"units": {joint: dict(of) for joint, of in self.units.items()}}  # fmt: skip

    def table(self, several: bool = False) -> list[str]:
        """The values with their times, of several motions with their names, and below uncertain ones certain ones."""
        names = list(next(iter(self.largest.values())))
        per = ["", " /s", *(f" /s^{k}" for k in range(2, len(names)))]
        heads = (cell for name, unit in zip(names, per, strict=False) for cell in (f"|{name}|{unit}", "at t"))
        rows: list[tuple[str, ...]] = [("largest", "unit", *heads)]

        def cells(motion: str, peak: "Peak", mark: str = "") -> tuple[str, str]:
            within = f" of {motion}" if several else ""
            return format_with_deviation(peak.value, peak.deviation) + mark, f"{peak.t:.6g}{within}"

        for joint, of in self.largest.items():
            certain = {name: x for name, x in self.certain[joint].items() if x != of[name]}
            shown = (cells(*of[name], " *" if name in certain else "") for name in names)
            rows.append((joint, self.units[joint][names[0]], *chain(*shown)))
            if certain:
                rows.append(
                    ("  certain", "", *chain(*(cells(*certain[x]) if x in certain else ("", "") for x in names)))
                )
        return [*align_columns(rows), *([UNCERTAIN_MARK] if any(row[0] == "  certain" for row in rows) else [])]


def _find_largest(
    motions: "Mapping[str, PeaksByJoint]", select: "Callable[[Extremes], Peak]"
) -> dict[str, dict[str, "tuple[str, Peak]"]]:
    from jounce.motion.extremes import surest_peak

    found: dict[str, dict[str, list[tuple[Peak, str]]]] = {}
    for motion, joints in motions.items():
        for joint, named in joints.items():
            for name, extremes in named.items():
                found.setdefault(joint, {}).setdefault(name, []).append((select(extremes), motion))
    largest: dict[str, dict[str, tuple[str, Peak]]] = {}
    for joint, of in found.items():
        for name, rows in of.items():
            peak = surest_peak([peak for peak, _ in rows])
            motion = next(motion for other, motion in rows if other is peak)
            largest.setdefault(joint, {})[name] = motion, peak
    return largest


def hidden_in_words(hidden: "Sequence[HiddenVibration]") -> list[str]:
    """Per joint of smoothed samples one line: which vibration would not show; of many motions that which adds most."""
    from jounce.engine.hidden_vibrations import describe_hidden_vibration

    worst: dict[str, HiddenVibration] = {}
    for found in hidden:
        worst[found.joint] = max(found, worst.get(found.joint, found), key=lambda x: x.adds)
    return ["", *map(describe_hidden_vibration, worst.values())] if worst else []


def format_with_deviation(value: float, deviation: float) -> str:
    """A value with its standard deviation, unless it is exact."""
    return f"{value:.6g}" + (f" ± {float(f'{deviation:.2g}'):g}" if deviation else "")


def notes_in_words(request: RunRequest, found: "RunSummary") -> list[str]:
    """The first notes, rows that are left out, and how much was computed before."""
    lines = list(found.notes[:MAX_NOTES_SHOWN])
    if (more := len(found.notes) - MAX_NOTES_SHOWN) > 0:
        lines.append(f"and {more} more notes; --json lists them")
    if found.skipped:
        where = f", see {request.where_skipped}" if request.where_skipped else ""
        lines.append(f"{found.skipped} bad rows, motions or files left out{where}")
    if before := found.parts - found.computed:
        lines.append(f"{before} of {found.parts} parts were finished before")
    return lines
