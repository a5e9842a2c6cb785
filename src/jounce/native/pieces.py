"""Straight-line programs cut into pieces, and the scratch memory in which values wait from one piece to another.

Problem: thousands of operations on a few vector registers. As one function they do not fit where a processor keeps
decoded instructions, and most values are saved and loaded again wherever the register allocator finds no room.
Algorithm: the operations in one of two orders, cut into functions of `PIECE_STEPS`. What a later piece reads has a
place in memory, by linear-scan allocation [1]; a value there is loaded again where it was not used for
`RELOAD_DISTANCE` operations, rather than kept in a register. Of the two orders, as recorded or depth first, the one
with fewer loads and stores is taken: the first for forces, the second for matrices. Invariants: each operation is done
once, after its operands, and by the same instruction in any order and piece; hence cuts change no bit of the results.
There is no failure.

[1] M. Poletto, V. Sarkar, Linear scan register allocation, ACM TOPLAS 21 (5), 1999.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count, pairwise

from jounce.program.operations import LEAVES, OPERATIONS, VectorFunction
from jounce.program.program import Program, reuse_places, topological_order

MAX_WHOLE_STEPS = {16: 300, 32: 8000}  # by registers; with 32, cuts gain nothing but LLVM's time for long functions
PIECE_STEPS = 150  # 150 to 250 were alike, 60 and 500 slower
RELOAD_DISTANCE = 12  # operations; 12 to 30 were alike
BLOCKS_AT_ONCE = 2  # in turn for each piece: the next block's operations fill the gaps that dependent ones leave


@dataclass(frozen=True)
class CutProgram:
    """The operations of a program in pieces.

    `homes` are the places in memory, counted in vectors, of what waits there: values of functions, and what crosses a
    cut. `loads` are the pairs of an operation and an operand that is loaded for it.
    """

    program: Program
    pieces: tuple[tuple[int, ...], ...]
    homes: Mapping[int, int]
    loads: frozenset[tuple[int, int]]

    @property
    def vectors(self) -> int:
        """The size of the memory."""
        return max(self.homes.values(), default=-1) + 1


def cut_program(program: Program, registers: int, first: Sequence[int] | None = None) -> CutProgram:
    """The pieces of a program for a processor with this number of vector registers.

    Depth first, the outputs of the numbers `first` are finished before others; by default the last outputs, those of
    the tip and the highest rate, which keeps fewer values.
    """
    roots = program.outputs[::-1]
    if first is not None:
        roots = tuple(program.outputs[k] for k in (*first, *range(len(program.outputs))))
    finishing = _operations(program, topological_order(roots, lambda i: program.steps[i].operands))
    if len(finishing) <= MAX_WHOLE_STEPS[registers]:
        return _cut_in_order(program, finishing, 1)
    number = round(len(finishing) / PIECE_STEPS)
    orders = [finishing] if registers > 16 else [finishing, _operations(program, range(len(program.steps)))]
    found = (_cut_in_order(program, order, number) for order in orders)
    return min(found, key=lambda cut: len(cut.loads) + len(cut.homes))  # loads and stores


def vector_calls(program: Program) -> dict[int, VectorFunction]:
    """The steps that call functions of vectors, and which."""
    rows = ((i, OPERATIONS[step.kind]) for i, step in enumerate(program.steps) if step.kind not in LEAVES)
    return {i: row.function for i, row in rows if row.function is not None}


def _operations(program: Program, order: Iterable[int]) -> list[int]:
    """The operations in an order, functions and what they depend on first: no call then saves the values of others."""
    steps, called = program.steps, vector_calls(program)
    depths: list[int] = []  # how many functions are called one after the other before a step, calls in one row
    for step in steps:
        depths.append(max((depths[j] + (j in called) for j in step.operands), default=0))
    needed = set(topological_order(list(called), lambda i: steps[i].operands))
    early = sorted(needed, key=lambda i: (depths[i], i in called, i))
    return [i for i in (*early, *(i for i in order if i not in needed)) if steps[i].kind not in LEAVES]


def _cut_in_order(program: Program, order: Sequence[int], number: int) -> CutProgram:
    """The operations in this order, in a number of pieces."""
    cuts = [len(order) * k // number for k in range(number + 1)]
    pieces = tuple(tuple(order[start:end]) for start, end in pairwise(cuts))
    called = vector_calls(program)
    homes = _homes(program, pieces, called)
    loads = frozenset(pair for piece in pieces for pair in _loads(program, piece, called))
    return CutProgram(program, pieces, homes, loads)


def _homes(program: Program, pieces: Sequence[Sequence[int]], called: Mapping[int, VectorFunction]) -> dict[int, int]:
    """Places in memory; those of what crosses a cut are free again after the last piece that reads them."""
    steps, homes, unused = program.steps, dict[int, int](), count()
    pairs: dict[tuple[str, int], int] = {}  # where one call writes, by function and operand
    for i, function in called.items():
        key = function.name, steps[i].operands[0]
        if key not in pairs:
            pairs[key] = next(unused)
            if function.result is not None:
                next(unused)  # of its second result
        homes[i] = pairs[key] + (function.result or 0)
    last = {j: k for k, piece in enumerate(pieces) for i in piece for j in steps[i].operands}
    spans = {i: (k, last[i]) for k, piece in enumerate(pieces) for i in piece if i not in homes and last.get(i, k) > k}
    first = next(unused)
    return homes | {i: first + place for i, place in zip(spans, reuse_places(spans.values()), strict=True)}


def _loads(program: Program, piece: Sequence[int], called: Mapping[int, VectorFunction]) -> Iterator[tuple[int, int]]:
    """The operands that are loaded: those that no operation of the piece leaves in a register, not used of late."""
    made, used = {i for i in piece if i not in called}, dict[int, int]()
    for now, i in enumerate(piece):
        for j in dict.fromkeys(program.steps[i].operands):
            if j not in made and (j not in used or now - used[j] > RELOAD_DISTANCE):
                yield i, j
            used[j] = now
