"""Parts of a mechanism's data as symbols: with the mechanism's own values they change nothing, with others as much."""

from pathlib import Path

import numpy as np
import pytest

import jounce
from jounce.model import body_parameters
from jounce.program.program import Tape
from jounce.spatial import inertia
from jounce.spatial.lie import pose
from support.refusals import refusal
from support.robots import golden, relative_error

PANDA = Path(__file__).parents[2] / "examples" / "panda.urdf"
ROBOTS = {
    "iiwa14": lambda: jounce.load("iiwa14").mechanism,
    "planar2r": lambda: jounce.load("planar2r", L1=1.1, L2=0.7, m1=2.0, m2=1.5).mechanism,
    "mixed5": lambda: golden("mixed5")[0],
    "tree7": lambda: golden("tree7")[0],
}


def placed(mechanism, names):
    """The names, a payload on the last body: of several ends it takes a name."""
    return [f"payload:{mechanism.bodies[-1]}" if name == "payload" else name for name in names]


def parametrised_forces(mechanism, names, values, state):
    """Q, Qd, Q2d with the parameters written on a tape as inputs beside the state, run on values."""
    tape = Tape()
    symbolic, symbols = body_parameters.parametrise(mechanism, names, lambda name, shape: tape.variables(*shape))
    assert {name: array.shape for name, array in symbols.items()} == {k: np.shape(v) for k, v in values.items()}
    Q = jounce.Robot(symbolic).inverse_dynamics(*(tape.variables(mechanism.n) for _ in state))
    inputs = np.concatenate([np.ravel(x) for x in (*values.values(), *state)])
    return np.reshape(tape.program(np.ravel(Q)).run(inputs), (3, -1))


@pytest.mark.parametrize(
    "names",
    [[name] for name in body_parameters.MODEL_PARAMETERS] + [list(body_parameters.MODEL_PARAMETERS)],
    ids="-".join,
)
@pytest.mark.parametrize("name", ROBOTS)
def test_own_values_change_nothing(name, names):
    mechanism = ROBOTS[name]()
    state, names = np.random.default_rng(0).uniform(-2, 2, (5, mechanism.n)), placed(mechanism, names)
    found = parametrised_forces(mechanism, names, body_parameters.own_values(mechanism, names), state)
    assert relative_error(found, jounce.Robot(mechanism).inverse_dynamics(*state)) < 1e-13


@pytest.mark.parametrize("name", ROBOTS)
def test_other_values_are_those_of_another_robot(name):
    m, rng = ROBOTS[name](), np.random.default_rng(1)
    state = rng.uniform(-2, 2, (5, m.n))
    gravity, masses, lengths = rng.uniform(-9, 9, 3), rng.uniform(1, 2, m.nb), rng.uniform(-1, 1, (m.nb, 3))
    com, six = rng.uniform(-1, 1, 3), np.array([0.3, 0.01, -0.02, 0.2, 0.03, 0.25])
    values = {"gravity": gravity, "masses": masses, "lengths": lengths}
    values |= {"payload_mass": [2.5], "payload_com": com, "payload_inertia": six}
    scaled = m.M * (masses / m.M[:, 3, 3])[:, None, None]
    scaled[-1] += jounce.inertia_matrix(2.5, com, inertia.symmetric_matrix(six))
    B = np.stack([pose(b[:3, :3], x[:, None]) for b, x in zip(m.B, lengths, strict=True)])
    other = jounce.Robot.from_screws(B, m.X, scaled, m.parent, gravity=gravity)
    found = parametrised_forces(m, placed(m, body_parameters.MODEL_PARAMETERS), values, state)
    assert relative_error(found, other.inverse_dynamics(*state)) < 1e-12


def test_payloads_hang_on_bodies_and_merged_links_in_their_own_frames():
    rng = np.random.default_rng(2)
    mechanism = jounce.load(PANDA).mechanism
    hand, link3 = (next(f for f in mechanism.frames if f.name == "panda_hand_tcp"), mechanism.frame("panda_link3"))
    state = rng.uniform(-1, 1, (5, mechanism.n))
    M = mechanism.M.copy()
    M[hand.body] += inertia.shift_inertia(jounce.inertia_matrix(1.5, [0, 0, 0.1], 0.02 * np.eye(3)), hand.T)
    M[link3.body] += jounce.inertia_matrix(0.5, [0.1, 0, 0], np.zeros((3, 3)))
    m = mechanism
    other = jounce.Robot.from_screws(m.B, m.X, M, m.parent, gravity=m.gravity, G=m.G, g=m.g)
    values = {
        "payload_mass": [1.5],
        "payload_com": [0, 0, 0.1],
        "payload_inertia": 0.02 * np.eye(3)[np.triu_indices(3)],
        "payload2_mass": [0.5],
        "payload2_com": [0.1, 0, 0],
        "payload2_inertia": np.zeros(6),
    }
    found = parametrised_forces(m, ["payload:panda_hand_tcp", "payload:panda_link3"], values, state)
    assert relative_error(found, other.inverse_dynamics(*state)) < 1e-13


def test_a_payload_without_a_name_hangs_on_the_only_end():
    m = jounce.load("iiwa14").mechanism
    state = np.random.default_rng(5).uniform(-2, 2, (5, 7))
    values = {"payload_mass": [1.5], "payload_com": [0, 0, 0.1], "payload_inertia": np.zeros(6)}
    assert (
        parametrised_forces(m, ["payload"], values, state).tolist()
        == parametrised_forces(m, ["payload:link7"], values, state).tolist()
    )


def test_a_massless_body_gets_its_mass_at_its_origin():
    m = jounce.load("planar2r", m1=0.0).mechanism
    state = np.random.default_rng(3).uniform(-2, 2, (5, 2))
    M = np.stack([np.diag([0, 0, 0, 3.0, 3, 3]), m.M[1]])
    other = jounce.Robot.from_screws(m.B, m.X, M, gravity=m.gravity)
    found = parametrised_forces(m, ["masses"], {"masses": [3.0, 1.0]}, state)
    assert relative_error(found, other.inverse_dynamics(*state)) < 1e-13


@pytest.mark.parametrize(("names", "message"), [
    (["mass"], "^unknown parameter 'mass'; did you mean 'masses'? available: gravity, …payload:BODY$"),
    (["masses:link1"], "^unknown parameter 'masses:link1'"),
    (["payload:panda_hnd"], "^unknown body 'panda_hnd'; did you mean 'panda_hand'?"),
    (["payload"], "^payload: panda ends in panda_leftfinger, panda_rightfinger; expected payload:BODY, on one of "),
    (["payload:panda_link0"], "^a payload on 'panda_link0' has no effect: it is fixed to the ground$"),
    (["gravity", "gravity"], r"expected a list of different names of gravity, "),
    ("gravity", "^parameters are 'gravity'; expected a list of different names"),
])  # fmt: skip
def test_refusals(names, message):
    refusal(lambda: body_parameters.own_values(jounce.load(PANDA).mechanism, names), message)
