"""The loop form of a kernel, in LLVM IR: the steps of one joint driven over the tree.

Straight-line code grows with the robot, and beyond some ten joints no longer fits where a processor keeps it; this form
does not grow. Every body has its part of scratch memory, the ground the first.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain

import numpy as np

from jounce.dynamics.computation import Port, Signature
from jounce.dynamics.recursion.forces import ground, sweep
from jounce.dynamics.recursion.steps import BodyMotion
from jounce.model.equivalent_mechanisms import minimal_mechanism
from jounce.model.mechanism import Mechanism
from jounce.native import loop_steps, memory_layout
from jounce.native.emit import BlockCode, emit_steps, nan_masks
from jounce.native.ir import Writer
from jounce.native.loop_steps import JointStep, Sweeps
from jounce.native.memory_layout import VectorLayout

STEP_MEMORY = ("constants", "body", "parent", "motion", "carrier")  # what a step reads and writes
GROUND_MEMORY = ("%bodies", "%bodies", "%motions")  # the body, parent and motion of the ground


def emit_loop(mechanism: Mechanism, sweeps: Sweeps, signature: Signature) -> BlockCode:
    """The sweeps over the tree for one block of states."""
    places = [range(port.start, port.end) for port in signature.outputs]
    vectors = memory_layout.vectors_of_bodies(sweeps.computation, mechanism)
    return BlockCode(lambda ir: _define_block(ir, mechanism, sweeps, signature), places, vectors)


def _define_block(ir: Writer, mechanism: Mechanism, sweeps: Sweeps, signature: Signature) -> None:
    reduced, of_joints = minimal_mechanism(mechanism), loop_steps.joint_kinds(mechanism)
    present = [kind for kind in loop_steps.JOINT_KINDS if kind in of_joints]
    _define_steps(ir, present, sweeps, reduced.floats)
    for name, numbers in loop_steps.tables(mechanism, [present.index(kind) for kind in of_joints]).items():
        ir.table(name, numbers)
    _define_sum(ir)
    with ir.function("internal void @block(ptr %in, ptr %out, ptr %bodies, i64 %count)"):
        ir.do(f"%motions = getelementptr {ir.V}, ptr %bodies, i64 {(len(reduced.joints) + 1) * sweeps.layout.size}")
        _set_results(ir, signature)
        if sweeps.computation.base:
            _move_ground(ir, reduced, sweeps, signature)
        else:
            _set_ground(ir, sweeps, ground(reduced.gravity.astype(float)))
        _set_joint_variables(ir, reduced, sweeps.layout)
        sweep(_Memory(ir, reduced, sweeps, signature, present))
        if reduced.floats:
            _add_base_force(ir, sweeps, signature)


@dataclass(frozen=True)
class _Memory:
    """The tree in scratch memory: each step of the sweep is a call of a traced function, in a loop over the bodies."""

    ir: Writer
    chain: Mechanism
    sweeps: Sweeps
    signature: Signature
    kinds: Sequence[str]

    def outward(self) -> Iterator[str]:
        with self.ir.loop(str(len(self.chain.joints))) as i:
            yield i

    def inward(self) -> Iterator[str]:
        with self.ir.loop(str(len(self.chain.joints))) as down:
            yield self.ir.let(f"sub i64 {len(self.chain.joints) - 1}, {down}")

    def move(self, i: str) -> None:
        _call(self.ir, "outward", self.kinds, i, _memory(self.ir, i, self.sweeps))

    def add_wrench(self, i: str) -> None:
        if self.sweeps.computation.wrench:
            place = self.ir.let(f"add i64 {i}, {int(self.chain.floats)}")  # among the bodies that take wrenches
            _add_wrench(self.ir, place, _memory(self.ir, i, self.sweeps), self.sweeps.layout, self.signature)

    def hand_on(self, i: str) -> None:
        memory = _memory(self.ir, i, self.sweeps)
        _call(self.ir, "inward", self.kinds, i, memory)
        if self.sweeps.acting:
            table = self.ir.at("@drives", self.ir.let(f"mul i64 {i}, {len(loop_steps.DRIVE_SIZES)}"))
            self.ir.do(f"call void @drive({_pointers(table, *memory)})")

    def collect(self, i: str) -> None:
        ir, body = self.ir, _memory(self.ir, i, self.sweeps)[0]
        with _loop_over_coordinates(ir, i) as (coordinate, factor):  # Q = G^T Q_theta
            for port, (place,) in zip(self.signature.outputs, self.sweeps.layout.places("Q"), strict=True):
                Q = ir.at("%out", ir.let(f"add i64 {coordinate}, {port.end - self.chain.n}"), ir.V)
                ir.store(ir.op("fma", factor, ir.load(ir.at(body, place, ir.V)), ir.load(Q)), Q)


def _define_steps(ir: Writer, present: Sequence[str], sweeps: Sweeps, floating: bool) -> None:
    for kind in present:
        _define_step(ir, f"outward_{kind}", sweeps.outward(kind))
        _define_step(ir, f"inward_{kind}", sweeps.inward(kind))
    if sweeps.computation.wrench:
        _define_step(ir, "add_wrench", sweeps.add_wrench())
    if sweeps.acting:
        _define_step(ir, "drive", sweeps.drive())
    if sweeps.computation.base:
        _define_step(ir, "move_base", sweeps.base(floating))


def _define_sum(ir: Writer) -> None:
    """``@sum(x, count, total)``: add 0 times each of `count` vectors to a total."""
    with ir.function(f"internal {ir.V} @sum(ptr %x, i64 %count, {ir.V} %total)"):
        ir.label("start")
        ir.do("br label %loop")
        ir.label("loop")
        i = ir.let("phi i64 [ 0, %start ], [ %next, %loop ]")
        total = ir.let(f"phi {ir.V} [ %total, %start ], [ %more, %loop ]")
        zero = ir.op("mul", ir.load(ir.at("%x", i, ir.V)), ir.vector(0.0))
        ir.do(f"%more = fadd {ir.V} {total}, {zero}")
        ir.do(f"%next = add i64 {i}, 1")
        ir.do(f"br i1 {ir.let('icmp slt i64 %next, %count')}, label %loop, label %done")
        ir.label("done")
        ir.do(f"ret {ir.V} %more")


def _set_results(ir: Writer, signature: Signature) -> None:
    """Initialise the forces: 0, or NaN if an input on which their order depends is not finite."""

    def add(total: str, port: Port) -> str:
        return ir.let(f"call {ir.V} @sum(ptr {ir.at('%in', port.start, ir.V)}, i64 {port.size}, {ir.V} {total})")

    for port, mask in zip(signature.outputs, nan_masks(ir, signature, add), strict=True):
        with ir.loop(str(port.end), str(port.start)) as j:
            ir.store(mask, ir.at("%out", j, ir.V))


def _set_ground(ir: Writer, sweeps: Sweeps, motion: BodyMotion) -> None:
    """The motion of the ground, constant here, and what acts on it: nothing yet, as bodies add to it."""
    for name, _, _ in sweeps.motion.parts:
        for k, places in enumerate(sweeps.motion.places(name)):
            for place, x in zip(places, np.ravel(getattr(motion, name)[k]).tolist(), strict=True):
                ir.store(ir.vector(float(x) + 0.0), ir.at("%motions", place, ir.V))
    _clear_ground(ir, sweeps.layout)


def _clear_ground(ir: Writer, layout: VectorLayout) -> None:
    for place in chain.from_iterable(chain.from_iterable(map(layout.places, ("f", "n")))):
        ir.store(ir.vector(0.0), ir.at("%bodies", place, ir.V))


def _move_ground(ir: Writer, chain: Mechanism, sweeps: Sweeps, signature: Signature) -> None:
    """The motion of the ground from that of the base, and what acts on a base that floats."""
    given = ir.at("%in", signature.of_role("base")[0].start, ir.V)
    memory = [*GROUND_MEMORY, given]
    if not chain.floats:
        _clear_ground(ir, sweeps.layout)
    ir.do(f"call void @move_base({_pointers('@base', *memory)})")
    if chain.floats and sweeps.computation.wrench:
        _add_wrench(ir, "0", memory, sweeps.layout, signature)


def _add_base_force(ir: Writer, sweeps: Sweeps, signature: Signature) -> None:
    """The force on a base that floats, as the bodies have passed it on: the results before those of the joints."""
    n, f = map(sweeps.layout.places, ("n", "f"))
    for port, moment, force in zip(signature.outputs, n, f, strict=True):
        for j, place in enumerate((*moment, *force)):
            Q = ir.at("%out", port.start + j, ir.V)
            ir.store(ir.op("add", ir.load(ir.at("%bodies", place, ir.V)), ir.load(Q)), Q)


def _set_joint_variables(ir: Writer, chain: Mechanism, layout: VectorLayout) -> None:
    """theta = G q + g with its rates, sine and cosine, of all joints, in pairs; of an odd number the last one twice."""
    last = len(chain.joints) - 1
    with ir.loop(str(last // 2 + 1)) as pair:
        even = ir.let(f"mul i64 {pair}, 2")
        joints = even, ir.call("llvm.smin.i64", "i64", ir.let(f"add i64 {even}, 1"), str(last))
        bodies = [ir.at("%bodies", ir.let(f"mul i64 {ir.let(f'add i64 {i}, 1')}, {layout.size}"), ir.V) for i in joints]
        for i, body in zip(joints, bodies, strict=True):
            _set_joint_variable(ir, i, body, layout, chain.n)
        theta, sine = layout.places("theta")[0][0], layout.places("sine")[0][0]  # and the cosine behind it
        angles = ", ".join(f"{ir.V} {ir.load(ir.at(body, theta, ir.V))}" for body in bodies)
        ir.do(f"call void @sincos({angles}, {_pointers(*(ir.at(body, sine, ir.V) for body in bodies))})")


def _set_joint_variable(ir: Writer, i: str, body: str, layout: VectorLayout, n: int) -> None:
    """theta = G q + g with its rates, of joint i."""
    offset = ir.splat(ir.let(f"load double, ptr {ir.at('@offsets', i)}"))
    for k, (place,) in enumerate(layout.places("theta")):
        ir.store(ir.vector(0.0) if k else offset, ir.at(body, place, ir.V))
    with _loop_over_coordinates(ir, i) as (coordinate, factor):
        for k, (place,) in enumerate(layout.places("theta")):
            theta, rate = ir.at(body, place, ir.V), ir.let(f"add i64 {coordinate}, {k * n}")
            ir.store(ir.op("fma", factor, ir.load(ir.at("%in", rate, ir.V)), ir.load(theta)), theta)


def _add_wrench(ir: Writer, i: str, memory: Sequence[str], layout: VectorLayout, signature: Signature) -> None:
    """The wrench on body i, added to what acts on it."""
    first = ir.let(f"mul i64 {i}, 6")
    for port, places in zip(signature.of_role("wrench"), layout.places("W"), strict=True):
        for j, place in enumerate(places):
            given = ir.at(ir.at("%in", first, ir.V), port.start + j, ir.V)
            ir.store(ir.load(given), ir.at(memory[0], place, ir.V))
    table = ir.at("@carry", ir.let(f"mul i64 {i}, {sum(loop_steps.CARRY_SIZES.values())}"))
    ir.do(f"call void @add_wrench({_pointers(table, *memory)})")


def _memory(ir: Writer, i: str, sweeps: Sweeps) -> list[str]:
    """The parts of scratch memory of body i and of its parent, and those of their motions."""
    own = ir.let(f"add i64 {i}, 1")
    above = ir.let(f"load i64, ptr {ir.at('@parents', i, 'i64')}")
    slots = [ir.let(f"load i64, ptr {ir.at('@slots', j, 'i64')}") for j in (own, above)]
    parts = [("%bodies", sweeps.layout, own), ("%bodies", sweeps.layout, above)]
    parts += [("%motions", sweeps.motion, slot) for slot in slots]
    return [ir.at(name, ir.let(f"mul i64 {j}, {layout.size}"), ir.V) for name, layout, j in parts]


@contextmanager
def _loop_over_coordinates(ir: Writer, i: str) -> Iterator[tuple[str, str]]:
    """A loop over the coordinates that joint i follows, and the factors by which it does."""
    first, last = (ir.let(f"load i64, ptr {ir.at('@entries', j, 'i64')}") for j in (i, ir.let(f"add i64 {i}, 1")))
    with ir.loop(last, first) as entry:
        coordinate = ir.let(f"load i64, ptr {ir.at('@coordinates', entry, 'i64')}")
        yield coordinate, ir.splat(ir.let(f"load double, ptr {ir.at('@factors', entry)}"))


def _call(ir: Writer, step: str, present: Sequence[str], i: str, memory: Sequence[str]) -> None:
    """The step of joint i, of its kind."""
    table = ir.at("@constants", ir.let(f"mul i64 {i}, {sum(loop_steps.JOINT_SIZES.values())}"))
    kind = ir.let(f"load i64, ptr {ir.at('@kinds', i, 'i64')}")
    cases = " ".join(f"i64 {k}, label %{step}.{name}" for k, name in enumerate(present))
    ir.do(f"switch i64 {kind}, label %{step}.{present[0]} [ {cases} ]")
    for name in present:
        ir.label(f"{step}.{name}")
        ir.do(f"call void @{step}_{name}({_pointers(table, *memory)})")
        ir.do(f"br label %{step}.done")
    ir.label(f"{step}.done")


def _pointers(*names: str) -> str:
    return ", ".join(f"ptr {name}" for name in names)


def _define_step(ir: Writer, name: str, step: JointStep) -> None:
    with ir.function(f"internal void @{name}({_pointers(*(f'%{part}' for part in STEP_MEMORY))}) {ir.aligned}"):

        def read(i: int) -> str:
            memory, place = step.reads[i]
            if memory == "constants":
                return ir.splat(ir.let(f"load double, ptr {ir.at('%constants', place)}"))
            return ir.load(ir.at(f"%{memory}", place, ir.V))

        values = emit_steps(ir, step.program, read)
        results = [values[i] for i in step.program.outputs]
        for (memory, place), result in zip(step.writes, results, strict=True):
            ir.store(result, ir.at(f"%{memory}", place, ir.V))
