"""Write a program as straight-line code: all its operations, in one function or in pieces, in LLVM IR.

Problem: thousands of operations on a few vector registers. As one function they do not fit where a processor keeps
decoded instructions, and most values are saved and loaded again wherever the register allocator finds no room.

Algorithm: the operations in one of two orders, cut into functions of `PIECE_STEPS` (`cut_program`). What a later piece
reads has a place in memory, by linear-scan allocation [1]; a value there is loaded again where it was not used for
`RELOAD_DISTANCE` operations, rather than kept in a register. Of the two orders, as recorded or depth first, the one
with fewer loads and stores is taken: the first for forces, the second for matrices. A `_Piece` then writes the
operations of each, and stores a result as soon as it is there.

`straight_block` is the door. Invariants: each operation is done once, after its operands, and by the same instruction
in any order and piece; hence cuts change no bit of the results. There is no failure.

[1] M. Poletto, V. Sarkar, Linear scan register allocation, ACM TOPLAS 21 (5), 1999.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, count, groupby, pairwise, zip_longest

from jounce.dynamics.computation import Port, Signature
from jounce.native import memory_layout
from jounce.native.ir import BlockCode, Writer, nan_masks, vector_calls
from jounce.native.jit import Target
from jounce.program import operations
from jounce.program.operations import VectorFunction
from jounce.program.program import Program, reuse_places, topological_order

MAX_STEPS_COMPILED_TWICE = 6000  # for vectors and for one state: each compiles in some tenths of a second
PARTIAL_SUMS = 4  # of the check, as many as a sum takes cycles: none waits for another
BROADCASTING_LANES = 8  # of AVX-512, which reads one number for all lanes within an instruction: no table is shorter
MAX_WHOLE_STEPS = {16: 300, 32: 8000}  # by registers; with 32, cuts gain nothing but LLVM's time for long functions
PIECE_STEPS = 150  # 150 to 250 were alike, 60 and 500 slower
RELOAD_DISTANCE = 12  # operations; 12 to 30 were alike
BLOCKS_AT_ONCE = 2  # in turn for each piece: the next block's operations fill the gaps that dependent ones leave


def straight_block(
    program: Program, signature: Signature, target: Target, first: Sequence[int] | None = None
) -> BlockCode:
    """A program in a straight line. Results of a port that are equal, as many zeros of matrices, are stored once."""
    numbers: dict[tuple[int, int], int] = {}  # numbers of vectors, by port and step of the program
    places = [
        [numbers.setdefault((k, program.outputs[j]), len(numbers)) for j in range(port.start, port.end)]
        for k, port in enumerate(signature.outputs)
    ]
    results = defaultdict(list)
    for (k, i), number in numbers.items():
        results[i].append((number, k))
    form = _Straight(cut_program(program, target.registers, first), signature, results)
    short = len(program.steps) <= MAX_STEPS_COMPILED_TWICE
    return BlockCode(form.define, places, form.vectors, short, BLOCKS_AT_ONCE if form.is_cut else 1)


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


@dataclass(frozen=True)
class _Straight:
    """A program in pieces: its results by step, each the number of its vector and of its port."""

    cut: CutProgram
    signature: Signature
    results: Mapping[int, Sequence[tuple[int, int]]]

    @cached_property
    def called(self) -> Mapping[int, VectorFunction]:
        return vector_calls(self.cut.program)

    @property
    def is_cut(self) -> bool:
        return len(self.cut.pieces) > 1

    @property
    def vectors(self) -> int:
        """Those of the pieces, and masks behind them."""
        return self.cut.vectors + len(self.signature.outputs)

    @cached_property
    def starts(self) -> Mapping[str, int]:
        """Where the parts of a block's memory begin: its inputs, its results, and what waits there."""
        inputs, outputs = self.signature.inputs[-1].end, self.signature.outputs[-1].end
        return {"inputs": 0, "results": inputs, "homes": inputs + outputs, "masks": inputs + outputs + self.cut.vectors}

    def define(self, ir: Writer) -> None:
        """The pieces as functions, and ``@block``, which calls each for all blocks before the next."""
        listed = (step.value for step in self.cut.program.steps if step.kind == "constant")
        places = {x: k for k, x in enumerate(dict.fromkeys(listed))} if ir.lanes != BROADCASTING_LANES else {}
        ir.table_of_vectors("constants", list(places))
        for k in range(len(self.cut.pieces)):
            with ir.function(f"internal void @piece{k}(ptr %memory, ptr %constants) {ir.aligned}"):
                _Piece(ir, self, places).write(k)
        size = memory_layout.block_size(self.signature, self.vectors, ir.lanes)
        with ir.function("internal void @block(ptr %in, ptr %out, ptr %bodies, i64 %count)"):
            second, both = ir.at("%in", size, "i8"), ir.let("icmp sgt i64 %count, 1")
            for k in range(len(self.cut.pieces)):
                ir.do(f"call void @piece{k}(ptr %in, ptr @constants)")
                if self.is_cut:  # a loop over blocks for each piece would take LLVM the square of their number
                    with ir.only_if(both, f"second.{k}", f"after.{k}"):
                        ir.do(f"call void @piece{k}(ptr {second}, ptr @constants)")


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


def _operations(program: Program, order: Iterable[int]) -> list[int]:
    """The operations in an order, functions and what they depend on first: no call then saves the values of others."""
    steps, called = program.steps, vector_calls(program)
    depths: list[int] = []  # how many functions are called one after the other before a step, calls in one row
    for step in steps:
        depths.append(max((depths[j] + (j in called) for j in step.operands), default=0))
    needed = set(topological_order(list(called), lambda i: steps[i].operands))
    early = sorted(needed, key=lambda i: (depths[i], i in called, i))
    return [i for i in (*early, *(i for i in order if i not in needed)) if steps[i].kind not in operations.LEAVES]


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


@dataclass(frozen=True)
class _Piece:
    """A piece as it is written: what is in registers, and the masks there, which only the first piece computes."""

    ir: Writer
    form: _Straight
    constants: Mapping[float, int]
    names: dict[int, str] = field(default_factory=dict)
    masks: list[str] = field(default_factory=list)

    def write(self, k: int) -> None:
        """The operations of piece k; the first also checks the inputs and stores results that take no operation."""
        steps = self.form.cut.program.steps
        if k == 0:
            self._check()
            for i in self.form.results:
                if steps[i].kind in operations.LEAVES:
                    self._store_results(i, self._load(i))
        for of_angles, run in groupby(self.form.cut.pieces[k], self._is_of_angle):
            (self._write_circles if of_angles else self._write_others)(list(run))

    def _is_of_angle(self, i: int) -> bool:
        """Whether a step is a sine or a cosine."""
        return i in self.form.called and self.form.called[i].result is not None

    def _write_circles(self, run: Sequence[int]) -> None:
        """Sines and cosines, two angles at a time, an odd one twice; angles that wait for others last and alone."""
        users = {self.form.cut.program.steps[i].operands[0]: i for i in reversed(run)}
        free, waiting = ([j for j in reversed(users) if (j in run) == after] for after in (False, True))
        pairs = zip_longest(free[::2], free[1::2], fillvalue=free[-1])
        for pair in chain(pairs, zip(waiting, waiting, strict=True)):
            angles = ", ".join(f"{self.ir.V} {self._operand(users[j], j)}" for j in pair)
            homes = (self.form.cut.homes[users[j]] - (self.form.called[users[j]].result or 0) for j in pair)
            places = ", ".join(f"ptr {self._at('homes', place)}" for place in homes)
            self.ir.do(f"call void @sincos({angles}, {places})")
        for i in run:
            if i in self.form.results:
                self._store_results(i, self._load(i))

    def _write_others(self, run: Sequence[int]) -> None:
        for i in run:
            step = self.form.cut.program.steps[i]
            operands = [self._operand(i, j) for j in step.operands]
            if function := self.form.called.get(i):
                value = self.ir.let(f"call {self.ir.V} @{function.name}({self.ir.V} {operands[0]})")
            else:
                self.names[i] = value = self.ir.op(step.kind, *operands)
            if i in self.form.cut.homes:
                self.ir.store(value, self._at("homes", self.form.cut.homes[i]))
            self._store_results(i, value)

    def _operand(self, i: int, j: int) -> str:
        """The value of step j for operation i."""
        if (i, j) in self.form.cut.loads:
            self.names[j] = self._load(j)
        return self.names[j]

    def _load(self, i: int) -> str:
        step = self.form.cut.program.steps[i]
        if step.kind == "input":
            return self.ir.load(self._at("inputs", int(step.value)))
        if step.kind != "constant":
            return self.ir.load(self._at("homes", self.form.cut.homes[i]))
        if step.value not in self.constants:
            return self.ir.vector(step.value)
        return self.ir.load(self.ir.at("%constants", self.constants[step.value], self.ir.V))

    def _at(self, part: str, place: int) -> str:
        """The address of a vector in memory."""
        return self.ir.at("%memory", self.form.starts[part] + place, self.ir.V)

    def _check(self) -> None:
        """The masks, kept for later pieces."""
        self.masks.extend(nan_masks(self.ir, self.form.signature, self._add_zeros))
        if self.form.is_cut:
            for k, mask in enumerate(self.masks):
                self.ir.store(mask, self._at("masks", k))

    def _add_zeros(self, total: str, port: Port) -> str:
        sums = [total] + [self.ir.vector(0.0)] * (PARTIAL_SUMS - 1)
        for j in range(port.start, port.end):
            x, k = self.ir.load(self._at("inputs", j)), j % PARTIAL_SUMS
            sums[k] = self.ir.op("fma", x, self.ir.vector(0.0), sums[k])
        first, second = (self.ir.op("add", *sums[k : k + 2]) for k in (0, 2))
        return self.ir.op("add", first, second)

    def _store_results(self, i: int, value: str) -> None:
        """What is a result into its vectors, at once, so that no register waits."""
        for number, k in self.form.results.get(i, ()):
            mask = self.masks[k] if self.masks else self.ir.load(self._at("masks", k))
            self.ir.store(self.ir.op("add", value, mask), self._at("results", number))
