"""The steps of partial derivatives in the columns form, traced for one joint: outward, inward, and of one column.

The mathematics is that of `dynamics.recursion.force_partials` and of `spatial.linear`. What joints of a robot have in
common are numbers in the trace, what distinguishes them are numbers in a table.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jounce.core.scalars import concatenate, cos, sin
from jounce.dynamics.computation import Signature
from jounce.dynamics.recursion.force_partials import ScrewProducts, Screws, ScrewWrenches
from jounce.dynamics.recursion.joints import FreeJoint, MovingJoint
from jounce.model.equivalent_mechanisms import minimal_mechanism
from jounce.model.mechanism import Mechanism
from jounce.native.column_layout import BODY, PRODUCTS, ColumnLayout
from jounce.native.column_sheets import TRIANGLE, ColumnSheet
from jounce.native.emit import JointStep
from jounce.spatial.inertia import moment_matrix, symmetric_matrix
from jounce.spatial.lie import Ad, ad, inverse, pose, position, rotation, wedge
from jounce.spatial.linear import Factors
from jounce.spatial.series import Series

_I3, _I4, _I6 = (np.eye(n, dtype=int) for n in (3, 4, 6))


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
        sheet.put("body", BODY.start("sine"), sin(angle))
        sheet.put("body", BODY.start("cosine"), cos(angle))
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
        return self._joint(sheet, *(sheet.take("body", BODY.start(name), 1) for name in ("sine", "cosine")))

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
        for name in PRODUCTS:
            for i, x in enumerate(np.ravel(by_name[name][0])):
                sheet.put("products", self.layout.results.start(f"all {name}") + i * self.layout.width, [x])
