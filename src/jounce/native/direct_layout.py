"""What direct calls read: fields of objects of CPython and NumPy, and tables that describe a call.

A table of 64-bit words has those of `TABLE_WORDS`; then each port: its number of axes, its size, the lengths of three
axes. The ports are the inputs and results of the kernel, and what is checked but does not enter.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from jounce.native.ir import Writer

# Offsets in bytes on 64-bit systems, in objects, lists and floats of CPython and in arrays of NumPy (public fields):
OBJECT_TYPE, LIST_LENGTH, LIST_ITEMS, FLOAT_VALUE = 8, 16, 24, 16
ARRAY_DATA, ARRAY_RANK, ARRAY_LENGTHS, ARRAY_DTYPE, ARRAY_FLAGS = 16, 24, 32, 56, 64
TUPLE_LENGTH, TUPLE_ITEMS = 16, 24
TABLE_SLOT, OTHERS_SLOT = 16, 24  # in what a direct call is bound to
READABLE, WRITABLE = 0x101, 0x501  # flags of arrays: contiguous and aligned; and writable
DOUBLE = 12  # NumPy's number of the type
TABLE_WORDS = (
    "code", "pool", "strides",  # addresses of the kernel
    "given", "inputs", "end", "all",  # numbers of ports: that are given, of inputs, of these and results, of all
    "positional", "required",  # how many arguments are positional, and how many keywords there are besides out
    "keywords",  # the address of their rows
    "pose", "check", "check_strides",  # which port is a pose that is checked, or -1, and by what code
    "closing",  # the address of the table of `CLOSING_WORDS`, or 0
)  # fmt: skip
CLOSING_WORDS = (
    "code", "pool", "strides",  # addresses of one step of Newton's method
    "independent", "dependent", "followers",  # numbers of coordinates
    "own", "others", "following",  # addresses of their places among all, and of the followers' among the dependent
    "still", "most", "in_place",  # addresses of numbers: no change, and bounds of measures and of followers
)  # fmt: skip
MAX_CLOSING_NUMBERS = 1024  # of coordinates and constraints, on the stack
PORT_WORDS, MAX_AXES = 5, 3
KEYWORD_WORDS = 4  # the address of the name, the first of its ports, their number or 0, the only value then
MAX_PORTS = 64  # of order 12 there are 15 of coordinates, 13 of wrenches, 15 of a base, and 13 results
MAX_LISTED = 512  # numbers in the lists of one call, which are copied to the stack
EXCEPTIONS = 0x3F  # what the processor remembers
FAILURES = 0x1D  # of it, what NumPy asks for: invalid numbers, division by zero, overflow, underflow
NEEDED = (
    "ndarray", "float64", "float", "double", "int", "list", "new_array", "scalar", "new_tuple", "set_item", "increase",
    "decrease", "call", "as_double", "occurred", "clear", "tuple", "out",
)  # fmt: skip
"""The types, functions and names of Python and NumPy that the code takes from ``@needed``, in this order."""


class CallWriter(Writer):
    """A writer of what reads structures of C, and leaves where a condition fails."""

    def field(self, structure: str, offset: int, kind: str = "ptr") -> str:
        """The field of a structure."""
        return self.let(f"load {kind}, ptr {self.at(structure, offset, 'i8')}")

    def named(self, name: str, kind: str = "i64", words: Sequence[str] = TABLE_WORDS) -> str:
        """A word of the table that describes the call, or of another one."""
        return self.field("%table", 8 * words.index(name), kind)

    def ports(self) -> str:
        """Those of the call."""
        return self.at("%table", len(TABLE_WORDS), "i64")

    def word(self, table: str, index: str | int) -> str:
        """A word of a table."""
        return self.let(f"load i64, ptr {self.at(table, index, 'i64')}")

    def double(self, array: str, index: str | int) -> str:
        """A number of an array."""
        return self.let(f"load double, ptr {self.at(array, index)}")

    def pointer(self, table: str, index: str | int) -> str:
        """A pointer in a table."""
        return self.let(f"load ptr, ptr {self.at(table, index, 'ptr')}")

    def port(self, ports: str, index: str) -> str:
        """The words of a port."""
        return self.at(ports, self.let(f"mul i64 {index}, {PORT_WORDS}"), "i64")

    def needed(self, name: str) -> str:
        """A type or function of Python or NumPy."""
        return self.field("@needed", 8 * NEEDED.index(name))

    def compare(self, kind: str, x: str, y: str | int, relation: str = "eq") -> str:
        """Whether two integers or pointers are in a relation."""
        return self.let(f"icmp {relation} {kind} {x}, {y}")

    @contextmanager
    def check(self, head: str) -> Iterator[None]:
        """A function that is true where nothing written inside declines."""
        with self.function(f"internal i1 @{head}"):
            yield
            self.do("ret i1 true")
            self.label("declined")
            self.do("ret i1 false")

    def require(self, condition: str, failed: str = "declined") -> None:
        """Go on where a condition holds, to a label where it does not."""
        self.names += 1
        self.do(f"br i1 {condition}, label %holds{self.names}, label %{failed}")
        self.label(f"holds{self.names}")

    @contextmanager
    def each(self, start: str, end: str) -> Iterator[str]:
        """A loop over an index from start to end, if there is any."""
        self.names += 1
        name = f"each{self.names}"
        with self.only_if(self.compare("i64", start, end, "slt"), name, f"{name}.done"), self.loop(end, start) as index:
            yield index
