"""The work folder of a run: finished parts, which a second run takes over.

A part is finished when its file of results is there, which appears as a whole, after its table of rows if it has one.
It is taken over only if it has the key of this run and the table its checksum.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from jounce.core.temporary_files import temporary_path
from jounce.core.typing import JsonObject
from jounce.engine.along import BreakCause, DescribedBreak
from jounce.engine.hidden_vibrations import HiddenVibration
from jounce.io.files import checksum, write_errors
from jounce.io.motions.skipped_rows import Skipped
from jounce.io.motions.table_parts import InputPart
from jounce.limits.samples import Sample
from jounce.limits.verdicts import read_check
from jounce.motion.extremes import Extremes, Peak
from jounce.stream.job import Job, digest
from jounce.stream.results import MotionFacts, MotionResult

CONTINUATION = "finished parts are kept, and the same command continues after them"


@dataclass(frozen=True)
class FinishedPart:
    """What was computed of a part.

    `results` are by motion, in the order of the input. `checksum` is that of the table of rows, empty without any rows.
    """

    number: int
    key: str
    results: Mapping[str, MotionResult]
    checksum: str = ""
    skipped: Sequence[Skipped] = ()
    warnings: Sequence[str] = ()

    @property
    def rows(self) -> int:
        """The number of rows that were computed."""
        return sum(of.rows for of in self.results.values())


def rows_folder(work: Path) -> Path:
    """The folder of the tables of rows."""
    return work / "rows"


def rows_path(work: Path, part: InputPart, form: str) -> Path:
    """The path of the table of rows of a part."""
    return rows_folder(work) / f"part-{part.number:06d}{form}"


def results_path(work: Path, part: InputPart) -> Path:
    """The path of the results of a part."""
    return work / f"part-{part.number:06d}.json"


@contextmanager
def write_atomically(path: Path) -> Iterator[Path]:
    """Yield a path to write to in the folder of a path; the file appears when all is in it."""
    temporary = temporary_path(path.parent)
    try:
        with write_errors(path, f"; {CONTINUATION}"):
            yield temporary
            temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_finished(work: Path, part: InputPart, found: FinishedPart) -> None:
    """Write the results of a part."""
    with write_atomically(results_path(work, part)) as path:
        path.write_text(line_of(found), encoding="utf-8")


def find_finished(work: Path, part: InputPart, job: Job) -> FinishedPart | None:
    """The results of a part in the work folder; None if they are missing, damaged or of another run."""
    try:
        found = parse_line(results_path(work, part).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError):
        return None
    return found if found and found.key == job.part_key(part) else None


def is_finished(job: Job, part: InputPart, work: Path) -> bool:
    """Whether a part needs no work: it has results of this run, and the table of its rows is as it was."""
    table = None if job.form is None else rows_path(work, part, job.form)
    return is_whole(find_finished(work, part, job), table, job.reading.skip)


def is_whole(found: FinishedPart | None, table: Path | None, skip: bool) -> bool:
    """Whether results are there with their table of rows, and no row was left out but by `skip`."""
    if found is None or (found.skipped and not skip):
        return False
    try:
        return table is None or not found.rows or checksum(table) == found.checksum
    except OSError:
        return False


def line_of(found: FinishedPart) -> str:
    """A finished part and its digest as a line of JSON."""
    data = asdict(found)
    return json.dumps({"digest": digest(data), "part": data})


def parse_line(line: str) -> FinishedPart | None:
    """The finished part in a line of JSON; None if it is damaged."""
    try:
        kept = json.loads(line)
        data = kept["part"]
        if kept["digest"] != digest(data):
            return None
        results = {name: _read_result(of) for name, of in data["results"].items()}
        skipped = tuple(Skipped(**row) for row in data["skipped"])
        return FinishedPart(**data | {"results": results, "skipped": skipped, "warnings": tuple(data["warnings"])})
    except (ValueError, KeyError, TypeError):
        return None


def _read_result(data: JsonObject) -> MotionResult:
    """The result of a motion from plain data."""
    facts, check = data["facts"], data["check"]
    breaks = tuple(
        DescribedBreak(**found | {
            "missing": tuple(found["missing"]),
            "causes": {joint: BreakCause(*cause) for joint, cause in found["causes"].items()},
        })
        for found in facts["breaks"]
    )  # fmt: skip
    hidden = tuple(HiddenVibration(**found) for found in facts["hidden"])
    peaks = {
        joint: {name: _read_extremes(*numbers) for name, numbers in of.items()} for joint, of in data["peaks"].items()
    }
    return MotionResult(
        data["rows"],
        tuple(data["span"]),
        MotionFacts(facts["source"], facts["residual"], tuple(facts["notes"]), breaks, hidden),
        peaks,
        data["broken"] and Sample(*data["broken"]),
        check and read_check(check),
    )


def _read_extremes(largest: Sequence[float], certain: Sequence[float], squares: float) -> Extremes:
    return Extremes(Peak(*largest), Peak(*certain), squares)
