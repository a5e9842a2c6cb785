"""Write the loop form of a kernel: steps driven over the tree.

The steps are those of one joint, in LLVM IR. Straight-line code grows with the robot, and beyond some ten joints no
longer fits where a processor keeps it; this form does not grow. Every body has its part of scratch memory, the ground
the first, and each step of a sweep is a call of a function that `loop_steps` has traced. `emit_loop` is the door: it
defines the steps and the tables of the robot, then ``@block``, in which a `LoopTree` is swept outward and inward as
`dynamics.recursion.forces.sweep` does it.

Steps are traced and written once per kernel, order and kind of joint. ``@block`` runs once per block of states, and
calls each step once per body: `sweep` itself runs only once, on a tree whose loops over bodies are loops of the code.

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
    """Return the code of the sweeps for one block of states."""
    places = [range(port.start, port.end) for port in signature.outputs]
    vectors = memory_layout.vectors_of_bodies(sweeps.computation, mechanism)
    return BlockCode(lambda ir: _define_block(ir, mechanism, sweeps, signature), places, vectors)


def _define_block(ir: Writer, mechanism: Mechanism, sweeps: Sweeps, signature: Signature) -> None:
    """Define steps and tables, and ``@block`` that calls the steps."""
    reduced, kinds = minimal_mechanism(mechanism), loop_steps.joint_kinds(mechanism)
    present_kinds = [kind for kind in loop_steps.JOINT_KINDS if kind in kinds]
    # Forces with all rates take one pass over the tree. Accelerations take one for each order, since the k-th rate of
    # the equations gives q^(k+2), which the next one needs.
    inverts = sweeps.computation.quantity.takes.forces
    passes = [replace(sweeps, order=k) for k in range(sweeps.order + 1)] if inverts else [sweeps]
    for sweeps_of_order in passes:
        _define_steps(ir, present_kinds, sweeps_of_order, reduced.floats)
    if inverts:
        _define_articulated_steps(ir, present_kinds, passes, reduced.floats)
    for name, numbers in loop_steps.tables(mechanism, [present_kinds.index(kind) for kind in kinds]).items():
        ir.table(name, numbers)
    _define_sum(ir)
    with ir.function("internal void @block(ptr %in, ptr %out, ptr %bodies, i64 %count)"):
        # Scratch memory behind the results: of all bodies, of their motions, and of that of a base that is found.
        sizes = memory_layout.loop_sizes(sweeps.computation, mechanism)
        ir.do(f"%motions = getelementptr {ir.V}, ptr %bodies, i64 {sizes[0]}")
        ir.do(f"%base = getelementptr {ir.V}, ptr %motions, i64 {sizes[1]}")
        _set_results(ir, signature)
        for sweeps_of_order in passes:
            tree = (ArticulatedTree if inverts else LoopTree)(ir, reduced, sweeps_of_order, signature, present_kinds)
            tree.begin()
            sweep(tree)
            tree.end()


def _define_steps(ir: Writer, kinds: Sequence[str], sweeps: Sweeps, floating: bool) -> None:
    """Define the steps of inverse dynamics for the kinds of joints."""
    for kind in kinds:
        define_step(ir, f"{sweeps.name('outward')}_{kind}", sweeps.outward(kind), STEP_MEMORY)
        define_step(ir, f"{sweeps.name('inward')}_{kind}", sweeps.inward(kind), STEP_MEMORY)
    if sweeps.computation.wrench:
        define_step(ir, sweeps.name("add_wrench"), sweeps.add_wrench(), STEP_MEMORY)
    if sweeps.acting:
        define_step(ir, sweeps.name("drive"), sweeps.drive(), STEP_MEMORY)
    if sweeps.computation.base:
        define_step(ir, sweeps.name("move_base"), sweeps.base(floating), STEP_MEMORY)


def _define_articulated_steps(ir: Writer, kinds: Sequence[str], passes: Sequence[Sweeps], floating: bool) -> None:
    """Define the steps that find accelerations.

    They are those of each kind of joint and of a floating base.
    """
    # They depend on the position alone, so that one trace, that of order 0, serves all orders.
    steps = ArticulatedSteps(passes[0])
    for kind in kinds:
        define_step(ir, f"articulate_{kind}", steps.articulate(kind), STEP_MEMORY)
        define_step(ir, f"balance_{kind}", steps.balance(kind), STEP_MEMORY)
        define_step(ir, f"accelerate_{kind}", steps.accelerate(kind), STEP_MEMORY)
    # That of the base stores the rate of its twist, which has another place for each order.
    for sweeps in passes if floating else ():
        define_step(ir, sweeps.name("accelerate_base"), ArticulatedSteps(sweeps).accelerate_base(), STEP_MEMORY)


def _define_sum(ir: Writer) -> None:
    """Define ``@sum(x, count, total)``, a sum of zeros and NaN.

    It adds 0 times each of `count` vectors to a total.
    """
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
    """The tree of forces: it writes what the sweep outward and inward does with a body.

    `recursion.forces.sweep` calls these methods. A body is the name of an index in the code, of any body.
    """

    ir: Writer
    chain: Mechanism
    sweeps: Sweeps
    signature: Signature
    kinds: Sequence[str]

    def begin(self) -> None:
        """Place the joints, and set motion and force of the ground."""
        self.place_joints()
        self._begin_at_ground()

    def _begin_at_ground(self) -> None:
        """Set the motion and the force of the ground or base."""
        if not self.sweeps.computation.base:
            # The ground rests, and its motion is that of gravity; children add their forces to 0.
            _set_ground(self.ir, self.sweeps, ground(self.chain.gravity.astype(float)))
            clear(self.ir, "%bodies", self.sweeps.layout, ("f", "n"))
            return
        memory = [*GROUND_MEMORY, self.base_motion()]
        # A base that floats has a force of its own, of inertia, which the step itself sets.
        if not self.chain.floats:
            clear(self.ir, "%bodies", self.sweeps.layout, ("f", "n"))
        self.ir.do(f"call void @{self.sweeps.name('move_base')}({pointers('@base', *memory)})")
        if self.chain.floats and self.sweeps.computation.wrench:
            self._add_wrench("0", memory)

    def base_motion(self) -> str:
        """Return the address of the motion of the base."""
        return self.ir.at("%in", self.signature.of_role("base")[0].start, self.ir.V)

    def outward(self) -> Iterator[str]:
        """Yield the bodies, each after its parent: one index, of a loop in the code."""
        with self.ir.loop(str(len(self.chain.joints))) as i:
            yield i

    def inward(self) -> Iterator[str]:
        """Yield the bodies, each before its parent: one index, of a loop in the code."""
        with self.ir.loop(str(len(self.chain.joints))) as down:
            yield self.ir.let(f"sub i64 {len(self.chain.joints) - 1}, {down}")

    def move(self, i: str) -> None:
        """Compute the motion of a body and the force that this takes."""
        self.call(self.sweeps.name("outward"), i)

    def place_joints(self) -> None:
        """Compute theta = G q + g with rates, sine and cosine.

        It does so of all joints, in pairs.
        """
        ir, layout, last = self.ir, self.sweeps.layout, len(self.chain.joints) - 1
        # ``@sincos`` takes two angles in less than twice the time of one. If the number of joints is odd, the last
        # joint is computed twice.
        with ir.loop(str(last // 2 + 1)) as pair:
            even = ir.let(f"mul i64 {pair}, 2")
            joints = even, ir.call("llvm.smin.i64", "i64", ir.let(f"add i64 {even}, 1"), str(last))
            places = [ir.let(f"mul i64 {ir.let(f'add i64 {i}, 1')}, {layout.size}") for i in joints]
            bodies = [ir.at("%bodies", place, ir.V) for place in places]
            for i, body in zip(joints, bodies, strict=True):
                self._place_joint(i, body)
            theta, sine = layout.places("theta")[0][0], layout.places("sine")[0][0]  # and the cosine behind it
            angles = ", ".join(f"{ir.V} {ir.load(ir.at(body, theta, ir.V))}" for body in bodies)
            ir.do(f"call void @sincos({angles}, {pointers(*(ir.at(body, sine, ir.V) for body in bodies))})")

    def _place_joint(self, i: str, body: str) -> None:
        """Compute the variable theta of joint i with its rates."""
        ir, computation = self.ir, self.sweeps.computation
        # All rates are set, those too that are found later: until then they are 0 in memory.
        offset = ir.splat(ir.let(f"load double, ptr {ir.at('@offsets', i)}"))
        places = [place for (place,) in replace(self.sweeps.layout, unknown=0).places("theta")]
        for k, place in enumerate(places):
            ir.store(ir.vector(0.0) if k else offset, ir.at(body, place, ir.V))
        # Add G q, and G qd to the first rate, and so on: the k-th rates are n inputs behind those before.
        with _loop_over_coordinates(ir, i) as (coordinate, factor):
            for k, place in enumerate(places[: computation.quantity.takes.coordinates(computation.rates)]):
                theta, rate = ir.at(body, place, ir.V), ir.let(f"add i64 {coordinate}, {k * self.chain.n}")
                ir.store(ir.op("fma", factor, ir.load(ir.at("%in", rate, ir.V)), ir.load(theta)), theta)

    def add_wrench(self, i: str) -> None:
        """Add the wrench on a body to what acts on it."""
        if self.sweeps.computation.wrench:
            # Among the bodies that take wrenches, a floating base is the first.
            place = self.ir.let(f"add i64 {i}, {int(self.chain.floats)}")
            self._add_wrench(place, self.memory(i))

    def hand_on(self, i: str) -> None:
        """Compute the force of a joint, and pass forces on.

        What acts on its body is added to that on the parent.
        """
        self.call(self.sweeps.name("inward"), i)
        # Drive terms are no forces between bodies: they enter Q after the body's force went to the parent.
        if self.sweeps.acting:
            table = self.ir.at("@drives", self.ir.let(f"mul i64 {i}, {len(loop_steps.DRIVE_SIZES)}"))
            self.ir.do(f"call void @{self.sweeps.name('drive')}({pointers(table, *self.memory(i))})")

    def collect(self, i: str) -> None:
        """Add the force of a joint to the results."""
        ir, body = self.ir, self.memory(i)[0]
        # Q = G^T Q_theta: joint i adds its force to that of each coordinate that it follows.
        with _loop_over_coordinates(ir, i) as (coordinate, factor):
            for port, (place,) in zip(self.signature.outputs, self.sweeps.layout.places("Q"), strict=True):
                Q = ir.at("%out", ir.let(f"add i64 {coordinate}, {port.end - self.chain.n}"), ir.V)
                ir.store(ir.op("fma", factor, ir.load(ir.at(body, place, ir.V)), ir.load(Q)), Q)

    def end(self) -> None:
        """Add the force on a floating base to the first results.

        The sweep inward has added the forces of all bodies to it.
        """
        if not self.chain.floats:
            return
        n, f = map(self.sweeps.layout.places, ("n", "f"))
        for port, moment, force in zip(self.signature.outputs, n, f, strict=True):
            for j, place in enumerate((*moment, *force)):
                add_to(self.ir, self.ir.at("%out", port.start + j, self.ir.V), self.ir.at("%bodies", place, self.ir.V))

    def memory(self, i: str) -> list[str]:
        """Return the addresses of a body, its parent, and their motions."""
        ir, sweeps = self.ir, self.sweeps
        # The ground, or base, is number 0 in memory.
        body_number = ir.let(f"add i64 {i}, 1")
        parent_number = ir.let(f"load i64, ptr {ir.at('@parents', i, 'i64')}")
        # Motions have slots, which are used again: few bodies' motions are needed at a time.
        slots = [ir.let(f"load i64, ptr {ir.at('@slots', j, 'i64')}") for j in (body_number, parent_number)]
        parts = [("%bodies", sweeps.layout, body_number), ("%bodies", sweeps.layout, parent_number)]
        parts += [("%motions", sweeps.motion, slot) for slot in slots]
        return [ir.at(name, ir.let(f"mul i64 {j}, {layout.size}"), ir.V) for name, layout, j in parts]

    def call(self, step: str, i: str) -> None:
        """Call the step of joint i that belongs to its kind."""
        ir, memory = self.ir, self.memory(i)
        table = ir.at("@constants", ir.let(f"mul i64 {i}, {sum(loop_steps.JOINT_SIZES.values())}"))
        kind = ir.let(f"load i64, ptr {ir.at('@kinds', i, 'i64')}")
        # The number of the value that holds the kind makes the labels of this switch different from all others.
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
        # The step reads W from the body's own memory. Passes of lower orders take fewer rates of it: no strict zip.
        for port, places in zip(self.signature.of_role("wrench"), self.sweeps.layout.places("W"), strict=False):
            for j, place in enumerate(places):
                component = ir.at(ir.at("%in", first, ir.V), port.start + j, ir.V)
                ir.store(ir.load(component), ir.at(memory[0], place, ir.V))
        table = ir.at("@carry", ir.let(f"mul i64 {i}, {sum(loop_steps.CARRY_SIZES.values())}"))
        ir.do(f"call void @{self.sweeps.name('add_wrench')}({pointers(table, *memory)})")


def clear(ir: Writer, body: str, layout: VectorLayout, names: Sequence[str]) -> None:
    """Set parts of a body's vectors to 0: children add to them."""
    for place in chain.from_iterable(chain.from_iterable(map(layout.places, names))):
        ir.store(ir.vector(0.0), ir.at(body, place, ir.V))


def add_to(ir: Writer, total: str, address: str) -> None:
    """Add a vector in memory to another."""
    ir.store(ir.op("add", ir.load(address), ir.load(total)), total)


def _set_ground(ir: Writer, sweeps: Sweeps, motion: BodyMotion) -> None:
    """Set the motion of the ground, which is constant."""
    for name, _, _ in sweeps.motion.parts:
        for k, places in enumerate(sweeps.motion.places(name)):
            for place, x in zip(places, np.ravel(getattr(motion, name)[k]).tolist(), strict=True):
                # Adding 0 makes 0 of -0.
                ir.store(ir.vector(float(x) + 0.0), ir.at("%motions", place, ir.V))


@contextmanager
def _loop_over_coordinates(ir: Writer, i: str) -> Iterator[tuple[str, str]]:
    """Write a loop over the coordinates that joint i follows.

    Yield a coordinate, and its factor in G.
    """
    first, last = (ir.let(f"load i64, ptr {ir.at('@entries', j, 'i64')}") for j in (i, ir.let(f"add i64 {i}, 1")))
    with ir.loop(last, first) as entry:
        coordinate = ir.let(f"load i64, ptr {ir.at('@coordinates', entry, 'i64')}")
        yield coordinate, ir.splat(ir.let(f"load double, ptr {ir.at('@factors', entry)}"))


class ArticulatedTree(LoopTree):
    """The tree of one order k, which finds q^(k+2).

    `begin`, `move`, `collect` and `end` have the equations of the mass matrix solved in the same sweep inward, which
    factors them (`articulate`, at order 0 only) and reduces their right sides (`balance`), and one more sweep outward.
    """

    def begin(self) -> None:
        """Set the motion of the ground; at order 0, place joints."""
        # Order 0 is the first pass: positions and articulated inertias hold for all orders. The ground has no
        # acceleration beyond the motion that is known, A = 0.
        if self.sweeps.order == 0:
            clear(self.ir, "%bodies", self.sweeps.layout, ("I", "A"))
            if self.chain.floats:
                self._keep_base_motion()
            self.place_joints()
        # F, what the children leave to their parent, starts from zero at each order.
        clear(self.ir, "%bodies", self.sweeps.layout, ("F",))
        self._begin_at_ground()

    def base_motion(self) -> str:
        """Return the address of the motion of the base.

        It is in scratch memory where its rates are found.
        """
        return "%base" if self.chain.floats else super().base_motion()

    def move(self, i: str) -> None:
        """Compute the known motion of a body and its inertia force."""
        clear(self.ir, self.memory(i)[0], self.sweeps.layout, ("F", "I") if self.sweeps.order == 0 else ("F",))
        super().move(i)

    def collect(self, i: str) -> None:
        """Find what a joint force leaves to accelerate the articulated body."""
        ir, body = self.ir, self.memory(i)[0]
        if self.sweeps.order == 0:
            self.call("articulate", i)
        # u is the k-th rate of Q less that of inverse dynamics with q^(k+2) = 0; `balance` reduces it by the children.
        force = ir.load(ir.at(ir.at("%in", i, ir.V), self._forces.end - self.chain.n, ir.V))
        required = ir.load(ir.at(body, self.sweeps.layout.places("Q")[-1][0], ir.V))
        ir.store(ir.op("sub", force, required), ir.at(body, self._place_of_u, ir.V))
        self.call("balance", i)

    def end(self) -> None:
        """Find the accelerations, or their rates, in a sweep outward."""
        ir, port = self.ir, self.signature.outputs[self.sweeps.order]
        # By now the articulated base holds the whole robot: its acceleration follows without the joints.
        if self.chain.floats:
            memory = ["%bodies", ir.at("%in", self._forces.start, ir.V), "%motions", "%base"]
            ir.do(f"call void @{self.sweeps.name('accelerate_base')}({pointers('@base', *memory)})")
            for j, place in enumerate(self.sweeps.base_motion.places("V")[-1]):
                add_to(ir, ir.at("%out", port.start + j, ir.V), ir.at("%base", place, ir.V))
        for i in self.outward():
            self.call("accelerate", i)
            # `accelerate` leaves q^(k+2) in the place of u. The next pass takes it as a rate of theta, and as a result
            # it is added to the mask, 0 or NaN, that is there.
            body = self.memory(i)[0]
            acceleration = ir.at(body, self._place_of_u, ir.V)
            ir.store(ir.load(acceleration), ir.at(body, self.sweeps.layout.places("theta")[-1][0], ir.V))
            add_to(ir, ir.at(ir.at("%out", i, ir.V), port.end - self.chain.n, ir.V), acceleration)

    @property
    def _forces(self) -> Port:
        """The input port of the forces of this order."""
        return self.signature.of_role("state")[2 + self.sweeps.order]

    @property
    def _place_of_u(self) -> int:
        return self.sweeps.layout.places("u")[0][0]

    def _keep_base_motion(self) -> None:
        """Copy the motion of a floating base into scratch memory.

        Its pose and twist are copied; rates of the twist are set to 0.
        """
        ir, (C, V), layout = self.ir, self.signature.of_role("base"), self.sweeps.base_motion
        with ir.loop(str(V.end - C.start)) as j:
            ir.store(ir.load(ir.at(ir.at("%in", j, ir.V), C.start, ir.V)), ir.at("%base", j, ir.V))
        with ir.loop(str(layout.size), str(V.end - C.start)) as j:
            ir.store(ir.vector(0.0), ir.at("%base", j, ir.V))
