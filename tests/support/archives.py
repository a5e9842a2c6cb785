"""NPZ archives of any content, which may state what is not true."""

import struct
import warnings
import zlib
from dataclasses import dataclass
from io import BytesIO

import numpy as np

LOCAL, CENTRAL, END = "<4s5H3L2H", "<4s6H3L5H2L", "<4s4H2LH"  # the fixed parts of a ZIP file
DEFLATED = 8


@dataclass(frozen=True)
class Member:
    """A member of an archive; what is None is stated as it is."""

    name: str
    content: bytes
    method: int = 0  # of compression
    size: int | None = None
    packed_size: int | None = None
    flags: int = 0
    checksum: int | None = None
    at: int | None = None  # the number of the member whose place is stated


def archive(*members):
    """The bytes of an archive."""
    file, directory, places = bytearray(), bytearray(), []
    for member in members:
        places.append(len(file))
        place = len(file) if member.at is None else places[member.at]
        content = member.content
        if member.method == DEFLATED:
            packer = zlib.compressobj(wbits=-15)
            content = packer.compress(content) + packer.flush()
        checksum = zlib.crc32(member.content) if member.checksum is None else member.checksum
        size = len(member.content) if member.size is None else member.size
        packed = len(content) if member.packed_size is None else member.packed_size
        name = member.name.encode()
        about = (20, member.flags, member.method, 0, 33, checksum, packed, size, len(name), 0)
        file += struct.pack(LOCAL, b"PK\3\4", *about) + name + content
        directory += struct.pack(CENTRAL, b"PK\1\2", 20, *about, 0, 0, 0, 0, place) + name
    end = (0, 0, len(members), len(members), len(directory), len(file), 0)
    return bytes(file + directory + struct.pack(END, b"PK\5\6", *end))


def npy(array):
    """An array as numpy.save writes it, objects among them."""
    file = BytesIO()
    with warnings.catch_warnings(action="ignore"):  # of names in UTF-8
        np.save(file, array, allow_pickle=True)
    return file.getvalue()


def npy_header(text, version=(1, 0)):
    """The header of an array, of any text."""
    size = struct.pack("<H" if version == (1, 0) else "<I", len(text.encode()))
    return b"\x93NUMPY" + bytes(version) + size + text.encode()
