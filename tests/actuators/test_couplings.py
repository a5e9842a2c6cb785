"""Rotors that links carry, against Lagrange's equations that SymPy derives: torques, accelerations and energy."""

from dataclasses import dataclass

import numpy as np
import pytest
import sympy as sp

import jounce
from jounce import Motor
from support.refusals import refusal

GRAVITY = (0.0, -1.5, -9.81)
SLOW = {"method": "recursion"}  # which compiles nothing
H = 1e-30  # of the complex step, which is exact


@dataclass(frozen=True)
class Arm:
    """A chain: axes of joints, offsets of their frames, point masses and rotational inertias, and motors."""

    axes: list[list[int]]
    offsets: list[list[float]]
    masses: list[float]
    coms: list[list[float]]
    inertia: list[float]
    motors: list[Motor]
    stiffness: list[float]

    @property
    def n(self):
        return len(self.axes)

    def robot(self):
        B = np.tile(np.eye(4), (self.n, 1, 1))
        B[:, :3, 3] = self.offsets
        X = np.pad(np.array(self.axes), [(0, 0), (0, 3)])
        M = [jounce.inertia_matrix(m, c, np.diag(self.inertia)) for m, c in zip(self.masses, self.coms, strict=True)]
        return jounce.Robot.from_screws(B, X, np.stack(M), gravity=GRAVITY)

    def elastic(self, coupling):
        robot = self.robot()
        return robot.elastic(
            self.stiffness, coupling=coupling, motors=dict(zip(robot.joint_names, self.motors, strict=True))
        )

    def lagrange(self):
        """d/dt dL/dx' - dL/dx of x = (q, theta), a function of x, x', x''."""
        q, qd, theta, thetad = (sp.symbols(f"{name}:{self.n}") for name in ("q", "u", "s", "v"))
        R, w, p, v, energy = sp.eye(3), sp.zeros(3, 1), sp.zeros(3, 1), sp.zeros(3, 1), sp.Integer(0)
        links = {}
        for i in range(self.n):
            r, axis = R * sp.Matrix(self.offsets[i]), sp.Matrix(self.axes[i])
            v, p, w = v + w.cross(r), p + r, w + R * axis * qd[i]
            skew = sp.Matrix(3, 3, lambda a, b, axis=axis: sum(-sp.LeviCivita(a, b, c) * axis[c] for c in range(3)))
            R = R * (sp.eye(3) + sp.sin(q[i]) * skew + (1 - sp.cos(q[i])) * skew * skew)
            links[f"body{i + 1}"], c, own = (R, w), R * sp.Matrix(self.coms[i]), R.T * w
            speed, turn = v + w.cross(c), sp.diag(*self.inertia)
            energy += self.masses[i] * speed.dot(speed) / 2 + own.dot(turn * own) / 2
            energy += self.masses[i] * sp.Matrix(GRAVITY).dot(p + c)
        for j, (motor, K) in enumerate(zip(self.motors, self.stiffness, strict=True)):
            R, w = links.get(motor.body, (sp.eye(3), sp.zeros(3, 1)))
            spin = motor.gear * thetad[j]
            energy += motor.inertia * (spin**2 / 2 + spin * (R * sp.Matrix(motor.axis)).dot(w))
            energy -= K * (theta[j] - q[j]) ** 2 / 2
        x, xd = (*q, *theta), (*qd, *thetad)
        momenta, forces = (sp.lambdify([*x, *xd], [energy.diff(y) for y in by], cse=True) for by in (xd, x))

        def equations(x, xd, x2d):
            rate = np.imag(momenta(*(x + 1j * H * xd), *(xd + 1j * H * x2d))) / H
            return rate - np.array(forces(*x, *xd))

        return equations


PLANAR = Arm(
    axes=[[0, 0, 1], [0, 0, 1]],
    offsets=[[0, 0, 0], [0.6, 0, 0]],
    masses=[3.0, 2.0],
    coms=[[0.3, 0, 0], [0.25, 0, 0]],
    inertia=[0.01, 0.02, 0.03],
    motors=[Motor(gear=80, inertia=4e-5, body="world"), Motor(gear=-100, inertia=3e-5, body="body1")],
    stiffness=[900.0, 700.0],
)
SKEW = Arm(
    axes=[[0, 0, 1], [0, 1, 0], [1, 0, 0]],
    offsets=[[0, 0, 0], [0.05, 0.1, 0], [0.4, 0, 0.03]],
    masses=[5.0, 4.0, 2.0],
    coms=[[0.01, 0, 0.1], [0.2, 0.01, 0], [0.15, 0, 0.02]],
    inertia=[0.01, 0.02, 0.03],
    motors=[
        Motor(gear=100, inertia=2e-5, body="world"),
        Motor(gear=-80, inertia=3e-5, body="body1", axis=(0, 3, 4)),
        Motor(gear=120, inertia=1e-5, body="body2", axis=(3, 4, 0)),
    ],
    stiffness=[3000.0, 2500.0, 1500.0],
)
ARMS = {"planar 2R": PLANAR, "skew 3R": SKEW}


def wave_rates(n, order, t=0.37, speed=1.5):
    """Waves of q, and their rates."""
    return [
        0.8 * speed**k * np.sin(speed * np.asarray(t)[..., None] + k * np.pi / 2 + np.arange(n)) for k in range(order)
    ]


@pytest.fixture(scope="module", params=ARMS)
def coupled_arm(request):
    arm = ARMS[request.param]
    return request.param, arm, arm.lagrange()


def test_motor_torques_obey_lagranges_equations(coupled_arm):
    """At level n - 1 of the coupling, which is exact for chains whose rotors are carried before their joints."""
    name, arm, equations = coupled_arm
    n, exact = arm.n, arm.elastic(arm.n - 1)
    q = wave_rates(n, 3 + 2 * n)
    theta = exact.motor_positions(*q, **SLOW)
    tau = exact.motor_torques(*q, **SLOW)
    residual = equations(*(np.concatenate([a, b]) for a, b in zip(q[:3], theta[:3], strict=True)))
    size = np.abs(tau).max()
    np.testing.assert_allclose(residual[:n] / size, 0, atol=1e-12)
    np.testing.assert_allclose((residual[n:] - tau) / size, 0, atol=1e-12)
    np.testing.assert_allclose(exact.motor_torques(*q, method="closed_form"), tau, atol=1e-12 * size)
    errors = {}
    for coupling, rates in (("spong", 5), *((level, 5 + 2 * level) for level in range(n))):
        found = arm.elastic(coupling).motor_torques(*q[:rates], **SLOW)
        errors[coupling] = np.abs(found - tau).max() / size
    print(f"{name}: errors of the motor torques by coupling:", ", ".join(f"{k}: {e:.1e}" for k, e in errors.items()))
    assert errors["spong"] > 1e-4
    assert errors[0] < 1e-2 * errors["spong"]
    assert all(errors[level] < 1e-2 * errors[level - 1] for level in range(1, n))


def test_accelerations_undo_motor_torques(coupled_arm):
    _, arm, _ = coupled_arm
    exact = arm.elastic(arm.n - 1)
    q = wave_rates(arm.n, 3 + 2 * arm.n, t=np.array([0.1, 0.7]))
    theta, thetad, theta2d = exact.motor_positions(*q, **SLOW)[:3]
    tau = exact.motor_torques(*q, **SLOW)
    found = exact.elastic_forward_dynamics(q[0], q[1], theta, thetad, tau)
    np.testing.assert_allclose(found[0], q[2], atol=1e-9)
    np.testing.assert_allclose(found[1], theta2d, atol=1e-9)


def test_the_energy_of_carried_rotors_is_the_work_of_the_motors(coupled_arm):
    """Over 1 s, by Gauss-Legendre quadrature."""
    _, arm, _ = coupled_arm
    exact = arm.elastic(arm.n - 1)
    points, weights = np.polynomial.legendre.leggauss(60)
    q = wave_rates(arm.n, 3 + 2 * arm.n, t=np.concatenate([[0.0, 1.0], (points + 1) / 2]))
    theta, thetad = exact.motor_positions(*q, **SLOW)[:2]
    energy = exact.elastic_energy(q[0], q[1], theta, thetad).total
    power = (exact.motor_torques(*q, **SLOW) * thetad).sum(-1)
    np.testing.assert_allclose(energy[1] - energy[0], power[2:] @ weights / 2, rtol=1e-10)


def test_symbols_have_the_coupling():
    exact, q = PLANAR.elastic(1), wave_rates(2, 7, t=0.4)
    symbols = [np.array([sp.Float(x, 25) for x in x], dtype=object) for x in q]
    np.testing.assert_allclose(exact.motor_torques(*symbols).astype(float), exact.motor_torques(*q, **SLOW), rtol=1e-12)


def test_rates_of_coupled_torques_are_their_derivatives():
    exact, t, h = SKEW.elastic(1), 0.4, 1e-4
    found = exact.motor_torques(*wave_rates(3, 8, t), **SLOW)
    before, after = (exact.motor_torques(*wave_rates(3, 7, t + side * h), **SLOW) for side in (-1, 1))
    np.testing.assert_allclose(found[1], (after - before) / (2 * h), rtol=1e-6)


def test_loads_enter_the_reactions():
    """Forces of a wrench on a link reach the rotors that lower links carry."""
    exact = SKEW.elastic(2)
    q, W = wave_rates(3, 9), tuple(np.random.default_rng(k).normal(size=(3, 6)) for k in range(7))
    tau = exact.motor_torques(*q, wrench=W, **SLOW)
    theta, thetad = exact.motor_positions(*q, wrench=W, **SLOW)[:2]
    found = exact.elastic_forward_dynamics(q[0], q[1], theta, thetad, tau, wrench=W[0])
    np.testing.assert_allclose(found[0], q[2], atol=1e-9)


def test_a_coupling_needs_its_rates_and_carriers():
    robot = SKEW.robot()
    motors = dict(zip(robot.joint_names, SKEW.motors, strict=True))
    refusal(lambda: robot.elastic(900, rotor=0.1, coupling=0), "coupling=0 needs the body that carries each rotor")
    refusal(lambda: robot.elastic(900, coupling=1, motors=motors | {"joint2": Motor(inertia=1e-5)}), "joint2 have none")
    refusal(lambda: robot.elastic([900, np.inf, 1], coupling=0, motors=motors), "joint2 have no finite stiffness")
    refusal(lambda: robot.elastic(900, rotor=0.1, coupling=-1), "coupling is -1; expected 'spong', or the level")
    refusal(lambda: robot.elastic(900, motors={"joint1": Motor(body="link9")}), "unknown body 'link9'")
    refusal(lambda: SKEW.elastic(1).motor_torques(*wave_rates(3, 6)), "q5d is the last rate given;", "take q6d too")
    state = wave_rates(3, 2) * 2
    refusal(lambda: SKEW.elastic(1).feedback_linearization(*state, state[0]), "not available with coupling=1")
