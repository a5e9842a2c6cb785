"""Write partial derivatives of large robots in the form of columns.

K, D and M are the partial derivatives of forces by q, qd and q2d. The wrenches that the screw of a joint requires of
all that the joint carries are a column of 24 numbers; entries of K, D and M are products of screws with columns. A
sweep passes over the joints three times: outward, to the motions of bodies; inward, to what each joint carries and to
its column; inward again, where each joint multiplies its screw by the columns of all joints that it carries.

Partial derivatives of accelerations take two sweeps. The first one is at accelerations 0. It gives M, which is
factored, and what the forces exceed the given ones by, hence the accelerations. The second one gives K and D at these
accelerations. Columns of K, D and -1 then are right sides b of M x = -b, whose solutions x are the result.

In a batch, a vector holds one number of several states, and a step of columns takes one column after the other. For
one state, all numbers are doubles, but a step of columns takes several neighbouring columns at once: each of its
vectors holds one number of them. Each number comes from the same operations in both.

`emit_columns` is the door. `ColumnSteps` traces the steps, once for all joints of a robot: the mathematics is that of
`dynamics.recursion.force_partials` and of `spatial.linear`. What the joints have in common are constants in the trace,
what distinguishes them are numbers in a table. A `ColumnSheet` knows where the inputs and results of a step are in
memory, `memory_layout.ColumnLayout` where everything is in scratch memory. `_Code` writes the functions that call the
steps.
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

# In these parts of memory, the same number of neighbouring columns lies side by side.
OF_COLUMNS = ("columns", "products")
_I3, _I4, _I6 = (np.eye(n, dtype=int) for n in (3, 4, 6))
# The moments of mass, a symmetric matrix (4, 4), are kept as these ten entries.
TRIANGLE = np.triu_indices(4)
# Of a joint: its rotation R and its position r in the parent, its screw X, what its variable exceeds its coordinate by
# ("offset"), and the moments of its body.
CONSTANT_SIZES = {"R": 9, "r": 3, "X": 6, "offset": 1, "Pi": 10}
JOINT_SIZE = sum(CONSTANT_SIZES.values())


def emit_columns(mechanism: Mechanism, layout: ColumnLayout, signature: Signature) -> BlockCode:
    """Return the code of the sweeps over the tree and over columns.

    `define` writes it for a block of states and, with vectors of one lane, for one state alone.
    """
    steps = ColumnSteps(mechanism, layout, signature)
    # Each step is traced once per kernel, whatever the number of joints: the code calls it for every joint.
    joint_steps, column_steps = steps.joint_steps(), steps.column_steps()
    all_steps = {**joint_steps, **column_steps}

    def define(ir: Writer) -> None:
        # For one state, the steps of columns work on wide vectors, in a module of their own that `define_wide` writes.
        for name, step in joint_steps.items() if ir.lanes == 1 else all_steps.items():
            define_step(ir, name, step, step.memory)
        _define_tables(ir, steps)
        code = _Code(ir, layout, all_steps)
        code.define_sweep()
        code.define_block(signature)

    def define_wide(ir: Writer) -> None:
        for name, step in column_steps.items():
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
    """Return where in scratch memory the numbers of results are.

    They are listed by output port, matrices row by row.
    """
    velocities, width = range(layout.nv), layout.solved_width
    if not layout.forward:
        # Partial derivatives of forces are one port: K, then D, then M.
        start = layout.areas.start("results")
        return [[start + layout.place(name, i, j) for name in ("K", "D", "M") for i in velocities for j in velocities]]
    # Solutions of M x = -b lie in rows: nv columns of dq2d/dq, then nv of dq2d/dqd, then nv of dq2d/dQ = M^-1.
    start = layout.areas.start("solved")
    by_q, by_qd = ([start + i * width + k * layout.nv + j for i in velocities for j in velocities] for k in range(2))
    # Both entries of a pair of M^-1 are read from the upper triangle: the result is symmetric to the last bit.
    by_force = [start + min(i, j) * width + 2 * layout.nv + max(i, j) for i in velocities for j in velocities]
    return [by_q, by_qd, by_force]


class ColumnSheet(Sheet):
    """A tape whose inputs and results have places in memory.

    `constants` are those of all joints, (joints, JOINT_SIZE); `numbers` are those of the one joint that a step is of,
    by name. A "mask" is 0, or NaN for a state with an input that is not finite: it makes all results of the state NaN.
    """

    def __init__(self, constants: np.ndarray | None = None) -> None:
        super().__init__(body=memory_layout.BODY, parent=memory_layout.BODY)
        self.numbers: dict[str, np.ndarray] = {}
        if constants is not None:
            # A number that all joints share is a constant of the trace: products with 0 and 1 then cost nothing.
            # Any other one is read from the table of constants, in which each joint has a row.
            row = [
                self.take("constants", k, 1)[0] if (of_joints != of_joints[0]).any() else of_joints[0]
                for k, of_joints in enumerate(constants.T)
            ]
            ends = np.cumsum(list(CONSTANT_SIZES.values()))
            self.numbers = dict(zip(CONSTANT_SIZES, np.split(np.array(row, dtype=object), ends[:-1]), strict=True))

    def take(self, memory: str, place: int, count: int) -> np.ndarray:
        """Read `count` numbers that lie one behind the other."""
        self.reads += [(memory, place + k) for k in range(count)]
        return self.tape.variables(count)

    def put(self, memory: str, place: int, values: Any) -> None:
        """Write results one behind the other, a matrix row by row."""
        self.outputs += [(memory, place + k, x) for k, x in enumerate(np.ravel(values))]

    def motion(self, memory: str) -> tuple[Series, Series]:
        """Read the twist V of a body, and gravity as a twist."""
        # Gravity has no angular part, which is not stored.
        V, g = self.read(memory, "V"), self.read(memory, "field")[0]
        return V, Series.of([concatenate([0 * g, g], axis=-2)])

    def carried(self, memory: str) -> CarriedBodies:
        """Read the moments and momentum of carried bodies."""
        # Pi and its rate are kept as ten entries each: (10, 1) -> (4, 4).
        Pi = [symmetric_matrix(x[:, 0]) for x in self.read(memory, "Pi").upto(1)]
        return CarriedBodies(Series.of(Pi), self.read(memory, "p"))

    def write_body(self, V: Series, field: Series, Pi: Array) -> None:
        """Write the motion of a body, and what it carries so far.

        This is the body alone. `Pi` are its moments.
        """
        self.write("body", "V", V)
        self.write("body", "field", field.map(lambda g: g[3:]))
        # The way inward adds what the children carry. Pi is constant in the body's axes, and p = I V.
        self.write_carried("body", Series.constant(Pi), from_moment_matrix(Pi) @ V)

    def write_carried(self, memory: str, Pi: Series, p: Series) -> None:
        """Write the moments and momentum of carried bodies."""
        self.write(memory, "Pi", Pi.map(lambda x: x[TRIANGLE]))
        self.write(memory, "p", p)

    def wrenches(self, width: int) -> list[Series]:
        """Read a column: momentum with its rate, reaction, change.

        `ScrewWrenches` says what these wrenches are. They are (6, 1) each.
        """
        # Each of the 24 numbers has a row, `width` long, with a place for every joint: that of number k is k rows
        # behind that of the first.
        x = np.stack([self.take("columns", k * width, 1) for k in range(memory_layout.WRENCH_NUMBERS)]).reshape(4, 6, 1)
        return [Series.of([x[0], x[1]]), Series.of([x[2]]), Series.of([x[3]])]

    def write_column(self, width: int, momentum: Series, reaction: Series, change: Series) -> None:
        """Write the wrenches of a column, as `wrenches` reads them."""
        for k, x in enumerate(np.ravel([momentum[0], momentum[1], reaction[0], change[0]])):
            self.put("columns", k * width, [x])

    def step(self) -> JointStep:
        """Return the recorded step, with masks in place of zeros.

        All results of a state have to become NaN by its mask. Those that the trace knows to be 0 take no input.
        """
        [mask], zero = self.take("mask", 0, 1), self.tape.node(0)
        self.outputs = [(m, place, mask if self.tape.node(x) is zero else x) for m, place, x in self.outputs]
        return super().step()


@dataclass(frozen=True)
class ColumnSteps:
    """The steps of a robot, traced once for all joints.

    The names of the methods `ground` to `solve` are those of the functions in the code. Steps name the parts of memory
    that they take, and `_Code` passes the addresses:

    - "in": inputs, where a joint's begin at its own coordinate; "found": accelerations that were found, alike;
    - "body", "parent": what `memory_layout.BODY` lists, of the body that the joint moves and of its parent;
    - "columns": from the column in question on, the 24 numbers of it, rows apart;
    - "products": results, where a joint's begin at its own row, and a step of columns takes the column in question;
    - "side": the last right side b, by which accelerations are found; "factors": those of M;
    - "constants": numbers of a joint; "mask": as in `ColumnSheet`.

    In `solve`, "columns" are right sides, and "products" are solutions.
    """

    mechanism: Mechanism
    layout: ColumnLayout
    signature: Signature

    def joint_steps(self) -> dict[str, JointStep]:
        """Return the steps of the base, a joint, and all of M.

        They have the names of the functions in the code.
        """
        # A list times a condition is empty where this does not hold.
        steps = [self.ground, self.outward, self.inward]
        steps += [self.of_base] * self.layout.floats + [self.factors] * self.layout.forward
        return {step.__name__: step() for step in steps}

    def column_steps(self) -> dict[str, JointStep]:
        """Return the steps of one column, by name."""
        steps = [self.column, *[self.column_of_base] * self.layout.floats, *[self.solve] * self.layout.forward]
        return {step.__name__: step() for step in steps}

    @property
    def constants(self) -> np.ndarray:
        """The constants of each joint, (joints, JOINT_SIZE), in the walk's order.

        `CONSTANT_SIZES` lists them.
        """
        # Joint j moves the body `owners[j]`, which has the pose B in its parent, and the inertia M.
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
        """Trace the motion of the base or of the ground."""
        chain, sheet = minimal_mechanism(self.mechanism), ColumnSheet()
        # The field of gravity is a twist (0; g), constant in space, which each body sees in its own axes.
        gravity = Series.of([concatenate([0 * chain.gravity, chain.gravity], axis=-1)[:, None]])
        if self.layout.floats:
            # The velocities of the base as a joint are its twist: its screws are unit twists.
            base = self._base(sheet)
            V, field = base.rate, base.twists(gravity)
            # Adding the mask, 0 or NaN, to the moments makes all that follows from them NaN.
            Pi = moment_matrix(chain.M[0]) + sheet.take("mask", 0, 1)
        else:
            # The ground rests, and its moments enter no result: it only collects what its children carry.
            V, field, Pi = Series.of([np.zeros((6, 1), dtype=int)] * 2), gravity, 0 * _I4
        sheet.write_body(V, field, Pi)
        return sheet.step()

    def outward(self) -> JointStep:
        """Trace the motion of a body from that of its parent."""
        sheet = ColumnSheet(self.constants)
        theta = self._coordinate(sheet)
        # Screws are along the z axis: X[2] is 1 where the joint turns and 0 where it only slides.
        angle = sheet.numbers["X"][2:3] * theta
        # The steps `inward` and `column` read sine and cosine, which are computed only once for each joint and sweep.
        sheet.put("body", memory_layout.BODY.start("sine"), sin(angle))
        sheet.put("body", memory_layout.BODY.start("cosine"), cos(angle))
        joint = self._joint(sheet, sin(angle), cos(angle))
        parent_V, parent_field = sheet.motion("parent")
        # V = Ad V_parent + X theta', with its rate. The field of gravity is a twist too, and is transported alike.
        V = joint.twists(parent_V) + joint.X @ joint.rate
        # The mask, 0 or NaN, enters by the moments, as in `ground`.
        Pi = symmetric_matrix(sheet.numbers["Pi"] + sheet.take("mask", 0, 1))
        sheet.write_body(V, joint.twists(parent_field), Pi)
        return sheet.step()

    def inward(self) -> JointStep:
        """Trace the column of a joint; add its bodies to its parent."""
        sheet = ColumnSheet(self.constants)
        joint = self._known_joint(sheet)
        V, field = sheet.motion("body")
        # All children have been visited, so that these moments and this momentum are complete.
        bodies, parent_bodies = sheet.carried("body"), sheet.carried("parent")
        # Momentum I S, reaction B^T S and change I A + B S' + S x F are the column of this joint, in its own axes. Only
        # a joint of several screws would need the twist of its parent, here None.
        own_wrenches = ScrewWrenches.of(joint, V, None, field, bodies)
        # The step `column` multiplies the columns of carried joints by S' and A.
        sheet.write("body", "S_rate", own_wrenches.screws.S_rate)
        sheet.write("body", "A", own_wrenches.screws.A)
        sheet.write_column(self.layout.width, own_wrenches.momentum, own_wrenches.reaction, own_wrenches.change)
        sheet.write_carried(
            "parent", parent_bodies.Pi + joint.moments(bodies.Pi), parent_bodies.p + joint.wrenches(bodies.p)
        )
        if self.layout.forward:
            # The force that this motion takes beyond Q: with accelerations 0 it is -M times those that are sought. The
            # second sweep writes it too, but nothing reads it then.
            Q = sheet.take("in", self._third_input, 1)
            sheet.put("side", 0, (joint.X.T @ bodies.force(V, field)[0]).ravel() - Q)
        return sheet.step()

    def column(self) -> JointStep:
        """Trace the products of a joint's screw with one column.

        The column is that of a joint that this one carries, or of the joint itself. The step hands it on to the
        parent.
        """
        sheet = ColumnSheet(self.constants)
        joint = self._known_joint(sheet)
        S_rate, A = (sheet.read("body", name) for name in ("S_rate", "A"))
        # The column is in the axes of this joint: the steps of the joints between have transported it here.
        wrenches = sheet.wrenches(self.layout.width)
        # Of a joint of one screw, S' is the rate of the screw in time, and also what a displacement moves it by.
        self._write_products(sheet, ScrewProducts.of(Screws(Series.constant(joint.X), S_rate, S_rate, A), *wrenches))
        # The column stays in its place, now in the axes of the parent, whose own step comes later.
        sheet.write_column(self.layout.width, *map(joint.wrenches, wrenches))
        return sheet.step()

    def of_base(self) -> JointStep:
        """Trace the blocks (6, 6) of K, D, M of the base."""
        sheet = ColumnSheet()
        base = self._base(sheet)
        V, field = sheet.motion("body")
        # The base carries the whole robot.
        bodies = sheet.carried("body")
        # The ground that would carry the base is at rest: None.
        own_wrenches = ScrewWrenches.of(base, V, None, field, bodies)
        blocks = ScrewProducts.of(
            own_wrenches.screws, own_wrenches.momentum, own_wrenches.reaction, own_wrenches.change
        )
        # `blocks.D` is that of joints of one screw, whose S' counts twice: their screws move in time and as they are
        # displaced. Displacements of the base leave its screws where they are, so that S' counts once.
        for name, matrix in (("K", blocks.change), ("D", blocks.D - blocks.counted_twice.mT), ("M", blocks.M)):
            sheet.put("products", self.layout.results.start(f"base {name}"), matrix[0])
        if self.layout.forward:
            # The wrench that the motion takes beyond the given one: six entries of a right side, rows apart.
            Q = sheet.take("in", self.signature.inputs[2].start, 6)
            for i, excess in enumerate(bodies.force(V, field)[0].ravel() - Q):
                sheet.put("side", i * self.layout.solved_width, [excess])
        return sheet.step()

    def column_of_base(self) -> JointStep:
        """Trace the products of the base's screws with one column."""
        # The column is that of a joint. By the step `column` of all joints between, it is in the axes of the base.
        sheet = ColumnSheet()
        base = self._base(sheet)
        V, field = sheet.motion("body")
        # Displacements of the base leave its screws where they are: nothing carries it. Hence A = S'' + S x g has no
        # S'', and S x g is the rate of screws on a body with the twist -g.
        nothing = Series.constant(0 * base.X)
        screws = Screws(Series.constant(base.X), base.screw_rate(V), nothing, base.screw_rate(-field))
        self._write_products(sheet, ScrewProducts.of(screws, *sheet.wrenches(self.layout.width)))
        return sheet.step()

    def factors(self) -> JointStep:
        """Trace the factors L^T D L of M.

        This step runs over all entries of M in a straight line, once for each block of states.
        """
        sheet = ColumnSheet()
        # Only entries of two velocities on one branch are read. Others are zeros of the trace: they cost no operation.
        M = self._place_entries(
            [sheet.take("products", self.layout.place("M", i, j), 1)[0] for i, j in self.layout.entries]
        )
        factors_of_M = Factors.of(M)
        # Row i of L is kept with 1 / D_i in place of its diagonal, which is 1. L has entries only where M has some.
        rows = [np.append(row, d) for row, d in zip(factors_of_M.L, factors_of_M.inverse_D, strict=True)]
        sheet.put("factors", 0, [rows[i][j] for i, j in self.layout.entries])
        return sheet.step()

    def solve(self) -> JointStep:
        """Trace the solution of M x = -b for one column b."""
        sheet = ColumnSheet()
        # Rows of L, which end with 1 / D_i on the diagonal.
        factors = self._place_entries(sheet.take("factors", 0, len(self.layout.entries)))
        width, rows = self.layout.solved_width, range(self.layout.nv)
        # Here "columns" are right sides and "products" solutions: `_Code._solve` passes these areas.
        b = np.stack([sheet.take("columns", i * width, 1) for i in rows])
        x = Factors(tuple(factors[i, :i] for i in rows), tuple(factors[i, i : i + 1] for i in rows)).solve(-b)
        for i in rows:
            sheet.put("products", i * width, x[i])
        return sheet.step()

    @property
    def _third_input(self) -> int:
        """The position of the first joint's acceleration or, for accelerations, force.

        Forces on a floating base come before those of the joints, which are the last ones of the port.
        """
        return self.signature.inputs[2].end - self.layout.joints

    def _place_entries(self, entries: Sequence[object] | np.ndarray) -> np.ndarray:
        """Return the lower triangle (nv, nv) from its nonzero entries."""
        matrix = np.zeros((self.layout.nv, self.layout.nv), dtype=object)
        for (i, j), x in zip(self.layout.entries, entries, strict=True):
            matrix[i, j] = x
        return matrix

    def _coordinate(self, sheet: ColumnSheet) -> np.ndarray:
        """Return the joint variable theta, (1,)."""
        return sheet.take("in", 0, 1) + sheet.numbers["offset"]

    def _known_joint(self, sheet: ColumnSheet) -> MovingJoint:
        """Return the joint, with sine and cosine that `outward` wrote."""
        return self._joint(
            sheet, *(sheet.take("body", memory_layout.BODY.start(name), 1) for name in ("sine", "cosine"))
        )

    def _joint(self, sheet: ColumnSheet, s: np.ndarray, c: np.ndarray) -> MovingJoint:
        """Return the joint, given the sine and cosine of its angle, (1,) each."""
        R, r, X = sheet.numbers["R"].reshape(3, 3), sheet.numbers["r"][:, None], sheet.numbers["X"]
        # T = exp(X theta): a turn about z, and a slide along z of X[5] per unit of theta. At theta = 0 the pose in the
        # parent is the product of a shift and a turn.
        rotation_about_z = np.array([[c[0], -s[0], 0], [s[0], c[0], 0], [0, 0, 1]], dtype=object)
        slide_along_z = _I3[:, 2:] * X[5] * self._coordinate(sheet)
        T, shift, turn = pose(rotation_about_z, slide_along_z), pose(_I3, r), pose(R, 0 * r)
        # A joint's part of "in" begins at its own entry of q. Its entry of qd is as far from there as the port of qd is
        # from that of q, which is the first.
        rate = sheet.take("in", self.signature.inputs[1].start, 1)[:, None]
        if self.layout.forward:
            # Accelerations are 0 in the first sweep, and those that were found in the second one. The first six are
            # those of a floating base.
            acceleration = sheet.take("found", 6 * self.layout.floats, 1)[:, None]
        else:
            acceleration = sheet.take("in", self._third_input, 1)[:, None]
        # In the order of the fields of `MovingJoint`. No step reads the number of the parent, 0.
        return MovingJoint(
            0, pose(R, r), shift, turn, Ad(inverse(shift)), Ad(inverse(turn)), X[:, None], ad(X[None]),
            wedge(X[None]), Series.of([rate, acceleration]), T, Ad(inverse(T)),
        )  # fmt: skip

    def _base(self, sheet: ColumnSheet) -> FreeJoint:
        """Return the base as a joint of six screws.

        The screws are along the axes of the body, which the joint moves from the ground.
        """
        C, *twists = self.signature.of_role("base")
        # Its velocities are the twist V. Its accelerations are the rate of V: a port where they are given, else the
        # first six of those that are found.
        pose_of_base = sheet.take("in", C.start, 16).reshape(4, 4)
        places = [("in", port.start) for port in twists] + [("found", 0)] * self.layout.forward
        rates = [sheet.take(memory, place, 6)[:, None] for memory, place in places]
        # The six screws, X of the joint, are the columns of a unit matrix. Its constant placement, the first five
        # matrices, is that of the ground: T alone moves the base.
        screws = _I6, ad(_I6), wedge(_I6)
        motion = pose_of_base, Ad(inverse(pose_of_base))
        return FreeJoint(-1, _I4, _I4, _I4, _I6, _I6, *screws, Series.of(rates), *motion)

    def _write_products(self, sheet: ColumnSheet, products: ScrewProducts) -> None:
        """Write the products of screws with a column into their rows."""
        # Of a carrying joint i and a carried joint j, all products are in the row of i, in column j: also K_ji and
        # D_ji, "by_place" and "by_rate", so that these lie transposed.
        by_name = {"M": products.M, "K": products.change, "D": products.D, "by_place": products.by_place}
        # Of joints of one screw, `counted_twice` is 0.
        by_name["by_rate"] = products.by_rate - products.counted_twice
        # Each screw has a row of its own in each matrix: one for a joint, six for the base.
        for name in memory_layout.PRODUCTS:
            for i, x in enumerate(np.ravel(by_name[name][0])):
                sheet.put("products", self.layout.results.start(f"all {name}") + i * self.layout.width, [x])


def _define_tables(ir: Writer, steps: ColumnSteps) -> None:
    """Define the tables of the robot, by place k in the walk.

    They are the constants of joints and their positions in memory, and where right sides are found.
    """
    layout = steps.layout
    # Bodies lie in memory in the order of the walk, behind the ground or base, which is number 0.
    velocities, body_numbers = range(layout.nv), {j: k + 1 for k, j in enumerate(layout.walk)} | {-1: 0}
    ir.table("constants", steps.constants.ravel().tolist())
    ir.table("parents", [body_numbers[layout.carriers[j]] for j in layout.walk])
    # Each joint has one coordinate, of its own number.
    ir.table("coordinates", layout.walk)
    # How many columns the step of the joint multiplies: those of all joints that it carries, its own among them.
    ir.table("carried", [layout.carried(j) for j in layout.walk])
    if layout.forward:
        # Where each entry of row i of the right sides [K, D, -1] is found among the results. Entries that are always 0
        # share one place, and so do those of -1.
        sides = [[layout.place(name, i, j) for name in ("K", "D") for j in velocities] for i in velocities]
        units = [[memory_layout.MINUS_ONE if i == j else memory_layout.ZERO for j in velocities] for i in velocities]
        ir.table("right_sides", [place for row in zip(sides, units, strict=True) for part in row for place in part])


def _define_wide_step(ir: Writer, name: str, step: JointStep) -> None:
    """Define a step of one state on vectors of columns.

    ``@name(memory, left)`` does it for one vector of columns, of which the first `left` count; ``@wide_name(memory,
    first, count)`` for all columns of a range.
    """
    arguments = pointers(*(f"%{part}" for part in step.memory))

    def read(i: int) -> str:
        part, place = step.reads[i]
        address = ir.at(f"%{part}", place)
        # Neighbours in a row are a vector of neighbouring columns; any other number is the same for all columns.
        return ir.load(address) if part in OF_COLUMNS else ir.splat(ir.let(f"load double, ptr {address}"))

    with ir.function(f"internal void @{name}({arguments}, i64 %left) {ir.aligned}"):
        values = emit_steps(ir, step.program, read)
        # Lane l holds a column of the range where l < left. Other lanes are not stored: behind the range there may be
        # columns that belong to other calls.
        in_first_lane = ir.let(f"insertelement {ir.I} poison, i64 %left, i64 0")
        spread_left = ir.let(f"shufflevector {ir.I} {in_first_lane}, {ir.I} poison, <{ir.lanes} x i32> zeroinitializer")
        lanes = ", ".join(f"i64 {lane}" for lane in range(ir.lanes))
        is_column = ir.let(f"icmp slt {ir.I} <{lanes}>, {spread_left}")
        store = f"@llvm.masked.store.v{ir.lanes}f64.p0"
        ir.declared[f"declare void {store}({ir.V}, ptr, i32, {ir.B})"] = None
        for (part, place), i in zip(step.writes, step.program.outputs, strict=True):
            ir.do(f"call void {store}({ir.V} {values[i]}, ptr {ir.at(f'%{part}', place)}, i32 8, {ir.B} {is_column})")
    # The range takes ceil(count / lanes) vectors, one call for each.
    with (
        ir.function(f"void @wide_{name}({arguments}, i64 %first, i64 %count)"),
        ir.loop(ir.let(f"sdiv i64 {ir.let(f'add i64 %count, {ir.lanes - 1}')}, {ir.lanes}")) as vector,
    ):
        columns_before = ir.let(f"mul i64 {vector}, {ir.lanes}")
        j, left = ir.let(f"add i64 %first, {columns_before}"), ir.let(f"sub i64 %count, {columns_before}")
        memory_at_j = {x: ir.at(f"%{x}", j) if x in OF_COLUMNS else f"%{x}" for x in step.memory}
        ir.do(f"call void @{name}({pointers(*(memory_at_j[x] for x in step.memory))}, i64 {left})")


@dataclass(frozen=True)
class _Code:
    """The functions that call the steps.

    ``@block`` runs once for each block of states. It calls ``@sweep`` once, or for accelerations twice. ``@sweep``
    calls steps of a joint once for each joint, and `column` once for each joint and each column of what it carries.
    """

    ir: Writer
    layout: ColumnLayout
    steps: Mapping[str, JointStep]

    def define_sweep(self) -> None:
        """Define ``@sweep(in, memory)``: outward, inward, and over the columns of each joint."""
        ir, layout = self.ir, self.layout
        with ir.function("internal void @sweep(ptr %in, ptr %memory)"):
            # The steps of the ground or base take the addresses of whole areas.
            base = {"in": "%in", "body": self._area("bodies"), "products": self._area("results")}
            base |= {name: self._area(name) for name in ("mask", "columns", *["found"] * layout.forward)}
            # Outward to the motions of all bodies, in the order of the walk: parents come before children.
            self._call("ground", base)
            with ir.loop(str(layout.joints)) as k:
                self._call("outward", self._memory_of_joint(k))
            # Inward, in the reverse order, to what each joint carries and to its column. The joint at place k of the
            # walk has column joints - 1 - k, which is the number of joints that have been visited.
            with ir.loop(str(layout.joints)) as visited:
                memory = self._memory_of_joint(ir.let(f"sub i64 {layout.joints - 1}, {visited}"))
                self._call("inward", {**memory, "columns": ir.at(memory["columns"], visited, ir.V)})
            # Inward once more, for a row of products of each joint. The joints that a joint carries come directly after
            # it in the walk, hence directly before it here: the last of their `count` columns is its own, `visited`.
            with ir.loop(str(layout.joints)) as visited:
                k = ir.let(f"sub i64 {layout.joints - 1}, {visited}")
                count = ir.let(f"load i64, ptr {ir.at('@carried', k, 'i64')}")
                first = ir.let(f"sub i64 {ir.let(f'add i64 {visited}, 1')}, {count}")
                self._call_columns("column", self._memory_of_joint(k), first, count)
            # A floating base carries all joints: by now, all columns are in its axes.
            if layout.floats:
                side = {"side": ir.at(self._area("sides"), 3 * layout.nv, ir.V)} if layout.forward else {}
                self._call("of_base", base | side)
                self._call_columns("column_of_base", base, "0", str(layout.joints))

    def define_block(self, signature: Signature) -> None:
        """Define ``@block(in, out, memory, count)``, which computes one block of states.

        Results stay in working memory, and there is one block only: "out" and "count" are not used.
        """
        ir = self.ir
        with ir.function("internal void @block(ptr %in, ptr %out, ptr %memory, i64 %count)"):
            # The mask is 0, or NaN in lanes of states with an input that is not finite. All results are of order 0 and
            # take all inputs, so that the first mask serves all.
            mask, results = next(nan_masks(ir, signature, self._add_zeros)), self._area("results")
            ir.store(mask, self._area("mask"))
            # Results begin with a zero, or rather the mask, from which all entries of K, D and M are read that are
            # always zero, and with -1, for right sides.
            ir.store(mask, ir.at(results, memory_layout.ZERO, ir.V))
            ir.store(ir.vector(-1.0), ir.at(results, memory_layout.MINUS_ONE, ir.V))
            self._clear_ends("columns", memory_layout.WRENCH_NUMBERS, self.layout.width)
            # K, D and M are those of the true motion: accelerations that are not given have to be found first.
            if self.layout.forward:
                self._solve_for_accelerations()
            ir.do("call void @sweep(ptr %in, ptr %memory)")
            if self.layout.forward:
                # M does not depend on accelerations: its factors from the first sweep still hold.
                self._copy_right_sides(results)
                self._solve(0, 3 * self.layout.nv)

    def _solve_for_accelerations(self) -> None:
        """Write the computation of the accelerations q2d.

        They solve M q2d = Q - (the forces at q2d = 0).
        """
        ir, layout = self.ir, self.layout
        self._clear_ends("sides", layout.nv, layout.solved_width)
        # In a sweep at accelerations 0, "side", the last column of the right sides, is what the forces exceed Q by. K
        # and D of this sweep are not read: the second one writes them again.
        with ir.loop(str(layout.nv)) as i:
            ir.store(ir.vector(0.0), ir.at(self._area("found"), i, ir.V))
        ir.do("call void @sweep(ptr %in, ptr %memory)")
        self._call(
            "factors", {name: self._area(name) for name in ("factors", "mask")} | {"products": self._area("results")}
        )
        self._solve(3 * layout.nv, 1)
        # The solution, a column, becomes the accelerations of the next sweep.
        with ir.loop(str(layout.nv)) as i:
            place = ir.let(f"add i64 {ir.let(f'mul i64 {i}, {layout.solved_width}')}, {3 * layout.nv}")
            ir.store(ir.load(ir.at(self._area("solved"), place, ir.V)), ir.at(self._area("found"), i, ir.V))

    def _solve(self, first: int, count: int) -> None:
        """Write the solution of M x = -b for `count` columns b from `first`."""
        memory = {name: self._area(name) for name in ("mask", "factors")}
        memory |= {"columns": self._area("sides"), "products": self._area("solved")}
        self._call_columns("solve", memory, str(first), str(count))

    def _copy_right_sides(self, results: str) -> None:
        """Write the copy of K, D and -1 into the right sides.

        -1 is the unit matrix with its sign changed, of which the solution is M^-1.
        """
        ir, columns = self.ir, 3 * self.layout.nv
        with ir.loop(str(self.layout.nv)) as i:
            row = ir.at(self._area("sides"), ir.let(f"mul i64 {i}, {self.layout.solved_width}"), ir.V)
            listed = ir.at("@right_sides", ir.let(f"mul i64 {i}, {columns}"), "i64")
            with ir.loop(str(columns)) as j:
                place = ir.let(f"load i64, ptr {ir.at(listed, j, 'i64')}")
                ir.store(ir.load(ir.at(results, place, ir.V)), ir.at(row, j, ir.V))

    def _clear_ends(self, area: str, rows: int, width: int) -> None:
        """Write the code that sets the empty places of rows to 0.

        They are the last places of each row. Vectors of columns of one state reach into them: what they compute there
        is not stored, but must raise no floating-point flag.
        """
        ir = self.ir
        # In a batch, vectors hold states, and reach into no other column.
        if ir.lanes > 1:
            return
        with ir.loop(str(rows)) as i:
            end = ir.at(self._area(area), ir.let(f"mul i64 {ir.let(f'add i64 {i}, 1')}, {width}"), ir.V)
            for j in range(memory_layout.MOST_LANES):
                ir.store(ir.vector(0.0), ir.at(end, j - memory_layout.MOST_LANES, ir.V))

    def _area(self, name: str) -> str:
        """Return the address of an area of scratch memory."""
        return self.ir.at("%memory", self.layout.areas.start(name), self.ir.V)

    def _memory_of_joint(self, k: str) -> dict[str, str]:
        """Return the addresses of a joint's memory.

        The joint is at place k of the walk.
        """
        ir, layout = self.ir, self.layout
        body_number, parent_number = ir.let(f"add i64 {k}, 1"), ir.let(f"load i64, ptr {ir.at('@parents', k, 'i64')}")
        bodies, coordinate = self._area("bodies"), ir.let(f"load i64, ptr {ir.at('@coordinates', k, 'i64')}")
        body, parent = (
            ir.at(bodies, ir.let(f"mul i64 {j}, {memory_layout.BODY.size}"), ir.V) for j in (body_number, parent_number)
        )
        # Rows of matrices are in the order of the velocities: those of a floating base come first.
        row = ir.let(f"add i64 {coordinate}, {6 * layout.floats}")
        memory = {"body": body, "parent": parent, "mask": self._area("mask"), "columns": self._area("columns")}
        memory["constants"] = ir.at("@constants", ir.let(f"mul i64 {k}, {JOINT_SIZE}"))
        # Inputs and rows of results are in the order of the coordinates, which may differ from that of the walk.
        memory["in"] = ir.at("%in", coordinate, ir.V)
        memory["products"] = ir.at(self._area("results"), ir.let(f"mul i64 {row}, {layout.width}"), ir.V)
        if layout.forward:
            memory["found"] = ir.at(self._area("found"), coordinate, ir.V)
            # The last column of the right sides, behind K, D and -1, is the one by which accelerations are found.
            row_start = ir.let(f"mul i64 {row}, {layout.solved_width}")
            memory["side"] = ir.at(ir.at(self._area("sides"), row_start, ir.V), 3 * layout.nv, ir.V)
        return memory

    def _call(self, name: str, memory: Mapping[str, str]) -> None:
        """Write the call of a step, with addresses of memory by name."""
        self.ir.do(f"call void @{name}({pointers(*(memory[x] for x in self.steps[name].memory))})")

    def _call_columns(self, name: str, memory: Mapping[str, str], first: str, count: str) -> None:
        """Write the calls of a step on `count` columns from `first`."""
        ir, step = self.ir, self.steps[name]
        # For one state, the step is in the module with wide vectors, and takes several columns at a time.
        if ir.lanes == 1:
            ir.declared[f"declare void @wide_{name}({', '.join(['ptr'] * len(step.memory))}, i64, i64)"] = None
            ir.do(f"call void @wide_{name}({pointers(*(memory[x] for x in step.memory))}, i64 {first}, i64 {count})")
            return
        # In a batch, vectors hold states: each column has a call of its own.
        with ir.loop(count) as k:
            j = ir.let(f"add i64 {first}, {k}")
            self._call(name, {**memory, **{x: ir.at(memory[x], j, ir.V) for x in OF_COLUMNS}})

    def _add_zeros(self, total: str, port: Port) -> str:
        """Write a total plus 0 times each scalar of an input.

        Such a product is NaN if the scalar is infinite or NaN.
        """
        for j in range(port.start, port.end):
            total = self.ir.op("fma", self.ir.load(self.ir.at("%in", j, self.ir.V)), self.ir.vector(0.0), total)
        return total
