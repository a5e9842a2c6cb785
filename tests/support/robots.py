"""Mechanisms and motions for the tests: golden ones, random ones, and analytic motions."""

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

import jounce
from jounce.dynamics.quantities import QUANTITIES
from jounce.model import screws
from jounce.model.drive_trains import AMOUNTS, DRIVE_TERMS, Drives
from jounce.model.elasticity import Elasticity
from jounce.model.frame import Frame
from jounce.model.mechanism import Mechanism
from jounce.spatial import lie
from jounce.spatial.series import Series
from support.units import ANY_UNITS, Units, in_units

GOLDEN = Path(__file__).parents[1] / "golden"
GOLDEN_NAMES = ("planar2r", "mixed5", "tree7", "iiwa")
RATES = ("q", "qd", "q2d", "q3d", "q4d", "q5d", "q6d")
WRENCH_RATES = ("W", "Wd", "W2d", "W3d", "W4d")


def golden(name: str) -> tuple[Mechanism, list[dict[str, Any]]]:
    """A mechanism of the golden data and its cases."""
    data = json.loads((GOLDEN / "lagrange" / f"{name}.json").read_text())
    joints = data["robot"]["joints"]
    M = [jounce.inertia_matrix(j["mass"], j["com"], j["inertia_com"]) for j in joints]
    mechanism = screws.from_screws(
        [j["B"] for j in joints],
        [j["screw"] for j in joints],
        np.stack(M),
        [j["parent"] for j in joints],
        screws.ScrewOptions(
            names=[f"body{i}" for i in range(len(joints))],
            joint_names=[j["name"] for j in joints],
            gravity=data["robot"]["gravity"],
            name=name,
        ),
    )
    return mechanism, data["cases"]


def rates_of(case: dict[str, Any]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """q and W of a golden case with all their rates."""
    return [np.array(case[k]) for k in RATES], [np.array(case[k]) for k in WRENCH_RATES]


def golden_case(name: str, i: int = 0, order: int = 2) -> tuple[jounce.Robot, list[np.ndarray], list[np.ndarray]]:
    """A robot of the golden data with q and W of a case, and the rates of both that forces of an order take."""
    mechanism, cases = golden(name)
    q, W = rates_of(cases[i])
    return jounce.Robot(mechanism), q[: order + 3], W[: order + 1]


def parts(robot: jounce.Robot) -> tuple[Any, dict[str, Any]]:
    """All that a robot is, arrays by their bits."""
    m = robot.mechanism
    arrays = m.arrays | {"limits": m.limits.table} | {f.name: f.T for f in m.frames}
    tree = (m.floats, m.parent, m.owners)
    names = (m.name, tree, m.bodies, m.joints, m.coordinates, [(f.name, f.body) for f in m.frames])
    return names, {name: (array.dtype, array.shape, array.tobytes()) for name, array in arrays.items()}


def relative_error(x: Any, reference: Any) -> float:
    """Norm-wise: the largest difference over the largest entry."""
    x, reference = np.asarray(x, dtype=float), np.asarray(reference, dtype=float)
    assert x.shape == reference.shape
    return float(np.abs(x - reference).max(initial=0) / max(np.abs(reference).max(initial=0), 1e-12))


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    Q, R = np.linalg.qr(rng.normal(size=(3, 3)))
    Q = Q * np.sign(np.diag(R))
    return Q * np.linalg.det(Q)


def random_pose(rng: np.random.Generator) -> np.ndarray:
    return lie.pose(random_rotation(rng), rng.uniform(-0.6, 0.6, (3, 1)))


def shifted(x: float, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    """A pose without a turn."""
    return lie.pose(np.eye(3), np.array([[x], [y], [z]]))


def random_screw(rng: np.random.Generator, kind: str) -> np.ndarray:
    e, x = random_rotation(rng)[0], rng.uniform(-0.3, 0.3, 3)
    e = e / np.linalg.norm(e)
    if kind == "prismatic":
        return np.array([*np.zeros(3), *e])
    pitch = rng.uniform(-0.3, 0.3) if kind == "helical" else 0.0
    return np.array([*e, *(np.cross(x, e) + pitch * e)])


def random_inertia(rng: np.random.Generator, mass: float) -> np.ndarray:
    """The inertia matrix of a random body: a distribution of mass, hence positive definite."""
    points = rng.normal(size=(6, 3)) * rng.uniform(0.02, 0.3, 3)
    c, P = points.mean(axis=0), np.cov(points.T, bias=True)
    theta = mass * (np.trace(P) * np.eye(3) - P)
    return jounce.inertia_matrix(mass, c + rng.uniform(-0.2, 0.2, 3), theta)


def random_mechanism(
    rng: np.random.Generator, parent: list[int], kinds: list[str], masses: list[float], mimic: bool = False
) -> Mechanism:
    nb = len(parent)
    G = g = None
    if mimic and nb > 1:  # the last joint follows the first
        G, g = np.eye(nb)[:, :-1].copy(), np.zeros(nb)
        G[-1, 0], g[-1] = rng.uniform(-2, 2), rng.uniform(-1, 1)
    return screws.from_screws(
        np.stack([random_pose(rng) for _ in range(nb)]),
        np.stack([random_screw(rng, kind) for kind in kinds]),
        np.stack([random_inertia(rng, mass) for mass in masses]),
        parent,
        screws.ScrewOptions(gravity=rng.normal(size=3) * 6, G=G, g=g),
    )


def random_chain(n: int, kinds: Sequence[str] = ("revolute",), seed: int = 0) -> Mechanism:
    """n bodies of 1 kg, one behind the other, on joints of these kinds in turn."""
    turns = [kinds[i % len(kinds)] for i in range(n)]
    return random_mechanism(np.random.default_rng(seed), [*range(-1, n - 1)], turns, [1.0] * n)


def with_drives(mechanism: Mechanism, rng: np.random.Generator, terms: tuple[str, ...] = DRIVE_TERMS) -> Mechanism:
    """The mechanism with random drives, of which some terms act; friction by the load at joints that none follows."""
    names = (*AMOUNTS.values(), "rest", "load_eps")
    nc = len(mechanism.joints)
    speeds = dict.fromkeys(("eps", "stribeck_velocity"), np.full(nc, 0.5))
    drives = Drives(**speeds, **{name: rng.uniform(0.1, 1, nc) for name in names})
    share = 0.3 * mechanism.lone_joints * ("load_friction" in terms)
    return replace(mechanism, drives=replace(drives, load_friction=share * drives.load_friction), acting=terms)


def rubbing(robot: jounce.Robot, friction: Any = 0.0, eps: Any = 0.05, damping: Any = 0.0) -> jounce.Robot:
    """The robot with Coulomb and viscous friction of all joints, or of each; what is not 0 acts, and nothing else."""
    nc = len(robot.mechanism.joints)
    given = {name: np.full(nc, x) for name, x in (("damping", damping), ("friction", friction)) if np.any(x)}
    drives = replace(robot.mechanism.drives, eps=np.full(nc, eps), **given)
    return jounce.Robot(replace(robot.mechanism, drives=drives)).with_drives([*given])


def floating(mechanism: Mechanism, rng: np.random.Generator, mass: float = 3.0) -> Mechanism:
    """The mechanism on a floating base instead of the ground."""
    return on_base(mechanism, screws.exact_inertia(random_inertia(rng, mass), "M") + 0.0)


def on_base(mechanism: Mechanism, M: np.ndarray, name: str = "base") -> Mechanism:
    """The mechanism on a floating base of this inertia; what stood on the ground is fixed to the base."""
    return replace(
        mechanism,
        B=np.concatenate([np.eye(4)[None], mechanism.B]),
        M=np.concatenate([M[None], mechanism.M]),
        parent=(-1, *(p + 1 for p in mechanism.parent)),
        owners=tuple(i + 1 for i in mechanism.owners),
        bodies=(name, *mechanism.bodies),
        frames=tuple(replace(frame, body=frame.body + 1) for frame in mechanism.frames),
        floats=True,
    )


def springs(n: int) -> Elasticity:
    """Springs and motors for n coordinates, some of them without friction; the second joint is rigid."""
    k = np.arange(n)
    stiffness = np.where(k == 1, np.inf, 5000.0 + 100 * k)
    motors = tuple(jounce.Motor(gear=50.0 + j, resistance=0.5, constant=0.04 + 0.01 * j) for j in range(n))
    return Elasticity(
        stiffness=stiffness, rotor=0.3 + 0.1 * k, viscous=0.2 * k, friction=0.5 * (k > 1), eps=np.full(n, 0.5),
        motors=motors,
    )  # fmt: skip


class Interpreted:
    """A robot whose quantities come from the recursion: native code of a drawn one would be compiled for one call."""

    def __init__(self, robot: jounce.Robot) -> None:
        self.robot = robot

    def __getattr__(self, name: str) -> Any:
        found = getattr(self.robot, name)
        return partial(found, method="recursion") if name in QUANTITIES else found


@st.composite
def mechanisms(
    draw: st.DrawFn, largest: int = 5, spread: bool = False, units: st.SearchStrategy[Units] = ANY_UNITS
) -> tuple[Mechanism, np.random.Generator]:
    """Trees and forests of any joints, sometimes with a mimic joint, in any units; with a generator for states."""
    nb = draw(st.integers(1, largest))
    parent = [draw(st.integers(-1, i - 1)) for i in range(nb)]
    kinds = [draw(st.sampled_from(["revolute", "prismatic", "helical"])) for _ in range(nb)]
    exponents = [draw(st.floats(-6, 4)) if spread else draw(st.floats(-0.5, 1)) for _ in range(nb)]
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    mimic = draw(st.booleans())
    m = random_mechanism(rng, parent, kinds, [10.0**e for e in exponents], mimic)
    chosen = draw(units)
    if "prismatic" in kinds:  # states of tests are some rad and some m, however small the robot is
        chosen = replace(chosen, length=1.0)
    return in_units(m, chosen), rng


def with_tool(drawn: tuple[Mechanism, np.random.Generator]) -> tuple[Interpreted, np.random.Generator, np.ndarray]:
    """A drawn mechanism as a robot, with links merged: `tool` at the pose T on its last body, `stand` on the ground."""
    mechanism, rng = drawn
    T = random_pose(rng)
    frames = (Frame("tool", mechanism.nb - 1, T), Frame("stand", -1, random_pose(rng)))
    return Interpreted(jounce.Robot(replace(mechanism, frames=frames))), rng, T


def on_its_axis(mass: float = 2.0) -> jounce.Robot:
    """A body turning about an odd axis through its COM: gravity does nothing, the mass matrix stays as it is."""
    e, x = np.array([1, 2, 3]) / np.sqrt(14), np.array([0.1, 0.2, -0.4])
    M = jounce.inertia_matrix(mass, x + 0.7 * e, mass * np.diag([0.1, 0.2, 0.25]))
    return jounce.Robot.from_screws([np.eye(4)], [[*e, *np.cross(x, e)]], [M], name="balanced")


def random_state(
    rng: np.random.Generator, mechanism: Mechanism, order: int = 2
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """q .. and W .., with as many rates as forces of the order take."""
    q = [rng.uniform(-2, 2, mechanism.n) for _ in range(order + 3)]
    return q, [rng.uniform(-3, 3, (mechanism.nb, 6)) for _ in range(order + 1)]


def loads(W: list[np.ndarray]) -> Series:
    return Series.of([w.reshape((*w.shape[:-2], 6 * w.shape[-2], 1)) for w in W])


def harmonic(rng: np.random.Generator, n: int, order: int):
    """q(t) = A cos(w t + p) as a function of t that returns q and its rates up to `order`."""
    A, w, p = rng.uniform(-1, 1, n), rng.uniform(0.5, 2, n), rng.uniform(-3, 3, n)

    def motion(t: Any) -> list[np.ndarray]:
        angle = np.multiply.outer(t, w) + p
        return [A * w**k * np.cos(angle + k * np.pi / 2) for k in range(order + 1)]

    return motion


WEIGHTS = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}  # of central differences over nine points, error O(h^8)


def differentiated(f: Any, h: float = 0.02) -> Any:
    """The derivative of f at 0."""
    return sum(w * (f(k * h) - f(-k * h)) for k, w in WEIGHTS.items()) / h


def differentiated_at_once(f: Any, h: float = 0.02) -> Any:
    """The derivative at 0 of a function of arrays of times, which it takes along the first axis, as a batch."""
    k = np.array([*WEIGHTS, *(-k for k in WEIGHTS)])
    weights = np.array([*WEIGHTS.values(), *(-w for w in WEIGHTS.values())])
    return np.tensordot(weights, f(k * h), axes=1) / h
