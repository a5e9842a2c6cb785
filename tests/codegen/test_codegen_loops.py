"""Generated code of closed robots: dependent coordinates are an input, and test vectors have closed loops."""

from dataclasses import replace

import numpy as np
import pytest
import sympy
from test_codegen import PROGRAMS, passes

import jounce
from jounce._codegen.test_vectors import states_near_start
from jounce.dynamics.loop_assembly import gaps
from support.refusals import expect_refusal
from support.robots import relative_error
from support.tools import needs

OUTPUTS = ("inverse_dynamics", "mass_matrix", "coordinates", "loop_wrenches")
TITLE = "Dependent coordinates, the 2 entries of q_dependent:"


@pytest.mark.parametrize(
    ("lang", "asked"),
    [
        pytest.param("c", {"order": 1, "outputs": OUTPUTS}, marks=needs("make", "gcc")),
        pytest.param("python", {"order": 0, "parameters": ["gravity", "payload:right_tip"]}, marks=needs("make")),
    ],
)
def test_generated_code_passes_its_own_tests(bundled_fivebar, lang, asked, tmp_path):
    bundled_fivebar.codegen(lang, directory=tmp_path / lang, **asked)
    passed, output = passes(tmp_path / lang, lang)
    assert passed, output


@needs("make")
def test_code_of_a_closed_robot_has_its_motors(bundled_fivebar, tmp_path):
    arm = bundled_fivebar.elastic(
        {"left_shoulder": 90.0}, spring={"right_shoulder": jounce.CubicSpring(70.0, 5.0)}, rotor=0.01
    )
    arm.codegen("python", 0, tmp_path, outputs=["motor_torques", "motor_positions"])
    passed, output = passes(tmp_path, "python")
    assert passed, output


@needs("make")
def test_code_of_coupled_drives_takes_joints_alone(tmp_path):
    arm = jounce.load("planar2r").with_transmission([[1, 0], [-0.5, 1]], ["a", "b"])
    arm.codegen("python", 1, tmp_path, outputs=["actuator_forces", "coordinates"])
    assert not [text for text in file_texts(tmp_path) if "q_dependent" in text]
    passed, output = passes(tmp_path, "python")
    assert passed, output


@pytest.mark.parametrize("lang", [pytest.param("c", marks=needs("make", "gcc"))])
def test_code_of_a_robot_on_the_ground_moves_its_springs(lang, tmp_path):
    """A floating double pendulum with a pivot on the ground: its base follows, and its second joint is on a spring."""
    rods = [jounce.inertia_matrix(1.0, (0.1 * k, 0, 0), np.diag([0.01, 0.02, 0.02])) for k in (1, 2)]
    B, turn = [np.eye(4), np.eye(4)], [0, 0, 1, 0, 0, 0]
    B[1][0, 3] = 0.3
    arm = jounce.Robot.from_screws(
        B, [turn] * 2, rods, [-1, 0], ["upper", "lower"], drives={"stiffness": [5.0, 5.0]}, base=rods[0]
    ).with_drives("spring")
    robot = arm.closed([("base", "ground", "fixed")], ["joint1"], passive=["joint2"])
    robot.codegen(lang, 1, tmp_path / lang, outputs=["passive_accelerations", "actuator_forces", "loop_wrenches"])
    passed, output = passes(tmp_path / lang, lang)
    assert passed, output


@pytest.mark.parametrize("lang", PROGRAMS)
def test_every_language_explains_the_dependent_coordinates(bundled_fivebar, lang, tmp_path):
    bundled_fivebar.codegen(lang, 0, tmp_path / lang)
    [explained] = [text for text in file_texts(tmp_path / lang) if TITLE in text][:1]
    assert "left_elbow, rad" in explained
    assert "left_tip and right_tip (spherical). Motors: left_shoulder, right_shoulder." in explained
    assert "q_dependent" in explained


def file_texts(folder):
    return [path.read_text(encoding="utf-8") for path in sorted(folder.iterdir()) if path.is_file()]


def test_vectors_have_closed_loops(bundled_fivebar):
    m = bundled_fivebar.mechanism
    u, d = states_near_start(m, np.random.default_rng(0).uniform(-5, 5, (4, 2)))  # as far as ways that are shortened
    q = np.empty((4, 4))
    q[:, list(m.closure.independent)], q[:, list(m.closure.dependent)] = u, d
    assert np.abs(gaps(m, q)[0]).max() < 1e-13
    assert np.ptp(u, axis=0).min() > 0.1


def test_casadi_function_takes_the_dependent_coordinates(bundled_fivebar):
    casadi = pytest.importorskip("casadi")
    F = bundled_fivebar.casadi_function(order=0, parameters=["gravity"])
    assert F.name_in() == ["q", "qd", "q2d", "q_dependent", "gravity"]
    q = bundled_fivebar.coordinates([2.2, 0.9])
    u, d, qd, q2d = q[[0, 2]], q[[1, 3]], [1.0, 0.5], [0.2, 0.3]
    Q = F(q=u, qd=qd, q2d=q2d, q_dependent=d, gravity=bundled_fivebar.gravity)["Q"]
    assert relative_error(np.array(casadi.DM(Q))[:, 0], bundled_fivebar.inverse_dynamics(q, qd, q2d)) < 1e-13


def test_symbols_are_refused_where_loops_need_numbers(bundled_fivebar, tmp_path):
    tree, loops = jounce.Robot(bundled_fivebar.mechanism.tree), [("left_tip", "right_tip")]
    motors, start = ["left_shoulder", "right_shoulder"], bundled_fivebar.mechanism.closure.start
    m, L = tree.mechanism, sympy.Symbol("L")
    B, M = m.B.astype(object), m.M.astype(object)
    B[1, 0, 3], M[0] = L, M[0] * L
    with expect_refusal("symbols in its joints or frames; expected numbers"):
        jounce.Robot(replace(m, B=B)).closed(loops, motors, start=start)
    heavy = jounce.Robot(replace(m, M=M)).closed(loops, motors, start=start)
    assert heavy.gravity_forces(start)[0].free_symbols == {L}
    assert heavy.symbolic().Qgrav[0].free_symbols >= {L}
    with expect_refusal("has closed loops, and its equations are no sums of products"):
        bundled_fivebar.codegen("latex", directory=tmp_path / "latex")
