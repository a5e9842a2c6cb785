"""What direct calls need of CPython and NumPy: their code, addresses, and fields that are where they are expected."""

import ctypes
import platform
import sys
import sysconfig
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from jounce.native import cache as kernels_on_disk
from jounce.native import direct_code, direct_layout, jit
from jounce.native.direct_layout import NEEDED

# Places in the table of NumPy's C interface to arrays, part of its ABI: the type, PyArray_Return, PyArray_New
ARRAY_TYPE_ENTRY, RETURN_ENTRY, NEW_ENTRY = 2, 76, 93
TESTED_MACHINES = ("x86_64", "AMD64")
FUNCTIONS = {
    "new_tuple": "PyTuple_New", "set_item": "PyTuple_SetItem", "increase": "Py_IncRef", "decrease": "Py_DecRef",
    "call": "PyObject_Vectorcall", "as_double": "PyLong_AsDouble", "occurred": "PyErr_Occurred",
    "clear": "PyErr_Clear",
}  # fmt: skip


class DirectBinding:
    """What a direct call is bound to: the table of its kernel, and what serves all other calls.

    An attribute of another name is one of `owner`, as which it is pickled: its method of the same name serves there.
    """

    __slots__ = ("_table", "others", "owner", "rest")  # native code reads the first two

    def __init__(self, table: np.ndarray, others: Callable[..., Any], owner: Any = None, rest: Any = None) -> None:
        self._table, self.others, self.owner, self.rest = table, others, owner, rest

    def __getattr__(self, name: str) -> Any:
        return getattr(self.owner, name)

    def __reduce__(self) -> Any:
        return self.owner.__reduce__()


@cache
def code() -> jit.Code | None:
    """The code of direct calls, given the addresses of what it needs; None where it does not fit this interpreter."""
    if not fits():
        return None
    target = jit.host()
    name = kernels_on_disk.code_key("direct calls", target)
    made = kernels_on_disk.read_or_make(name, lambda: jit.assemble([direct_code.module(target)], target))
    loaded = jit.load_object(made, target)
    pointers = (ctypes.c_void_p * len(NEEDED)).from_address(loaded.address("needed"))
    for k, address in enumerate(map(_addresses().__getitem__, NEEDED)):
        pointers[k] = address
    return loaded


def _addresses() -> dict[str, int | None]:
    """The addresses of what the code needs."""
    kinds = {"float": float, "int": int, "list": list, "tuple": tuple, "double": np.float64, "ndarray": np.ndarray}
    found: dict[str, int | None] = {name: id(kind) for name, kind in kinds.items()}
    found["out"] = id(sys.intern("out"))
    found["float64"] = id(np.dtype(np.float64))
    for name, function in FUNCTIONS.items():
        found[name] = ctypes.cast(getattr(ctypes.pythonapi, function), ctypes.c_void_p).value
    table = _array_table() or 0
    return found | {"new_array": jit.entry(table, NEW_ENTRY), "scalar": jit.entry(table, RETURN_ENTRY)}


def fits() -> bool:
    """Whether objects of this interpreter and of NumPy have the fields that native code reads."""
    locked = not sysconfig.get_config_var("Py_GIL_DISABLED")
    if sys.implementation.name != "cpython" or not locked or platform.machine() not in TESTED_MACHINES:
        return False
    if ctypes.sizeof(ctypes.c_void_p) != 8 or not (table := _array_table()):
        return False
    array = np.zeros((2, 3))
    listed, pair, bound, numbers = [0.5, 0.25], (0.5, array), DirectBinding(array, max), (0.5, np.float64(3))
    lengths = _read(id(array), direct_layout.ARRAY_LENGTHS)
    return (
        jit.entry(table, ARRAY_TYPE_ENTRY) == id(np.ndarray)
        and _read(id(array), direct_layout.OBJECT_TYPE) == id(np.ndarray)
        and _read(id(array), direct_layout.ARRAY_DATA) == array.ctypes.data
        and ctypes.c_int.from_address(id(array) + direct_layout.ARRAY_RANK).value == 2
        and (_read(lengths, 0), _read(lengths, 8)) == (2, 3)
        and _read(id(array), direct_layout.ARRAY_DTYPE) == id(np.dtype(np.float64))
        and ctypes.c_int.from_address(id(array) + direct_layout.ARRAY_FLAGS).value == array.flags.num
        and array.flags.num & direct_layout.WRITABLE == direct_layout.WRITABLE
        and _read(id(listed), direct_layout.LIST_LENGTH) == 2
        and _read(_read(id(listed), direct_layout.LIST_ITEMS), 8) == id(listed[1])
        and _read(id(pair), direct_layout.TUPLE_LENGTH) == 2
        and _read(id(pair), direct_layout.TUPLE_ITEMS + 8) == id(array)
        and all(ctypes.c_double.from_address(id(x) + direct_layout.FLOAT_VALUE).value == x for x in numbers)
        and _read(id(bound), direct_layout.TABLE_SLOT) == id(array)
        and _read(id(bound), direct_layout.OTHERS_SLOT) == id(max)
    )


def _read(address: int, offset: int) -> int:
    return ctypes.c_ssize_t.from_address(address + offset).value


def _array_table() -> int | None:
    """The address of the table of NumPy's C interface to arrays."""
    return jit.c_table("_ARRAY_API")


@cache
def function_maker() -> Any:
    """PyCFunction_NewEx of CPython."""
    return ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p, ctypes.py_object, ctypes.py_object)(
        ("PyCFunction_NewEx", ctypes.pythonapi)
    )
