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
    """Return a program as straight-line code.

    The outputs with the numbers `first` are finished before others, see `cut_program`.
    """
    # Results of a port that are equal, such as the zeros of a matrix, are stored once: a vector by port and step.
    numbers: dict[tuple[int, int], int] = {}
    places = [
        [numbers.setdefault((k, program.outputs[j]), len(numbers)) for j in range(port.start, port.end)]
        for k, port in enumerate(signature.outputs)
    ]
    # Of each step, the vectors that it is stored into as a result, and the ports that determine its mask.
    results = defaultdict(list)
    for (k, i), number in numbers.items():
        results[i].append((number, k))
    form = _Straight(cut_program(program, target.registers, first), signature, results)
    # A second version for one state alone is worth its compilation if there are few steps.
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
        """The size of the memory of pieces and masks, in vectors."""
        return self.cut.vectors + len(self.signature.outputs)

    @cached_property
    def starts(self) -> Mapping[str, int]:
        """The positions of the parts of a block's memory: inputs, results, waiting values, masks."""
        inputs, outputs = self.signature.inputs[-1].end, self.signature.outputs[-1].end
        return {"inputs": 0, "results": inputs, "homes": inputs + outputs, "masks": inputs + outputs + self.cut.vectors}

    def define(self, ir: Writer) -> None:
        """Define the pieces as functions, and ``@block``, which calls them in turn."""
        # Constants are vectors in a table, where the processor cannot read one number for all lanes.
        listed = (step.value for step in self.cut.program.steps if step.kind == "constant")
        distinct = [] if ir.lanes == BROADCASTING_LANES else dict.fromkeys(listed)
        places = {x: k for k, x in enumerate(distinct)}
        ir.table_of_vectors("constants", list(places))
        for k in range(len(self.cut.pieces)):
            with ir.function(f"internal void @piece{k}(ptr %memory, ptr %constants) {ir.aligned}"):
                _Piece(ir, self, places).write(k)
        size = memory_layout.block_size(self.signature, self.vectors, ir.lanes)
        with ir.function("internal void @block(ptr %in, ptr %out, ptr %bodies, i64 %count)"):
            # Each piece computes both blocks before the next piece begins: its code is loaded once for two. A loop over
            # blocks for each piece would take LLVM the square of their number.
            second, both = ir.at("%in", size, "i8"), ir.let("icmp sgt i64 %count, 1")
            for k in range(len(self.cut.pieces)):
                ir.do(f"call void @piece{k}(ptr %in, ptr @constants)")
                if self.is_cut:
                    with ir.only_if(both, f"second.{k}", f"after.{k}"):
                        ir.do(f"call void @piece{k}(ptr {second}, ptr @constants)")


def cut_program(program: Program, registers: int, first: Sequence[int] | None = None) -> CutProgram:
    """Return the pieces of a program for a number of vector registers.

    Depth first, the outputs of the numbers `first` are finished before others; by default the last outputs, those of
    the tip and the highest rate, which keeps fewer values.
    """
    # Depth first from the outputs: all that one output needs, then what the next one needs besides.
    roots = program.outputs[::-1]
    if first is not None:
        roots = tuple(program.outputs[k] for k in (*first, *range(len(program.outputs))))
    depth_first = _operations(program, topological_order(roots, lambda i: program.steps[i].operands))
    # Few operations fit into the caches, or into the registers, as one function.
    if len(depth_first) <= MAX_WHOLE_STEPS[registers]:
        return _cut_in_order(program, depth_first, 1)
    # Of two orders the one with fewer accesses to memory is taken. Many registers hardly distinguish them.
    number = round(len(depth_first) / PIECE_STEPS)
    orders = [depth_first] if registers > 16 else [depth_first, _operations(program, range(len(program.steps)))]
    cuts = (_cut_in_order(program, order, number) for order in orders)
    return min(cuts, key=_count_accesses)


def _count_accesses(cut: CutProgram) -> int:
    """Count the loads and stores of a cut program."""
    return len(cut.loads) + len(cut.homes)


def _operations(program: Program, order: Iterable[int]) -> list[int]:
    """Return the operations in an order, functions and their operands first.

    A call would save and load all registers in use: at the beginning no register is in use.
    """
    steps, called = program.steps, vector_calls(program)
    # How many functions are called one after the other before a step. Sorted by depth, calls lie in one row: sines and
    # cosines of independent angles are neighbours, and are computed in pairs.
    depths: list[int] = []
    for step in steps:
        depths.append(max((depths[j] + (j in called) for j in step.operands), default=0))
    needed = set(topological_order(list(called), lambda i: steps[i].operands))
    early = sorted(needed, key=lambda i: (depths[i], i in called, i))
    late = [i for i in order if i not in needed]
    # Inputs and constants are no operations: they are loaded where they are used.
    return [i for i in (*early, *late) if steps[i].kind not in operations.LEAVES]


def _cut_in_order(program: Program, order: Sequence[int], number: int) -> CutProgram:
    """Cut the operations in this order into pieces of equal length."""
    cuts = [len(order) * k // number for k in range(number + 1)]
    pieces = tuple(tuple(order[start:end]) for start, end in pairwise(cuts))
    called = vector_calls(program)
    homes = _homes(program, pieces, called)
    loads = frozenset(pair for piece in pieces for pair in _loads(program, piece, called))
    return CutProgram(program, pieces, homes, loads)


def _homes(program: Program, pieces: Sequence[Sequence[int]], called: Mapping[int, VectorFunction]) -> dict[int, int]:
    """Return the places in memory of values that wait there.

    They are values of functions, and values that cross a cut.
    """
    steps, homes, unused = program.steps, dict[int, int](), count()
    # The sine and the cosine of an angle are two steps of the program and one call, which writes both into two
    # neighbouring vectors: a call is known by its function and its operand.
    pairs: dict[tuple[str, int], int] = {}
    for i, function in called.items():
        key = function.name, steps[i].operands[0]
        if key not in pairs:
            pairs[key] = next(unused)
            # The second result of a pair takes the next place.
            if function.result is not None:
                next(unused)
        homes[i] = pairs[key] + (function.result or 0)
    # Any other value needs a place from the piece that computes it to the last piece that reads it, if this is a later
    # one. Places are used again by values whose spans do not overlap: linear-scan allocation [1].
    last = {j: k for k, piece in enumerate(pieces) for i in piece for j in steps[i].operands}
    spans = {i: (k, last[i]) for k, piece in enumerate(pieces) for i in piece if i not in homes and last.get(i, k) > k}
    first = next(unused)
    return homes | {i: first + place for i, place in zip(spans, reuse_places(spans.values()), strict=True)}


def _loads(program: Program, piece: Sequence[int], called: Mapping[int, VectorFunction]) -> Iterator[tuple[int, int]]:
    """Yield the pairs of an operation and an operand to load.

    Values of operations of the piece itself stay in registers, as the register allocator decides.
    """
    computed_here, last_use = {i for i in piece if i not in called}, dict[int, int]()
    for position, i in enumerate(piece):
        for j in dict.fromkeys(program.steps[i].operands):
            # A value from memory is kept in a register for a short time only: a load is as cheap as what frees one.
            if j not in computed_here and (j not in last_use or position - last_use[j] > RELOAD_DISTANCE):
                yield i, j
            last_use[j] = position


@dataclass(frozen=True)
class _Piece:
    """A piece as it is written.

    `names` are the values in registers, by step. `masks` are those of the first piece, which computes them; other
    pieces load them.
    """

    ir: Writer
    form: _Straight
    constants: Mapping[float, int]
    names: dict[int, str] = field(default_factory=dict)
    masks: list[str] = field(default_factory=list)

    def write(self, k: int) -> None:
        """Write the operations of piece k."""
        steps = self.form.cut.program.steps
        # The first piece also computes the masks, and stores results that are inputs or constants.
        if k == 0:
            self._check()
            for i in self.form.results:
                if steps[i].kind in operations.LEAVES:
                    self._store_results(i, self._load(i))
        # Neighbouring sines and cosines are written together, as one call takes two angles.
        for of_angles, group in groupby(self.form.cut.pieces[k], self._is_of_angle):
            if of_angles:
                self._write_circles(list(group))
            else:
                self._write_others(list(group))

    def _is_of_angle(self, i: int) -> bool:
        """Return whether a step is a sine or a cosine."""
        return i in self.form.called and self.form.called[i].result is not None

    def _write_circles(self, group: Sequence[int]) -> None:
        """Write sines and cosines of some angles, two angles at a time."""
        # Angles in their order, each with the first operation that takes it.
        users = {self.form.cut.program.steps[i].operands[0]: i for i in reversed(group)}
        # An angle may itself be a sine of this group: it waits for the others, and is computed alone.
        free, waiting = ([j for j in reversed(users) if (j in group) == waits] for waits in (False, True))
        # Of an odd number of angles, the last one is paired with itself.
        pairs = zip_longest(free[::2], free[1::2], fillvalue=free[-1])
        for pair in chain(pairs, zip(waiting, waiting, strict=True)):
            angles = ", ".join(f"{self.ir.V} {self._operand(users[j], j)}" for j in pair)
            # A call writes the sine into the first vector of its home and the cosine into the second one.
            homes = (self.form.cut.homes[users[j]] - (self.form.called[users[j]].result or 0) for j in pair)
            places = ", ".join(f"ptr {self._at('homes', place)}" for place in homes)
            self.ir.do(f"call void @sincos({angles}, {places})")
        for i in group:
            if i in self.form.results:
                self._store_results(i, self._load(i))

    def _write_others(self, group: Sequence[int]) -> None:
        """Write operations that are no sines and cosines, in their order."""
        for i in group:
            step = self.form.cut.program.steps[i]
            operands = [self._operand(i, j) for j in step.operands]
            function = self.form.called.get(i)
            # The value of a function is not kept in a register: it is in the way of the calls that follow.
            if function is not None:
                value = self.ir.let(f"call {self.ir.V} @{function.name}({self.ir.V} {operands[0]})")
            else:
                self.names[i] = value = self.ir.op(step.kind, *operands)
            if i in self.form.cut.homes:
                self.ir.store(value, self._at("homes", self.form.cut.homes[i]))
            self._store_results(i, value)

    def _operand(self, i: int, j: int) -> str:
        """Return the value of step j for operation i, loaded if necessary."""
        if (i, j) in self.form.cut.loads:
            self.names[j] = self._load(j)
        return self.names[j]

    def _load(self, i: int) -> str:
        """Return the value of a step that is in memory or constant."""
        step = self.form.cut.program.steps[i]
        if step.kind == "input":
            return self.ir.load(self._at("inputs", int(step.value)))
        if step.kind != "constant":
            return self.ir.load(self._at("homes", self.form.cut.homes[i]))
        if step.value not in self.constants:
            return self.ir.vector(step.value)
        return self.ir.load(self.ir.at("%constants", self.constants[step.value], self.ir.V))

    def _at(self, part: str, place: int) -> str:
        """Return the address of a vector in a part of memory."""
        return self.ir.at("%memory", self.form.starts[part] + place, self.ir.V)

    def _check(self) -> None:
        """Compute the masks of all ports, and store them for later pieces."""
        self.masks.extend(nan_masks(self.ir, self.form.signature, self._add_zeros))
        if self.form.is_cut:
            for k, mask in enumerate(self.masks):
                self.ir.store(mask, self._at("masks", k))

    def _add_zeros(self, total: str, port: Port) -> str:
        """Add 0 times each scalar of an input.

        That is NaN of inf and of NaN.
        """
        # Several sums in turn, joined in the end: none waits for another.
        sums = [total] + [self.ir.vector(0.0)] * (PARTIAL_SUMS - 1)
        for j in range(port.start, port.end):
            x, k = self.ir.load(self._at("inputs", j)), j % PARTIAL_SUMS
            sums[k] = self.ir.op("fma", x, self.ir.vector(0.0), sums[k])
        first, second = (self.ir.op("add", *sums[k : k + 2]) for k in (0, 2))
        return self.ir.op("add", first, second)

    def _store_results(self, i: int, value: str) -> None:
        """Store a value into its results at once.

        No register is occupied longer.
        """
        for number, k in self.form.results.get(i, ()):
            # Adding the mask, 0 or NaN, makes a result NaN if an input that its port depends on is not finite.
            mask = self.masks[k] if len(self.masks) > 0 else self.ir.load(self._at("masks", k))
            self.ir.store(self.ir.op("add", value, mask), self._at("results", number))
