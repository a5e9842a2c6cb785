"""MAT tables: what a file states of its sizes is judged before it is read."""

from io import BytesIO
from struct import pack

import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import csc_array

import jounce
from jounce.io import tables, whole_tables
from support.mat_files import (
    CELLS,
    DOUBLE,
    STRUCTURE,
    TEXT,
    array,
    element,
    mat_file,
    number_element,
    packed,
    structure,
)
from support.refusals import refusal

T = np.arange(5.0)


@pytest.fixture(params=["<", ">"])
def order(request):
    return request.param


@pytest.fixture
def mat_table(tmp_path, order):
    def write(*arrays):
        path = tmp_path / "table.mat"
        good = array(order, DOUBLE, (5, 1), b"t", number_element(order, T))
        path.write_bytes(mat_file(order, good, *arrays))
        return path

    return write


def test_what_is_written_here_is_a_mat_file(mat_table, order):
    field = array(order, DOUBLE, (5, 1), b"", number_element(order, 2 * T))
    path = mat_table(
        packed(order, array(order, DOUBLE, (5, 1), b"x", number_element(order, 3 * T))), structure(order, field)
    )
    found = tables.read(path)
    assert {name: x.tolist() for name, x in found.items()} == {
        "t": T.tolist(), "x": (3 * T).tolist(), "s.field": (2 * T).tolist(),
    }  # fmt: skip


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("inner", [False, True])
@pytest.mark.parametrize(("kind", "shape", "size", "word"), [
    (DOUBLE, (2**31 - 1, 1), None, "cells in an array"),
    (DOUBLE, (5, 1), 0xFFFFFFF0, "within an array"),
    (CELLS, (2**31 - 1, 1), None, "cells in an array"),
    (TEXT, (2**31 - 1, 1), 0, "cells in an array"),
    (STRUCTURE, (2**20, 2**10), None, "cells in an array"),
])  # fmt: skip
def test_arrays_that_lie_of_their_size_are_refused(mat_table, order, kind, shape, size, word, inner, compressed):
    lie = array(order, kind, shape, b"" if inner else b"x", number_element(order, T, size))
    lie = structure(order, lie) if inner else lie
    path = mat_table(packed(order, lie) if compressed else lie)
    refusal(lambda: tables.read(path, lambda _: ["t"]), f"{path}: not a MAT file:", word)


def test_compressed_variables_are_inflated_within_a_bound(mat_table, order, monkeypatch):
    path = mat_table(packed(order, array(order, DOUBLE, (100, 1), b"x", number_element(order, np.zeros(100)))))
    stated = len(array(order, DOUBLE, (100, 1), b"x", number_element(order, np.zeros(100)))) - 8
    monkeypatch.setattr(whole_tables, "MAX_INFLATED_BYTES", stated)
    assert "t" in tables.read(path, lambda _: ["t"])
    monkeypatch.setattr(whole_tables, "MAX_INFLATED_BYTES", stated - 1)
    refusal(lambda: tables.read(path), f"{path}: compressed variables of {stated} bytes", str(stated - 1), "-v6")


@pytest.mark.parametrize("stated", [0, 100, 10**6])
def test_a_variable_of_other_bytes_than_it_states_is_refused(mat_table, order, stated):
    path = mat_table(
        packed(order, array(order, DOUBLE, (100, 1), b"x", number_element(order, np.zeros(100))), stated=stated)
    )
    refusal(lambda: tables.read(path), f"{path}: not a MAT file", f"has not the {stated} bytes")


@pytest.mark.parametrize("compressed", [False, True])
def test_a_motion_of_one_row_is_read(tmp_path, compressed):
    path = tmp_path / "one.mat"
    savemat(path, {"t": 0.5, "q": np.array([[2.0]]), "s": {"a": 3}, "word": "text"}, do_compression=compressed)
    assert {name: x.tolist() for name, x in tables.read(path).items()} == {"t": [0.5], "q": [2], "s.a": [3]}
    savemat(path, {"t": T, "rate": 1000.0}, do_compression=compressed)
    assert list(tables.read(path)) == ["t"]


@pytest.mark.parametrize("compressed", [False, True])
def test_numbers_of_all_kinds_are_columns(tmp_path, compressed):
    """Of any size, those of one and of none among them."""
    path = tmp_path / "table.mat"
    kinds = [f"{sign}int{8 << k}" for sign in ("", "u") for k in range(4)] + ["float32", "float64", "bool"]
    columns = {kind: (np.arange(5) % 2).astype(kind) for kind in kinds}
    savemat(path, columns, do_compression=compressed)
    found = tables.read(path)
    assert {name: x.tolist() for name, x in found.items()} == {kind: [0, 1, 0, 1, 0] for kind in kinds}
    assert {x.dtype for x in found.values()} == {np.dtype(float)}
    wide = {"a": np.arange(10, dtype="u1").reshape(5, 2), "t": T, "one": np.uint8(3), "none": np.zeros((0, 0))}
    savemat(path, wide | {"s": {"none": np.zeros((0, 3))}}, do_compression=compressed)
    found = tables.read(path, lambda names: [name for name in names if name in ("a[0]", "a[1]", "t")])
    assert {name: x.tolist() for name, x in found.items()} == {
        "a[0]": [0, 2, 4, 6, 8], "a[1]": [1, 3, 5, 7, 9], "t": T.tolist(),
    }  # fmt: skip


def test_a_tag_without_an_element_is_refused(mat_table, order):
    path = mat_table()
    path.write_bytes(path.read_bytes() + pack(f"{order}2I", 14, 80))
    size = path.stat().st_size
    refusal(lambda: tables.read(path), f"{path}: not a MAT file: it has {size} bytes; expected {size + 80}")


def test_files_of_version_4_are_read(tmp_path):
    path = tmp_path / "table.mat"
    savemat(path, {"t": T, "a": np.stack([T, -T], axis=1)}, format="4")
    assert {name: x.tolist() for name, x in tables.read(path).items()} == {
        "t": T.tolist(), "a[0]": T.tolist(), "a[1]": (-T).tolist(),
    }  # fmt: skip


@pytest.mark.parametrize(("cells", "refused"), [(5, False), (88, False), (89, True), (2**31 - 1, True)])
def test_shapes_of_one_length_are_judged(mat_table, order, cells, refused):
    """A length of four bytes stands in the tag of its element."""
    flags = element(order, 6, pack(f"{order}2I", DOUBLE, 0))
    shape, name = pack(f"{order}Ii", 5 | 4 << 16, cells), element(order, 1, b"x")
    path = mat_table(element(order, 14, flags + shape + name + number_element(order, T)))
    if refused:
        refusal(lambda: tables.read(path, lambda _: ["t"]), f"{path}: not a MAT file: {cells} cells in an array of 88")
    else:
        whole_tables._check_array(memoryview(flags + shape + name + number_element(order, T)), order)


@pytest.mark.parametrize(("kind", "coding"), [(4, "utf-16"), (16, "utf-8"), (17, "utf-16"), (18, "utf-32")])
def test_texts_of_any_coding_are_left_alone(mat_table, order, kind, coding):
    content = "word".encode(f"{coding}-{'le' if order == '<' else 'be'}" if coding != "utf-8" else coding)
    path = mat_table(array(order, TEXT, (1, 4), b"x", element(order, kind, content)))
    assert list(tables.read(path)) == ["t"]


@pytest.mark.parametrize("kind", [0, 8, 10, 11, 14, 15, 19])
def test_elements_that_hold_no_numbers_are_refused(mat_table, order, kind):
    path = mat_table(array(order, DOUBLE, (5, 1), b"x", element(order, kind, T.tobytes())))
    refusal(lambda: tables.read(path, lambda _: ["t"]), f"an element of type {kind} within an array of class 6")


def test_an_array_that_begins_with_another_element_is_refused(mat_table, order):
    path = mat_table(element(order, 14, element(order, 8, T.tobytes())))
    refusal(lambda: tables.read(path, lambda _: ["t"]), "an element of type 8 within an array of class 0")


def test_what_is_no_column_is_left_alone(tmp_path):
    path = tmp_path / "table.mat"
    kinds = {"sparse": csc_array((1000, 1000)), "s": {"sparse": csc_array((1000, 1000)), "cells": [T, "x"]}}
    for compressed in (False, True):
        savemat(path, {"t": T, "x": T + 1j, "word": "x", "cells": np.array([T, "x"], object)} | kinds,
                do_compression=compressed)  # fmt: skip
        assert list(tables.read(path, lambda _: ["t"])) == ["t"]


def test_variables_of_one_name_are_refused(mat_table, order):
    path = mat_table(array(order, DOUBLE, (5, 1), b"t", number_element(order, -T)))
    refusal(lambda: tables.read(path), "'t' occurs 2 times")


@pytest.mark.parametrize(("of_class", "given"), [(5, 0), (5, 1), (5, 2), (6, 0), (6 | 0x800, 1)])
def test_arrays_that_lack_elements_are_refused(tmp_path, of_class, given):
    """Sparse ones have three elements of numbers, complex ones two: SciPy takes what follows, and crashes."""

    def element(kind, content):
        return pack("<2I", kind, len(content)) + content + bytes(-len(content) % 8)

    head = element(6, pack("<2I", of_class, 0)) + element(5, pack("<2i", 1, 1)) + element(1, b"a")
    variable = element(14, head + given * element(9, pack("<d", 1.0)))
    path = tmp_path / "table.mat"
    path.write_bytes(b" " * 124 + pack("<H", 0x0100) + b"IM" + 2 * variable)
    refusal(lambda: tables.read_rows(path), "elements within an array of class")


def test_files_that_are_cut_off_are_refused(tmp_path):
    file, path = BytesIO(), tmp_path / "table.mat"
    savemat(file, {"t": T, "s": {"a": T}}, do_compression=True)
    content = file.getvalue()

    def answer(end):
        path.write_bytes(content[:end])
        try:
            return sorted(tables.read(path))
        except jounce.JounceError as error:
            return str(error)

    answers = [answer(end) for end in range(0, len(content), 5)]
    assert all(isinstance(found, list) or found.isprintable() for found in answers)
    assert [found for found in answers if isinstance(found, list) and not set(found) <= {"t", "s.a"}] == []
