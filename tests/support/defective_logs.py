"""Logs of one motion with a defect each, as loggers, editors and cables make them.

``python tests/support/defective_logs.py FOLDER`` writes them to a folder, with the true motion as ``truth.csv``.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

JOINTS = ("joint1", "joint2")  # of the bundled robot planar2r
ROWS, RATE = 400, 100  # Hz
NOISE = 1e-4  # rad
STEP = 1 / RATE
KNOWN_VALUES = ("on_error", "angles", "time_unit")  # options of which messages name the value as well


@dataclass(frozen=True)
class DefectiveLog:
    """A table, what is noted of it where it is read as it is, or the words of its refusal and the options that cure it.

    The refusal names these options too, as its reader writes them: `named_options` and `named_arguments`.

    `noted` holds words of the notes of the motion that is read at last, and `rows` the number of its rows.
    """

    text: str
    noted: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()
    cure: Mapping[str, Any] | None = field(default_factory=dict)  # options of load_motion; None if there are none
    rows: int = ROWS
    suffix: str = ".csv"


def named_arguments(cure: Mapping[str, Any] | None) -> list[str]:
    """What a message in Python says of a cure: its arguments, with the values that it can know."""
    return [f"{name}={value!r}" if name in KNOWN_VALUES else f"{name}=" for name, value in (cure or {}).items()]


def named_options(cure: Mapping[str, Any] | None) -> list[str]:
    """What a message at the shell says of a cure: its options, with the values that it can know."""
    options = {name: f"--{name.replace('_', '-')}" for name in cure or {}}
    return [
        f"{options[name]} {value}" if name in KNOWN_VALUES else options[name] for name, value in (cure or {}).items()
    ]


def true_positions(t, order=0):
    """The positions of the joints at times, or a derivative of these."""
    t = np.asarray(t)[..., None]
    w = np.array([2.0, 3.0])
    return np.array([0.8, 0.5]) * w**order * np.sin(w * t + order * np.pi / 2) + (order == 0) * np.array([0.3, -0.4])


def clean_columns(early: Mapping[int, float] | None = None):
    """The log without a defect: stamps that scatter, positions with noise, torques; some rows by so much `early`.

    And the first stamp in the times of the truth, s.
    """
    rng = np.random.default_rng(38)
    t = np.arange(ROWS) * STEP + rng.uniform(-0.2, 0.2, ROWS) * STEP
    for row, seconds in (early or {}).items():
        t[row] = t[row + 1] - seconds
    q = true_positions(t) + NOISE * rng.normal(size=(ROWS, 2))
    torques = 5 * np.cos(q) + 0.01 * rng.normal(size=(ROWS, 2))
    columns = np.concatenate([t[:, None] - t[0], q, torques], axis=1).T
    return dict(zip(("t", *JOINTS, *(f"tau_{joint}" for joint in JOINTS)), columns, strict=True)), float(t[0])


def write_table(columns: Mapping[str, Any], mark: str = ",") -> list[str]:
    """The lines of a table."""
    cells = [[x if isinstance(x, str) else repr(float(x)) for x in column] for column in columns.values()]
    return [mark.join(columns), *map(mark.join, zip(*cells, strict=True))]


def edited(lines: list[str], changes: Mapping[int, Mapping[int, str]]) -> str:
    """A table with other texts in some cells: by row from 0 and column."""
    rows = [line.split(",") for line in lines]
    for row, cells in changes.items():
        for column, text in cells.items():
            rows[row + 1][column] = text
    return "\n".join(map(",".join, rows)) + "\n"


def swapped_rows(lines: list[str], row: int, by: int) -> str:
    """A table in which a row stands some rows later."""
    moved = lines[: row + 1] + lines[row + 2 : row + 2 + by] + [lines[row + 1]] + lines[row + 2 + by :]
    return "\n".join(moved)


def iso_stamps(t) -> list[str]:
    """Stamps of a day in November, in nanoseconds."""
    ns = np.rint(np.asarray(t) * 1e9).astype(int)
    return [f"2024-11-22T15:00:{x // 10**9:02d}.{x % 10**9:09d}Z" for x in ns]


def renamed(columns, title):
    return {title(name): column for name, column in columns.items()}


SKIP = {"on_error": "skip"}


def make_logs() -> dict[str, DefectiveLog]:
    """The logs by what is wrong with them."""
    columns, _ = clean_columns()
    lines, t = write_table(columns), columns["t"]
    degrees = 180 / np.pi
    angles = {name: degrees * x if name in JOINTS else x for name, x in columns.items()}
    late = np.where(np.arange(ROWS) == 150, t - 2.5 * STEP, t)
    midway = {name: np.where(t < 2, x, degrees * x) if name in JOINTS else x for name, x in columns.items()}
    return {
        # decided, and noted
        "empty torque": DefectiveLog(edited(lines, {70: {4: ""}}), ("torques missing", "1 of 400 of joint2")),
        "torque sensor off": DefectiveLog(
            edited(lines, {i: {3: "nan"} for i in range(50, 150)}), ("torques missing", "100 of 400 of joint1")
        ),
        "two rows out of order": DefectiveLog(
            swapped_rows(write_table(clean_columns({200: 29e-6})[0]), 200, 1),
            ("1 of 400 rows out of order by up to 2.9e-05 s; sorted by their stamps",),
        ),
        "ISO 8601 stamps": DefectiveLog(
            "\n".join(write_table(columns | {"t": iso_stamps(t)})), ("2024-11-22 15:00:00 UTC",)
        ),
        "comments above the header": DefectiveLog("\n".join(["# Robot 7, cell B", "% 22.11.2024; 15:00", *lines])),
        "header as a comment": DefectiveLog("\n".join(["# robot 7", f"# {lines[0]}", *lines[1:]])),
        "separators at the end": DefectiveLog("\n".join([lines[0], *(f"{line}," for line in lines[1:])])),
        "semicolons and decimal commas": DefectiveLog("\n".join(write_table(columns, ";")).replace(".", ",")),
        "rows with a time alone": DefectiveLog(
            edited(lines, {i: dict.fromkeys(range(1, 5), "") for i in (30, 31, 90)}),
            ("3 of 400 rows state no position; left out",), rows=397,
        ),
        # refused, with what decides
        "empty position": DefectiveLog(
            edited(lines, {70: {2: ""}}),
            ("1 of 400 rows left out",), (".csv:72: column 'joint2' holds ''",), SKIP, 399,
        ),
        "texts among numbers": DefectiveLog(
            edited(lines, {7: {1: "err"}, 9: {0: "?"}}),
            ("2 of 400 rows left out, the first:",), (".csv:9: column 'joint1' holds 'err'",), SKIP, 398,
        ),
        "last line cut off": DefectiveLog(
            "\n".join(lines)[:-40], ("1 of 400 rows left out",), ("cells; expected 5",), SKIP, 399
        ),
        "stamps that go back": DefectiveLog(
            "\n".join(write_table(columns | {"t": late})),
            ("1 of 400 rows left out",), (".csv:152: column 't' does not increase",), SKIP, 399,
        ),
        "a stamp far ahead": DefectiveLog(
            edited(lines, {10: {0: "99.5"}}),
            ("1 of 400 rows left out",), ("does not increase: 99.5 comes before 0.1",), SKIP, 399,
        ),
        "a row twice": DefectiveLog(
            "\n".join([*lines[:101], lines[100], *lines[101:]]),
            ("1 of 401 rows left out",), (".csv:102: column 't' does not increase",), SKIP,
        ),
        "one stamp for two rows": DefectiveLog(
            edited(lines, {10: {0: repr(float(t[9]))}}),
            ("1 of 400 rows left out",), ("does not increase",), SKIP, 399,
        ),
        "names of another prefix": DefectiveLog(
            "\n".join(write_table(renamed(columns, lambda name: name.replace("joint", "fer_joint")))),
            (), ("missing 'joint1'",), {"rename": {"fer_*": "*"}},
        ),
        "units in the header": DefectiveLog(
            "\n".join(write_table(renamed(angles, lambda name: f"q{name[-1]} [deg]" if name in JOINTS else name))),
            (), ("missing 'joint1'",), {"columns": "q{number} [deg]"},
        ),
        "degrees": DefectiveLog("\n".join(write_table(angles)), (), ("if they were degrees",), {"angles": "deg"}),
        "milliseconds": DefectiveLog(
            "\n".join(write_table(columns | {"t": 1e3 * t})), (), ("t looks like ms",), {"time_unit": "ms"}
        ),
        "two columns for a joint": DefectiveLog(
            "\n".join(write_table(angles | {"joint1 [deg]": angles["joint1"], "joint2 [deg]": angles["joint2"]})),
            (), ("'joint1' and 'joint1 [deg]' have the same name",), {"columns": "{joint} [deg]"},
        ),
        "two torques for a joint": DefectiveLog(
            "\n".join(write_table(columns | {"joint1.effort": 0 * t})),
            (), ("both state torques of 'joint1'",), {"torques": "tau_{joint}"},
        ),
        # refused: no option decides
        "one name twice": DefectiveLog(
            "\n".join(line + "," + line.split(",")[1] for line in lines),
            (), ("column 'joint1' occurs 2 times; rename or remove",), None,
        ),
        "a unit that changes midway": DefectiveLog(
            "\n".join(write_table(midway)), (), ("angles become degrees", "write all rows in one unit"), None
        ),
    }  # fmt: skip


def write_logs(folder: Path) -> dict[str, Path]:
    """Write the logs to a folder; returns their paths by what is wrong with them."""
    folder.mkdir(exist_ok=True)
    t = clean_columns()[0]["t"]
    rates = {
        f"{j}.{s}": true_positions(t + clean_columns()[1], k)[:, i]
        for k, s in enumerate(("q", "qd", "q2d"))
        for i, j in enumerate(JOINTS)
    }
    (folder / "truth.csv").write_text("\n".join(write_table({"t": t} | rates)))
    paths = {}
    for name, log in make_logs().items():
        paths[name] = folder / f"{name.replace(' ', '_')}{log.suffix}"
        paths[name].write_text(log.text)
    return paths


if __name__ == "__main__":
    for name, path in write_logs(Path(sys.argv[1])).items():
        print(f"{path}: {name}")
