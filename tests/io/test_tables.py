"""Tables: every digit kept, every bad cell named, never half a file."""

import gc
import json
import os
import tracemalloc
import warnings
from io import BytesIO, StringIO
from zipfile import ZipFile

import numpy as np
import pytest
from scipy.io import savemat

import jounce
from jounce.io import csv, parquet, tables
from jounce.io import npz as archives
from jounce.io.table_format import Span
from support.archives import npy
from support.refusals import refusal

COLUMNS = {"t": np.arange(9.0), "a": np.arange(9.0) ** 2}


def npz(compressed=False, **columns):
    file = BytesIO()
    (np.savez_compressed if compressed else np.savez)(file, **columns)
    return file.getvalue()


def doubled(name, more=b""):
    """An archive with a column t, and one more member."""
    file = BytesIO(npz(t=np.zeros(3)))
    with ZipFile(file, "a") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the name that is there already
        archive.writestr(name, npy(np.ones(3)) + more)
    return file.getvalue()


@pytest.fixture
def read_content(tmp_path):
    def read(content, name="table.csv"):
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return tables.read(path)

    return read


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".CSV"])
def test_round_trip_keeps_every_bit(tmp_path, suffix):
    bits = np.random.default_rng(0).integers(0, 2**64, 3000, dtype=np.uint64).view(float)
    special = [0.0, -0.0, 5e-324, -5e-324, 2.2e-308, 1e308, np.finfo(float).max, np.finfo(float).tiny, 0.1, 1 / 3, 1e16]
    numbers = np.concatenate([bits[np.isfinite(bits)], special])
    columns = {"t": numbers, "a b, c": -numbers, 'quoted "x"': numbers[::-1], "Grüße.Q2d": 3 * np.arange(len(numbers))}
    path = tmp_path / f"table{suffix}"
    tables.write(path, columns)
    found = tables.read(path)
    assert list(found) == list(columns)
    for name, column in columns.items():
        assert found[name].dtype == float
        assert np.array_equal(found[name].view(np.uint64), column.astype(float).view(np.uint64)), name
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["file", "allow_pickle", "t/x.Q", "x.npy", "t"])
def test_any_column_name_goes_into_an_archive(tmp_path, name):
    tables.write(tmp_path / "table.npz", {name: np.arange(3.0)})
    assert tables.read(tmp_path / "table.npz")[name].tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    "content",
    [
        "t,a b\n1,2\n3,4.5\n", "# t,a b\n1,2\n3,4.5\n", "#t,a b\r\n1,2\r\n3,4.5\r\n", "\ufefft,a b\n1,2\n3,4.5",
        " t , a b\n 1,\t2\n3 , 4.50 \n", '"t","a b"\n"1","2"\n3,4.5\n', "t,a b\n\n1,2\n\n3,45e-1\n,\n\n",
    ],
)  # fmt: skip
def test_dialects_of_csv(read_content, content):
    found = read_content(content)
    assert {name: column.tolist() for name, column in found.items()} == {"t": [1, 3], "a b": [2, 4.5]}


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_lines_of_csv_end_anywhere_and_in_any_way(read_content, monkeypatch, size):
    """Within quotes too, and with the carriage return alone of spreadsheets."""
    monkeypatch.setattr(csv, "BLOCK_BYTES", size)
    for end in ("\n", "\r\n", "\r"):
        rows = ['"t",a,"of, which"', "1,2,3", '"4","5","', '6"', "", "7,8,9"]
        found = read_content(end.join(rows))
        assert [column.tolist() for column in found.values()] == [[1, 4, 7], [2, 5, 8], [3, 6, 9]]
    rows[5] = "7,8,x"
    for end in ("\n", "\r\n", "\r"):
        refusal(lambda end=end: read_content(end.join(rows)), ":6: column 'of, which' holds 'x'")


def test_what_numpy_writes(tmp_path, read_content):
    x, text = np.random.default_rng(2).normal(size=(9, 2)), StringIO()
    np.savetxt(text, x, delimiter=",", header="t,a")
    assert np.array_equal(np.stack([*read_content(text.getvalue()).values()], axis=1), x)
    content = npz(True, t=np.arange(3), a=np.arange(3, dtype=np.float32) / 3)
    found = read_content(content, "table.npz")
    assert found["t"].dtype == found["a"].dtype == float
    assert found["a"].tolist() == (np.arange(3, dtype=np.float32) / 3).tolist()


@pytest.mark.parametrize("size", [1, 150, 100_000])
def test_pieces_are_of_some_rows_and_make_the_whole(tmp_path, monkeypatch, size):
    monkeypatch.setattr(csv, "BLOCK_BYTES", size)
    x = np.random.default_rng(3).normal(size=(3, 50))
    columns, path = dict(zip("tab", x, strict=True)), tmp_path / "table.csv"
    tables.write(path, columns)
    [span] = tables.CSV.spans(path, 1000)
    rows = [len(chunk.columns["t"]) for chunk in tables.CSV.chunks(path, ["t"], None, span)]
    assert sum(rows) == 50
    lines = [len(line) for line in path.read_text().splitlines()[1:]]
    assert max(rows) <= 1 + size // min(lines)
    found = tables.read(path)
    assert np.array_equal([found[name] for name in columns], x)
    path.write_text(path.read_text() + "1,2,bad\n")
    refusal(lambda: tables.read(path), f"{path}:52: column 'b' holds 'bad'")


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_what_is_written_in_pieces_is_the_whole(tmp_path, suffix):
    whole, path = tmp_path / f"whole{suffix}", tmp_path / f"pieces{suffix}"
    parts = [{name: column[i : i + 4] for name, column in COLUMNS.items()} for i in range(0, 9, 4)]
    tables.write(whole, COLUMNS)
    tables.write_pieces(path, iter(parts))
    assert list(tables.read(path)) == list(COLUMNS)
    assert all(np.array_equal(tables.read(path)[name], column) for name, column in COLUMNS.items())
    assert suffix == ".npz" or path.read_bytes() == whole.read_bytes()  # archives hold the time
    path.unlink()
    parts[2] = {"t": np.array([np.inf]), "a": np.zeros(1)}
    refusal(lambda: tables.write_pieces(path, parts), "column 't' holds inf in row 8 from 0")
    assert list(tmp_path.iterdir()) == [whole]


def test_a_table_whose_next_piece_fails_leaves_nothing(tmp_path):
    def pieces():
        yield COLUMNS
        raise KeyboardInterrupt

    for suffix in (".csv", ".npz"):
        with pytest.raises(KeyboardInterrupt):
            tables.write_pieces(tmp_path / f"t{suffix}", pieces())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_tables_take_no_more_than_three_times_their_size_in_memory(tmp_path, suffix):
    rng = np.random.default_rng(4)
    columns, path = {name: rng.normal(size=30_000) for name in "tabc"}, tmp_path / f"table{suffix}"
    peaks = []
    for call in (lambda: tables.write(path, columns), lambda: tables.read(path)):
        gc.collect()
        tracemalloc.start()
        call()
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert max(peaks) < 3 * path.stat().st_size + 8e6  # which a piece takes, of a table of any size


def test_half_a_character_in_a_column_name_is_refused(tmp_path):
    for suffix in (".csv", ".npz"):
        refusal(lambda suffix=suffix: tables.write(tmp_path / f"t{suffix}", {"\ud800": ZEROS}), "cannot write a name")
    assert list(tmp_path.iterdir()) == []


BAD_CSV = {
    "empty": ("", ["the table is empty", "column names"]),
    "blank": ("\n , \n", ["the table is empty"]),
    "header only": ("t,a\n", ["no rows"]),
    "no names": ("1,2\n3,4\n", ["no row of column names", "expected one, such as 't,JOINT,...'"]),
    "column twice": ("t,a,b,a\n1,2,3,4\n", ["'a'", "2 times"]),
    "short row": ("t,a\n1,2\n\n3\n", [":4", "1 cells", "expected 2"]),
    "long row": ("t,a\n1,2\n1,2,3\n", [":3", "3 cells", "expected 2"]),
    **{
        f"cell {cell!r}": (f"t,a b\n1,2\n3,{cell}\n", [":3", "'a b'", repr(cell), "finite number"])
        for cell in ("nan", "-inf", "1e999", "", "two", "0x10", "1_000", "1 2", "1;2", "٣")
    },
    "line of a cell after blanks": ('t,"a\nb"\n\n1,2\n\n3,x\n', [":6", r"'a\nb'", "'x'"]),
    "line of a cell after a blank one": ("\nt,a\n1,x\n", [":3: column 'a' holds 'x'"]),
    "not UTF-8": ("t,é\n1,2\n".encode("latin-1"), ["CSV"]),
    "UTF-16": ("t,a\n1,2\n".encode("utf-16"), ["CSV"]),
    "binary": (bytes(range(256)) * 4, ["CSV"]),
    "zeros": (bytes(99), []),
    "open quote": ('t,"a\n1,2\n', ["CSV"]),
    "text after a quote": ('t,"a"b\n1,2\n', ["CSV"]),
    "long cell": (f"t,a\n1,{'x' * 200}\n", [":2", f"'{'x' * 80}...'"]),
    "directions in a cell": ("t,a\n1,\u202e\x1b[2J\n", [":2", r"'\u202e\x1b[2J'"]),
    "huge cell": (f"t,a\n1,{'2' * 200_000}\n", ["CSV"]),
}
ZEROS = np.zeros(3)
BAD_NPZ = {
    "empty": (b"", ["NPZ"]),
    "text": (b"t,a\n1,2\n", ["NPZ"]),
    "single array": (npy(ZEROS), ["NPZ", "not a zip file"]),
    "pickle": (npy(np.array([None])), []),
    "broken zip": (b"PK\x03\x04" + bytes(99), ["NPZ", "zip"]),
    "no columns": (npz(), ["no columns or no rows"]),
    "no rows": (npz(t=np.zeros(0)), ["no columns or no rows"]),
    "objects": (npz(t=ZEROS, a=np.array([1, None, "x"])), ["'a'", "object"]),
    "3-D": (npz(t=ZEROS, a=np.zeros((3, 2, 2))), ["'a'", "(3, 2, 2)", "(3,)"]),
    "3-D first": (npz(a=np.zeros((3, 2, 2)), t=ZEROS), ["'a'", "(3, 2, 2); expected numbers of shape (3,)"]),
    "0-D": (npz(t=1.0), ["'t'", "()", "(N,)"]),
    "ragged": (npz(t=ZEROS, a=np.zeros(2)), ["'a'", "(2,)", "(3,)"]),
    "text column": (npz(t=ZEROS, a=np.array(["x"] * 3)), ["'a'", "<U1"]),
    "complex": (npz(t=ZEROS, a=1j * ZEROS), ["'a'", "complex128"]),
    "column twice": (doubled("t.npy"), ["'t'", "2 times"]),
    "column with and without its ending": (doubled("t"), ["'t'", "2 times"]),
    "column beside a field": (npz(a=ZEROS, t=np.zeros(3, [("a", float)])), ["'a'", "2 times"]),
    "more after the array": (doubled("a.npy", b"more"), ["'a'", "more follows"]),
    "NaN": (npz(t=ZEROS, a=np.array([0, np.nan, 0])), ["'a'", "nan", "row 1", "finite"]),
    "infinite": (npz(t=np.array([0, 1, -np.inf])), ["'t'", "-inf", "row 2"]),
}


@pytest.mark.parametrize(("content", "words"), BAD_CSV.values(), ids=BAD_CSV)
def test_refuses_csv(tmp_path, read_content, content, words):
    refusal(lambda: read_content(content), f"{tmp_path / 'table.csv'}:", *words)


@pytest.mark.parametrize(("content", "words"), BAD_NPZ.values(), ids=BAD_NPZ)
def test_refuses_npz(tmp_path, read_content, content, words):
    message = refusal(lambda: read_content(content, "table.npz"), f"{tmp_path / 'table.npz'}:", *words)
    assert "unsafely" not in message  # no advice to unpickle


def test_refused_archives_are_closed(read_content):
    for content, _ in BAD_NPZ.values():
        refusal(lambda content=content: read_content(content, "table.npz"))
    gc.collect()  # a file left open would be heard of here


@pytest.mark.parametrize("compressed", [False, True])
def test_a_damaged_archive_is_refused_or_read(read_content, compressed):
    good = npz(compressed, t=np.arange(40.0), a=np.sqrt(np.arange(40.0)))
    damaged = [good[:i] for i in range(0, len(good), 7)]
    damaged += [good[:i] + bytes([good[i] ^ flip]) + good[i + 1 :] for i in range(len(good)) for flip in (1, 0xFF)]

    def answer(content):
        try:
            read_content(content, "table.npz")
        except jounce.JounceError as error:
            return str(error)
        return "read"

    assert {answer(content).isprintable() for content in damaged} == {True}
    gc.collect()


LONG = "x" * 300


@pytest.mark.parametrize(
    ("name", "words"),
    [("no.csv", ["no such file"]), ("t.xls", ["'.xls'", ".csv, .npz"]), ("t", [".csv, .npz"]), (f"{LONG}.csv", [LONG])],
)
def test_refuses_to_read(tmp_path, name, words):
    refusal(lambda: tables.read(tmp_path / name), str(tmp_path / name), *words)


def test_refuses_to_read_a_directory(tmp_path):
    (tmp_path / "t.csv").mkdir()
    assert "no such file" not in refusal(lambda: tables.read(tmp_path / "t.csv"), str(tmp_path / "t.csv"))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("no/t.csv", ["no folder"]), ("file/t.csv", ["no folder"]), ("folder.csv", ["not a file"]),
        ("t.xls", ["'.xls'", ".csv, .npz"]), ("t", [".csv, .npz"]), (f"{LONG}.csv", [LONG]),
    ],
)  # fmt: skip
def test_refuses_to_write(tmp_path, name, words):
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "file").touch()
    before = sorted(tmp_path.rglob("*"))
    for call in (lambda: tables.check_writable(tmp_path / name), lambda: tables.write(tmp_path / name, COLUMNS)):
        refusal(call, str(tmp_path / name), *words)
    assert sorted(tmp_path.rglob("*")) == before


def test_writes_any_name_that_the_file_system_takes(tmp_path):
    tables.write(tmp_path / f"{'x' * 250}.csv", COLUMNS)
    assert (tmp_path / f"{'x' * 250}.csv").is_file()


class Interrupted:
    """A column whose numbers never come: Ctrl-C while a table is written."""

    def __array__(self, *_, **__):
        raise KeyboardInterrupt


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
@pytest.mark.parametrize("existing", [False, True])
@pytest.mark.parametrize("fault", ["no space", "Ctrl-C"])
def test_writing_that_fails_half_way_leaves_nothing(tmp_path, suffix, existing, fault):
    resource = pytest.importorskip("resource")
    path = tmp_path / f"table{suffix}"
    if existing:
        path.write_text("old")
    if fault == "no space":  # no file may grow beyond 9000 bytes
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (9000, before[1]))
        try:
            refusal(lambda: tables.write(path, {"t": np.arange(1e5)}), f"{path}: cannot be written: File too large")
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
    else:
        with pytest.raises(KeyboardInterrupt):
            tables.write(path, {"t": np.arange(1e5), "a": Interrupted()})
    assert list(tmp_path.iterdir()) == [path] * existing
    assert not existing or path.read_text() == "old"


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".parquet"])
def test_a_file_that_is_cut_off_while_it_is_read_is_refused(tmp_path, monkeypatch, suffix):
    """No row is lost in silence, whenever the file is cut off."""
    monkeypatch.setattr(csv, "BLOCK_BYTES", 1000)
    monkeypatch.setattr(parquet, "ROWS_PER_GROUP", 10_000)
    monkeypatch.setattr(archives, "CHUNK_BYTES", 1 << 16)
    path, t = tmp_path / f"table{suffix}", np.arange(1e5) + 0.5
    form = tables.TABLE_WRITERS[suffix]
    form.write(path, [{"t": part} for part in np.split(t, 10)], None)
    content = path.read_bytes()
    for share in (0.1, 0.6, 0.99):
        path.write_bytes(content)
        span = Span(form.spans(path, 10**9)[0].start, form.spans(path, 10**9)[-1].stop)
        chunks = form.chunks(path, ["t"], None, span)
        next(chunks)
        os.truncate(path, int(share * len(content)))
        refusal(lambda chunks=chunks: list(chunks), f"{path}:")


def test_parquet_tables_far_larger_than_their_file_are_read_by_parts(tmp_path, monkeypatch):
    path = tmp_path / "table.parquet"
    tables.write(path, COLUMNS)
    stated, size = 2 * 9 * 8, path.stat().st_size
    monkeypatch.setattr(parquet, "MAX_INFLATED_BYTES", stated - size)
    assert len(tables.read(path)["a"]) == 9
    monkeypatch.setattr(parquet, "MAX_INFLATED_BYTES", stated - size - 1)
    refusal(lambda: tables.read(path), f"{path}: 2 columns of {stated} bytes in memory; expected at most {stated - 1}")
    assert len(tables.read(path, lambda _: ["a"])["a"]) == 9
    [span] = tables.PARQUET.spans(path, 1000)
    assert len(next(tables.PARQUET.chunks(path, ["t", "a"], None, span)).columns["a"]) == 9


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".parquet", ".mat", ".jsonl"])
def test_a_motion_of_one_row_is_one_state_or_refused(tmp_path, suffix):
    """Its rates are those of the row; a single sample has none."""
    robot, path = jounce.load("planar2r"), tmp_path / f"one{suffix}"
    rates = {f"joint{j}.{name}": j + 0.1 * k
             for j in (1, 2) for k, name in enumerate(("q", "qd", "q2d"))}  # fmt: skip
    samples = {"t": 0.5, "joint1": 1.0, "joint2": 2.0}

    def write(row):
        if suffix == ".mat":
            savemat(path, row)
        elif suffix == ".jsonl":
            path.write_text(json.dumps(row))
        else:
            tables.write(path, {name: np.array([x]) for name, x in row.items()})

    write(samples)
    refusal(lambda: jounce.load_motion(path, robot), f"{path}: 1 samples")
    if suffix == ".mat":  # whose names have no points
        return
    write({"t": 0.5} | rates)
    motion = jounce.load_motion(path, robot, order=0)
    assert motion.times.tolist() == [0.5]
    assert [x.tolist() for x in motion(motion.times, 2)] == [[[1, 2]], [[1.1, 2.1]], [[1.2, 2.2]]]
