"""Rows of tables by their places: spans that follow each other, the rows around a place, sizes, and joined tables."""

import sys
import tracemalloc
from itertools import pairwise
from zipfile import ZipFile

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jounce.io import csv, npz, parquet, tables
from jounce.io.remainders import remainder_name
from jounce.io.table_format import Span, TableMetadata
from support.refusals import refusal

ROWS, GROUP = 23, 5
COLUMNS = {"t": np.arange(ROWS) / 8, "n": np.arange(ROWS) ** 2, "b": -np.arange(ROWS) / 3}
TEXTS = np.array(["one"] * 9 + ["two"] * 14)
FORMATS = (".csv", ".npz", ".parquet")


@pytest.fixture(params=FORMATS)
def table(tmp_path, monkeypatch, request):
    """A format, and a table of it of numbers and of texts, in row groups and chunks of a few rows."""
    monkeypatch.setattr(parquet, "ROWS_PER_GROUP", GROUP)
    monkeypatch.setattr(csv, "BLOCK_BYTES", 100)
    monkeypatch.setattr(npz, "CHUNK_BYTES", 3 * 24)
    form, path = tables.TABLE_WRITERS[request.param], tmp_path / f"table{request.param}"
    columns = COLUMNS | {"motion": TEXTS}
    form.write(path, [{name: x[i : i + 2] for name, x in columns.items()} for i in range(0, ROWS, 2)])
    return form, path


def read(form, path, span):
    """The columns of a span, its texts, and the places of its rows; places follow from one chunk to the next."""
    chunks = list(form.chunks(path, list(COLUMNS), "motion", span))
    assert all(a.places[-1] == b.places[0] for a, b in pairwise(chunks))
    places = [*(place for chunk in chunks for place in chunk.places[:-1]), chunks[-1].places[-1]]
    columns = {name: np.concatenate([chunk.columns[name] for chunk in chunks]) for name in COLUMNS}
    return columns, np.concatenate([chunk.motions for chunk in chunks]), places


def whole(form, path):
    spans = form.spans(path, 10**9)
    return Span(spans[0].start, spans[-1].stop)


@pytest.mark.parametrize("cells", [1, 7, 20, 41, 10**9])
def test_spans_hold_each_row_once(table, cells):
    form, path = table
    spans = form.spans(path, cells)
    assert all(a.stop == b.start for a, b in pairwise(spans))
    parts = [read(form, path, span) for span in spans]
    for name, column in COLUMNS.items():
        assert np.array_equal(np.concatenate([columns[name] for columns, *_ in parts]), column)
    assert np.array_equal(np.concatenate([texts for _, texts, _ in parts]), TEXTS)
    rows = [len(texts) for _, texts, _ in parts]
    if path.suffix == ".npz":
        assert {*rows[:-1]} <= {max(1, cells // 4)} >= {max(rows)} or len(rows) == 1
    if path.suffix == ".parquet":  # as many whole groups as fit, or one
        assert max(rows) <= max(cells // 4, GROUP)
        assert all(a + b > cells // 4 for a, b in pairwise(rows))
    if path.suffix == ".csv":
        longest = max(map(len, path.read_bytes().splitlines(keepends=True)))
        assert all(abs(b - a - 16 * cells) < longest for a, b in spans[:-1])


def test_rows_around_a_place(table):
    """Each is read alone, and numbered from the first."""
    form, path = table
    span = whole(form, path)
    *_, places = read(form, path, span)
    assert len(places) == ROWS + 1
    assert form.row_before(path, places[0]) is None
    assert form.next_row(path, places[-1]) is None
    for i, row in enumerate(pairwise(places)):
        assert form.next_row(path, row[0]) == form.row_before(path, row[1]) == Span(*row)
        columns, texts, own = read(form, path, Span(*row))
        assert ([x.tolist() for x in columns.values()], *texts) == ([[x[i]] for x in COLUMNS.values()], TEXTS[i])
        assert own == list(row)
        said = f"{path}:{i + 2}" if path.suffix == ".csv" else f"{path}: row {i} from 0"
        assert form.place(path, row[0]) == tables.describe_place(path, row[0]) == said
        if i:
            assert form.number(path, row[0], (places[1], 17)) - form.number(path, places[1], (places[1], 17)) == i - 1


def test_rows_of_spans_that_end_within_groups(table):
    form, path = table
    *_, places = read(form, path, whole(form, path))
    for first, last in ((0, 1), (1, 4), (3, 7), (4, 6), (6, 19), (21, 23)):
        columns, texts, _ = read(form, path, Span(places[first], places[last]))
        assert np.array_equal(columns["n"], COLUMNS["n"][first:last])
        assert np.array_equal(texts, TEXTS[first:last])


def test_sizes_are_those_of_numbers_or_of_text(table):
    form, path = table
    sizes = {".csv": path.stat().st_size, ".npz": ROWS * (3 * 8 + 3 * 4), ".parquet": ROWS * 4 * 8}
    assert form.size(path) == sizes[path.suffix]


@pytest.mark.parametrize("suffix", FORMATS)
def test_joined_tables_are_one_below_the_other(tmp_path, monkeypatch, suffix):
    monkeypatch.setattr(csv, "BLOCK_BYTES", 50)
    form, parts = tables.TABLE_WRITERS[suffix], []
    for first, last in ((0, 1), (1, 9), (9, 23)):
        parts.append(tmp_path / f"{first}{suffix}")
        tables.write(parts[-1], {name: x[first:last] for name, x in COLUMNS.items()})
    form.join(tmp_path / f"out{suffix}", iter(parts))
    found = tables.read(tmp_path / f"out{suffix}")
    assert list(found) == list(COLUMNS)
    assert all(np.array_equal(found[name], column) for name, column in COLUMNS.items())


def test_joined_archives_are_as_numpy_writes_them(tmp_path):
    """Integers next to doubles become doubles; the numbers are in the order of C."""
    parts = [tmp_path / "a.npz", tmp_path / "b.npz"]
    tables.write(parts[0], {"x": np.arange(3), "k": np.arange(3)})
    tables.write(parts[1], {"x": np.arange(2) / 3, "k": np.arange(2)})
    tables.NPZ.join(tmp_path / "out.npz", parts)
    found = np.load(tmp_path / "out.npz")
    assert np.array_equal(found["x"], [0, 1, 2, 0, 1 / 3])
    assert (found["k"].tolist(), found["k"].dtype) == ([0, 1, 2, 0, 1], np.arange(3).dtype)
    with ZipFile(tmp_path / "out.npz") as archive:
        heads = [archive.read(name)[:128] for name in archive.namelist()]
    assert [b"'fortran_order': False" in head for head in heads] == [True, True]


@pytest.mark.parametrize("rows", [1, 4, 5, 6, 10])
def test_row_groups_are_written_when_they_are_full(tmp_path, monkeypatch, rows):
    """Of pieces of one row, and of one piece."""
    monkeypatch.setattr(parquet, "ROWS_PER_GROUP", GROUP)
    about, t = TableMetadata(lambda name: {"t": "s"}.get(name, ""), {"robot": "arm"}), np.arange(rows) + 0.5
    texts = np.array(["a", "b"] * 5)[:rows]
    for pieces in ([{"t": t[i : i + 1], "motion": texts[i : i + 1]} for i in range(rows)], [{"t": t, "motion": texts}]):
        tables.PARQUET.write(tmp_path / "t.parquet", pieces, about)
        with pq.ParquetFile(tmp_path / "t.parquet") as file:
            counts = [file.metadata.row_group(i).num_rows for i in range(file.metadata.num_row_groups)]
            schema, found = file.schema_arrow, file.read()
        assert counts == [GROUP] * (rows // GROUP) + [rows % GROUP] * (rows % GROUP > 0)
        assert (found.column("t").to_pylist(), found.column("motion").to_pylist()) == (t.tolist(), texts.tolist())
        assert schema.field("t").metadata == {b"unit": b"s"}
        assert schema.field("motion").metadata is None
        assert schema.metadata[b"jounce"] == b'{"robot": "arm", "units": {"t": "s"}}'


def test_full_row_groups_do_not_wait_for_the_last_rows(tmp_path, monkeypatch):
    """Each is written when it is full, not all of them at the end, which would hold the table in memory."""
    monkeypatch.setattr(parquet, "ROWS_PER_GROUP", GROUP)
    written, write = [], pq.ParquetWriter.write_table
    monkeypatch.setattr(
        pq.ParquetWriter, "write_table", lambda self, x, *size: written.append(len(x)) or write(self, x, *size)
    )
    tables.PARQUET.write(tmp_path / "t.parquet", [{"t": np.full(2, float(i))} for i in range(8)])
    assert written == [6, 6, 4]


def test_texts_in_runs_are_those_that_were_given(tmp_path):
    texts = np.array(["b", "b", "a", "b", "\u0142", "\u0142", "a"])
    tables.PARQUET.write(tmp_path / "t.parquet", [{"t": np.zeros(7), "motion": texts}])
    found = pq.read_table(tmp_path / "t.parquet").column("motion")
    assert found.to_pylist() == texts.tolist()
    assert sorted(found.chunk(0).dictionary.to_pylist()) == ["a", "b", "\u0142"]


def test_columns_of_parquet_tables_are_numbers_or_named_by_type(tmp_path):
    path = tmp_path / "t.parquet"
    kinds = {"d": pa.decimal128(5, 2), "i": pa.int64(), "f": pa.float32(), "b": pa.bool_(), "s": pa.string()}
    values = {"d": [1, 2], "i": [1, 2**60 + 1], "f": [0.5, None], "b": [True, False], "s": ["x", None]}
    pq.write_table(pa.table({name: pa.array(values[name], kind) for name, kind in kinds.items()}), path)
    assert tables.PARQUET.columns(path) == {"d": "", "i": "", "f": "", "b": "bool", "s": "string"}
    for name in "bs":
        refusal(lambda name=name: tables.read(path, lambda _: [name]), f"column '{name}' holds", "expected numbers")
    found = tables.PARQUET.whole(path, lambda _: ["d", "i", "f"]).columns
    assert {name: x.tolist() for name, x in found.items() if name != "f"} == {"d": [1, 2], "i": [1, 2.0**60]}
    assert (found["f"][0], np.isnan(found["f"][1])) == (0.5, True)
    [span] = tables.PARQUET.spans(path, 100)
    refusal(lambda: list(tables.PARQUET.chunks(path, ["i"], "s", span)), "column of motions has 1 empty cells")


@pytest.mark.parametrize("kind", [pa.int64(), pa.decimal128(20, 1)])
def test_remainders_of_what_is_not_plain_integers(tmp_path, kind):
    """An integer is missing, or all are decimals: they are read as doubles."""
    path, name = tmp_path / "t.parquet", remainder_name("t")
    pq.write_table(pa.table({"t": pa.array([15 * 10**17, None if kind == pa.int64() else 0], kind)}), path)
    [chunk] = tables.PARQUET.chunks(path, ["t", name], None, Span(0, 2))
    np.testing.assert_array_equal(chunk.columns["t"], [1.5e18, np.nan if kind == pa.int64() else 0])
    np.testing.assert_array_equal(chunk.columns[name], [0, 0])


def test_chunks_are_of_four_megabytes_and_groups_of_one(tmp_path):
    t, path = np.arange(600_000.0), tmp_path / "t.npz"
    tables.write(path, {"t": t})
    assert [len(x.columns["t"]) for x in tables.NPZ.chunks(path, ["t"], None, Span(0, 600_000))] == [2**19, 75_712]
    tables.write(path.with_suffix(".parquet"), {"t": t})
    with pq.ParquetFile(path.with_suffix(".parquet")) as file:
        groups = [file.metadata.row_group(i).num_rows for i in range(file.metadata.num_row_groups)]
    assert groups == [2**17] * 4 + [75_712]


def test_archives_may_have_columns_of_more_than_four_gigabytes(tmp_path):
    tables.write(tmp_path / "t.npz", COLUMNS)
    tables.NPZ.join(tmp_path / "out.npz", [tmp_path / "t.npz"])
    for name in ("t", "out"):
        with ZipFile(tmp_path / f"{name}.npz") as archive:
            assert {entry.extract_version for entry in archive.infolist()} == {45}  # the version of ZIP64


class Watched(np.ndarray):
    """Numbers that note how many of them are taken at a time."""

    def __getitem__(self, places):
        found = super().__getitem__(places)
        taken.append(len(found))
        return found


taken = []


@pytest.mark.parametrize(("cells", "rows"), [(1, 1), (8, 4), (9, 4)])
def test_cells_are_converted_to_text_some_at_a_time(tmp_path, monkeypatch, cells, rows):
    monkeypatch.setattr(csv, "CELLS_PER_WRITE", cells)
    taken.clear()
    tables.CSV.write(tmp_path / "t.csv", [{name: np.arange(10).view(Watched) for name in "ab"}])
    assert max(taken) == rows
    assert (tmp_path / "t.csv").read_text() == "a,b\n" + "".join(f"{i},{i}\n" for i in range(10))


@pytest.mark.parametrize("line", [b"0.123456\n", b"0.123456\r", b'"0.1234"\n'], ids=["feeds", "returns", "quotes"])
def test_text_is_converted_half_a_megabyte_at_a_time(tmp_path, line):
    path = tmp_path / "t.csv"
    path.write_bytes(b"t" + line[-1:] + line * 150_000)
    [span] = tables.CSV.spans(path, 10**9)
    chunks = list(tables.CSV.chunks(path, ["t"], None, span))
    sizes = [chunk.places[-1] - chunk.places[0] for chunk in chunks]
    assert len(sizes) == 3
    assert all(2**19 - 10 < size <= 2**19 for size in sizes[:-1])
    assert sum(len(chunk.columns["t"]) for chunk in chunks) == 150_000


def test_the_row_before_is_looked_for_in_a_megabyte(tmp_path):
    """Which holds a row as long as it, and bounds the memory of tables without line breaks."""
    path = tmp_path / "t.csv"
    for longest in (2**20 - 1, 9):
        path.write_bytes(b"t\n" + b"0.123456\n" * 400_000 + b"1" * (longest - 1) + b"\n")
        size = path.stat().st_size
        tracemalloc.start()
        assert tables.CSV.row_before(path, size) == Span(size - longest, size)
        assert tracemalloc.get_traced_memory()[1] < 2**21
        tracemalloc.stop()


def test_row_groups_out_of_a_span_are_not_read(tmp_path, monkeypatch):
    monkeypatch.setattr(parquet, "ROWS_PER_GROUP", GROUP)
    tables.write(tmp_path / "t.parquet", COLUMNS)
    for span, groups in ((Span(5, 10), [1]), (Span(4, 11), [0, 1, 2]), (Span(20, 23), [4]), (Span(0, 5), [0])):
        with pq.ParquetFile(tmp_path / "t.parquet") as file:
            found, real = [], file.iter_batches

            def iterate(*given, found=found, real=real, row_groups, **options):
                found += row_groups
                return real(*given, row_groups=row_groups, **options)

            file.iter_batches = iterate
            rows = [n for _, batch in parquet._read_batches(file, ["n"], span) for n in batch.column("n").to_pylist()]
        assert (found, rows) == (groups, COLUMNS["n"][span.start : span.stop].tolist())


def test_columns_of_other_lengths_are_not_cut_off(tmp_path):
    with pytest.raises(ValueError, match="shorter"):
        tables.CSV.write(tmp_path / "t.csv", [{"t": np.zeros(3), "a": np.zeros(2)}])


def test_numbers_without_names_are_left_alone(tmp_path):
    """Where names end in separators, cells without a name may hold anything; other rows have only blank cells more."""
    path = tmp_path / "t.csv"
    path.write_text("t,a,,\n1,2,note,\n3,4\n5,6,,,\n7,8,,x\n")
    assert {name: x.tolist() for name, x in tables.read(path).items()} == {"t": [1, 3, 5, 7], "a": [2, 4, 6, 8]}
    path.write_text("t,\n1,note\n2\n")
    assert {name: x.tolist() for name, x in tables.read(path).items()} == {"t": [1, 2]}
    path.write_text("t,a,,\n1,2,note,,more\n")
    refusal(lambda: tables.read(path), f"{path}:2: 5 cells; expected 2")
    path.write_text("t,a\n1,2,note\n")
    refusal(lambda: tables.read(path), f"{path}:2: 3 cells; expected 2")


NAMED_BY_COMMENTS = {
    "as numpy.savetxt": ("# t,a b\n1,2\n3,4\n", ["t", "a b"]),
    "above the names": ("# of a robot, in SI\nt,a b\n1,2\n3,4\n", ["t", "a b"]),
    "above others": ("# in SI\n\n// t,a b\n% of a robot, both joints\n1,2\n3,4\n", ["t", "a b"]),
    "of other numbers of cells": ("# a robot, its joints, in SI\n# t,a b\n1,2\n3,4\n", ["t", "a b"]),
    "decimal commas": ("% t;a b\n1,0;2\n3;4\n", ["t", "a b"]),
    "within names": ("item#,load %\n1,2\n3,4\n", ["item#", "load %"]),
    "within names, semicolons": ("a//b; 50% c\n1;2\n3;4\n", ["a//b", "50% c"]),
    "marked twice": ("## # t,a\n1,2\n3,4\n", ["t", "a"]),
    "none, blanks": ("t a\n1 2\n3 4\n", ["t", "a"]),
    "none, first without name": (",a\n1,2\n3,4\n", ["", "a"]),
    "between blanks": ("# t a\n1 2\n3 4\n", ["t", "a"]),
    "names and a number": ("t,7\n1,2\n3,4\n", ["t", "7"]),
}


@pytest.mark.parametrize(("content", "names"), NAMED_BY_COMMENTS.values(), ids=NAMED_BY_COMMENTS)
def test_comments_of_csv(tmp_path, content, names):
    path = tmp_path / "t.csv"
    path.write_text(content)
    found = tables.read(path)
    assert (list(found), [x.tolist() for x in found.values()]) == (names, [[1, 3], [2, 4]])


def test_a_comment_names_columns_of_texts_too(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("# t,motion\n1,walk\n3,run\n")
    assert list(tables.CSV.columns(path)) == ["t", "motion"]
    [chunk] = tables.CSV.chunks(path, ["t"], "motion", *tables.CSV.spans(path, 100))
    assert (chunk.columns["t"].tolist(), chunk.motions.tolist()) == ([1, 3], ["walk", "run"])


def test_parquet_tables_without_pyarrow_are_refused_at_once(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    refusal(lambda: tables.check_writable(tmp_path / "t.PARQUET"), "t.PARQUET: Parquet needs pyarrow", "jounce[tables]")
    tables.check_writable(tmp_path / "t.csv")
