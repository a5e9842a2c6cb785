"""Write the loop form of a kernel, in LLVM IR: the steps of one joint driven over the tree.

Straight-line code grows with the robot, and beyond some ten joints no longer fits where a processor keeps it; this form
does not grow. Every body has its part of scratch memory, the ground the first, and each step of a sweep is a call of a
function that `loop_steps` has traced. `emit_loop` is the door: it defines the steps and the tables of the robot, then
``@block``, in which a `LoopTree` is swept outward and inward as `dynamics.recursion.forces.sweep` says.

Where accelerations q2d, q3d, ... of given Q, Qd, ... are found, an `ArticulatedTree` is swept for one order after the
other: the k-th rate of inverse dynamics where q^(k+2) = 0, as `dynamics.forward.solve_with_inverse_dynamics` has it,
and the equations of the mass matrix by `dynamics.recursion.articulated`, in the same sweep inward and another one
outward. Invariant: rates of theta, and of a floating base, that are not known yet are 0 in memory.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from jounce.dynamics.computation import Port, Signature
from jounce.dynamics.recursion.forces import BodyMotion, ground, sweep
from jounce.model.equivalent_mechanisms import minimal_mechanism
from jounce.model.mechanism import Mechanism
from jounce.native import loop_steps, memory_layout
from jounce.native.ir import BlockCode, Writer, define_step, nan_masks, pointers
from jounce.native.loop_steps import ArticulatedSteps, Sweeps
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


@dataclass(frozen=True)
class LoopTree:
    """The tree of forces: what the sweep outward and inward does with a body."""

    ir: Writer
    chain: Mechanism
    sweeps: Sweeps
    signature: Signature
    kinds: Sequence[str]

    def begin(self) -> None:
        """Place the joints; set the motion of the ground and what acts on it."""
        self.place_joints()
        self._begin_at_ground()

    def _begin_at_ground(self) -> None:
        if not self.sweeps.computation.base:
            _set_ground(self.ir, self.sweeps, ground(self.chain.gravity.astype(float)))
            clear(self.ir, "%bodies", self.sweeps.layout, ("f", "n"))
            return
        memory = [*GROUND_MEMORY, self.base_motion()]
        if not self.chain.floats:
            clear(self.ir, "%bodies", self.sweeps.layout, ("f", "n"))
        self.ir.do(f"call void @{self.sweeps.name('move_base')}({pointers('@base', *memory)})")
        if self.chain.floats and self.sweeps.computation.wrench:
            self._add_wrench("0", memory)

    def base_motion(self) -> str:
        """Where the motion of the base is."""
        return self.ir.at("%in", self.signature.of_role("base")[0].start, self.ir.V)

    def outward(self) -> Iterator[str]:
        """The bodies, each after its parent."""
        with self.ir.loop(str(len(self.chain.joints))) as i:
            yield i

    def inward(self) -> Iterator[str]:
        """The bodies, each before its parent."""
        with self.ir.loop(str(len(self.chain.joints))) as down:
            yield self.ir.let(f"sub i64 {len(self.chain.joints) - 1}, {down}")

    def move(self, i: str) -> None:
        """Compute the motion of a body and the force that this takes."""
        self.call(self.sweeps.name("outward"), i)

    def place_joints(self) -> None:
        """Compute theta = G q + g with its rates, sine and cosine, of all joints, in pairs."""
        ir, layout, last = self.ir, self.sweeps.layout, len(self.chain.joints) - 1
        with ir.loop(str(last // 2 + 1)) as pair:
            even = ir.let(f"mul i64 {pair}, 2")
            joints = even, ir.call("llvm.smin.i64", "i64", ir.let(f"add i64 {even}, 1"), str(last))
            # of an odd number, the last one is taken twice
            own = [ir.let(f"mul i64 {ir.let(f'add i64 {i}, 1')}, {layout.size}") for i in joints]
            bodies = [ir.at("%bodies", place, ir.V) for place in own]
            for i, body in zip(joints, bodies, strict=True):
                self._place_joint(i, body)
            theta, sine = layout.places("theta")[0][0], layout.places("sine")[0][0]  # and the cosine behind it
            angles = ", ".join(f"{ir.V} {ir.load(ir.at(body, theta, ir.V))}" for body in bodies)
            ir.do(f"call void @sincos({angles}, {pointers(*(ir.at(body, sine, ir.V) for body in bodies))})")

    def _place_joint(self, i: str, body: str) -> None:
        ir, computation = self.ir, self.sweeps.computation
        offset = ir.splat(ir.let(f"load double, ptr {ir.at('@offsets', i)}"))
        places = [place for (place,) in replace(self.sweeps.layout, unknown=0).places("theta")]
        for k, place in enumerate(places):
            ir.store(ir.vector(0.0) if k else offset, ir.at(body, place, ir.V))
        with _loop_over_coordinates(ir, i) as (coordinate, factor):
            for k, place in enumerate(places[: computation.quantity.takes.coordinates(computation.rates)]):
                theta, rate = ir.at(body, place, ir.V), ir.let(f"add i64 {coordinate}, {k * self.chain.n}")
                ir.store(ir.op("fma", factor, ir.load(ir.at("%in", rate, ir.V)), ir.load(theta)), theta)

    def add_wrench(self, i: str) -> None:
        """Add the wrench on a body to what acts on it."""
        if self.sweeps.computation.wrench:
            place = self.ir.let(f"add i64 {i}, {int(self.chain.floats)}")  # among the bodies that take wrenches
            self._add_wrench(place, self.memory(i))

    def hand_on(self, i: str) -> None:
        """Compute the force of a joint, and add what acts on its body to that on the parent."""
        self.call(self.sweeps.name("inward"), i)
        if self.sweeps.acting:
            table = self.ir.at("@drives", self.ir.let(f"mul i64 {i}, {len(loop_steps.DRIVE_SIZES)}"))
            self.ir.do(f"call void @{self.sweeps.name('drive')}({pointers(table, *self.memory(i))})")

    def collect(self, i: str) -> None:
        """Add the force of a joint to the results."""
        ir, body = self.ir, self.memory(i)[0]
        with _loop_over_coordinates(ir, i) as (coordinate, factor):  # Q = G^T Q_theta
            for port, (place,) in zip(self.signature.outputs, self.sweeps.layout.places("Q"), strict=True):
                Q = ir.at("%out", ir.let(f"add i64 {coordinate}, {port.end - self.chain.n}"), ir.V)
                ir.store(ir.op("fma", factor, ir.load(ir.at(body, place, ir.V)), ir.load(Q)), Q)

    def end(self) -> None:
        """Add the force on a base that floats, as bodies have passed it on, to the results before those of joints."""
        if not self.chain.floats:
            return
        n, f = map(self.sweeps.layout.places, ("n", "f"))
        for port, moment, force in zip(self.signature.outputs, n, f, strict=True):
            for j, place in enumerate((*moment, *force)):
                add_to(self.ir, self.ir.at("%out", port.start + j, self.ir.V), self.ir.at("%bodies", place, self.ir.V))

    def memory(self, i: str) -> list[str]:
        """The parts of scratch memory of body i and of its parent, and those of their motions."""
        ir, sweeps = self.ir, self.sweeps
        own = ir.let(f"add i64 {i}, 1")
        above = ir.let(f"load i64, ptr {ir.at('@parents', i, 'i64')}")
        slots = [ir.let(f"load i64, ptr {ir.at('@slots', j, 'i64')}") for j in (own, above)]
        parts = [("%bodies", sweeps.layout, own), ("%bodies", sweeps.layout, above)]
        parts += [("%motions", sweeps.motion, slot) for slot in slots]
        return [ir.at(name, ir.let(f"mul i64 {j}, {layout.size}"), ir.V) for name, layout, j in parts]

    def call(self, step: str, i: str) -> None:
        """Call the step of joint i, of its kind."""
        ir, memory = self.ir, self.memory(i)
        table = ir.at("@constants", ir.let(f"mul i64 {i}, {sum(loop_steps.JOINT_SIZES.values())}"))
        kind = ir.let(f"load i64, ptr {ir.at('@kinds', i, 'i64')}")
        label = f"{step}.{kind[1:]}"
        cases = " ".join(f"i64 {k}, label %{label}.{name}" for k, name in enumerate(self.kinds))
        ir.do(f"switch i64 {kind}, label %{label}.{self.kinds[0]} [ {cases} ]")
        for name in self.kinds:
            ir.label(f"{label}.{name}")
            ir.do(f"call void @{step}_{name}({pointers(table, *memory)})")
            ir.do(f"br label %{label}.done")
        ir.label(f"{label}.done")

    def _add_wrench(self, i: str, memory: Sequence[str]) -> None:
        """Add the wrench on body i to what acts on it."""
        ir, first = self.ir, self.ir.let(f"mul i64 {i}, 6")
        for port, places in zip(self.signature.of_role("wrench"), self.sweeps.layout.places("W"), strict=False):
            for j, place in enumerate(places):
                given = ir.at(ir.at("%in", first, ir.V), port.start + j, ir.V)
                ir.store(ir.load(given), ir.at(memory[0], place, ir.V))
        table = ir.at("@carry", ir.let(f"mul i64 {i}, {sum(loop_steps.CARRY_SIZES.values())}"))
        ir.do(f"call void @{self.sweeps.name('add_wrench')}({pointers(table, *memory)})")


def clear(ir: Writer, body: str, layout: VectorLayout, names: Sequence[str]) -> None:
    """Set parts of a body's vectors to 0: others add to them."""
    for place in chain.from_iterable(chain.from_iterable(map(layout.places, names))):
        ir.store(ir.vector(0.0), ir.at(body, place, ir.V))


def add_to(ir: Writer, total: str, address: str) -> None:
    """Add a vector in memory to another."""
    ir.store(ir.op("add", ir.load(address), ir.load(total)), total)


def _set_ground(ir: Writer, sweeps: Sweeps, motion: BodyMotion) -> None:
    """The motion of the ground, constant here."""
    for name, _, _ in sweeps.motion.parts:
        for k, places in enumerate(sweeps.motion.places(name)):
            for place, x in zip(places, np.ravel(getattr(motion, name)[k]).tolist(), strict=True):
                ir.store(ir.vector(float(x) + 0.0), ir.at("%motions", place, ir.V))


@contextmanager
def _loop_over_coordinates(ir: Writer, i: str) -> Iterator[tuple[str, str]]:
    """A loop over the coordinates that joint i follows, and the factors by which it does."""
    first, last = (ir.let(f"load i64, ptr {ir.at('@entries', j, 'i64')}") for j in (i, ir.let(f"add i64 {i}, 1")))
    with ir.loop(last, first) as entry:
        coordinate = ir.let(f"load i64, ptr {ir.at('@coordinates', entry, 'i64')}")
        yield coordinate, ir.splat(ir.let(f"load double, ptr {ir.at('@factors', entry)}"))


class ArticulatedTree(LoopTree):
    """The tree of forces at one order: what it takes to move a body besides."""

    def begin(self) -> None:
        """At order 0 place the joints too; nothing acts on articulated bodies yet."""
        if not self.sweeps.order:
            clear(self.ir, "%bodies", self.sweeps.layout, ("I", "A"))
            if self.chain.floats:
                self._keep_base_motion()
            self.place_joints()
        clear(self.ir, "%bodies", self.sweeps.layout, ("F",))
        self._begin_at_ground()

    def base_motion(self) -> str:
        """Where the motion of the base is: rates of that of a floating one are found."""
        return "%base" if self.chain.floats else super().base_motion()

    def move(self, i: str) -> None:
        """Compute the motion of a body as far as it is known, and the force that this takes."""
        clear(self.ir, self.memory(i)[0], self.sweeps.layout, ("F",) if self.sweeps.order else ("F", "I"))
        super().move(i)

    def collect(self, i: str) -> None:
        """Find what the force of a joint leaves to accelerate its articulated body."""
        ir, body = self.ir, self.memory(i)[0]
        if not self.sweeps.order:
            self.call("articulate", i)
        given = ir.load(ir.at(ir.at("%in", i, ir.V), self._given.end - self.chain.n, ir.V))
        required = ir.load(ir.at(body, self.sweeps.layout.places("Q")[-1][0], ir.V))
        ir.store(ir.op("sub", given, required), ir.at(body, self._place_of_u, ir.V))
        self.call("balance", i)

    def end(self) -> None:
        """Find the accelerations, or their rates, outward."""
        ir, port = self.ir, self.signature.outputs[self.sweeps.order]
        if self.chain.floats:
            memory = ["%bodies", ir.at("%in", self._given.start, ir.V), "%motions", "%base"]
            ir.do(f"call void @{self.sweeps.name('accelerate_base')}({pointers('@base', *memory)})")
            for j, place in enumerate(self.sweeps.base_motion.places("V")[-1]):
                add_to(ir, ir.at("%out", port.start + j, ir.V), ir.at("%base", place, ir.V))
        for i in self.outward():
            self.call("accelerate", i)
            body = self.memory(i)[0]
            found = ir.at(body, self._place_of_u, ir.V)
            ir.store(ir.load(found), ir.at(body, self.sweeps.layout.places("theta")[-1][0], ir.V))
            add_to(ir, ir.at(ir.at("%out", i, ir.V), port.end - self.chain.n, ir.V), found)

    @property
    def _given(self) -> Port:
        """The forces of this order."""
        return self.signature.of_role("state")[2 + self.sweeps.order]

    @property
    def _place_of_u(self) -> int:
        return self.sweeps.layout.places("u")[0][0]

    def _keep_base_motion(self) -> None:
        """Copy the pose and the twist of a floating base to where the rates of its twist are found."""
        ir, (C, V), layout = self.ir, self.signature.of_role("base"), self.sweeps.base_motion
        with ir.loop(str(V.end - C.start)) as j:
            ir.store(ir.load(ir.at(ir.at("%in", j, ir.V), C.start, ir.V)), ir.at("%base", j, ir.V))
        with ir.loop(str(layout.size), str(V.end - C.start)) as j:
            ir.store(ir.vector(0.0), ir.at("%base", j, ir.V))
