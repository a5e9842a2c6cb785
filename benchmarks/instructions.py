"""``python -m benchmarks.instructions``: of what native code consists, by processor; other programs disturb no count.

Counted is the code for one block of states in a straight line: `@block` and the functions that it calls, without sines
and other functions of vectors, and without moving rows in and out. Instructions are read from LLVM's assembly, bytes
from the table of symbols of the object code.
"""

import re
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import click
import llvmlite.binding as llvm

from benchmarks.robots import ARMS, load
from benchmarks.tables import figure, paragraph, table
from jounce import Robot
from jounce.dynamics.computation import Computation
from jounce.io import files
from jounce.native import code_forms, jit, vector_functions
from jounce.native.jit import Target

X86, ARM = "x86_64-unknown-linux-gnu", "aarch64-unknown-linux-gnu"
TARGETS = {
    "AVX2, znver3": Target("znver3", "", 4, 16, fma=True, triple=X86),
    "AVX-512, znver4": Target("znver4", "", 8, 32, fma=True, triple=X86),
    "NEON, neoverse-n1": Target("neoverse-n1", "", 2, 32, fma=True, triple=ARM),
}
FORCES = Computation("inverse_dynamics", 2)
MATRICES = Computation("mass_matrix", 0), Computation("coriolis_matrix", 0)
KINDS = ("instructions", "arithmetic", "loads", "folded", "stores")
TEXT = """Instructions for one block of states (of 4 with AVX2, 8 with AVX-512, 2 with NEON) by LLVM of llvmlite
{version}, without sines, cosines, and the transposition of rows. Arithmetic is products, fused or not, and sums, those
of the check for what is not finite included. Loads read memory; folded are those among them that compute with what they
read, as on x86 most can. Stores write memory. On Arm one load or store can move two vectors."""

ARITHMETIC = re.compile(r"v(add|sub|mul|div|fn?m(add|sub)\d+)[ps]d|f(add|sub|n?mul|div|mla|mls|n?m(add|sub))")
MOVES = re.compile(r"v?mov|vbroadcast|pop|ld")  # what reads memory and computes nothing
OPERAND = re.compile(r"(?:[^,([]|\(.*?\)|\[.*?\])+")  # commas within an address divide no operands
SYMBOL_TABLE, FUNCTION_SYMBOL = 2, 2  # types of a section and of a symbol, of ELF


@dataclass(frozen=True)
class Code:
    """Functions by their names: instructions, and bytes."""

    lines: Mapping[str, list[str]]
    sizes: Mapping[str, int]

    def counts(self) -> Counter[str]:
        """Instructions of each kind, and bytes, of a block of states."""
        names = reached(self.lines, "block")
        found = Counter(kind for name in names for line in self.lines[name] for kind in kinds(line))
        return found + Counter(bytes=sum(self.sizes[name] for name in names))


def compiled(robot: Robot, computation: Computation, target: Target) -> Code:
    """The module that works on blocks of states, compiled for a target."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    text = code_forms.kernel_modules(robot.mechanism, computation, target)[0]
    code, module = jit.link([text], target)
    return Code(functions(code.emit_assembly(module)), symbol_sizes(jit.assemble([text], target)))


def functions(assembly: str) -> dict[str, list[str]]:
    """The instructions of each function."""
    found: dict[str, list[str]] = {}
    lines: list[str] = []
    for line in assembly.splitlines():
        if label := re.match(r"(\w[\w.]*):", line):
            lines = found[label[1]] = []
        elif re.match(r"\s+[a-z]", line):  # directives begin with a point
            lines.append(line.strip())
    return {name: lines for name, lines in found.items() if lines}


def symbol_sizes(code: bytes) -> dict[str, int]:
    """The bytes of each function of an ELF file of 64 bits."""
    first, size, count = *struct.unpack_from("<Q", code, 40), *struct.unpack_from("<HH", code, 58)
    sections = [struct.unpack_from("<IIQQQQIIQQ", code, first + i * size) for i in range(count)]
    *_, start, length, strings, _, _, _ = next(section for section in sections if section[1] == SYMBOL_TABLE)
    names = sections[strings][4]
    return {
        code[names + name : code.index(0, names + name)].decode(): taken
        for name, kind, _, _, _, taken in struct.iter_unpack("<IBBHQQ", code[start : start + length])
        if kind & 15 == FUNCTION_SYMBOL
    }


def reached(lines: Mapping[str, list[str]], name: str) -> set[str]:
    """A function and those that it calls, by name or by address, without the functions of vectors."""
    found, left = set(), {name}
    while left:
        found.add(one := left.pop())
        operands = {word for line in lines[one] for word in re.findall(r"[\w.]+", line.partition("\t")[2])}
        left |= (operands & lines.keys()) - found - vector_functions.DEFINITIONS.keys()
    return found


def kinds(line: str) -> Iterator[str]:
    """The kinds of which an instruction is, in the syntax of AT&T, where the last operand is written, or of Arm."""
    mnemonic, _, rest = line.partition("\t")
    *others, last = OPERAND.findall(rest) or [""]
    yield "instructions"
    if ARITHMETIC.fullmatch(mnemonic):
        yield "arithmetic"
    if mnemonic.startswith(("st", "push")) or "(" in last:
        yield "stores"
    elif mnemonic.startswith(("ld", "pop")) or ("(" in "".join(others) and not mnemonic.startswith("lea")):
        yield "loads"
        if not MOVES.match(mnemonic):
            yield "folded"


def page() -> str:
    """The page of results."""
    asked = [*((name, FORCES) for name in (*ARMS, "g1")), *(("panda", matrix) for matrix in MATRICES)]
    lines = ["# Instructions", "", *paragraph(TEXT.format(version=version("llvmlite")))]
    for name, computation in asked:
        robot, rows = load(name), []
        for label, target in TARGETS.items():
            counts = compiled(robot, computation, target).counts()
            rows.append((label, *(f"{counts[kind]:,}" for kind in KINDS), figure(counts["bytes"] / 1024)))
        lines += table((computation.describe(name), *KINDS, "KiB"), rows)
    return "\n".join(lines).rstrip() + "\n"


@click.command()
@click.option("-o", "--output", default=Path(__file__).parent / "INSTRUCTIONS.md", type=click.Path(path_type=Path))
def main(output: Path) -> None:
    """Count the instructions of native code for several processors, and write INSTRUCTIONS.md."""
    with files.write_whole(output) as part:
        part.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
