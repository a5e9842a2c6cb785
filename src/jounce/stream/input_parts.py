"""The plan of a run: the parts of the input, each a span of a file, and the schema that all files share."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from jounce.actuators.along import voltage_order
from jounce.core.errors import JounceError, join_names, locate_errors, quote_value
from jounce.dynamics.joint_springs import elasticity_of
from jounce.engine.engine import Engine
from jounce.io.motions.log_rows import read_stamps
from jounce.io.remainders import remainder_name
from jounce.io.table_format import Span
from jounce.io.tables import ROW_FORMATS, select_format
from jounce.io.tables import describe_place as place_in_words
from jounce.model.positions import multiscrew_joints
from jounce.motion import loads, poses
from jounce.motion.spline import Smoothing, refuse_smoothing
from jounce.motion.table_columns import DEVIATION, TIME, ColumnMatch, follower_columns, match_columns
from jounce.motion.time_origin import TimeOrigin, find_origin
from jounce.spatial.series import rate_name
from jounce.stream.job import MOTION_COLUMN, InputPart, Job, Task, digest

MAX_PART_CELLS = 1 << 23  # 64 MB of numbers, little of the memory of a worker
MIN_LARGE_TABLE_BYTES = 1 << 28  # 256 MB; smaller tables are read as a whole unless parts are asked for
FIT_MEMORY_RATIO = 60  # bytes of memory per byte of a table whose samples are fitted: 52 to 61 were measured
ASSUMED_MEMORY_BYTES = 1 << 33  # where the system reports none: 8 GB, as most machines have
IGNORED_PREFIXES = (".", "_")  # what names of files begin with that are no data


@dataclass(frozen=True, eq=False)
class InputPlan:
    """The parts of the input in order, and what is computed of each."""

    task: Task
    parts: tuple[InputPart, ...]
    notes: tuple[str, ...] = ()


def make_plan(job: Job, source: Path, highest: int) -> InputPlan:
    """The plan for a table, or for all tables of a folder, of which each is a motion unless a column names motions."""
    paths, notes = _files(source)
    whole = [path for path in paths if not job.reading.skip or _is_readable(path)] or paths
    matches = [_match(job, path, highest) for path in whole]
    (first, named), *others = matches
    for path, (other, names) in zip(whole[1:], others, strict=True):
        _check_alike(whole[0], path, first, other, named, names)
    independent = _is_independent(job, first)
    if independent:
        refuse_smoothing(job.reading.way or Smoothing(), str(whole[0]), "all rates are in the table")
        job = _with_voltages(job, first)
    parts: list[InputPart] = []
    for path in paths:
        stem = None if named else path.stem
        spans = list(_spans(path, first, independent, named)) if path in whole else [Span(0, 0)]
        origin = _origin(path, first, spans[0]) if path in whole else None
        parts += [_part(job, len(parts) + i, path, span, stem, origin) for i, span in enumerate(spans)]
    origins = [part.origin for part in parts if part.origin]
    stamps: tuple[str, ...] = ()
    if origins:
        stamps = origins[0].notes if len(paths) == 1 else ("times are since the first row of each table",)
    return InputPlan(
        Task(job, first, independent, named or source.is_dir()), tuple(parts), (*stamps, *first.notes, *notes)
    )


def _origin(path: Path, found: ColumnMatch, span: Span) -> TimeOrigin | None:
    """The first stamp of a table, where it is large."""
    table, time = select_format(path), found.sources[TIME]
    asked = [time, remainder_name(time)]
    try:
        row = table.next_row(path, span.start)
        for chunk in table.chunks(path, asked, None, row) if row else ():
            high, low = (float(read_stamps(chunk, found).columns[name][0]) for name in asked)
            return find_origin(high, low, found.factors[TIME])
    except JounceError:  # rows that cannot be read are reported with their part
        pass
    return None


def is_by_parts(job: Job, source: Path) -> bool:
    """Whether a table is read by parts without being asked: it holds several motions, or is large and states all rates.

    What cannot be read is left to those who read tables as a whole, and their messages.
    """
    if source.suffix.lower() not in ROW_FORMATS:
        return False
    try:
        found, named = _match(job, source, job.highest)
        return named or (_is_independent(job, found) and select_format(source).size(source) > MIN_LARGE_TABLE_BYTES)
    except JounceError:
        return False


def _files(source: Path) -> tuple[list[Path], tuple[str, ...]]:
    if not source.is_dir():
        select_format(source)
        return [source], ()
    there = sorted(path for path in source.iterdir() if not path.name.startswith(IGNORED_PREFIXES))
    found = [path for path in there if path.is_file() and path.suffix.lower() in ROW_FORMATS]
    if not found:
        raise JounceError(f"{source}: no table in this folder; read by rows are: {', '.join(ROW_FORMATS)}")
    others = [path.name for path in there if path not in found]
    return found, (f"other files, ignored: {join_names(others)}",) if others else ()


def _is_readable(path: Path) -> bool:
    """Whether the names of the columns can be read; of a file without them one empty part is left out and recorded."""
    try:
        return bool(select_format(path).names(path))
    except JounceError:
        return False


def _match(job: Job, path: Path, highest: int) -> tuple[ColumnMatch, bool]:
    """The columns of the motion in a table, and whether one names motions."""
    names = select_format(path).names(path)
    named = MOTION_COLUMN in names and MOTION_COLUMN not in job.robot.joint_names
    with locate_errors(path):
        return match_columns([name for name in names if name != MOTION_COLUMN or not named], job.robot.mechanism,
                     job.reading.options, highest), named  # fmt: skip


def _check_alike(first: Path, path: Path, known: ColumnMatch, other: ColumnMatch, named: bool, names: bool) -> None:
    """Raise `JounceError` where the tables of a folder have not the same columns."""
    missing = sorted({*known.sources.values()} - {*other.sources.values()}) + [MOTION_COLUMN] * (named and not names)
    extra = sorted({*other.sources.values()} - {*known.sources.values()}) + [MOTION_COLUMN] * (names and not named)
    if missing or extra:
        differ = f"has no column {join_names(map(quote_value, missing), 3)}" if missing else ""
        differ += " and " * bool(missing and extra)
        differ += f"has a column {join_names(map(quote_value, extra), 3)} more" if extra else ""
        raise JounceError(f"{path}: {differ} than {first.name}; expected the same columns in all tables of a folder")


def _is_independent(job: Job, found: ColumnMatch) -> bool:
    """Whether every row of the input states all that its results need."""
    reading, sources = job.reading, list(found.sources)
    of_wrenches = loads.select_wrench_columns(sources, job.robot.mechanism)
    spread = any(name.endswith(DEVIATION) for name in sources)
    of_base = poses.select_base_columns(sources, job.robot.mechanism)
    sampled = found.sampled or loads.are_sampled(of_wrenches) or (of_base and poses.are_sampled(list(of_base)))
    m = job.robot.mechanism  # loops are closed from the row before, unless every row states all joints
    continued = m.takes_dependent and len(follower_columns(m, sources, found.sampled)) < m.tree.n - m.n
    several = multiscrew_joints(m)  # signs of quaternions follow those of the row before
    highest = rate_name("q", job.highest)  # which may be a difference between rows
    differ = any(f"{joint}.{highest}" not in sources for joint in m.coordinates)
    turned = found.unwrap  # turns are counted from the row before
    whole = sampled or spread or differ or reading.blend or reading.step or continued or several or turned
    return not whole and not (job.of_motors and _has_memory(job.robot))


def _with_voltages(job: Job, found: ColumnMatch) -> Job:
    """The job with the rate of motor torques that voltages take, if the table states as many rates of q."""
    if not job.of_motors:
        return job
    further = job.highest + 1
    is_known = all(f"{joint}.{rate_name('q', further)}" in found.sources for joint in job.robot.joint_names)
    return replace(job, order=voltage_order(elasticity_of(job.robot.mechanism), job.highest + is_known))


def _has_memory(robot: Engine) -> bool:
    """Whether motor torques depend on the motion before."""
    e = elasticity_of(robot.mechanism)
    return bool((e.dampers and e.level is None) or e.pairs)


def _spans(path: Path, found: ColumnMatch, independent: bool, named: bool) -> Iterator[Span]:
    """The spans of the parts of a table: of rows that do not depend on each other, or of whole motions."""
    table = select_format(path)
    table.check_numbers(path, found.names)
    spans = table.spans(path, MAX_PART_CELLS)
    if not spans:
        raise JounceError(f"{path}: no rows of numbers under the column names")
    if independent:
        yield from spans
        return
    whole, start = Span(spans[0].start, spans[-1].stop), spans[0].start
    most, share = max(span.stop - span.start for span in spans), len(found.names) / len(table.names(path))
    for run in runs(path, spans) if named else [whole]:
        _check_memory(path, run, whole, share)
        if run.start > start and run.stop - start > most:
            yield Span(start, run.start)
            start = run.start
    yield Span(start, whole.stop)


def runs(path: Path, spans: Sequence[Span]) -> Iterator[Span]:
    """The spans of the motions of a table, which a column names; rows of a motion that stand apart are refused."""
    name, start, seen = None, spans[0].start, set[str]()
    for span in spans:
        for chunk in select_format(path).chunks(path, [], MOTION_COLUMN, span):
            assert chunk.motions is not None
            whole = np.delete(np.arange(len(chunk.motions)), list(chunk.broken))
            motions = chunk.motions[whole]
            for i in whole[np.append(True, motions[1:] != motions[:-1])[: len(whole)]].tolist():
                place, other = int(chunk.places[i]), str(chunk.motions[i])
                if other == name:
                    continue
                if other in seen:
                    raise JounceError(
                        f"{place_in_words(path, place)}: motion {quote_value(other)} begins a second time; its samples"
                        " need a fit as a whole: sort the rows by motion"
                    )
                if name is not None:
                    yield Span(start, place)
                name, start = other, place
                seen.add(other)
    yield Span(start, spans[-1].stop)


def _check_memory(path: Path, span: Span, whole: Span, share: float) -> None:
    """Raise `JounceError` where a motion does not fit into memory; `share` is that of the columns that are read."""
    table = select_format(path)
    needed = FIT_MEMORY_RATIO * share * table.size(path) * (span.stop - span.start) / (whole.stop - whole.start)
    if needed > (there := _memory()):
        raise JounceError(
            f"{place_in_words(path, span.start)}: the motion that begins here takes {needed / 1e9:.3g} GB to fit,"
            f" and there are {there / 1e9:.3g} GB: state its rates in columns NAME.q, NAME.qd, ..., or divide it into"
            " several motions"
        )


def _memory() -> int:
    """The bytes of memory of this machine."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # not every system has these names
        return ASSUMED_MEMORY_BYTES


def _part(job: Job, number: int, path: Path, span: Span, motion: str | None, origin: TimeOrigin | None) -> InputPart:
    about = path.stat()
    identity = [job.key, str(path.resolve()), about.st_size, about.st_mtime_ns, *span, motion]
    return InputPart(number, path, span, motion, digest(identity), origin)
