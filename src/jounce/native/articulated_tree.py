"""The tree in scratch memory where forces are given and accelerations found: that of forces, with articulated bodies.

Problem: q2d, q3d, ... of given Q, Qd, ..., one order after the other. Algorithm: the k-th rate of inverse dynamics
where q^(k+2) = 0, as `dynamics.forward.solve_with_inverse_dynamics` has it, and the equations of the mass matrix by
`dynamics.recursion.articulated`, in the same sweep inward and another one outward. Invariant: rates of theta, and of a
floating base, that are not known yet are 0 in memory.
"""

from jounce.dynamics.computation import Port
from jounce.native.emit import pointers
from jounce.native.loop_tree import LoopTree, add_to, clear


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
