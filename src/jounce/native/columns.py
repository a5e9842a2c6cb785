"""Write the columns form of a kernel: partial derivatives of large robots, one traced step for all joints.

What joints require of the bodies that they carry are columns of matrices (`memory_layout.ColumnLayout`). The sweep goes
outward over the joints to motions, inward to what each joint requires, and for each joint over the columns of all that
it carries, to the products of its screw with them. Accelerations are found the same way: the forces that are missing
where nothing accelerates, the factors of M, and solutions of M x = -b for every column b.

In a batch, vectors hold a number of several states, and steps of columns run one column after the other. For one state,
numbers are doubles, and the vectors of a column's step hold those of as many columns, which lie one behind the other.
Operations on each number are the same.

`emit_columns` is the door, `_Code` writes the functions that call the steps, `ColumnSteps` traces these, once a kernel:
the mathematics is that of `dynamics.recursion.force_partials` and of `spatial.linear`. What joints of a robot have in
common are numbers in the trace, what distinguishes them are numbers in a table. A `ColumnSheet` knows where the inputs
and results of a step are in memory.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jounce.core.scalars import Array, concatenate, cos, sin
from jounce.dynamics.computation import Port, Signature
from jounce.dynamics.recursion.force_partials import CarriedBodies, ScrewProducts, Screws, ScrewWrenches
from jounce.dynamics.recursion.joints import FreeJoint, MovingJoint
from jounce.model.equivalent_mechanisms import minimal_mechanism
from jounce.model.mechanism import Mechanism
from jounce.native import memory_layout
from jounce.native.ir import BlockCode, JointStep, Writer, define_step, emit_steps, nan_masks, pointers
from jounce.native.loop_steps import Sheet
from jounce.native.memory_layout import ColumnLayout
from jounce.spatial.inertia import from_moment_matrix, moment_matrix, symmetric_matrix
from jounce.spatial.lie import Ad, ad, inverse, pose, position, rotation, wedge
from jounce.spatial.linear import Factors
from jounce.spatial.series import Series

OF_COLUMNS = ("columns", "products")  # the memory of a step in which columns lie side by side
_I3, _I4, _I6 = (np.eye(n, dtype=int) for n in (3, 4, 6))
TRIANGLE = np.triu_indices(4)
CONSTANT_SIZES = {"R": 9, "r": 3, "X": 6, "offset": 1, "Pi": 10}  # of a joint and its body
JOINT_SIZE = sum(CONSTANT_SIZES.values())


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


class ColumnSheet(Sheet):
    """A sheet of the columns form."""

    def __init__(self, numbers: np.ndarray | None = None) -> None:
        super().__init__(body=memory_layout.BODY, parent=memory_layout.BODY)
        self.numbers: dict[str, np.ndarray] = {}
        if numbers is not None:
            row = [
                self.take("constants", k, 1)[0] if (column != column[0]).any() else column[0]
                for k, column in enumerate(numbers.T)
            ]
            ends = np.cumsum(list(CONSTANT_SIZES.values()))
            self.numbers = dict(zip(CONSTANT_SIZES, np.split(np.array(row, dtype=object), ends[:-1]), strict=True))

    def take(self, memory: str, place: int, count: int) -> np.ndarray:
        """Numbers one behind the other."""
        self.reads += [(memory, place + k) for k in range(count)]
        return self.tape.variables(count)

    def put(self, memory: str, place: int, values: Any) -> None:
        """Results one behind the other."""
        self.outputs += [(memory, place + k, x) for k, x in enumerate(np.ravel(values))]

    def motion(self, memory: str) -> tuple[Series, Series]:
        """The twist of a body with its rate, and gravity as a twist."""
        V, g = self.read(memory, "V"), self.read(memory, "field")[0]
        return V, Series.of([concatenate([0 * g, g], axis=-2)])

    def carried(self, memory: str) -> CarriedBodies:
        """The bodies that a joint carries."""
        Pi = [symmetric_matrix(x[:, 0]) for x in self.read(memory, "Pi").upto(1)]
        return CarriedBodies(Series.of(Pi), self.read(memory, "p"))

    def write_body(self, V: Series, field: Series, Pi: Array) -> None:
        """The motion of a body with moments Pi, which so far carries itself alone."""
        self.write("body", "V", V)
        self.write("body", "field", field.map(lambda g: g[3:]))
        self.write_carried("body", Series.constant(Pi), from_moment_matrix(Pi) @ V)

    def write_carried(self, memory: str, Pi: Series, p: Series) -> None:
        """The bodies that a joint carries."""
        self.write(memory, "Pi", Pi.map(lambda x: x[TRIANGLE]))
        self.write(memory, "p", p)

    def wrenches(self, width: int) -> list[Series]:
        """The wrenches of a column: momentum with its rate, reaction, change."""
        x = np.stack([self.take("columns", k * width, 1) for k in range(memory_layout.WRENCH_NUMBERS)]).reshape(4, 6, 1)
        return [Series.of([x[0], x[1]]), Series.of([x[2]]), Series.of([x[3]])]

    def write_column(self, width: int, momentum: Series, reaction: Series, change: Series) -> None:
        """The wrenches of a column."""
        for k, x in enumerate(np.ravel([momentum[0], momentum[1], reaction[0], change[0]])):
            self.put("columns", k * width, [x])

    def step(self) -> JointStep:
        """Return the recorded step; results that are 0 are the mask, as NaN of any input makes all results NaN."""
        [mask], zero = self.take("mask", 0, 1), self.tape.node(0)
        self.outputs = [(m, place, mask if self.tape.node(x) is zero else x) for m, place, x in self.outputs]
        return super().step()


@dataclass(frozen=True)
class ColumnSteps:
    """The steps of a robot."""

    mechanism: Mechanism
    layout: ColumnLayout
    signature: Signature

    def of_joints(self) -> dict[str, JointStep]:
        """The steps of joints and of all, by name."""
        steps = [self.ground, self.outward, self.inward]
        steps += [self.of_base] * self.layout.floats + [self.factors] * self.layout.forward
        return {step.__name__: step() for step in steps}

    def of_columns(self) -> dict[str, JointStep]:
        """The steps of one column, by name."""
        steps = [self.column, *[self.column_of_base] * self.layout.floats, *[self.solve] * self.layout.forward]
        return {step.__name__: step() for step in steps}

    @property
    def constants(self) -> np.ndarray:
        """What `CONSTANT_SIZES` lists, of each joint, in the order of the walk: (joints, ...)."""
        chain = minimal_mechanism(self.mechanism)
        rows = [
            np.concatenate(
                [*map(np.ravel, (rotation(B), position(B), X)), [g], np.asarray(moment_matrix(M)[TRIANGLE], float)]
            )
            for B, X, g, M in zip(
                chain.B[list(chain.owners)], chain.X, chain.g, chain.M[list(chain.owners)], strict=True
            )
        ]
        return np.array(rows, dtype=float)[self.layout.walk]

    def ground(self) -> JointStep:
        """Trace the motion of the base, or of the ground, and what the base itself is to those that carry it."""
        chain, sheet = minimal_mechanism(self.mechanism), ColumnSheet()
        gravity = Series.of([concatenate([0 * chain.gravity, chain.gravity], axis=-1)[:, None]])
        if self.layout.floats:
            base = self._base(sheet)
            motion, seen = base.rate, base.twists(gravity)
            Pi = moment_matrix(chain.M[0]) + sheet.take("mask", 0, 1)
        else:
            motion, seen, Pi = Series.of([np.zeros((6, 1), dtype=int)] * 2), gravity, 0 * _I4
        sheet.write_body(motion, seen, Pi)
        return sheet.step()

    def outward(self) -> JointStep:
        """Trace the motion of a body from that of its parent."""
        sheet = ColumnSheet(self.constants)
        theta = self._coordinate(sheet)
        angle = sheet.numbers["X"][2:3] * theta
        sheet.put("body", memory_layout.BODY.start("sine"), sin(angle))
        sheet.put("body", memory_layout.BODY.start("cosine"), cos(angle))
        joint = self._joint(sheet, sin(angle), cos(angle))
        V, above = sheet.motion("parent")
        V = joint.twists(V) + joint.X @ joint.rate
        Pi = symmetric_matrix(sheet.numbers["Pi"] + sheet.take("mask", 0, 1))
        sheet.write_body(V, joint.twists(above), Pi)
        return sheet.step()

    def inward(self) -> JointStep:
        """Trace what a joint requires of the bodies that it carries, and what these are to its parent."""
        sheet = ColumnSheet(self.constants)
        joint = self._known_joint(sheet)
        V, seen = sheet.motion("body")
        on, above = sheet.carried("body"), sheet.carried("parent")
        x = ScrewWrenches.of(joint, V, None, seen, on)
        sheet.write("body", "S_rate", x.screws.S_rate)
        sheet.write("body", "A", x.screws.A)
        sheet.write_column(self.layout.width, x.momentum, x.reaction, x.change)
        sheet.write_carried("parent", above.Pi + joint.moments(on.Pi), above.p + joint.wrenches(on.p))
        if self.layout.forward:
            Q = sheet.take("in", self._third_input, 1)
            sheet.put("side", 0, (joint.X.T @ on.force(V, seen)[0]).ravel() - Q)
        return sheet.step()

    def column(self) -> JointStep:
        """Trace the products of a joint's screw with the wrenches of one it carries, and their way to its parent."""
        sheet = ColumnSheet(self.constants)
        joint = self._known_joint(sheet)
        S_rate, A = (sheet.read("body", name) for name in ("S_rate", "A"))
        wrenches = sheet.wrenches(self.layout.width)
        self._write_products(sheet, ScrewProducts.of(Screws(Series.constant(joint.X), S_rate, S_rate, A), *wrenches))
        sheet.write_column(self.layout.width, *map(joint.wrenches, wrenches))
        return sheet.step()

    def of_base(self) -> JointStep:
        """Trace what the screws of the base require, and their products with it."""
        sheet = ColumnSheet()
        base = self._base(sheet)
        V, seen = sheet.motion("body")
        on = sheet.carried("body")
        x = ScrewWrenches.of(base, V, None, seen, on)
        own = ScrewProducts.of(x.screws, x.momentum, x.reaction, x.change)
        for name, matrix in (("K", own.change), ("D", own.D - own.counted_twice.mT), ("M", own.M)):
            sheet.put("products", self.layout.results.start(f"base {name}"), matrix[0])
        if self.layout.forward:
            Q = sheet.take("in", self.signature.inputs[2].start, 6)
            for i, x in enumerate(on.force(V, seen)[0].ravel() - Q):
                sheet.put("side", i * self.layout.solved_width, [x])
        return sheet.step()

    def column_of_base(self) -> JointStep:
        """Trace the products of the screws of the base with the wrenches of one joint."""
        sheet = ColumnSheet()
        base = self._base(sheet)
        V, seen = sheet.motion("body")
        nothing = Series.constant(0 * base.X)
        screws = Screws(Series.constant(base.X), base.screw_rate(V), nothing, base.screw_rate(-seen))
        self._write_products(sheet, ScrewProducts.of(screws, *sheet.wrenches(self.layout.width)))
        return sheet.step()

    def factors(self) -> JointStep:
        """Trace the factors of M."""
        sheet = ColumnSheet()
        M = self._spread([sheet.take("products", self.layout.place("M", i, j), 1)[0] for i, j in self.layout.entries])
        of_M = Factors.of(M)
        rows = [np.append(row, d) for row, d in zip(of_M.L, of_M.inverse_D, strict=True)]
        sheet.put("factors", 0, [rows[i][j] for i, j in self.layout.entries])
        return sheet.step()

    def solve(self) -> JointStep:
        """Trace the solution of M x = -b for one column b."""
        sheet = ColumnSheet()
        L = self._spread(sheet.take("factors", 0, len(self.layout.entries)))
        width, rows = self.layout.solved_width, range(self.layout.nv)
        b = np.stack([sheet.take("columns", i * width, 1) for i in rows])
        x = Factors(tuple(L[i, :i] for i in rows), tuple(L[i, i : i + 1] for i in rows)).solve(-b)
        for i in rows:
            sheet.put("products", i * width, x[i])
        return sheet.step()

    @property
    def _third_input(self) -> int:
        """Where the accelerations or forces of the first joint are."""
        return self.signature.inputs[2].end - self.layout.joints

    def _spread(self, entries: Sequence[object] | np.ndarray) -> np.ndarray:
        matrix = np.zeros((self.layout.nv, self.layout.nv), dtype=object)
        for (i, j), x in zip(self.layout.entries, entries, strict=True):
            matrix[i, j] = x
        return matrix

    def _coordinate(self, sheet: ColumnSheet) -> np.ndarray:
        return sheet.take("in", 0, 1) + sheet.numbers["offset"]

    def _known_joint(self, sheet: ColumnSheet) -> MovingJoint:
        return self._joint(
            sheet, *(sheet.take("body", memory_layout.BODY.start(name), 1) for name in ("sine", "cosine"))
        )

    def _joint(self, sheet: ColumnSheet, s: np.ndarray, c: np.ndarray) -> MovingJoint:
        """A joint that has turned by an angle of this sine and cosine."""
        R, r, X = sheet.numbers["R"].reshape(3, 3), sheet.numbers["r"][:, None], sheet.numbers["X"]
        turned = np.array([[c[0], -s[0], 0], [s[0], c[0], 0], [0, 0, 1]], dtype=object)
        slid = _I3[:, 2:] * X[5] * self._coordinate(sheet)
        T, offset, turn = pose(turned, slid), pose(_I3, r), pose(R, 0 * r)
        rate = sheet.take("in", self.signature.inputs[1].start, 1)[:, None]
        if self.layout.forward:
            acceleration = sheet.take("found", 6 * self.layout.floats, 1)[:, None]
        else:
            acceleration = sheet.take("in", self._third_input, 1)[:, None]
        return MovingJoint(
            0, pose(R, r), offset, turn, Ad(inverse(offset)), Ad(inverse(turn)), X[:, None], ad(X[None]),
            wedge(X[None]), Series.of([rate, acceleration]), T, Ad(inverse(T)),
        )  # fmt: skip

    def _base(self, sheet: ColumnSheet) -> FreeJoint:
        C, *V = self.signature.of_role("base")
        pose_of_base = sheet.take("in", C.start, 16).reshape(4, 4)
        places = [("in", port.start) for port in V] + [("found", 0)] * self.layout.forward
        rates = [sheet.take(memory, place, 6)[:, None] for memory, place in places]
        screws = _I6, ad(_I6), wedge(_I6)
        turn = pose_of_base, Ad(inverse(pose_of_base))
        return FreeJoint(-1, _I4, _I4, _I4, _I6, _I6, *screws, Series.of(rates), *turn)

    def _write_products(self, sheet: ColumnSheet, found: ScrewProducts) -> None:
        by_name = {"M": found.M, "K": found.change, "D": found.D, "by_place": found.by_place}
        by_name["by_rate"] = found.by_rate - found.counted_twice
        for name in memory_layout.PRODUCTS:
            for i, x in enumerate(np.ravel(by_name[name][0])):
                sheet.put("products", self.layout.results.start(f"all {name}") + i * self.layout.width, [x])


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
        units = [[memory_layout.MINUS_ONE if i == j else memory_layout.ZERO for j in every] for i in every]
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
            ir.store(mask, ir.at(results, memory_layout.ZERO, ir.V))
            ir.store(ir.vector(-1.0), ir.at(results, memory_layout.MINUS_ONE, ir.V))
            self._clear_ends("columns", memory_layout.WRENCH_NUMBERS, self.layout.width)
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
            for j in range(memory_layout.MOST_LANES):
                ir.store(ir.vector(0.0), ir.at(end, j - memory_layout.MOST_LANES, ir.V))

    def _area(self, name: str) -> str:
        return self.ir.at("%memory", self.layout.areas.start(name), self.ir.V)

    def _memory_of_joint(self, k: str) -> dict[str, str]:
        """The memory that steps of a joint take."""
        ir, layout = self.ir, self.layout
        own, above = ir.let(f"add i64 {k}, 1"), ir.let(f"load i64, ptr {ir.at('@parents', k, 'i64')}")
        bodies, coordinate = self._area("bodies"), ir.let(f"load i64, ptr {ir.at('@coordinates', k, 'i64')}")
        body, parent = (ir.at(bodies, ir.let(f"mul i64 {j}, {memory_layout.BODY.size}"), ir.V) for j in (own, above))
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
