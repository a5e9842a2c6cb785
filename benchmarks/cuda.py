"""What CUDA kernels take of a GPU, by its assembler: ``python -m benchmarks.cuda`` writes CUDA.md beside this file.

It needs no GPU: NVRTC compiles for any, and ptxas says what registers and memory a thread takes. Both are in the extra
`bench-cuda`. Nothing is measured.
"""

import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory

import click

from benchmarks.tables import paragraph, table
from jounce import JounceError, load
from jounce.arguments import requests
from jounce.core.version import __version__
from jounce.cuda import THREADS_PER_BLOCK, source
from jounce.io import files
from jounce.native import code_forms

ROBOTS = ("iiwa14", "g1")
KERNELS = (  # quantity, order, precision
    ("inverse_dynamics", 0, "float64"),
    ("inverse_dynamics", 2, "float64"),
    ("inverse_dynamics", 2, "float32"),
    ("mass_matrix", 0, "float64"),
    ("forward_dynamics", 0, "float64"),
    ("forward_dynamics", 0, "float32"),
)
ARCHITECTURES = {"80": "A100", "90": "H100 and H200", "120": "GeForce RTX 50"}
REGISTERS = 65_536  # of a multiprocessor of all of them
WRITTEN = """Written by `python -m benchmarks.cuda` with jounce {version}, NVRTC {nvrtc} and {ptxas}. No GPU was there:
these are the assembler's figures of compiled code, not measurements. Kernels are those of `jounce.cuda`, in blocks of
{threads} threads, one state per thread."""
EXPLAINED = """Registers, stack and spills are of one thread, in bytes where not said otherwise. The stack is local
memory: values that do not fit into the registers, and 40 bytes in which the CUDA library reduces very large angles.
Spills are the bytes that go there and come back, once per state. Threads are those that the registers of a
multiprocessor hold at once. Bytes are those of the arrays of a state, which memory has to move at least."""
USAGE = re.compile(r"(\d+) bytes stack frame, (\d+) bytes spill stores, (\d+) bytes spill loads")


@dataclass(frozen=True)
class Usage:
    """What a thread of a kernel takes, and the code itself."""

    registers: int
    stack: int
    stores: int
    loads: int
    shared: int  # bytes of a block
    code: int  # bytes

    @property
    def threads(self) -> int:
        """How many threads the registers of a multiprocessor hold: whole blocks, of warps that take 256 at a time."""
        warp = -(-32 * self.registers // 256) * 256
        return REGISTERS // (warp * THREADS_PER_BLOCK // 32) * THREADS_PER_BLOCK


def assembler() -> str:
    """The path of ptxas: that of the system, or of the package nvidia-cuda-nvcc."""
    found = find_spec("nvidia")
    places = [Path(place) for place in (found.submodule_search_locations or []) if found] if found else []
    own = next((str(path) for place in places for path in place.glob("*/bin/ptxas")), None)
    path = own or which("ptxas")
    if path is None:
        raise JounceError("ptxas is missing; install it by: pip install -e '.[bench-cuda]'")
    return path


def usage(code: str, architecture: str) -> Usage:
    """Compile CUDA source for an architecture, and read what ptxas says of its kernel."""
    with TemporaryDirectory() as folder:
        given, made = Path(folder, "kernel.ptx"), Path(folder, "kernel.cubin")
        given.write_bytes(_assembly(code, architecture))
        command = [assembler(), "-v", f"-arch=sm_{architecture}", given, "-o", made]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        return read(done.stderr, made.stat().st_size)


def read(said: str, code: int = 0) -> Usage:
    """Read the figures of the kernel `states` in what ``ptxas -v`` says; other functions are part of its own."""
    of_kernel = said.partition("'states'")[2]
    memory, registers = USAGE.search(of_kernel), re.search(r"Used (\d+) registers", of_kernel)
    if memory is None or registers is None:
        raise JounceError(f"ptxas says nothing of the kernel: {said[:200]!r}")
    shared = re.search(r"(\d+) bytes smem", of_kernel)
    return Usage(int(registers[1]), *map(int, memory.groups()), int(shared[1]) if shared else 0, code)


def _assembly(code: str, architecture: str) -> bytes:
    from cupy.cuda import nvrtc

    program = nvrtc.createProgram(code, "states.cu", (), ())
    try:
        nvrtc.compileProgram(program, [f"--gpu-architecture=compute_{architecture}", "-std=c++17"])
    except nvrtc.NVRTCError:
        raise JounceError(nvrtc.getProgramLog(program)) from None
    found = nvrtc.getPTX(program)
    return found if isinstance(found, bytes) else found.encode()


def page() -> Iterator[str]:
    """CUDA.md."""
    from cupy.cuda import nvrtc

    said = subprocess.run([assembler(), "--version"], capture_output=True, text=True, check=True).stdout
    release = re.search(r"release [\d.]+, V([\d.]+)", said)
    names = {"nvrtc": ".".join(map(str, nvrtc.getVersion())), "ptxas": f"ptxas {release[1] if release else '?'}"}
    yield from ["# CUDA kernels", ""]
    yield from paragraph(WRITTEN.format(version=__version__, threads=THREADS_PER_BLOCK, **names))
    yield from paragraph(EXPLAINED)
    for architecture, cards in ARCHITECTURES.items():
        yield from [f"## sm_{architecture}, {cards}", ""]
        rows = [_row(name, *kernel, architecture) for name in ROBOTS for kernel in KERNELS]
        head = ("kernel", "operations", "bytes", "registers", "stack", "spill stores", "spill loads", "shared, a block",
                "threads", "code, KiB")  # fmt: skip
        yield from table(head, rows)


def _row(name: str, quantity: str, order: int, dtype: str, architecture: str) -> tuple[str, ...]:
    mechanism = load(name).mechanism
    asked = requests.build_computation(mechanism, quantity, order)
    signature = asked.signature(mechanism)
    moved = (4 if dtype == "float32" else 8) * (signature.inputs[-1].end + signature.outputs[-1].end)
    found = usage(source(mechanism, asked, dtype == "float32"), architecture)
    click.echo(f"sm_{architecture} {name} {quantity} {order} {dtype}: {found}", err=True)
    counts = (code_forms.trace_program(mechanism, asked).operations, moved, found.registers, found.stack, found.stores,
              found.loads, found.shared, found.threads, found.code // 1024)  # fmt: skip
    return f"{name}, {quantity}, order {order}, {dtype}", *(f"{x:,}" for x in counts)


if __name__ == "__main__":
    with files.write_whole(Path(__file__).parent / "CUDA.md") as part:
        part.write_text("\n".join(page()), encoding="utf-8")
