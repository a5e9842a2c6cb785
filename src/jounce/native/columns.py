"""The columns form of a kernel, in LLVM IR: partial derivatives of large robots, one traced step for all joints.

What joints require of the bodies that they carry are columns of matrices. In a batch, vectors hold a number of several
states, and steps of columns run one column after the other. For one state, numbers are doubles, and the vectors of a
column's step hold those of as many columns, which lie one behind the other. Operations on each number are the same.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from jounce.dynamics.computation import Port, Signature
from jounce.model.mechanism import Mechanism
from jounce.native.column_layout import BODY, MINUS_ONE, MOST_LANES, WRENCH_NUMBERS, ZERO, ColumnLayout
from jounce.native.column_sheets import JOINT_SIZE
from jounce.native.column_steps import ColumnSteps
from jounce.native.emit import BlockCode, JointStep, define_step, emit_steps, nan_masks, pointers
from jounce.native.ir import Writer

OF_COLUMNS = ("columns", "products")  # the memory of a step in which columns lie side by side


def emit_columns(mechanism: Mechanism, layout: ColumnLayout, signature: Signature) -> BlockCode:
    """The sweeps over the tree and over columns, for a block of states or for one."""
    steps = ColumnSteps(mechanism, layout, signature)
    of_joints, of_columns = steps.of_joints(), steps.of_columns()

    def define(ir: Writer) -> None:
        for name, step in of_joints.items() if ir.lanes == 1 else {**of_joints, **of_columns}.items():
            define_step(ir, name, step, step.memory)
        _define_tables(ir, steps)
        code = _Code(ir, layout, {**of_joints, **of_columns})
        code.define_sweep()
        code.define_block(signature)

    def define_wide(ir: Writer) -> None:
        for name, step in of_columns.items():
            _define_wide_step(ir, name, step)

    return BlockCode(
        define,
        _result_places(layout),
        layout.areas.size,
        short=True,
        define_wide=define_wide,
        results_in_bodies=True,
    )


def _result_places(layout: ColumnLayout) -> list[list[int]]:
    """Where the results are among all: by port, in the order of its numbers."""
    every, width = range(layout.nv), layout.solved_width
    if not layout.forward:
        first = layout.areas.start("results")
        return [[first + layout.place(name, i, j) for name in ("K", "D", "M") for i in every for j in every]]
    first = layout.areas.start("solved")
    by_q, by_qd = ([first + i * width + k * layout.nv + j for i in every for j in every] for k in range(2))
    return [by_q, by_qd, [first + min(i, j) * width + 2 * layout.nv + max(i, j) for i in every for j in every]]


def _define_tables(ir: Writer, steps: ColumnSteps) -> None:
    """The constants of joints, in the order of the walk, and where things are."""
    layout = steps.layout
    every, after = range(layout.nv), {j: k + 1 for k, j in enumerate(layout.walk)} | {-1: 0}
    ir.table("constants", steps.constants.ravel().tolist())
    ir.table("parents", [after[layout.carriers[j]] for j in layout.walk])
    ir.table("coordinates", layout.walk)
    ir.table("carried", [layout.carried(j) for j in layout.walk])
    if layout.forward:
        sides = [[layout.place(name, i, j) for name in ("K", "D") for j in every] for i in every]
        units = [[MINUS_ONE if i == j else ZERO for j in every] for i in every]
        ir.table("right_sides", [place for row in zip(sides, units, strict=True) for part in row for place in part])


def _define_wide_step(ir: Writer, name: str, step: JointStep) -> None:
    """A step on columns from one on, as many at once as there are lanes; those beyond the last are not kept."""
    given = pointers(*(f"%{memory}" for memory in step.memory))

    def read(i: int) -> str:
        memory, place = step.reads[i]
        address = ir.at(f"%{memory}", place)
        return ir.load(address) if memory in OF_COLUMNS else ir.splat(ir.let(f"load double, ptr {address}"))

    with ir.function(f"internal void @{name}({given}, i64 %left) {ir.aligned}"):
        values = emit_steps(ir, step.program, read)
        first = ir.let(f"insertelement {ir.I} poison, i64 %left, i64 0")
        left = ir.let(f"shufflevector {ir.I} {first}, {ir.I} poison, <{ir.lanes} x i32> zeroinitializer")
        lanes = ", ".join(f"i64 {lane}" for lane in range(ir.lanes))
        kept = ir.let(f"icmp slt {ir.I} <{lanes}>, {left}")
        store = f"@llvm.masked.store.v{ir.lanes}f64.p0"
        ir.declared[f"declare void {store}({ir.V}, ptr, i32, {ir.B})"] = None
        for (memory, place), i in zip(step.writes, step.program.outputs, strict=True):
            ir.do(f"call void {store}({ir.V} {values[i]}, ptr {ir.at(f'%{memory}', place)}, i32 8, {ir.B} {kept})")
    with (
        ir.function(f"void @wide_{name}({given}, i64 %first, i64 %count)"),
        ir.loop(ir.let(f"sdiv i64 {ir.let(f'add i64 %count, {ir.lanes - 1}')}, {ir.lanes}")) as block,
    ):
        done = ir.let(f"mul i64 {block}, {ir.lanes}")
        j, left = ir.let(f"add i64 %first, {done}"), ir.let(f"sub i64 %count, {done}")
        there = {x: ir.at(f"%{x}", j) if x in OF_COLUMNS else f"%{x}" for x in step.memory}
        ir.do(f"call void @{name}({pointers(*(there[x] for x in step.memory))}, i64 {left})")


@dataclass(frozen=True)
class _Code:
    """The functions that call the steps."""

    ir: Writer
    layout: ColumnLayout
    steps: Mapping[str, JointStep]

    def define_sweep(self) -> None:
        """``@sweep(in, memory)``: outward and inward over the joints, and over the columns of all that each carries."""
        ir, layout = self.ir, self.layout
        with ir.function("internal void @sweep(ptr %in, ptr %memory)"):
            base = {"in": "%in", "body": self._area("bodies"), "products": self._area("results")}
            base |= {name: self._area(name) for name in ("mask", "columns", *["found"] * layout.forward)}
            self._call("ground", base)
            with ir.loop(str(layout.joints)) as k:
                self._call("outward", self._memory_of_joint(k))
            with ir.loop(str(layout.joints)) as done:
                memory = self._memory_of_joint(ir.let(f"sub i64 {layout.joints - 1}, {done}"))
                self._call("inward", {**memory, "columns": ir.at(memory["columns"], done, ir.V)})
            with ir.loop(str(layout.joints)) as done:
                k = ir.let(f"sub i64 {layout.joints - 1}, {done}")
                count = ir.let(f"load i64, ptr {ir.at('@carried', k, 'i64')}")
                first = ir.let(f"sub i64 {ir.let(f'add i64 {done}, 1')}, {count}")
                self._call_columns("column", self._memory_of_joint(k), first, count)
            if layout.floats:
                side = {"side": ir.at(self._area("sides"), 3 * layout.nv, ir.V)} if layout.forward else {}
                self._call("of_base", base | side)
                self._call_columns("column_of_base", base, "0", str(layout.joints))

    def define_block(self, signature: Signature) -> None:
        """``@block(in, out, bodies, count)``, of one block."""
        ir = self.ir
        with ir.function("internal void @block(ptr %in, ptr %out, ptr %memory, i64 %count)"):
            mask, results = next(nan_masks(ir, signature, self._add_zeros)), self._area("results")
            ir.store(mask, self._area("mask"))  # all inputs enter all results
            ir.store(mask, ir.at(results, ZERO, ir.V))
            ir.store(ir.vector(-1.0), ir.at(results, MINUS_ONE, ir.V))
            self._clear_ends("columns", WRENCH_NUMBERS, self.layout.width)
            if self.layout.forward:
                self._solve_for_accelerations()
            ir.do("call void @sweep(ptr %in, ptr %memory)")
            if self.layout.forward:
                self._copy_right_sides(results)
                self._solve(0, 3 * self.layout.nv)

    def _solve_for_accelerations(self) -> None:
        """The accelerations, from the forces that are missing where nothing accelerates."""
        ir, layout = self.ir, self.layout
        self._clear_ends("sides", layout.nv, layout.solved_width)
        with ir.loop(str(layout.nv)) as i:
            ir.store(ir.vector(0.0), ir.at(self._area("found"), i, ir.V))
        ir.do("call void @sweep(ptr %in, ptr %memory)")
        self._call(
            "factors", {name: self._area(name) for name in ("factors", "mask")} | {"products": self._area("results")}
        )
        self._solve(3 * layout.nv, 1)
        with ir.loop(str(layout.nv)) as i:
            place = ir.let(f"add i64 {ir.let(f'mul i64 {i}, {layout.solved_width}')}, {3 * layout.nv}")
            ir.store(ir.load(ir.at(self._area("solved"), place, ir.V)), ir.at(self._area("found"), i, ir.V))

    def _solve(self, first: int, count: int) -> None:
        memory = {name: self._area(name) for name in ("mask", "factors")}
        memory |= {"columns": self._area("sides"), "products": self._area("solved")}
        self._call_columns("solve", memory, str(first), str(count))

    def _copy_right_sides(self, results: str) -> None:
        """K, D, and -1 on the diagonal."""
        ir, width = self.ir, 3 * self.layout.nv
        with ir.loop(str(self.layout.nv)) as i:
            row = ir.at(self._area("sides"), ir.let(f"mul i64 {i}, {self.layout.solved_width}"), ir.V)
            listed = ir.at("@right_sides", ir.let(f"mul i64 {i}, {width}"), "i64")
            with ir.loop(str(width)) as j:
                place = ir.let(f"load i64, ptr {ir.at(listed, j, 'i64')}")
                ir.store(ir.load(ir.at(results, place, ir.V)), ir.at(row, j, ir.V))

    def _clear_ends(self, area: str, rows: int, width: int) -> None:
        """Numbers in the lanes beyond the last column: what is computed with them is not kept, but raises no flag."""
        ir = self.ir
        if ir.lanes > 1:
            return
        with ir.loop(str(rows)) as i:
            end = ir.at(self._area(area), ir.let(f"mul i64 {ir.let(f'add i64 {i}, 1')}, {width}"), ir.V)
            for j in range(MOST_LANES):
                ir.store(ir.vector(0.0), ir.at(end, j - MOST_LANES, ir.V))

    def _area(self, name: str) -> str:
        return self.ir.at("%memory", self.layout.areas.start(name), self.ir.V)

    def _memory_of_joint(self, k: str) -> dict[str, str]:
        """The memory that steps of a joint take."""
        ir, layout = self.ir, self.layout
        own, above = ir.let(f"add i64 {k}, 1"), ir.let(f"load i64, ptr {ir.at('@parents', k, 'i64')}")
        bodies, coordinate = self._area("bodies"), ir.let(f"load i64, ptr {ir.at('@coordinates', k, 'i64')}")
        body, parent = (ir.at(bodies, ir.let(f"mul i64 {j}, {BODY.size}"), ir.V) for j in (own, above))
        row = ir.let(f"add i64 {coordinate}, {6 * layout.floats}")
        memory = {"body": body, "parent": parent, "mask": self._area("mask"), "columns": self._area("columns")}
        memory["constants"] = ir.at("@constants", ir.let(f"mul i64 {k}, {JOINT_SIZE}"))
        memory["in"] = ir.at("%in", coordinate, ir.V)
        memory["products"] = ir.at(self._area("results"), ir.let(f"mul i64 {row}, {layout.width}"), ir.V)
        if layout.forward:
            memory["found"] = ir.at(self._area("found"), coordinate, ir.V)
            side = ir.let(f"mul i64 {row}, {layout.solved_width}")
            memory["side"] = ir.at(ir.at(self._area("sides"), side, ir.V), 3 * layout.nv, ir.V)
        return memory

    def _call(self, name: str, memory: Mapping[str, str]) -> None:
        self.ir.do(f"call void @{name}({pointers(*(memory[x] for x in self.steps[name].memory))})")

    def _call_columns(self, name: str, memory: Mapping[str, str], first: str, count: str) -> None:
        """A step on a number of columns: one after the other, or of one state by another module."""
        ir, step = self.ir, self.steps[name]
        if ir.lanes == 1:
            ir.declared[f"declare void @wide_{name}({', '.join(['ptr'] * len(step.memory))}, i64, i64)"] = None
            ir.do(f"call void @wide_{name}({pointers(*(memory[x] for x in step.memory))}, i64 {first}, i64 {count})")
            return
        with ir.loop(count) as k:
            j = ir.let(f"add i64 {first}, {k}")
            self._call(name, {**memory, **{x: ir.at(memory[x], j, ir.V) for x in OF_COLUMNS}})

    def _add_zeros(self, total: str, port: Port) -> str:
        for j in range(port.start, port.end):
            total = self.ir.op("fma", self.ir.load(self.ir.at("%in", j, self.ir.V)), self.ir.vector(0.0), total)
        return total
