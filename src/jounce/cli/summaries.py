"""Commands over a motion or many, that fit into memory or not: their options, and the one summary that they print."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import wraps
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.cli.motion_options import MotionRequest
from jounce.cli.output import align_columns, check_distinct
from jounce.cli.robot_options import PATH
from jounce.core.errors import JounceError, collect_warnings, join_names, quote_value, shorten, warn
from jounce.core.progress import stage

if TYPE_CHECKING:
    from jounce.motion import Motion
    from jounce.stream.job import Job, Reading
    from jounce.stream.whole_run import Summary

Largest = dict[str, dict[str, dict[str, Any]]]  # by joint and quantity
MAX_NOTES_SHOWN = 8  # notes, warnings and sources: more would hide the results; --json has all
MAX_BREAKS_SHOWN = 4  # as of notes
UNCERTAIN_MARK = "* uncertain, towards an end of the samples: its deviation is over 5 %, and over ten times the median"
SUMMARY_SCHEMA = 1  # of the JSON of `run`, `motors` and `check`: raised where a key goes or changes its meaning

OUTPUT = click.option("-o", "--output", required=True, type=PATH, help="Output: .csv, .npz, .parquet, or a folder.")
REDUCE = click.option(
    "--reduce", metavar="KINDS", help="Write aggregates per motion and joint instead of rows: peak, rms, or peak,rms."
)


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
        from jounce.motion.spline import select_smoothing
        from jounce.motion.table_columns import ColumnOptions
        from jounce.stream.job import Reading

        asked = dict(motion.options)
        way = select_smoothing(*(asked[name] for name in ("degree", "intervals", "bandwidth", "allow_noise", "as_")))
        asked["pattern"], asked["skip"] = asked["columns"], asked["on_error"] == "skip"
        options = ColumnOptions(**{field.name: asked[field.name] for field in fields(ColumnOptions)})
        return Reading(options, way, motion.blend, motion.step)


def add_stream_options(verb: Callable[..., None]) -> Callable[..., None]:
    """Add --reduce and --cluster to a command, which gets them as one `stream`, an `StreamRequest`."""
    return REDUCE(add_stream_options_without_reduce(verb))


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


def is_by_parts(job: "Job", motion: MotionRequest, output: Path | None, stream: StreamRequest) -> bool:
    """Whether a motion is read by parts: for its size, or as asked by a folder, `reduce`, skipping or a cluster."""
    from jounce.io.motions.bags import is_bag
    from jounce.io.tables import ROW_FORMATS
    from jounce.stream.input_parts import is_by_parts

    of_folder = motion.path.is_dir() and not is_bag(motion.path)
    into_folder = output is not None and not output.suffix
    skips = job.reading.skip and motion.path.suffix.lower() in ROW_FORMATS
    asked = of_folder or into_folder or stream.reduce or skips or stream.cluster is not None
    return bool(asked) or is_by_parts(job, motion.path)


def compute(
    job: "Job",
    motion: MotionRequest,
    output: Path | None,
    stream: StreamRequest,
    label: str,
    load: "Callable[[], Motion]",
) -> "tuple[Summary, dict[str, Any]]":
    """Compute a motion that is loaded as a whole, or by parts; returns what all commands report too."""
    from jounce.io import tables
    from jounce.stream.whole_run import skipped_path, stream_motion

    if is_by_parts(job, motion, output, stream):
        found = _compute_by_parts(job, motion, output, stream, label)
    else:
        if output is not None:
            tables.check_writable(output)
            check_distinct(output, motion.path)
        with collect_warnings() as caught, stage(label) as show:
            found = stream_motion(job, load(), motion.path.stem, output, show)
        found = replace(found, warnings=(*dict.fromkeys(caught),))
    for text in found.warnings[:MAX_NOTES_SHOWN]:
        warn(text)
    if (more := len(found.warnings) - MAX_NOTES_SHOWN) > 0:
        warn(f"and {more} more warnings; --json lists them")
    spans = [of["t"] for of in found.aggregates.values()]
    table = str(skipped_path(output)) if output is not None and found.skipped else None
    return found, {
        "schema": SUMMARY_SCHEMA, "robot": job.robot.name, "motion": str(motion.path),
        "output": None if output is None else str(output), "states": found.rows, "motions": len(found.aggregates),
        "t": [min(start for start, _ in spans), max(stop for _, stop in spans)],
        "parts": found.parts, "parts_computed": found.computed, "skipped": {"rows": found.skipped, "table": table},
        "notes": list(found.notes), "warnings": list(found.warnings),
        "hidden_vibrations": [one | {"motion": name} for name, of in found.aggregates.items() for one in of["hidden"]],
    }  # fmt: skip


def _compute_by_parts(
    job: "Job", motion: MotionRequest, output: Path | None, stream: StreamRequest, label: str
) -> "Summary":
    from jounce.stream.runner import Runner, run_here
    from jounce.stream.whole_run import stream as run

    if motion.options["topic"] is not None:
        raise JounceError("--topic is for bags of ROS, which are not read by parts: leave it out")
    if motion.options["measured"] == "motors":
        raise JounceError(
            "--measured motors needs the whole motion, and this one is read by parts;"
            " jounce motion ROBOT MOTION --measured motors -o links.csv writes that of the links"
        )
    runner: Runner = run_here
    if stream.cluster is not None:
        from jounce.stream.cluster import cluster_runner

        runner = cluster_runner(stream.cluster)
    with stage(label) as show:
        return run(job, motion.path, output, stream.reduce, runner, show)


def compute_results(
    job: "Job", motion: MotionRequest, output: Path, stream: StreamRequest, label: str, load: "Callable[[], Motion]"
) -> "tuple[Summary, dict[str, Any]]":
    """Compute and write rows, or aggregates of them; returns the summary with the largest values of all motions too."""
    from jounce.io.motions.writing import table_metadata

    found, summary = compute(job, motion, output, stream, label, load)
    unit, motions = table_metadata(job.robot.mechanism, job.order).unit, found.aggregates
    largest, certain = (find_largest({x: of["values"] for x, of in motions.items()}, sure) for sure in (False, True))
    return found, summary | {
        "source": "; ".join(list(dict.fromkeys(of["source"] for of in motions.values()))[:MAX_NOTES_SHOWN]),
        "residual": max((of["residual"] for of in motions.values() if of["residual"] is not None), default=None),
        "blend": motion.blend,
        "breaks": [at | {"motion": name} for name, of in motions.items() for at in of["breaks"]],
        "reduced": list(stream.reduce),
        "peaks": {joint: {name: of["value"] for name, of in named.items()} for joint, named in largest.items()},
        "deviations": {joint: {x: of["deviation"] for x, of in named.items()} for joint, named in largest.items()},
        "largest": largest,
        "certain": certain,
        "units": {joint: {name: unit(f"{joint}.{name}") for name in named} for joint, named in largest.items()},
    }


def find_largest(motions: Mapping[str, Mapping[str, Mapping[str, Sequence[float]]]], certain: bool = False) -> Largest:
    """By joint and quantity the largest value of all motions, or certain one: its deviation, when and in which."""
    from jounce.stream.aggregates import CERTAIN, LARGEST, surest_peak

    found: dict[str, dict[str, list[Sequence[Any]]]] = {}
    for motion, joint, named in ((motion, *of) for motion, joints in motions.items() for of in joints.items()):
        for name, numbers in named.items():
            rows = found.setdefault(joint, {}).setdefault(name, [])
            rows.append((*numbers[CERTAIN if certain else LARGEST], motion))
    keys = ("value", "deviation", "t", "motion")
    return {
        joint: {name: dict(zip(keys, surest_peak(rows), strict=True)) for name, rows in of.items()}
        for joint, of in found.items()
    }


def tabulate_largest(summary: dict[str, Any]) -> list[str]:
    """The largest values as a table with their times, and below uncertain ones the largest certain ones."""
    names = list(next(iter(summary["largest"].values())))
    per = ["", " /s", *(f" /s^{k}" for k in range(2, len(names)))]
    heads = (cell for name, unit in zip(names, per, strict=False) for cell in (f"|{name}|{unit}", "at t"))
    rows: list[tuple[str, ...]] = [("largest", "unit", *heads)]

    def cells(found: dict[str, Any], mark: str = "") -> tuple[str, str]:
        within = f" of {found['motion']}" if summary.get("motions", 1) > 1 else ""
        return format_with_deviation(found["value"], found["deviation"]) + mark, f"{found['t']:.6g}{within}"

    for joint, of in summary["largest"].items():
        certain = {name: x for name, x in summary["certain"][joint].items() if x != of[name]}
        shown = (cells(of[name], " *" if name in certain else "") for name in names)
        rows.append((joint, summary["units"][joint][names[0]], *chain(*shown)))
        if certain:
            rows.append(("  certain", "", *chain(*(cells(certain[x]) if x in certain else ("", "") for x in names))))
    return [*align_columns(rows), *([UNCERTAIN_MARK] if any(row[0] == "  certain" for row in rows) else [])]


def results_in_words(summary: dict[str, Any], names: Sequence[str], table: Sequence[str], *more: str) -> str:
    """What is computed of rows, with further lines and a table of the largest values."""
    robot, (first, last) = shorten(summary["robot"]), summary["t"]
    many = f" in {summary['motions']} motions" if summary["motions"] > 1 else ""
    kind = "at most {:.2g} from it" if summary["blend"] else "largest residual {:.2g}"
    residual = "" if summary["residual"] is None else f", {kind.format(summary['residual'])}"
    kinds = f"{', '.join(summary['reduced'])} of " if summary["reduced"] else ""
    return "\n".join([
        f"{robot} along {summary['motion']}: {summary['states']} states{many}, t = {first:g} .. {last:g} s",
        summary["source"] + residual,
        *notes_in_words(summary),
        *breaks_in_words(summary["breaks"]),
        *more,
        f"{kinds}{', '.join(names)} written to {summary['output']}",
        "",
        *table,
        *hidden_in_words(summary),
    ])  # fmt: skip


def hidden_in_words(summary: dict[str, Any]) -> list[str]:
    """Per joint of smoothed samples one line: which vibration would not show; of many motions that which adds most."""
    from jounce.engine.hidden_vibrations import describe_hidden_vibration

    worst: dict[str, dict[str, Any]] = {}
    for found in summary["hidden_vibrations"]:
        worst[found["joint"]] = max(found, worst.get(found["joint"], found), key=lambda x: x["adds"])
    return ["", *map(describe_hidden_vibration, worst.values())] if worst else []


def format_with_deviation(value: float, deviation: float) -> str:
    """A value with its standard deviation, unless it is exact."""
    return f"{value:.6g}" + (f" ± {float(f'{deviation:.2g}'):g}" if deviation else "")


def breaks_in_words(breaks: Sequence[dict[str, Any]]) -> list[str]:
    """Describe the first breaks, one per line, and the number of all."""
    lines = []
    for found in breaks[:MAX_BREAKS_SHOWN]:
        joints: dict[str, list[str]] = {}
        for joint, cause in found["causes"].items():
            joints.setdefault(cause["rate"], []).append(joint)
        causes = " and ".join(f"{rate} of {join_names(names)}" for rate, names in joints.items()) or "a contact's limit"
        missing = found["missing"]
        then = [f"{found['jumps']} jumps"] if found["jumps"] else []
        then += [f"{', '.join(missing)} do{'es' * (len(missing) == 1)} not exist"] if missing else []
        lines.append(f"break at t = {found['t']:.9g} s: {causes} jumps; {', '.join(then)}")
    rest = len(breaks) - MAX_BREAKS_SHOWN
    if rest > 0:
        lines.append(f"and {rest} more break{'s' * (rest > 1)}; --json lists them, --blend replaces them")
    return lines


def notes_in_words(summary: dict[str, Any]) -> list[str]:
    """The first notes, rows that are left out, and how much was computed before."""
    notes, skipped, parts = summary["notes"], summary["skipped"], summary["parts"]
    lines = notes[:MAX_NOTES_SHOWN]
    if (more := len(notes) - MAX_NOTES_SHOWN) > 0:
        lines.append(f"and {more} more notes; --json lists them")
    if skipped["rows"]:
        where = f", see {skipped['table']}" if skipped["table"] else ""
        lines.append(f"{skipped['rows']} bad rows, motions or files left out{where}")
    if before := parts - summary["parts_computed"]:
        lines.append(f"{before} of {parts} parts were finished before")
    return lines
