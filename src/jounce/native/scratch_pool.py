"""Scratch memory that is too large for the stack: buffers on the heap, one for each call under way, kept for the next.

Calls take them without a lock, from any thread. The first is there from the start: where memory is short and no other
can be had, a call waits until one under way gives its own back. A forked process has its own pool.
"""

import ctypes

from jounce.core.errors import JounceError
from jounce.native import memory_layout
from jounce.native.ir import Writer
from jounce.native.jit import Code

MAX_KEPT_BUFFERS = 64  # more than the calls at once on most machines; each of further ones allocates its own
BUFFER_ALIGNMENT = 64  # bytes: those of the widest vector, of AVX-512
_allocate = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.c_size_t)(("PyMem_RawMalloc", ctypes.pythonapi))  # any thread may
_free = ctypes.PYFUNCTYPE(None, ctypes.c_void_p)(("PyMem_RawFree", ctypes.pythonapi))


class Pool:
    """The buffers of one kernel, freed with it: a table of the two functions of the heap and of buffers not in use."""

    def __init__(self, size: int) -> None:
        # Entries 0 and 1 are malloc and free, which the code calls; then come buffers, or null where one is lent.
        functions = (ctypes.cast(function, ctypes.c_void_p) for function in (_allocate, _free))
        self.table, self._free = (ctypes.c_void_p * (2 + MAX_KEPT_BUFFERS))(*functions), _free
        # The first buffer always exists: with it, a call that gets no other one can wait.
        self.table[2] = _allocate(size + BUFFER_ALIGNMENT)
        if not self.table[2]:
            raise JounceError(f"not enough memory for native code: it works in {size} bytes")

    def __del__(self) -> None:
        for buffer in self.table[2:]:
            self._free(buffer)

    @property
    def address(self) -> int:
        """The address of the table."""
        return ctypes.addressof(self.table)


def make_pool(code: Code) -> Pool | None:
    """Return the pool of a kernel; None if it uses the stack."""
    size = ctypes.c_int64.from_address(code.address("scratch")).value
    return Pool(size) if size > memory_layout.MAX_STACK_BYTES else None


def define_on_heap(ir: Writer, size: int, name: str) -> None:
    """Define a function of states with its scratch memory from the pool."""
    for text in (_BORROW, _GIVE_BACK):
        ir.lines.append(text.format(first=2, end=2 + MAX_KEPT_BUFFERS, size=size + BUFFER_ALIGNMENT))
    with ir.function(f"void {name}(ptr %args, ptr %dimensions, ptr %steps, ptr %pool)"):
        buffer = ir.let("call ptr @borrow(ptr %pool)")
        # Memory begins at the next multiple of the alignment in the buffer, which is that much larger.
        after = ir.let(f"add i64 {ir.let(f'ptrtoint ptr {buffer} to i64')}, {BUFFER_ALIGNMENT - 1}")
        memory = ir.let(f"inttoptr i64 {ir.let(f'and i64 {after}, -{BUFFER_ALIGNMENT}')} to ptr")
        ir.do(f"call void @blocks(ptr %args, ptr %dimensions, ptr %steps, ptr {memory})")
        ir.do(f"call void @give_back(ptr %pool, ptr {buffer})")


# Take the first buffer in the table by exchanging it with null, which is atomic: no two calls get the same one. If
# all are taken, allocate one; if that fails too, search again until another call gives its own back.
_BORROW = """\
define internal ptr @borrow(ptr %pool) #0 {{
start:
  br label %search
search:
  %i = phi i64 [ {first}, %start ], [ %next, %empty ], [ {first}, %allocate ]
  %slot = getelementptr ptr, ptr %pool, i64 %i
  %kept = atomicrmw xchg ptr %slot, ptr null acquire, align 8
  %found = icmp ne ptr %kept, null
  br i1 %found, label %done, label %empty
empty:
  %next = add i64 %i, 1
  %more = icmp ult i64 %next, {end}
  br i1 %more, label %search, label %allocate
allocate:
  %malloc = load ptr, ptr %pool, align 8
  %new = call ptr %malloc(i64 {size})
  %made = icmp ne ptr %new, null
  br i1 %made, label %done, label %search
done:
  %buffer = phi ptr [ %kept, %search ], [ %new, %allocate ]
  ret ptr %buffer
}}"""
# Put a buffer into the first entry that is null, if it is still null when it is written; free it if the table is full.
_GIVE_BACK = """\
define internal void @give_back(ptr %pool, ptr %buffer) #0 {{
start:
  br label %search
search:
  %i = phi i64 [ {first}, %start ], [ %next, %taken ]
  %slot = getelementptr ptr, ptr %pool, i64 %i
  %exchange = cmpxchg ptr %slot, ptr null, ptr %buffer release monotonic, align 8
  %kept = extractvalue {{ ptr, i1 }} %exchange, 1
  br i1 %kept, label %done, label %taken
taken:
  %next = add i64 %i, 1
  %more = icmp ult i64 %next, {end}
  br i1 %more, label %search, label %full
full:
  %place = getelementptr ptr, ptr %pool, i64 1
  %free = load ptr, ptr %place, align 8
  call void %free(ptr %buffer)
  br label %done
done:
  ret void
}}"""
