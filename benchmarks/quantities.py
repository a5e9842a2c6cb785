"""Every quantity of arms and humanoids, beside the nearest algorithm of Pinocchio called from Python.

The robots are those of example-robot-data, and the iiwa of the paper. Pinocchio computes one state a call and no rates
of its results; where it leaves coordinates that follow others free, its robot has one more.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib import metadata
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.measure import Case, seconds
from benchmarks.robots import states
from jounce import JounceError, Robot, load
from jounce.checks.compare import build_pinocchio_model
from jounce.dynamics.computation import Computation
from jounce.native import code_forms
from jounce.native.kernel import Kernel

FILES = {"panda": "panda.urdf", "g1": "g1_29dof_rev_1_0.urdf", "talos": "talos_reduced.urdf"}
DERIVED = ("iiwa14", "g1", "talos")  # the robots of `DERIVATIVES`
BODIES = {"iiwa14": "link7", "panda": "panda_hand", "g1": "left_wrist_yaw_link", "talos": "arm_left_7_link"}
COUNT = 1_000
COMPARED = 3  # states, with the closed form
WRONG = 1e-10  # further off, it is something else; times the condition number of M where M is inverted

State = tuple[np.ndarray, np.ndarray, np.ndarray]
Peer = Callable[[Any, Any, Any, State, int], Any]  # of pin, its model and data, a state and a frame


@dataclass(frozen=True)
class Row:
    """A quantity with rates, and the peer's call that comes nearest."""

    method: str
    order: int
    peer: Peer
    keywords: dict[str, str] = field(default_factory=dict)
    of_body: bool = False
    quantity: str = ""  # where it is not named as the method
    arms: bool = False  # of a humanoid it would take too long to compile

    @property
    def label(self) -> str:
        """What the row is called."""
        name = self.quantity or self.method
        rates = ["", ", one rate", ", two rates"][self.order]
        return f"{name}{' of a body' if self.of_body else ''}{rates}"


ROWS = (
    Row("gravity_forces", 0, lambda pin, m, d, x, f: pin.computeGeneralizedGravity(m, d, x[0])),
    Row("inverse_dynamics", 0, lambda pin, m, d, x, f: pin.rnea(m, d, *x)),
    Row("mass_matrix", 0, lambda pin, m, d, x, f: pin.crba(m, d, x[0])),
    Row("coriolis_matrix", 0, lambda pin, m, d, x, f: pin.computeCoriolisMatrix(m, d, *x[:2])),
    Row(
        "coriolis_matrix", 0, lambda pin, m, d, x, f: pin.computeCoriolisMatrix(m, d, *x[:2]), {"form": "skew"},
        quantity="skew_coriolis_matrix",
    ),
    Row("poses", 0, lambda pin, m, d, x, f: pin.forwardKinematics(m, d, x[0])),
    Row(
        "twists", 0,
        lambda pin, m, d, x, f: (pin.forwardKinematics(m, d, *x[:2]), pin.getFrameVelocity(m, d, f)), of_body=True,
    ),
    Row(
        "twists", 1,
        lambda pin, m, d, x, f: (pin.forwardKinematics(m, d, *x), pin.getFrameAcceleration(m, d, f)), of_body=True,
    ),
    Row("jacobian", 0, lambda pin, m, d, x, f: pin.computeFrameJacobian(m, d, x[0], f), of_body=True),
    Row(
        "jacobian", 1,
        lambda pin, m, d, x, f: (
            pin.computeJointJacobiansTimeVariation(m, d, *x[:2]),
            pin.getFrameJacobianTimeVariation(m, d, f, pin.LOCAL),
        ),
        of_body=True,
    ),
    Row("momentum", 1, lambda pin, m, d, x, f: pin.computeCentroidalMomentumTimeVariation(m, d, *x)),
    Row("base_wrench", 0, lambda pin, m, d, x, f: pin.computeCentroidalMomentumTimeVariation(m, d, *x)),
)  # fmt: skip

DERIVATIVES = (
    Row("forward_dynamics", 0, lambda pin, m, d, x, f: pin.aba(m, d, *x)),
    Row("forward_dynamics", 2, lambda pin, m, d, x, f: pin.aba(m, d, *x)),
    Row("regressor", 0, lambda pin, m, d, x, f: pin.computeJointTorqueRegressor(m, d, *x)),
    Row("inverse_dynamics_partials", 0, lambda pin, m, d, x, f: pin.computeRNEADerivatives(m, d, *x)),
    Row("forward_dynamics_partials", 0, lambda pin, m, d, x, f: pin.computeABADerivatives(m, d, *x)),
    Row("inverse_dynamics_partials", 2, lambda pin, m, d, x, f: pin.computeRNEADerivatives(m, d, *x), arms=True),
)


@dataclass(frozen=True)
class Compiled:
    """What compiling a row for a robot took, in seconds, and how many operations it has."""

    operations: int
    cold: float
    from_cache: float


@dataclass
class Gathered:
    """What there is to measure, and what compiling took, by robot and row."""

    cases: list[Case] = field(default_factory=list)
    compiled: dict[tuple[str, str], Compiled] = field(default_factory=dict)


def gathered() -> Gathered:
    """Keyed ("quantity", robot, label, "batch" | "call" | "peer")."""
    found = Gathered()
    paths = {Path(file).name: file.locate() for file in metadata.files("example-robot-data") or []}
    for name in dict.fromkeys((*FILES, *DERIVED)):
        path = str(paths[FILES[name]]) if name in FILES else ""
        robot, rows = load(path or name), rows_of(name)
        calls = _peer(path, robot, BODIES[name], rows)
        for row, call in zip(rows, calls, strict=True):
            found.compiled[name, row.label] = _compiled(robot, row, BODIES[name])
            found.cases += _cases(name, robot, row, BODIES[name])
            found.cases.append(Case(("quantity", name, row.label, "peer"), call))
    return found


def rows_of(name: str) -> list[Row]:
    """The rows of a robot."""
    derived = [row for row in DERIVATIVES if not row.arms or name == "iiwa14"] if name in DERIVED else []
    return [*ROWS, *derived] if name in FILES else derived


def _asked(row: Row, body: str) -> Computation:
    return Computation(row.quantity or row.method, row.order, body=body if row.of_body else None)


def _keywords(row: Row, body: str) -> dict[str, str]:
    return row.keywords | ({"body": body} if row.of_body else {})


def _compiled(robot: Robot, row: Row, body: str) -> Compiled:
    """A kernel, compiled into an empty cache and read from it."""
    asked = _asked(row, body)
    with TemporaryDirectory() as folder:
        before = os.environ.get("JOUNCE_CACHE_DIR")
        os.environ["JOUNCE_CACHE_DIR"] = folder
        try:
            cold, again = (seconds(partial(Kernel, robot.mechanism, asked)) for _ in range(2))
        finally:
            os.environ.pop("JOUNCE_CACHE_DIR")
            os.environ |= {"JOUNCE_CACHE_DIR": before} if before is not None else {}
    return Compiled(code_forms.trace_program(robot.mechanism, asked).operations, cold, again)


def _cases(name: str, robot: Robot, row: Row, body: str) -> Iterator[Case]:
    law, keywords = getattr(robot, row.method), _keywords(row, body)
    asked = _asked(row, body)
    rates = states(robot.n, COUNT, row.order)[: asked.rates]
    robot.compile(asked.name, order=asked.order, body=asked.body)  # however long it takes
    first = law(*rates, **keywords)
    inverted = (row.quantity or row.method).startswith("forward")
    _compare(law, rates, keywords, first, np.linalg.cond(robot.mass_matrix(rates[0])).max() if inverted else 1.0)
    out = first if row.order == 0 else tuple(first)
    yield Case(("quantity", name, row.label, "batch"), partial(law, *rates, **keywords, out=out), COUNT)
    state = [x[0].copy() for x in rates]  # the method is looked up in each call, as users do
    yield Case(("quantity", name, row.label, "call"), lambda: getattr(robot, row.method)(*state, **keywords))


def _compare(
    law: Callable[..., Any], rates: Sequence[np.ndarray], keywords: dict[str, str], found: Any, condition: float
) -> None:
    exact = law(*(x[:COMPARED] for x in rates), **keywords, method="closed_form")
    both = zip(found, exact, strict=True) if isinstance(found, tuple) else [(found, exact)]
    error = max(np.abs(x[:COMPARED] - y).max() / np.abs(y).max() for x, y in both)
    if not error < WRONG * condition:
        raise JounceError(f"results are {error:.1g} from those of the closed form")


def _peer(path: str, robot: Robot, body: str, rows: Sequence[Row]) -> Iterator[Callable[[], Any]]:
    """The peer's calls, in the order of the rows; without a file it is given the data of the robot."""
    import pinocchio as pin

    model = pin.buildModelFromUrdf(path) if path else build_pinocchio_model(pin, robot.mechanism)
    data, frame = model.createData(), model.getFrameId(body)
    x = tuple(np.random.default_rng(0).uniform(-1, 1, (3, model.nv)))
    for row in rows:
        yield partial(row.peer, pin, model, data, x, frame)
