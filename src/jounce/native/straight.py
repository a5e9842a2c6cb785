"""The straight form of a kernel, in LLVM IR: all operations of a program, in one function or in pieces."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, groupby, zip_longest

from jounce.dynamics.computation import Port, Signature
from jounce.native import memory_layout, pieces
from jounce.native.emit import BlockCode, nan_masks
from jounce.native.ir import Writer
from jounce.native.jit import Target
from jounce.native.pieces import CutProgram
from jounce.program.operations import LEAVES, VectorFunction
from jounce.program.program import Program

MAX_STEPS_COMPILED_TWICE = 6000  # for vectors and for one state: each compiles in some tenths of a second
PARTIAL_SUMS = 4  # of the check, as many as a sum takes cycles: none waits for another
BROADCASTING_LANES = 8  # of AVX-512, which reads one number for all lanes within an instruction: no table is shorter


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
    form = _Straight(pieces.cut_program(program, target.registers, first), signature, results)
    short = len(program.steps) <= MAX_STEPS_COMPILED_TWICE
    return BlockCode(form.define, places, form.vectors, short, pieces.BLOCKS_AT_ONCE if form.is_cut else 1)


@dataclass(frozen=True)
class _Straight:
    """A program in pieces: its results by step, each the number of its vector and of its port."""

    cut: CutProgram
    signature: Signature
    results: Mapping[int, Sequence[tuple[int, int]]]

    @cached_property
    def called(self) -> Mapping[int, VectorFunction]:
        return pieces.vector_calls(self.cut.program)

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
                if steps[i].kind in LEAVES:
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
