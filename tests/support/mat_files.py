"""MAT files of version 5 of any content, which may state what is not true."""

import struct
import zlib

import numpy as np

DOUBLE, STRUCTURE, TEXT, CELLS = 6, 2, 4, 1  # classes


def mat_file(order, *arrays):
    """A file of arrays in a byte order, "<" or ">"."""
    head = struct.pack(f"{order}H", 0x100) + (b"IM" if order == "<" else b"MI")
    return b"MATLAB 5.0 MAT-file".ljust(124) + head + b"".join(arrays)


def element(order, kind, content, size=None):
    """A tag, which may state another size, and a content."""
    size = len(content) if size is None else size
    return struct.pack(f"{order}2I", kind, size) + content + bytes(-len(content) % 8)


def array(order, kind, shape, name, content):
    """An array of a class and a shape."""
    head = element(order, 6, struct.pack(f"{order}2I", kind, 0)), element(order, 5, struct.pack(f"{order}2i", *shape))
    return element(order, 14, b"".join(head) + element(order, 1, name) + content)


def packed(order, content, stated=None):
    """A compressed array, which may state another size."""
    if stated is not None:
        content = struct.pack(f"{order}2I", 14, stated) + content[8:]
    packed = zlib.compress(content)
    return struct.pack(f"{order}2I", 15, len(packed)) + packed


def number_element(order, x, size=None):
    """The element of numbers."""
    return element(order, 9, np.asarray(x).astype(f"{order}f8").tobytes(), size)


def structure(order, inner):
    """A structure of one field."""
    fields = element(order, 5, struct.pack(f"{order}i", 8)) + element(order, 1, b"field".ljust(8, b"\0"))
    return array(order, STRUCTURE, (1, 1), b"s", fields + inner)
