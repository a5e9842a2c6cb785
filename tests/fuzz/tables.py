"""Tables that lie: archives, MAT and Parquet files of odd kinds, shapes, sizes and headers; and what reads them.

What reads them runs in a process of its own with little memory, since a reader that trusts a file may end its process.
"""

import math
import os
import resource
import tracemalloc
from io import BytesIO
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import jounce
from fuzz.contract import refusal_or
from fuzz.mutations import hostile, raw
from jounce.io import csv, npz, parquet, tables, whole_tables
from jounce.io.table_format import Span
from support import mat_files
from support.archives import DEFLATED, Member, archive, npy_header

PLANAR = jounce.load("planar2r")
MEMORY = 1 << 33  # bytes that the process of the readers has, most of it for what libraries reserve
MOST_INFLATED = 1 << 19  # bytes that compressed columns may take here
PEAK = 1 << 24  # bytes that a reader takes of a small file: little more than chunks and what is inflated
NAMES = ("t", "joint1", "joint2", "joint1.q", "joint2.qd", "motion", "t.npy", "a", "t")
KINDS = (
    "'<f8'", "'<f8'", "'>f8'", "'<f4'", "'<f2'", "'<f16'", "'<i8'", "'>u2'", "'|u1'", "'|b1'", "'|O'", "'|V8'",
    "'|V0'", "'<U3'", "'>U2'", "'<U0'", "'|S2'", "'|S0'", "'<c16'", "'<M8[s]'", "'<m8'", "'<U1000000000'", "'<U999'",
    "'T'", "'f'", "[('a', '<f8'), ('b', '<U2')]", "[('a', '<f8'), ('b', '|O')]", "[('a', '<f8', (2,))]",
    "[('a', [('b', '<f8')])]", "[('', '|V4'), ('t', '<f8')]", "[('a', '<f8'), ('a', '<f8')]", "[]", "('<f8', (3,))",
    "(('t', 'a'), '<f8')", "[('a', '<f8', (1000000000,))]", "[(('x', 't'), '<f8')]", "None", "1",
)  # fmt: skip
SHAPES = (
    "(3,)", "(3,)", "(3,)", "(3,1)", "(1,3)", "(3,2)", "(2,3)", "(1,)", "(1,1)", "()", "(0,)", "(0,3)", "(3,0)",
    "(-3,)", "(-3,-1)", "(3,2,2)", "(0,1000000000000)", "(True,)", "(4611686018427387904,)", "(4611686018427387904,4)",
    "3", "None", "(3.0,)", "(99999,)", "(2,99999)", "(1" + "0" * 300 + ",)", "(" + "1," * 70 + ")", "((3,),)",
)  # fmt: skip
SIZES = {"'<f8'": 8, "'>f8'": 8, "'<f4'": 4, "'<f2'": 2, "'<f16'": 16, "'<i8'": 8, "'>u2'": 2, "'<U3'": 12, "'>U2'": 8,
         "'|S2'": 2, "'|V8'": 8, "'<c16'": 16, "'<M8[s]'": 8, "'|O'": 8}  # fmt: skip
LENGTHS = (0, 1, 24, 2**16, 2**31 - 1, 2**32 - 1)  # that are stated in place of the true ones


def lying_archive(rng):
    """An NPZ file of one to four members, each with up to two lies."""
    content = archive(*(_member(rng, number) for number in range(rng.choice((1, 1, 1, 2, 3, 4)))))
    return raw(rng, content) if rng.random() < 0.1 else content


def _member(rng, number):
    kind, shape = rng.choice(KINDS), rng.choice(SHAPES)
    if rng.random() < 0.5:
        kind, shape = "'<f8'", rng.choice((*["(3,)"] * 9, "(99999,)"))
    fortran = rng.choice((*["False"] * 9, *["True"] * 9, "1", "'no'"))
    text = f"{{'descr': {kind}, 'fortran_order': {fortran}, 'shape': {shape}}}"
    if rng.random() < 0.1:
        i = rng.randrange(len(text))
        text = (
            text[:i]
            + rng.choice((hostile(rng), "-" * 9000, "(" * 9000, " " * 11_000, " " * 20_000, ""))
            + text[i + 1 :]
        )
    head = npy_header(f"{text}\n", rng.choice(((1, 0), (1, 0), (2, 0), (3, 0))))
    about = {
        "method": rng.choice((0, 0, DEFLATED)),
        **dict(rng.sample([
            ("size", rng.choice(LENGTHS)), ("packed_size", rng.choice(LENGTHS)), ("checksum", 7),
            ("flags", rng.choice((1, 8, 32, 64, 2048))), ("at", rng.randint(0, number)),
            ("method", rng.choice((1, 9, 12, 14, 93, 99))),
        ], rng.choice((*[0] * 9, 1, 2)))),
    }  # fmt: skip
    name = rng.choice(NAMES) if rng.random() < 0.95 else hostile(rng)[:1000]
    return Member(f"{name}.npy", head + _array_bytes(rng, kind, shape), **about)


def _array_bytes(rng, kind, shape):
    """As many bytes as the header states, most often, if these are few."""
    size, lengths = 24, [length for length in shape.strip("(),").split(",") if length]
    if rng.random() < 0.9 and kind in SIZES and len(shape) < 10 and all(map(str.isdigit, lengths)):
        size = SIZES[kind] * math.prod(map(int, lengths))
    if size > MOST_INFLATED and rng.random() < 0.5:
        size = 24
    return rng.choice((bytes(size), b"\xff" * size, np.arange(size // 8 + 1.0).tobytes()[:size]))


def lying_mat(rng):
    """A MAT file with arrays of any class, shape and size, at any depth."""
    order = rng.choice("<>")
    arrays = [mat_files.array(order, mat_files.DOUBLE, (5, 1), b"t", mat_files.number_element(order, np.arange(5.0)))]
    for _ in range(rng.randint(0, 3)):
        found = _mat_array(rng, order, rng.choice((b"x", b"t", b"joint1", b"", b"y" * 3000)), 0)
        if rng.random() < 0.5:
            stated = rng.choice((None, None, *LENGTHS))
            found = mat_files.packed(order, found, stated)
        arrays.append(found)
    content = mat_files.mat_file(order, *arrays)
    return raw(rng, content) if rng.random() < 0.3 else content


def _mat_array(rng, order, name, depth):
    if depth < 3 and rng.random() < 0.3:
        return mat_files.structure(order, _mat_array(rng, order, b"", depth + 1))
    kind = rng.choice((mat_files.DOUBLE, mat_files.DOUBLE, *range(20)))
    shape = rng.choice(((5, 1), (5, 1), (1, 5), (5, 2), (0, 0), (-5, 1), (2**31 - 1, 1), (2**20, 2**10), (10**5, 1)))
    size = rng.choice((None, None, None, *LENGTHS))
    return mat_files.array(
        order, kind, shape, name, mat_files.number_element(order, np.arange(5.0 * rng.choice((1, 2))), size)
    )


def lying_parquet(rng):
    """A Parquet file with columns of any type, damaged in its bytes."""
    columns = {"t": pa.array(np.arange(5.0))}
    for _ in range(rng.randint(0, 3)):
        columns[rng.choice(("joint1", "joint2", "motion", "a"))] = rng.choice((
            pa.array(np.arange(5)), pa.array([1.0, None, 2, 3, 4]), pa.array(["a", "b", None, "c", "d"]),
            pa.array(["a"] * 5).dictionary_encode(), pa.array([[1.0], [], None, [2.0], [3.0]]), pa.array([True] * 5),
            pa.array([{"t": 1.0}] * 5), pa.array([b"\xff"] * 5), pa.nulls(5), pa.array([10**30] * 5, pa.decimal128(38)),
        ))  # fmt: skip
    file = BytesIO()
    pq.write_table(pa.table(columns), file, compression=rng.choice(("none", "snappy", "zstd", "gzip")))
    content = file.getvalue()
    for _ in range(rng.randint(0, 3)):
        content = raw(rng, content)
    return content


LYING = {".npz": lying_archive, ".mat": lying_mat, ".parquet": lying_parquet}


def prepare():
    """Set up the process of the readers, with what it imports: its memory is no reader's."""
    rng = Random(0)
    with TemporaryDirectory() as folder:
        for suffix, make in LYING.items():
            path = Path(folder, f"table{suffix}")
            for _ in range(20):
                path.write_bytes(make(rng))
                refusal_or(jounce.load_motion, path, PLANAR, order=0)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    for module in (npz, whole_tables, parquet):
        module.MAX_INFLATED_BYTES = MOST_INFLATED
    npz.MAX_COLUMNS = 1000
    csv.BLOCK_BYTES = 1000


def check_lying(path):
    """What is read of a table is what NumPy reads, the same by rows, and takes little memory."""
    tracemalloc.start()
    try:
        whole = refusal_or(tables.read_rows, path)
        refusal_or(jounce.load_motion, path, PLANAR, order=0)
        if path.suffix in tables.ROW_FORMATS:
            by_rows = refusal_or(_read_by_rows, path, None if whole is None else list(whole.columns))
            if whole is not None and by_rows is not None:
                for name, cells in whole.columns.items():
                    assert np.array_equal(cells, by_rows[name], equal_nan=True), name
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < PEAK + 4 * path.stat().st_size, f"{peak / 1e6:.3g} MB of a file of {path.stat().st_size} bytes"
    is_archive = path.suffix == ".npz" and path.read_bytes().startswith(b"PK")  # by which NumPy knows one
    if is_archive and whole is not None:
        check_as_numpy(path, whole.columns)


def _read_by_rows(path, names):
    form = tables.ROW_FORMATS[path.suffix]
    npz.CHUNK_BYTES = max(16, path.stat().st_size // 100)  # some rows of a small file, and not too many chunks
    types = form.columns(path)
    names = [name for name in types if not types[name]] if names is None else names
    found = [
        chunk
        for span in form.spans(path, path.stat().st_size // 100 + 10)
        for chunk in form.chunks(path, names, None, span)
    ]
    for text in types:  # also where they are numbers, or nothing that is read
        refusal_or(lambda text=text: [list(form.chunks(path, [], text, span)) for span in form.spans(path, 10**6)])
    if not found:  # a table without rows
        return None
    return {name: np.concatenate([chunk.columns[name] for chunk in found]) for name in names}


def check_as_numpy(path, columns):
    """Columns are the arrays that NumPy reads, or their columns and fields."""
    expected, ambiguous = {}, set()
    with np.load(path, allow_pickle=False) as arrays:
        for name in arrays.files:
            array = arrays[name]
            if name in arrays.zip.namelist():  # beside name.npy there is name, which NumPy returns for both
                ambiguous.add(name)
            fields = {name: array} if array.dtype.names is None else {of: array[of] for of in array.dtype.names}
            for of, x in fields.items():
                expected |= {of: x.reshape(-1)} if x.ndim == 1 or 1 in x.shape[:2] else {}
                expected |= {f"{of}[{j}]": x[:, j] for j in range(x.shape[1])} if x.ndim == 2 else {}
    for name in columns.keys() - ambiguous:
        assert np.array_equal(columns[name], expected[name].astype(float), equal_nan=True), name


def check_changing(path, changed, share):
    """Rows of a table that changes while it is read are those that it had, or it is refused in one line.

    After a part of the rows, the file becomes that with the bytes `changed`, which begin as the file does.
    """
    form = tables.ROW_FORMATS[path.suffix]
    npz.CHUNK_BYTES = 1000
    spans = form.spans(path, 10**9)
    expected = np.concatenate([chunk.columns["t"] for span in spans for chunk in form.chunks(path, ["t"], None, span)])
    chunks = form.chunks(path, ["t"], None, Span(spans[0].start, spans[-1].stop))
    found, wanted = [next(chunks)], share * len(expected)

    def rest():
        while sum(len(chunk.columns["t"]) for chunk in found) < wanted:
            found.append(next(chunks))
        os.truncate(path, min(len(changed), path.stat().st_size))
        with path.open("r+b") as file:
            file.seek(0, os.SEEK_END)
            file.write(changed[file.tell() :])
        return np.concatenate([chunk.columns["t"] for chunk in [*found, *chunks]])

    rows = refusal_or(rest)
    assert rows is None or np.array_equal(rows, expected)
