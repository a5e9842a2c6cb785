"""NPZ tables: what an archive states is judged before it is used, and no archive ends the process."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import jounce
from jounce.io import npz, tables
from jounce.io.table_format import Span
from jounce.spatial.series import rate_name
from support.archives import DEFLATED, Member, archive, npy, npy_header
from support.refusals import refusal, refused

ZEROS = np.zeros(3)
ROBOT = jounce.load("planar2r")


class Trap:
    """An object that makes a file when it is read from a pickle."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def column(name, content, **about):
    return Member(f"{name}.npy", content if isinstance(content, bytes) else npy(content), **about)


@pytest.fixture
def write(tmp_path):
    def write(*members):
        path = tmp_path / "table.npz"
        path.write_bytes(archive(*members))
        return path

    return write


def state_columns(rows):
    """All rates of a motion."""
    t = np.arange(rows) / 100
    found = {"t": t}
    for j, joint in enumerate(ROBOT.joint_names):
        found |= {f"{joint}.{rate_name('q', k)}": (2 + j) ** k * np.cos((2 + j) * t + k * np.pi / 2) for k in range(5)}
    return found


def by_rows(path, names, texts=None):
    [span] = tables.NPZ.spans(path, 10**9)
    parts = list(tables.NPZ.chunks(path, names, texts, span))
    cells = {name: np.concatenate([part.columns[name] for part in parts]) for name in names}
    return cells if texts is None else (cells, np.concatenate([part.motions for part in parts]))


NO_NUMBERS = {
    "objects": (np.array([1.0, "x", None], object), "Python objects"),
    "void": (np.zeros(3, "V8"), "|V8"),
    "nothing": (npy_header("{'descr': '|V0', 'fortran_order': False, 'shape': (3,)}\n"), "|V0"),
    "a record of records": (np.zeros(3, [("x", [("y", float)])]), "[('y', '<f8')]"),
    "objects in a record": (np.zeros(3, [("x", float), ("y", object)]), "Python objects"),
    "complex": (1j * ZEROS, "complex128"),
    "Booleans": (ZEROS > 1, "bool"),
    "dates": (ZEROS.astype("M8[s]"), "datetime64[s]"),
}
NO_TEXTS = {
    "code points": (npy(np.zeros(3, "<U2"))[:-24] + 6 * b"\xff\xff\xff\xff", "code points"),
    "the next code point": (npy(np.zeros(3, "<U1"))[:-12] + 3 * b"\0\0\x11\0", "code points"),
    "bytes": (np.full(3, b"\xff"), "ascii"),
    "texts without length": (npy_header("{'descr': '<U0', 'fortran_order': False, 'shape': (3,)}\n"), "<U0"),
}


@pytest.mark.parametrize("method", [0, DEFLATED])
@pytest.mark.parametrize(("content", "word"), NO_NUMBERS.values(), ids=NO_NUMBERS)
def test_columns_of_other_kinds_are_refused_and_may_be_left_alone(write, content, word, method):
    path = write(column("t", ZEROS), column("a", content, method=method))
    name = next(name for name in tables.NPZ.names(path) if name != "t")
    place = f"{path}: column {name!r} holds"
    refusal(lambda: tables.read(path), place, word)
    refusal(lambda: by_rows(path, ["t", name]), place, word)
    refusal(lambda: tables.NPZ.check_numbers(path, [name]), place, word)
    refusal(lambda: by_rows(path, ["t"], name), place, word)
    assert by_rows(path, ["t"])["t"].tolist() == [0, 0, 0]
    assert list(tables.read(path, lambda _: ["t"])) == ["t"]


@pytest.mark.parametrize("method", [0, DEFLATED])
@pytest.mark.parametrize(("content", "word"), NO_TEXTS.values(), ids=NO_TEXTS)
def test_texts_that_are_none_are_refused(write, content, word, method):
    path = write(column("t", ZEROS), column("motion", content, method=method))
    refusal(lambda: by_rows(path, ["t"], "motion"), f"{path}: column 'motion' holds", word)


@pytest.mark.parametrize(
    "texts",
    [
        np.array(["a", "b\u0142", "\U0001f916\U0010ffff"]),
        np.array(["a", "b", "c"], ">U7"),
        np.array([b"x", b"", b"yz"]),
    ],
)
def test_texts_are_read_in_any_byte_order(write, texts):
    path = write(column("motion", texts), column("t", ZEROS))
    assert by_rows(path, ["t"], "motion")[1].tolist() == texts.astype(str).tolist()


def test_names_of_motions_in_an_array_of_objects_are_refused_by_run(tmp_path, write):
    columns = state_columns(60) | {"motion": np.array(["x"] * 60, object)}
    path = write(*(column(name, x) for name, x in columns.items()))
    words = "column 'motion' holds Python objects", "column.astype(str)"
    refused(tmp_path, f"run planar2r {path} -o out", *words)


@pytest.mark.parametrize("suffix", [".npz", ".npy", ".mat"])
def test_no_object_of_a_file_is_made(tmp_path, write, suffix):
    made = tmp_path / "made"
    path = write(column("t", ZEROS), column("a", np.array([Trap(made)] * 3, object))).replace(tmp_path / f"t{suffix}")
    refusal(lambda: tables.read(path))
    refusal(lambda: jounce.load_motion(path, ROBOT))
    assert not made.exists()


def lying(**about):
    return column("a", ZEROS, **about)


HEADER = "{{'descr': '<f8', 'fortran_order': False, 'shape': {}}}\n"
LIES = {
    "a shape beyond the member": (column("a", npy_header(HEADER.format("(10**9,)".replace("10**9", "1" + 30 * "0")))),
                                  "ends too early"),
    "a negative shape": (column("a", npy_header(HEADER.format("(-3,)")) + bytes(24)), "negative"),
    "cells that are arrays": (column("a", npy_header("{'descr': ('<f8', (2,)), 'fortran_order': False, 'shape': (2,)}")
                                     + bytes(32)), "no arrays"),
    "a product of negative lengths": (column("a", npy_header(HEADER.format("(-3, -1)")) + bytes(24)), "negative"),
    "a shape below the member": (column("a", npy_header(HEADER.format("(2,)")) + bytes(24)), "more follows"),
    "a longer header": (column("a", b"\x93NUMPY\2\0\xff\xff\xff\x7f" + bytes(99_999), method=DEFLATED), "array header"),
    "a larger stored size": (lying(size=10**6), "expected"),
    "a larger inflated size": (lying(size=10**6, method=DEFLATED), "more follows"),
    "a smaller inflated size": (lying(size=150, method=DEFLATED), "CRC"),
    "a size that its header states too": (column("a", npy_header(HEADER.format("(3,)")), size=90, method=DEFLATED),
                                          "ends before its last cell"),
    "a larger stored member": (lying(size=10**6, packed_size=10**6), "larger than the file"),
    "a member at the place of another": (lying(at=0), "differ"),
    "encryption": (lying(flags=1), "encrypted"),
    "another compression": (lying(method=12), "compression 12"),
    "another checksum": (lying(checksum=7), "CRC"),
}  # fmt: skip


@pytest.mark.parametrize(("member", "word"), LIES.values(), ids=LIES)
def test_archives_that_lie_are_refused(write, member, word):
    path = write(column("t", ZEROS), member)
    refusal(lambda: tables.read(path), f"{path}: not an NPZ table:", word)
    if word != "CRC":  # which is of a member as a whole
        refusal(lambda: by_rows(path, ["t", "a"]), word)


def test_an_array_of_more_columns_than_a_table_has_is_refused(write):
    for more, too_many in ((2**16 - 1, False), (2**16, True)):
        path = write(column("t", np.zeros(2)), column("a", np.zeros((2, more), np.int8), method=DEFLATED))
        if too_many:
            refusal(lambda path=path: tables.NPZ.names(path), "more than 65536 columns")
        else:
            assert len(tables.NPZ.names(path)) == 2**16
    for kind, shape in (("<f8", "(0, 1000000000000)"), ("|O", "(2, 1000000000000)")):
        head = npy_header(f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}}}")
        path = write(column("t", np.zeros(2)), column("a", head))
        refusal(lambda path=path: tables.read(path), "column 'a'", shape)


@pytest.mark.parametrize("kind", ["|O", "T", "<U0", "|V0", "<f8"])
def test_rows_are_counted_in_columns_whose_sizes_are_judged(write, kind):
    """A list of the spans of all rows that a header states would fill the memory."""
    head = npy_header(f"{{'descr': '{kind}', 'fortran_order': False, 'shape': ({2**28},)}}")
    lie = column("a", head, size=len(head) + 2**31, method=DEFLATED) if kind == "<f8" else column("a", head)
    path = write(lie)
    word = f"compressed columns of {2**31} bytes" if kind == "<f8" else "no columns of numbers"
    refusal(lambda: tables.NPZ.spans(path, 1), f"{path}: {word}")
    if kind != "<f8":
        path = write(lie, column("t", ZEROS))
        assert tables.NPZ.spans(path, 10) == [Span(0, 3)]


def test_nothing_is_inflated_before_names_and_sizes_are_judged(write, monkeypatch):
    path = write(column("t", np.arange(4e6), method=DEFLATED), column("other", np.zeros(4_000_000), method=DEFLATED))
    tracemalloc.start()
    refusal(lambda: jounce.load_motion(path, ROBOT), "joint1")
    monkeypatch.setattr(npz, "MAX_INFLATED_BYTES", 32_000_000 - 1)
    for read in (lambda: tables.read(path, lambda _: ["t"]), lambda: by_rows(path, ["t"])):
        refusal(read, "compressed columns of 32000000 bytes; expected at most 31999999", "numpy.savez")
    assert tracemalloc.get_traced_memory()[1] < 4e6
    tracemalloc.stop()
    monkeypatch.setattr(npz, "MAX_INFLATED_BYTES", 32_000_000)
    for read in (lambda: tables.read(path, lambda _: ["t"]), lambda: by_rows(path, ["t"])):
        assert read()["t"].sum() == np.arange(4e6).sum()


@pytest.mark.parametrize("rows", [1, 2, 100])
@pytest.mark.parametrize("method", [0, DEFLATED])
@pytest.mark.parametrize("chunk", [1, 300, 10**6])
def test_cells_are_those_of_the_array_in_any_layout(write, monkeypatch, rows, method, chunk):
    monkeypatch.setattr(npz, "CHUNK_BYTES", chunk)
    a = np.random.default_rng(rows).normal(size=(rows, 3))
    arrays = {
        "half": a[:, 0].astype("f2"), "big": a[:, 1].astype(">f8"), "long": a[:, 0].astype("g"),
        "count": np.arange(rows, dtype="u8"), "down": a[:, :1], "across": a[:, :1].T,
    }  # fmt: skip
    expected = {name: array.ravel() for name, array in arrays.items()}
    records = np.zeros(rows, [("n\u0142", "<i2"), ("p", ">f4", 2), ("v", "<f8")])
    records["n\u0142"], records["p"], records["v"] = np.arange(rows), a[:, :2], a[:, 2]
    arrays["records"] = records
    expected |= {"n\u0142": np.arange(rows), "v": a[:, 2]} | {f"p[{j}]": a[:, j].astype("f4") for j in range(2)}
    if rows > 1:  # an array (1, 3) is a vector, as MATLAB has it
        arrays |= {"c": a, "f": np.asfortranarray(a)}
        expected |= {f"{name}[{j}]": a[:, j] for name in "cf" for j in range(3)}
    path = write(*(column(name, array, method=method) for name, array in arrays.items()))
    assert set(tables.NPZ.names(path)) == set(expected)
    for found in (tables.read(path), by_rows(path, list(expected))):
        for name, cells in expected.items():
            assert found[name].dtype == float
            assert np.array_equal(found[name], cells.astype(float)), name


def test_no_object_is_written(tmp_path):
    with pytest.raises(ValueError, match="Object arrays cannot be saved"):
        tables.NPZ.write(tmp_path / "t.npz", [{"a": np.array([None])}])


@pytest.mark.parametrize("shape", [(0, 1), (1, 0), (0, 0), (0,)])
def test_columns_of_no_cells_are_refused_and_may_be_left_alone(write, shape):
    path = write(column("t", ZEROS), column("a", np.zeros(shape)))
    refusal(lambda: tables.read(path), "column 'a' holds float64 of shape (0", "expected numbers of shape (3,)")
    assert list(tables.NPZ.names(path)) == ["t"] == list(tables.read(path, lambda _: ["t"]))
    refusal(lambda: tables.read(write(column("a", np.zeros(shape)))), "no columns or no rows")


def test_a_file_that_grows_while_it_is_read_keeps_its_rows(write, monkeypatch):
    monkeypatch.setattr(npz, "CHUNK_BYTES", 1 << 17)
    path = write(column("t", np.arange(1e5)))
    chunks = tables.NPZ.chunks(path, ["t"], None, Span(0, 100_000))
    first = next(chunks)
    with path.open("ab") as file:
        file.write(bytes(10**6))
    found = np.concatenate([chunk.columns["t"] for chunk in [first, *chunks]])
    assert np.array_equal(found, np.arange(1e5))


def test_a_table_with_fewer_rows_than_when_it_was_divided_is_refused(write):
    path = write(column("t", ZEROS))
    [span] = tables.NPZ.spans(path, 10)
    write(column("t", np.zeros(2)))
    refusal(lambda: list(tables.NPZ.chunks(path, ["t"], None, span)), "lost rows", "expected 3")
