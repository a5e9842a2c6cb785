"""Native code as a generalized ufunc of NumPy, made at run time through NumPy's C interface.

NumPy then does what it does well: broadcasting, casting, strides, `out`, letting other threads run meanwhile.
"""

import ctypes
from typing import Any

import numpy as np

from jounce.dynamics.computation import Signature

FROM_SIGNATURE = 31  # PyUFunc_FromFuncAndDataAndSignature's place in the table of NumPy's C interface, part of its ABI
NO_IDENTITY = -1


def ufunc(address: int, signature: Signature, name: str, pool: int | None) -> tuple[np.ufunc, Any]:
    """The ufunc of a loop at an address that is given the address of a pool, and what must live as long as it does."""
    taken, given = ([port.shape for port in ports] for ports in (signature.inputs, signature.outputs))
    count = len(taken) + len(given)
    loops, data = (ctypes.c_void_p * 1)(address), (ctypes.c_void_p * 1)(pool)
    types = ctypes.create_string_buffer(bytes([np.dtype(float).num] * count))
    axes = "->".join(",".join(f"({','.join(map(str, shape))})" for shape in shapes) for shapes in (taken, given))
    texts = name.encode(), b"", axes.encode()
    made = _maker()(loops, data, types, 1, len(taken), len(given), NO_IDENTITY, *texts[:2], 0, texts[2])
    return made, (loops, data, types, texts)


def _maker() -> Any:
    get = ctypes.pythonapi.PyCapsule_GetPointer
    get.restype, get.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    table = get(np._core._multiarray_umath._UFUNC_API, None)  # type: ignore[attr-defined]
    address = ctypes.c_void_p.from_address(table + FROM_SIGNATURE * ctypes.sizeof(ctypes.c_void_p)).value
    text, integer, pointer = ctypes.c_char_p, ctypes.c_int, ctypes.c_void_p
    kinds = [pointer, pointer, pointer, integer, integer, integer, integer, text, text, integer, text]
    return ctypes.PYFUNCTYPE(ctypes.py_object, *kinds)(address or 0)
