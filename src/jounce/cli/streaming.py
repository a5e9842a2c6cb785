"""Commands over tables larger than memory and over many motions: their options, and what they print."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.cli.motions import AskedMotion
from jounce.cli.output import progress, straight_columns, tell
from jounce.core.errors import JounceError, quoted, shortened

if TYPE_CHECKING:
    from jounce.stream.job import Job, Reading
    from jounce.stream.results import Summary

SHOWN = 4  # notes

OUTPUT = click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    help="Output: .csv, .npz, .parquet, or a folder.",
)
ON_ERROR = click.option(
    "--on-error",
    type=click.Choice(["stop", "skip"]),
    default="stop",
    show_default=True,
    help="Bad rows of large tables: stop at the first, or skip them and write them to OUT.skipped.csv.",
)
REDUCE = click.option(
    "--reduce",
    metavar="KINDS",
    help="Write aggregates per motion and joint instead of rows: peak, rms, or peak,rms.",
)


CLUSTER = click.option(
    "--cluster",
    metavar="ADDRESS",
    help="Compute the parts on Dask: local for all cores of this machine, or the scheduler's tcp://HOST:PORT.",
)


@dataclass(frozen=True)
class AskedStream:
    """How a command treats tables that it reads by parts, and where it computes them: here, or on a cluster."""

    reduce: tuple[str, ...]
    skip: bool
    cluster: str | None

    def reading(self, motion: AskedMotion) -> "Reading":
        """How the table of a motion is read."""
        from jounce.motion.columns import Options
        from jounce.motion.spline import way_of
        from jounce.stream.job import Reading

        asked = dict(motion.options)
        way = way_of(*(asked[name] for name in ("degree", "intervals", "bandwidth", "allow_noise")))
        options = Options(asked["time"], asked["columns"], asked["angles"], asked["time_unit"], asked["torques"])
        return Reading(options, way, motion.blend, motion.step, self.skip)


def on_stream(verb: Callable[..., None]) -> Callable[..., None]:
    """Add --reduce, --on-error and --cluster to a command, which gets them as one `stream`, an `AskedStream`."""
    return REDUCE(on_stream_without_reduce(verb))


def on_stream_without_reduce(verb: Callable[..., None]) -> Callable[..., None]:
    """`on_stream` of a command without aggregates of its own."""

    @wraps(verb)
    def asked(on_error: str, cluster: str | None, reduce: str | None = None, **others: Any) -> None:
        verb(stream=AskedStream(_kinds(reduce), on_error == "skip", cluster), **others)

    return ON_ERROR(CLUSTER(asked))


def _kinds(given: str | None) -> tuple[str, ...]:
    known = ("peak", "rms")
    kinds = tuple(given.split(",")) if given is not None else ()
    if wrong := [kind for kind in kinds if kind not in known]:
        raise JounceError(f"--reduce {quoted(wrong[0])}; expected {', '.join(known)}, or several with commas")
    return tuple(dict.fromkeys(kinds))


def is_asked(stream: AskedStream, motion: AskedMotion, output: Path | None) -> bool:
    """Whether a call is one over parts by its options: of or into a folder, `reduce`, `skip` or a cluster."""
    from jounce.io.motions.bags import is_bag

    of_folder = motion.path.is_dir() and not is_bag(motion.path)
    into_folder = output is not None and not output.suffix
    return bool(of_folder or into_folder or stream.reduce or stream.skip or stream.cluster is not None)


def run_stream(
    job: "Job", motion: AskedMotion, output: Path | None, stream: AskedStream, label: str
) -> "tuple[Summary, dict[str, Any]]":
    """Run a job over a table or folder with a bar; returns the summary, and what all commands tell of it."""
    from jounce.stream.results import skipped_path
    from jounce.stream.results import stream as run
    from jounce.stream.runner import Runner, here

    if motion.options["topic"] is not None:
        raise JounceError("--topic is for bags of ROS, which are not read by parts: leave it out")
    runner: Runner = here
    if stream.cluster is not None:
        from jounce.stream.cluster import on_cluster

        runner = on_cluster(stream.cluster)
    with progress(label) as show:
        found = run(job, motion.path, output, stream.reduce, runner, show)
    table = str(skipped_path(output)) if output is not None and found.skipped else None
    return found, {
        "robot": job.robot.name,
        "motion": str(motion.path),
        "output": None if output is None else str(output),
        "states": found.rows,
        "motions": len(found.aggregates),
        "parts": len(found.plan.parts),
        "parts_computed": found.computed,
        "notes": list(found.notes),
        "skipped": {"rows": found.skipped, "table": table},
    }


def tell_results(job: "Job", motion: AskedMotion, output: Path, stream: AskedStream, label: str, as_json: bool) -> None:
    """Run a job that computes rows, and print the largest values of all motions."""
    from jounce.io.motions.writing import about

    found, summary = run_stream(job, motion, output, stream, label)
    peaks: dict[str, dict[str, float]] = {}
    for aggregate in found.aggregates.values():
        for name, of in aggregate["peaks"].items():
            for joint, peak in of.items():
                known = peaks.setdefault(joint, {})
                known[name] = max(known.get(name, 0.0), peak)
    unit = about(job.robot.mechanism, job.order).unit
    units = {f"{joint}.{name}": unit(f"{joint}.{name}") for joint, of in peaks.items() for name in of}
    tell(summary | {"peaks": peaks, "reduced": list(stream.reduce), "units": units}, _results_in_words, as_json)


def head_in_words(summary: dict[str, Any]) -> list[str]:
    """The first lines of what commands print: how much was computed, notes, rows that are left out."""
    count, before = summary["motions"], summary["parts"] - summary["parts_computed"]
    motions = f" in {count} motions" if count > 1 else ""
    done = f"; {before} of {summary['parts']} parts were finished before" if before else ""
    notes, skipped = summary["notes"], summary["skipped"]
    lines = [f"{shortened(summary['robot'])} along {summary['motion']}: {summary['states']} states{motions}{done}"]
    lines += notes[:SHOWN]
    lines += [f"and {len(notes) - SHOWN} more notes; --json lists them"] if len(notes) > SHOWN else []
    if skipped["rows"]:
        where = f", see {skipped['table']}" if skipped["table"] else ""
        lines.append(f"{skipped['rows']} bad rows, motions or files left out{where}")
    return lines


def _results_in_words(summary: dict[str, Any]) -> str:
    names = list(dict.fromkeys(name for of in summary["peaks"].values() for name in of))
    rows = [("largest", *names)]
    for joint, of in summary["peaks"].items():
        cells = (f"{of[name]:.6g} {summary['units'][f'{joint}.{name}']}" if name in of else "-" for name in names)
        rows.append((joint, *cells))
    kinds = f"{', '.join(summary['reduced'])} of " if summary["reduced"] else ""
    written = f"{kinds}{', '.join(names)} written to {summary['output']}"
    return "\n".join([*head_in_words(summary), written, "", *straight_columns(rows)])
