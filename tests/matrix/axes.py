"""The axes of the matrix: robots with what each is there for, backends, and what does not exist, with the words of it.

A cell is a quantity of a robot by a backend, with as many rates as the robot's row states. What computes it takes a
`Request`, and returns the results for the first of its states, as many as it computes.
"""

import ctypes
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from tempfile import TemporaryDirectory
from typing import Any

import jax
import numpy as np

import casadi
import jounce
from jounce._codegen.function import function_names
from jounce.arguments import requests
from jounce.core.scalars import convert_element
from jounce.dynamics.computation import Computation
from jounce.dynamics.quantities import QUANTITIES, Quantity
from jounce.dynamics.quantities import row as rows
from jounce.model.drive_trains import AMOUNTS, DRIVE_TERMS, LOAD_FRICTION
from jounce.model.frame import Frame
from jounce.model.mechanism import Mechanism
from jounce.model.polynomials import PolynomialLaw, with_polynomials
from jounce.spatial.series import rate_name
from support.expressions import entries, evaluated
from support.linkages import palletizer
from support.quantities import branched, rigid, tupled
from support.random_loops import LOOPED, looped
from support.robots import floating, golden, random_chain, random_mechanism, random_pose, springs
from support.several_named import named_robot
from support.several_screws import screw_robot
from support.tools import require

STATES = 9  # one more than the lanes of any processor
METHODS = ("closed form", "paper")
STRICT = "-std=c99 -O0 -Wall -Wextra -Wpedantic -Wconversion -Werror"
MOST = {"closed form of symbols": 0, "paper of symbols": 0}  # orders: dense products of symbols grow fast
LESS_CODE = ("inverse_dynamics_partials", "forward_dynamics_partials")  # by the closed form than by the recursion
CLOSED = tuple(
    row.name for row in QUANTITIES.values() if rows.CLOSED in row.needs or row.name in ("inverse_dynamics", "twists")
)
HASTY = {"xla_backend_optimization_level": 0, "xla_cpu_use_fusion_emitters": False}  # as each function runs once


@dataclass(frozen=True)
class Case:
    """A robot of the matrix: what it has of what quantities need, and by which backends they are asked for."""

    make: Callable[[], jounce.Robot]
    why: str
    has: str = ""  # words of `NEEDS`
    backends: str = "closed form, paper, native"
    order: int = 1  # of rates
    large: int = 0  # of partial derivatives and regressors
    wrench: bool = True
    moving: bool = False  # whether the ground of a fixed robot moves
    bodies: tuple[str, ...] = ("last",)  # of which quantities are asked beside those of all bodies
    only: tuple[str, ...] = tuple(QUANTITIES)
    tolerance: float = 1e-12

    @cached_property
    def robot(self) -> jounce.Robot:
        """The robot, made once."""
        return self.make()

    @cached_property
    def symbolic(self) -> Any:
        """The robot's equations in symbolic form."""
        return self.robot.symbolic(moving_base=self.moving)

    def order_of(self, row: Quantity) -> int:
        """The order to which a quantity is asked for."""
        large = {"rates", "parameters"} & set(row.gives.shape)
        return row.highest(min(self.large, self.order) if large else self.order)

    @cached_property
    def cells(self) -> tuple[tuple[str, str | None, str], ...]:
        """All (quantity, body, frame) that are asked for."""
        found = []
        for row in (row for row in QUANTITIES.values() if row.name in self.only and not lacks(self, row)):
            found += [(row.name, None, "body")]
            if row.of_bodies:
                found += [(row.name, body, frame) for body in self.bodies for frame in row.gives.frames or ("body",)]
        return tuple(found)

    @cache  # noqa: B019
    def request(self, name: str, body: str | None, frame: str, most: int | None = None) -> "Request":
        """A cell as a request, of an order that is not more than some backend takes in short time."""
        row, m = QUANTITIES[name], self.robot.mechanism
        body = self.robot.body_names[-1] if body == "last" else body
        given = {"wrench": self.wrench and row.takes.wrenches, "body": body, "frame": frame, "moving_base": self.moving}
        order = self.order_of(row) if most is None else min(self.order_of(row), most)
        return Request(self, requests.build_computation(m, requests.ComputationRequest(name, order, **given)))

    @cache  # noqa: B019
    def library(self, order: int) -> tuple[ctypes.CDLL, dict[Computation, str]]:
        """Generated C of all quantities of an order, compiled at once, and the names of its functions."""
        asked = [self.request(*cell).asked for cell in self.cells if serves("generated C", *cell)]
        asked = [x for x in asked if x.order == order]
        options = {"outputs": [x.spelling for x in asked], "wrench": any(x.wrench for x in asked)}
        with TemporaryDirectory() as folder:
            self.robot.codegen("c", order, folder, **options, moving_base=self.moving, prefix="robot", overwrite=True)
            compiler = ["gcc", *STRICT.split(), "-shared", "-fPIC", "robot.c", "-lm", "-o", "robot.so"]
            subprocess.run(compiler, cwd=folder, check=True)
            return ctypes.CDLL(f"{folder}/robot.so"), dict(zip(asked, function_names(asked), strict=True))


def cams() -> jounce.Robot:
    """A chain of four joints, two of which follow others by polynomials, one through the other."""
    laws = {
        "joint2": PolynomialLaw("joint1", (0.1, 0.4, -0.3, 0.2)),
        "joint4": PolynomialLaw("joint2", (0.2, 0.0, 0.5)),
    }
    return jounce.Robot(with_polynomials(random_chain(4, ("revolute", "prismatic")), laws))


def sprung() -> jounce.Robot:
    """The planar 2R with every kind of drive, and a motor behind a spring."""
    m = jounce.load("planar2r").mechanism
    drives = {name: [0.3, 0.7] for name in (*(AMOUNTS[term] for term in DRIVE_TERMS), "rest")}
    rigid_arm = jounce.Robot.from_screws(m.B, m.X, m.M, gravity=m.gravity, drives=drives)
    driven = rigid_arm.with_drives(eps=0.5).mechanism
    return jounce.Robot(replace(driven, elasticity=springs(driven.n)))


def wound(robot: jounce.Robot) -> jounce.Robot:
    """The robot on soft joints, whose motors state all that they may."""
    motor = jounce.Motor(gear=50, inertia=4e-5, friction=1e-3, resistance=0.5, inductance=2e-3, constant=0.1)
    return robot.elastic(500.0, motors=motor)


def carried() -> jounce.Robot:
    """A planar 2R whose second rotor is carried by its first link: both inertias are coupled."""
    motors = {
        "joint1": jounce.Motor(gear=80, inertia=4e-5, body="world", constant=0.1, resistance=0.4),
        "joint2": jounce.Motor(gear=-100, inertia=3e-5, body="body1", constant=0.1, resistance=0.5),
    }
    return jounce.load("planar2r").elastic([900.0, 700.0], coupling=1, motors=motors)


def floating_forest() -> jounce.Robot:
    """A forest of all kinds of joints and drives on a floating base."""
    return jounce.Robot(floating(rigid(branched((-1, 0, 0))).mechanism, np.random.default_rng(0)))


def with_all_drives(m: Mechanism, rng: np.random.Generator) -> Mechanism:
    """The mechanism with drives, all terms of which act, and numbers for friction by the load, which does not."""
    names = (*(AMOUNTS[term] for term in DRIVE_TERMS), "rest", "load_eps", "eps", "stribeck_velocity")
    nc = len(m.joints)
    drives = {name: rng.uniform(0.3, 1, nc) for name in names} | {"load_friction": np.linspace(0, 0.3, nc)}
    return replace(m, drives=replace(m.drives, **drives), acting=DRIVE_TERMS)


def load_driven() -> jounce.Robot:
    """A tree with friction by the load at all joints but the first."""
    kinds, rng = ["revolute", "prismatic", "helical"], np.random.default_rng(3)
    m = with_all_drives(random_mechanism(rng, [-1, 0, 0], kinds, [1.0] * 3), rng)
    return jounce.Robot(replace(m, acting=(*DRIVE_TERMS, LOAD_FRICTION)))


def standing() -> jounce.Robot:
    """A floating robot on a point of a slope and on a plane."""
    robot = jounce.Robot(floating(golden("planar2r")[0], np.random.default_rng(1)))
    base, *_, tip = robot.body_names
    point = jounce.Contact(base, "point", place=(0.2, -0.1, 0.3), normal=(0.6, 0, 0.8))
    return robot.contacts([point, jounce.Contact(tip, "plane", place=(0.1, 0.2, 0))])


def half_driven_fivebar() -> jounce.Robot:
    """A five-bar with one motor, sprung and damped, whose other shoulder is passive."""
    whole = jounce.load("fivebar").mechanism
    terms = {"stiffness": np.full(4, 5.0), "damping": np.array([0.1, 0.2, 0.3, 0.1])}
    tree = replace(whole.tree, drives=replace(whole.tree.drives, **terms), acting=("damping", "spring"))
    shoulders = {"actuated": ["left_shoulder"], "passive": ["right_shoulder"]}
    return jounce.Robot(tree).closed(whole.loops, **shoulders, start=whole.closure.start)


def followers() -> jounce.Robot:
    """The planar 2R with one coordinate."""
    m = jounce.load("planar2r", L1=1.1, m2=0.3).mechanism
    return jounce.Robot.from_screws(m.B, m.X, m.M, gravity=m.gravity, G=[[1.0], [-0.5]], g=[0.25, 0.3])


def slider_with_links() -> jounce.Robot:
    """A prismatic and a helical joint, and links merged into a body and into the ground."""
    m, rng = golden("mixed5")[0], np.random.default_rng(7)
    robot = jounce.Robot.from_screws(*(x[1:3] for x in (m.B, m.X, m.M)), gravity=m.gravity)
    frames = (Frame("tool", 1, random_pose(rng)), Frame("stand", -1, random_pose(rng)))
    return jounce.Robot(replace(robot.mechanism, frames=frames))


MOTORS = tuple(row.name for row in QUANTITIES.values() if rows.ELASTIC in row.needs)
FIRST = tuple(name for name in QUANTITIES if "second" not in name)  # others take long to compile for many velocities
SHORT = tuple(row.name for row in QUANTITIES.values() if row.takes.rates < 2)
CAMS = ("inverse_dynamics", "coordinates", "mass_matrix", "coriolis_matrix", "inverse_dynamics_partials", "jacobian",
        "regressor", "kinetic_energy", "forward_dynamics")  # fmt: skip
LOADED = ("inverse_dynamics", "forward_dynamics", "mass_matrix")
OF_SYMBOLS = "recursion of symbols, closed form of symbols, paper of symbols"
ROBOTS = {
    "forest": Case(
        branched, "all kinds of joints, one of which follows another, drives, springs, merged links",
        has="motors electric", order=2, large=2, bodies=("body3", "tool", "stand"),
    ),
    "small forest": Case(
        lambda: branched((-1, 0, -1)), "the same of few bodies, for what takes long for each",
        has="motors electric", backends="CasADi", order=2, bodies=("body2", "tool", "stand"),
    ),
    "small forest at rest": Case(
        lambda: branched((-1, 0, -1)), "the same without rates, which take compilers longest",
        has="motors electric", backends="JAX, generated C", order=0, bodies=("tool",),
    ),
    "iiwa": Case(lambda: jounce.Robot(golden("iiwa")[0]), "a chain of exact axes", order=2, wrench=False, only=FIRST),
    "drives": Case(
        sprung, "of two coordinates, for symbols", has="motors electric", backends=f"{OF_SYMBOLS}, symbolic",
        wrench=False, bodies=("body2",), order=0,
    ),
    "rates of drives": Case(
        lambda: rigid(sprung()), "the same without motors", wrench=False, order=2, backends="recursion of symbols",
    ),
    "slider": Case(
        slider_with_links, "joints that shift and screw", bodies=("tool", "stand"),
        backends="symbolic, generated C",
    ),
    "followers": Case(
        followers, "two joints that follow one coordinate, with an offset", order=2, backends="symbolic",
    ),
    "floats": Case(
        floating_forest, "six velocities more, and the motion of the base", has="base",
        backends="closed form, paper, native, generated C", only=FIRST,
    ),
    "moving ground": Case(
        lambda: rigid(branched((-1, 0, -1))), "a base that moves as it is told", has="base", moving=True, order=2,
    ),
    "moving wall": Case(
        slider_with_links, "a base that moves, for what takes long",
        has="base", moving=True, backends="JAX", only=SHORT,
    ),
    "several screws": Case(
        lambda: named_robot(floats=True), "balls, planar and free joints: more numbers than velocities",
        has="base", order=0, backends="closed form, paper, native", only=FIRST,
    ),
    "screws on their frames": Case(
        lambda: screw_robot("branches"), "such joints whose frames are on their axes, and ground that moves",
        has="base", moving=True, order=2, large=2, backends="closed form, paper", tolerance=1e-11,
    ),
    "forest of screws": Case(
        lambda: screw_robot("forest", tilted=True), "such joints on the ground", order=2, large=2,
        backends="closed form, paper", tolerance=1e-11,
    ),
    "wound motors": Case(
        lambda: wound(jounce.load("planar2r")), "soft joints whose motors state all data", has="motors electric soft",
        backends="closed form, native, CasADi, JAX, generated C", only=MOTORS,
    ),
    "soft joints": Case(
        lambda: wound(jounce.load("planar2r")), "what takes soft joints, for symbols", has="motors electric soft",
        backends="recursion of symbols, closed form of symbols", only=("feedback_linearization",), wrench=False,
    ),
    "motors on a cart": Case(
        lambda: wound(jounce.Robot(floating(golden("planar2r")[0], np.random.default_rng(0)))),
        "soft joints on a base that moves", has="motors electric soft base", only=MOTORS,
        backends="closed form, native",
    ),
    "carried rotors": Case(
        carried, "rotors whose carriers turn: more rates, inertia of both", has="motors electric carried", only=MOTORS,
        backends="closed form, native, CasADi",
    ),
    "loads": Case(
        load_driven, "friction that grows with the load", has="loads", order=2, only=LOADED,
        backends="closed form, paper, native, CasADi, recursion of symbols",
    ),
    "fivebar": Case(
        lambda: wound(jounce.load("fivebar")), "a planar loop with motors on springs", tolerance=1e-11,
        has="loops cuts motors electric soft", backends="closed form, native, generated C",
    ),
    "half": Case(
        half_driven_fivebar, "a passive coordinate, on a spring", has="loops cuts passive", tolerance=1e-11,
        backends=f"closed form, native, CasADi, JAX, generated C, {OF_SYMBOLS}", only=CLOSED,
    ),
    "palletizer": Case(
        palletizer, "coordinates that follow by ratios", has="loops cuts", backends="closed form", tolerance=1e-11,
    ),
    **{
        name: Case(
            partial(looped, name), "a spatial loop", has="loops cuts" + " base" * ("floating" in name), order=2,
            backends="closed form", tolerance=1e-11,
        )
        for name in LOOPED
    },
    "coupled drives": Case(
        lambda: jounce.load("planar2r").with_transmission([[1, 0], [-0.5, 1]], ["a", "b"]),
        "motors that move several joints, without loops", has="loops", only=(*CLOSED, "mass_matrix", "regressor"),
        backends="closed form, native, CasADi, JAX, generated C",
    ),
    "coordinates of motors": Case(
        lambda: jounce.load("planar2r").with_transmission([[1, 0], [-0.5, 1]], ["a", "b"]).closed(),
        "the same in the places of joints", has="loops", only=("inverse_dynamics", "mass_matrix", "twists"),
        backends="closed form, native",
    ),
    "cams": Case(
        cams, "coordinates that follow by polynomials", has="loops", only=CAMS, wrench=False,
        backends=f"closed form, native, CasADi, JAX, generated C, {OF_SYMBOLS}",
    ),
    "stance": Case(
        standing, "contacts that balance the base", has="contacts base", only=("inverse_dynamics", "contact_wrenches"),
        backends=f"closed form, paper, native, CasADi, JAX, generated C, {OF_SYMBOLS}",
    ),
}  # fmt: skip

NEEDS = (  # which quantities need what of a robot, or that it is without, and words of what those that lack it say
    (lambda row: rows.ELASTIC in row.needs, "motors", "its joints are rigid"),
    (lambda row: row.name in ("motor_currents", "motor_voltages"), "electric", "of a motor: motors=jounce.Motor("),
    (lambda row: row.name == "feedback_linearization", "soft", "feedback_linearization of"),
    (lambda row: row.name == "motor_commands", "no carried", "take q6d too"),  # which only its kernel takes
    (lambda row: row.takes.motors, "no base", "moves; expected one at rest"),
    (lambda row: "partials" in row.name, "no loads", "does not hold load_friction"),
    (lambda row: row.name == "loop_wrenches", "cuts", "no loop is closed"),
    (lambda row: rows.CLOSED in row.needs, "loops", "no loop is closed"),
    (lambda row: row.name == "passive_accelerations", "passive", "is of passive coordinates, and it has none"),
    (lambda row: "second" in row.name, "no loops", "has closed loops: there are no tensors"),
    (lambda row: row.name == "joint_wrenches", "no loops", "depend on what its cut joints transmit"),
    (lambda row: rows.ON_CONTACTS in row.needs, "contacts", "it has no contacts"),
    (lambda row: rows.WITHOUT_CONTACTS in row.needs, "no contacts", "contacts"),
)


def lacks(case: Case, row: Quantity) -> str:
    """Words of the reason for which a robot has none of a quantity, or nothing."""
    for concerns, need, words in NEEDS:
        left_out, word = need.startswith("no "), need.removeprefix("no ")
        if concerns(row) and (word in case.has.split()) == left_out:
            return words
    return ""


def quantity_names(concerns: Callable[[Quantity], Any]) -> tuple[str, ...]:
    """The names of quantities."""
    return tuple(row.name for row in QUANTITIES.values() if concerns(row))


PRINTED = ("inverse_dynamics", "gravity_forces", "mass_matrix", "coriolis_matrix")  # by the paper, to order 2
ABSENT: dict[str, dict[str, tuple[str, ...]]] = {  # by backend: what it has of no robot, by words of the refusal
    "closed form": {  # tensors differentiate the recursion's steps, and all methods close loops alike
        "no method 'closed_form'": (
            "inverse_dynamics_second_partials", "forward_dynamics_second_partials", "coordinates",
        ),
    },
    "paper": {"no method 'paper'": quantity_names(lambda row: row.name not in PRINTED)},
    "symbolic": {
        "divides by expressions": quantity_names(lambda row: row.inverts),
        "expected derivatives of another": quantity_names(lambda row: row.gives.results and not row.inverts),
        "no member": quantity_names(  # which divide, or close loops by numbers
            lambda row: rows.CLOSED in row.needs or rows.ON_CONTACTS in row.needs
        ),
    },
}  # fmt: skip
ABSENT |= {f"{name} of symbols": ABSENT[name] for name in METHODS}


def serves(backend: str, name: str, body: str | None, frame: str) -> bool:
    """Whether a backend has a quantity of a body, or of all: C has one body, CasADi two axes."""
    row = QUANTITIES[name]
    if any(name in names for names in ABSENT.get(backend, {}).values()):
        return False
    if body is None and row.of_bodies:
        return backend != "generated C" and (backend != "CasADi" or len(row.gives.shape) < 3)
    return True


@dataclass(frozen=True, eq=False)
class Request:
    """A quantity of a robot to an order, with a batch of states."""

    case: Case
    asked: Computation

    @cached_property
    def arrays(self) -> list[np.ndarray]:
        """The inputs in the order of the signature."""
        rng, m, given = np.random.default_rng(0), self.case.robot.mechanism, []
        for port in self.asked.signature(m).inputs:
            x = rng.uniform(-1, 1, (STATES, *port.shape))
            if port.is_pose:
                x = np.stack([random_pose(rng) for _ in x])
            elif port.role == "dependent":
                x = self.case.robot.coordinates(given[0], method="recursion")[:, m.closure.dependent]
            elif m.closure and not given:
                x = m.closure.start[list(m.closure.independent)] + 0.05 * x
            given.append(x)
        return given

    def of_role(self, role: str) -> list[np.ndarray]:
        """The inputs of a role."""
        ports = self.asked.signature(self.case.robot.mechanism).inputs
        return [x for port, x in zip(ports, self.arrays, strict=True) if port.role == role]

    @property
    def given(self) -> tuple[list[np.ndarray], dict[str, tuple[np.ndarray, ...]]]:
        """The arrays of a call of a robot's method, and those by keyword; q are all coordinates of a closed robot."""
        q, dependent = self.of_role("state"), self.of_role("dependent")
        if dependent:
            closure = self.case.robot.mechanism.closure
            order = np.argsort([*closure.independent, *closure.dependent])
            q[0] = np.concatenate([q[0], *dependent], axis=1)[:, order]
        keywords = {"wrench": tuple(self.of_role("wrench")), "base": tuple(self.of_role("base"))}
        return q, {name: arrays for name, arrays in keywords.items() if arrays}

    def call(self, method: str, q: Sequence[Any], keywords: dict[str, Any]) -> tuple[Any, ...]:
        """The results of the robot's method for arrays of any scalar type."""
        row = QUANTITIES[self.asked.name]
        place = {"body": self.asked.body} if row.of_bodies and self.asked.body else {}
        place |= {"frame": self.asked.frame} if row.gives.frames else {}
        return tupled(getattr(self.case.robot, row.name)(*q, **keywords, **place, method=method))

    def by(self, method: str) -> tuple[np.ndarray, ...]:
        """The results for all states by a method on arrays."""
        return self.call(method, *self.given)

    @cached_property
    def expected(self) -> tuple[np.ndarray, ...]:
        """The results by the recursion."""
        return self.by("recursion")


def by_native_code(request: Request) -> tuple[Any, ...]:
    """A kernel compiled ahead; a state alone has the same digits."""
    asked, case = request.asked, request.case
    options = {"body": asked.body, "frame": asked.frame, "moving_base": case.moving}
    kernel = case.robot.compile(asked.name, asked.order, asked.wrench, **options)
    found = tupled(kernel(*request.arrays))
    for x, alone in zip(found, tupled(kernel(*(x[4] for x in request.arrays))), strict=True):
        np.testing.assert_array_equal(x[4], alone)
    return found


def traced_by_jax(request: Request) -> tuple[Any, ...]:
    """The law that JAX compiles for one state; by the closed form where that is less code."""
    method = "closed_form" if request.asked.name in LESS_CODE else "recursion"
    law = jax.jit(lambda q, keywords: request.call(method, q, keywords), compiler_options=HASTY)
    with jax.enable_x64(True):
        return tuple(np.asarray(x)[None] for x in law(*jax.tree.map(lambda x: x[0], request.given)))


def casadi_function(request: Request) -> tuple[Any, ...]:
    """A function of two states, whose results have two axes."""
    asked, case = request.asked, request.case
    options = {"body": asked.body, "frame": asked.frame, "moving_base": case.moving}
    F = case.robot.casadi_function(asked.name, asked.order, asked.wrench, **options)
    assert F.name_out() == [port.name for port in asked.signature(case.robot.mechanism).outputs]
    of_states = [tupled(F(*(x[i] for x in request.arrays))) for i in range(2)]
    shapes = [x.shape[1:] for x in request.expected]
    for x, shape in zip(of_states[0], shapes, strict=True):
        assert x.shape == ((int(np.prod(shape[:-1])), shape[-1]) if len(shape) > 2 else (*shape, 1, 1)[:2])
    rows = [[x.full().reshape(shape) for x, shape in zip(found, shapes, strict=True)] for found in of_states]
    return tuple(map(np.stack, zip(*rows, strict=True)))


def of_symbols(request: Request, method: str) -> tuple[Any, ...]:
    """A method on arrays of symbols of CasADi, of a state."""
    leaves, tree = jax.tree.flatten(jax.tree.map(lambda x: x[0], request.given))
    symbols = [casadi.SX.sym("x", x.size) for x in leaves]
    arrays = [
        np.array(casadi.vertsplit(s), dtype=object).reshape(x.shape) for s, x in zip(symbols, leaves, strict=True)
    ]
    found = request.call(method, *jax.tree.unflatten(tree, arrays))
    flat = [casadi.vertcat(*convert_element(x, "it").ravel()) for x in found]
    values = casadi.Function("f", symbols, flat).call([x.ravel() for x in leaves])
    return tuple(x.full().reshape((1, *y.shape[1:])) for x, y in zip(values, request.expected, strict=True))


def symbolic(request: Request) -> tuple[Any, ...]:
    """The members of the symbolic form, at a state."""
    S, asked, row = request.case.symbolic, request.asked, QUANTITIES[request.asked.name]
    known: dict[Any, float] = {}
    for port, x in zip(asked.signature(request.case.robot.mechanism).inputs, request.arrays, strict=True):
        known |= dict(zip(entries(getattr(S, port.name)), x[0].ravel().tolist(), strict=True))
    if row.of_bodies:
        frame = {"frame": asked.frame} if row.gives.frames else {}
        terms = getattr(S, row.name)(asked.body, order=asked.order, **frame)
        terms = terms if asked.order else [terms]
    else:
        terms = [getattr(S, name) for name in row.names(asked.order)]
    if asked.wrench:
        of_wrenches = [getattr(S, rate_name(f"{row.gives.symbol}ext", k)) for k in range(len(terms))]
        terms = [x + y for x, y in zip(terms, of_wrenches, strict=True)]
    found = [np.array([evaluated(x, known) for x in entries(term)]) for term in terms]
    return tuple(x.reshape((1, *y.shape[1:])) for x, y in zip(found, request.expected, strict=True))


def generated_c(request: Request) -> tuple[Any, ...]:
    """Functions of C, of two states."""
    require("gcc")
    code, names = request.case.library(request.asked.order)
    found = [np.empty((2, *x.shape[1:])) for x in request.expected]
    for i in range(2):
        arrays = [np.ascontiguousarray(x[i]) for x in request.arrays] + [x[i : i + 1] for x in found]
        getattr(code, f"robot_{names[request.asked]}")(*(ctypes.c_void_p(x.ctypes.data) for x in arrays))
    return tuple(found)


BACKENDS: dict[str, Callable[[Request], tuple[Any, ...]]] = {
    "closed form": lambda request: request.by("closed_form"),
    "paper": lambda request: request.by("paper"),
    "native": by_native_code,
    "JAX": traced_by_jax,
    "CasADi": casadi_function,
    "recursion of symbols": partial(of_symbols, method="recursion"),
    "closed form of symbols": partial(of_symbols, method="closed_form"),
    "paper of symbols": partial(of_symbols, method="paper"),
    "symbolic": symbolic,
    "generated C": generated_c,
}
