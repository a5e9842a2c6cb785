"""The loop form of a kernel, in LLVM IR: the steps of one joint driven over the tree.

Straight-line code grows with the robot, and beyond some ten joints no longer fits where a processor keeps it; this form
does not grow. Every body has its part of scratch memory, the ground the first.
"""

from collections.abc import Sequence
from dataclasses import replace

from jounce.dynamics.computation import Port, Signature
from jounce.dynamics.recursion.forces import sweep
from jounce.model.equivalent_mechanisms import minimal_mechanism
from jounce.model.mechanism import Mechanism
from jounce.native import loop_steps, memory_layout
from jounce.native.articulated_steps import ArticulatedSteps
from jounce.native.articulated_tree import ArticulatedTree
from jounce.native.emit import BlockCode, define_step, nan_masks
from jounce.native.ir import Writer
from jounce.native.loop_steps import Sweeps
from jounce.native.loop_tree import LoopTree

STEP_MEMORY = ("constants", "body", "parent", "motion", "carrier")  # what a step reads and writes


def emit_loop(mechanism: Mechanism, sweeps: Sweeps, signature: Signature) -> BlockCode:
    """The sweeps over the tree for one block of states."""
    places = [range(port.start, port.end) for port in signature.outputs]
    vectors = memory_layout.vectors_of_bodies(sweeps.computation, mechanism)
    return BlockCode(lambda ir: _define_block(ir, mechanism, sweeps, signature), places, vectors)


def _define_block(ir: Writer, mechanism: Mechanism, sweeps: Sweeps, signature: Signature) -> None:
    reduced, of_joints = minimal_mechanism(mechanism), loop_steps.joint_kinds(mechanism)
    present = [kind for kind in loop_steps.JOINT_KINDS if kind in of_joints]
    inverts = sweeps.computation.quantity.takes.forces
    orders = [replace(sweeps, order=k) for k in range(sweeps.order + 1)] if inverts else [sweeps]
    for of_order in orders:
        _define_steps(ir, present, of_order, reduced.floats)
    if inverts:
        _define_articulated_steps(ir, present, orders, reduced.floats)
    for name, numbers in loop_steps.tables(mechanism, [present.index(kind) for kind in of_joints]).items():
        ir.table(name, numbers)
    _define_sum(ir)
    with ir.function("internal void @block(ptr %in, ptr %out, ptr %bodies, i64 %count)"):
        sizes = memory_layout.loop_sizes(sweeps.computation, mechanism)
        ir.do(f"%motions = getelementptr {ir.V}, ptr %bodies, i64 {sizes[0]}")
        ir.do(f"%base = getelementptr {ir.V}, ptr %motions, i64 {sizes[1]}")
        _set_results(ir, signature)
        for of_order in orders:
            tree = (ArticulatedTree if inverts else LoopTree)(ir, reduced, of_order, signature, present)
            tree.begin()
            sweep(tree)
            tree.end()


def _define_steps(ir: Writer, present: Sequence[str], sweeps: Sweeps, floating: bool) -> None:
    for kind in present:
        define_step(ir, f"{sweeps.name('outward')}_{kind}", sweeps.outward(kind), STEP_MEMORY)
        define_step(ir, f"{sweeps.name('inward')}_{kind}", sweeps.inward(kind), STEP_MEMORY)
    if sweeps.computation.wrench:
        define_step(ir, sweeps.name("add_wrench"), sweeps.add_wrench(), STEP_MEMORY)
    if sweeps.acting:
        define_step(ir, sweeps.name("drive"), sweeps.drive(), STEP_MEMORY)
    if sweeps.computation.base:
        define_step(ir, sweeps.name("move_base"), sweeps.base(floating), STEP_MEMORY)


def _define_articulated_steps(ir: Writer, present: Sequence[str], orders: Sequence[Sweeps], floating: bool) -> None:
    steps = ArticulatedSteps(orders[0])
    for kind in present:
        define_step(ir, f"articulate_{kind}", steps.articulate(kind), STEP_MEMORY)
        define_step(ir, f"balance_{kind}", steps.balance(kind), STEP_MEMORY)
        define_step(ir, f"accelerate_{kind}", steps.accelerate(kind), STEP_MEMORY)
    for sweeps in orders if floating else ():
        define_step(ir, sweeps.name("accelerate_base"), ArticulatedSteps(sweeps).accelerate_base(), STEP_MEMORY)


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
