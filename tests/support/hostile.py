"""Values that no argument was meant for."""

from collections.abc import Callable
from datetime import datetime, timedelta
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import sympy

import casadi


class Malicious:
    """What raises whatever is asked of it."""

    def _raise(self, *_: object) -> Any:
        raise ZeroDivisionError("first line\nsecond line")

    __repr__ = __str__ = __eq__ = __hash__ = __bool__ = __len__ = __iter__ = __array__ = __fspath__ = __float__ = _raise
    __getitem__ = __lt__ = __index__ = __contains__ = keys = _raise


def endless() -> list[Any]:
    """A list that holds itself."""
    rows: list[Any] = []
    rows.append(rows)
    return rows


FRAME = pd.DataFrame({"joint1": [1.0, None], "joint2": ["x", 2]})  # takes as long to make as to be refused
FRAME_OF_TWICE = pd.DataFrame([[1.0, 2.0]], columns=["joint1", "joint1"])
FRAME_OF_INDICES = pd.DataFrame([[1.0]], columns=pd.MultiIndex.from_tuples([("a", "b")]))
CATEGORIES = pd.Categorical(["x", "y"])

HOSTILE: dict[str, Callable[[], Any]] = {
    "None": lambda: None,
    "object": object,
    "malicious": Malicious,
    "type": lambda: int,
    "function": lambda: lambda: 0,
    "ellipsis": lambda: ...,
    "not implemented": lambda: NotImplemented,
    "module": lambda: np,
    "text": lambda: "x",
    "empty text": lambda: "",
    "lines": lambda: "a\nb\x1b[31m\u202e\udc80\ud800",
    "zero byte": lambda: "a\0.urdf",
    "long text": lambda: "x" * 5_000,
    "bytes": lambda: b"x",
    "bytearray": lambda: bytearray(8),
    "nan": lambda: np.nan,
    "inf": lambda: -np.inf,
    "-1": lambda: -1,
    "7": lambda: 7,
    "1.5": lambda: 1.5,
    "True": lambda: True,
    "10**400": lambda: 10**400,
    "10**5000": lambda: -(10**5000),
    "1j": lambda: 1j,
    "numpy bool": lambda: np.True_,
    "numpy int": lambda: np.int8(1),
    "numpy float": lambda: np.float16(1),
    "numpy complex": lambda: np.complex64(1j),
    "fraction": lambda: Fraction(1, 3),
    "decimal": lambda: Decimal("0.1"),
    "date": lambda: datetime(2024, 1, 1),
    "duration": lambda: timedelta(1),
    "empty list": list,
    "empty tuple": tuple,
    "empty dict": dict,
    "set": lambda: {1},
    "frozen set": lambda: frozenset({"x"}),
    "range": lambda: range(2),
    "generator": lambda: (x for x in "ab"),
    "iterator": lambda: iter([1.0, 2.0]),
    "memory": lambda: memoryview(b"12345678"),
    "ragged": lambda: [[1.0, 2.0], [3.0]],
    "ragged and deep": lambda: [[1.0], [[2.0], "x"]],
    "endless": endless,
    "deep tuples": lambda: ((1, (2, (3,))), ((),)),
    "lists of nothing": lambda: [[], []],
    "Nones": lambda: [None, None],
    "dicts": lambda: [{}, {}],
    "sets": lambda: [{1}, {2}],
    "lists": lambda: [["x"], ["y"]],
    "texts": lambda: ["x", "y"],
    "huge numbers": lambda: [10**400, 10**400],
    "huge and symbolic": lambda: [10**400, sympy.Symbol("x")],
    "CasADi's MX": lambda: casadi.MX.sym("x", 2),
    "complex numbers": lambda: [1j, 2.0],
    "decimals": lambda: [Decimal(1), Decimal(2)],
    "two": lambda: [1.0, 2.0],
    "malicious ones": lambda: [Malicious(), Malicious()],
    "dict of lists": lambda: {"joint1": [1.0, 2.0], "joint2": [1.0, 2.0, 3.0]},
    "dict of nothing": lambda: {"joint1": None, "body1": {}},
    "dict by numbers": lambda: {1: 2, None: 3},
    "dict by tuples": lambda: {("a", "b"): [1]},
    "array of none": lambda: np.zeros(0),
    "array of one": lambda: np.zeros(()),
    "array": lambda: np.ones(2),
    "array of bools": lambda: np.ones(2, dtype=bool),
    "matrix": lambda: np.eye(2),
    "column": lambda: np.ones((2, 1)),
    "blocks": lambda: np.ones((1, 2, 6)),
    "empty batch": lambda: np.ones((0, 2)),
    "array of texts": lambda: np.array(["joint1", "joint2"]),
    "array of objects": lambda: np.array([[1.0], {}, None, "x"][:2], dtype=object),
    "array of lists": lambda: np.array([None, [1.0]], dtype=object),
    "array of dates": lambda: np.array(["2024-01-01"] * 2, dtype="M8[s]"),
    "structured": lambda: np.zeros(2, dtype=[("joint1", float), ("x", "U3")]),
    "masked": lambda: np.ma.array([1.0, 2.0], mask=[True, False]),
    "masked texts": lambda: np.ma.array(["a", "b"], mask=[True, False]),
    "masked constant": lambda: np.ma.masked,
    "record": lambda: np.rec.array([(1.0, 2.0)], names="joint1,joint2"),
    "NumPy's matrix": lambda: np.asmatrix([1.0, 2.0]),
    "series": lambda: pd.Series([1.0, 2.0], index=["joint1", "joint2"]),
    "frame": FRAME.copy,
    "frame of twice": FRAME_OF_TWICE.copy,
    "frame of indices": FRAME_OF_INDICES.copy,
    "NA": lambda: pd.NA,
    "NaT": lambda: pd.NaT,
    "pandas' numbers": lambda: pd.array([1, None], dtype="Int64"),
    "categories": CATEGORIES.copy,
    "index": lambda: pd.Index(["joint1", "joint2"]),
    "path": lambda: Path("x.yaml"),
}
