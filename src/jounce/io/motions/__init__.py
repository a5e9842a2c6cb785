"""Motion files: tables, terms, ROS trajectories, and bundled motions."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jounce.core.cures import option_name
from jounce.core.errors import JounceError, join_names, locate_errors, unknown_name_error
from jounce.core.progress import stage
from jounce.io.entries import DOCUMENT_SUFFIXES
from jounce.model.mechanism import Mechanism

if TYPE_CHECKING:  # what reads them takes a while to import, and robots need it not
    from jounce.motion import Motion
    from jounce.motion.joint_matching import MotionDescription
    from jounce.motion.spline import Smoothing, Spline
    from jounce.motion.table_columns import ColumnOptions

BUNDLED_MOTIONS = {"paper": "paper.yaml", "paper-wrench": "paper-wrench.yaml"}  # names of bundled motions


def read(
    source: Path,
    mechanism: Mechanism,
    highest: int,
    way: "Smoothing | Spline | None" = None,
    options: "ColumnOptions | None" = None,
    topic: str | None = None,
) -> "Motion":
    """Return the motion of a file or bundled name, for a mechanism.

    Its rates go up to the one of order `highest`.
    """
    with stage(f"reading {source.name}"):
        return _read(source, mechanism, highest, way, options, topic)


def _read(
    source: Path,
    mechanism: Mechanism,
    highest: int,
    way: "Smoothing | Spline | None",
    options: "ColumnOptions | None",
    topic: str | None,
) -> "Motion":
    """Return the motion of a source by the reader of its type."""
    from jounce.io import entries, tables
    from jounce.io.motions import logs, terms
    from jounce.io.motions.episodes import is_data_set
    from jounce.motion.joint_matching import build_motion
    from jounce.motion.ros import is_joint_state, read_joint_states
    from jounce.motion.spline import refuse_smoothing
    from jounce.motion.table import DEFAULT_COLUMN_OPTIONS, DEFAULT_SMOOTHING
    from jounce.motion.table_columns import DURATION_CURE, UntimedError

    if topic is not None and not logs.is_bag(source):
        raise JounceError(f"{source}: {option_name('topic')} is for bags of ROS, which it is not: leave it out")
    way, options = way or DEFAULT_SMOOTHING, options or DEFAULT_COLUMN_OPTIONS
    # YAML files hold samples, as `ros2 topic echo` prints them, or terms.
    documents = entries.read_documents(source, "the motion") if _is_document(source) else []
    if len(documents) > 0 and is_joint_state(documents[0].value):
        columns = read_joint_states([x.value for x in documents], lambda i: f"{documents[i].place}: message {i}")
        return logs.read_arrays(columns, mechanism, highest, way, options, str(source))
    if len(documents) > 0 and terms.has_points(documents[0].value):
        expected = f"time_from_start of each point, or {DURATION_CURE}"
        raise UntimedError(f"{source}: the points have no times; expected {expected}")
    if is_analytic(source):
        reason = "its terms or trajectory points are exact"
        refuse_smoothing(way, str(source), reason)
        options.refuse(str(source), reason)
    if str(source) in BUNDLED_MOTIONS:
        with locate_errors(source):
            return build_motion(read_bundled(str(source)), mechanism)
    if len(documents) > 0:
        return terms.read(entries.only_document(documents), mechanism, options.skip)
    if source.suffix.lower() in tables.TABLE_READERS or is_data_set(source):
        return logs.read_table(source, mechanism, highest, way, options)
    if logs.is_bag(source):
        return logs.read_bag(source, mechanism, highest, way, options, topic)
    types = ", ".join([*tables.TABLE_READERS, *DOCUMENT_SUFFIXES, *logs.BAG_SUFFIXES])
    if source.suffix == "":
        raise JounceError(f"{unknown_name_error('motion', str(source), BUNDLED_MOTIONS)}, or a file of type {types}")
    available = f"{types}, {', '.join(BUNDLED_MOTIONS)}"
    raise JounceError(f"{source}: unknown type of motion {source.suffix!r}; available: {available}")


def read_points(
    source: "Path | Mapping[str, Any]",
    mechanism: Mechanism,
    options: "ColumnOptions",
    duration: object,
    tolerance: object,
    place: str,
) -> "Motion":
    """Return the motion along way points of a file or named columns.

    They are positions without times: rows of a table, or points of a document.
    """
    from jounce.io import entries, tables
    from jounce.io.motions import terms, untimed
    from jounce.motion import joint_matching
    from jounce.motion.table import points_from_columns

    branch: dict[str, float] = {}
    notes: tuple[str, ...] = ()
    points: Any
    # A document lists points, a table has one in each row.
    if isinstance(source, Path) and _is_document(source):
        entry = entries.read(source, "the motion")
        if not terms.has_points(entry.value):
            raise JounceError(
                f"{source}: the file states times; {option_name('duration')} and {option_name('tolerance')} are for way"
                " points without times, 'points: [[...], ...]': leave them out"
            )
        replace(options, angles=None).refuse(place, "its points are no columns of a table")
        points = terms.read_points(entry, mechanism, options.angles)
    elif isinstance(source, Path) and source.suffix.lower() not in tables.TABLE_READERS:
        types = ", ".join([*tables.TABLE_READERS, *DOCUMENT_SUFFIXES])
        raise JounceError(
            f"{source}: {option_name('duration')} and {option_name('tolerance')} are for way points without times, in"
            f" files of type {types}; leave them out"
        )
    else:
        columns, match, notes = untimed.read_untimed_rows(source, mechanism, options, place)
        points, branch = points_from_columns(columns, match, mechanism, place)
    with locate_errors(place):
        motion = joint_matching.follow_points(points, mechanism, duration, tolerance)
    return replace(motion, branch=branch, notes=(*notes, *motion.notes))


def list_logs(folder: Path) -> tuple[list[Path], tuple[str, ...]]:
    """Return the tables and bags in a folder, and a note.

    They are sorted by name; the note lists other files.
    """
    from jounce.io import files, tables
    from jounce.io.motions import logs

    with files.system_errors(folder):
        paths = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    log_paths = [path for path in paths if path.suffix.lower() in tables.TABLE_READERS or logs.is_bag(path)]
    if len(log_paths) == 0:
        types = ", ".join([*tables.TABLE_READERS, *logs.BAG_SUFFIXES])
        raise JounceError(f"{folder}: no log in this folder; logs are files of type {types}")
    other_names = [path.name for path in paths if path not in log_paths]
    notes = (f"{folder}: other files, ignored: {join_names(other_names)}",) if len(other_names) > 0 else ()
    return log_paths, notes


def is_analytic(source: Path) -> bool:
    """Return whether a motion is a bundled name or YAML file.

    It is in closed form, unless the file has messages of samples.
    """
    return str(source) in BUNDLED_MOTIONS or _is_document(source)


def _is_document(source: Path) -> bool:
    return source.suffix.lower() in DOCUMENT_SUFFIXES


def read_bundled(name: str) -> "MotionDescription":
    """Return the analytic terms of a bundled motion."""
    from importlib.resources import as_file, files

    from jounce.io import entries
    from jounce.io.motions import terms

    with as_file(files(__name__) / BUNDLED_MOTIONS[name]) as path:
        return terms.read_terms(entries.read(path, "the motion"))
