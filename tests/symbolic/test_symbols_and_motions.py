"""Robots whose inertias are symbols, and what is computed along motions: one line says that it takes numbers."""

from dataclasses import replace

import numpy as np
import pytest
import sympy

import jounce
from support.refusals import refusal

NUMBERS = jounce.load("planar2r").mechanism
MASSES = [jounce.inertia_matrix(m, [0.5, 0, 0], np.zeros((3, 3))) for m in sympy.symbols("m1 m2")]
ROBOT = jounce.Robot.from_screws(NUMBERS.B, NUMBERS.X, np.stack(MASSES), gravity=[0, -9.81, 0]).with_limits(
    velocity=3, effort=40, acceleration=50, lower=-3, upper=3
)
ARM = ROBOT.elastic(100, rotor=0.1).with_limits(motor_velocity=9)
T = np.linspace(0, 2, 101)
MOTION = jounce.Motion.polynomial([[0, 1, 0.1], [0.2, 0.5, 0.3]], 2.0)
LOG = replace(MOTION, torques=(T, np.ones((101, 2))))
CALLS = {
    "check": lambda: ROBOT.check(MOTION),
    "check at a rate": lambda: ROBOT.check(MOTION, rate=100),
    "check of motors": lambda: ARM.check(MOTION),
    "explain": lambda: ROBOT.explain(MOTION, rate=100),
    "slowdown": lambda: ROBOT.slowdown(MOTION),
    "retime": lambda: ROBOT.retime(MOTION),
    "report": lambda: ROBOT.report(MOTION),
    "forces_along": lambda: ROBOT.forces_along(MOTION),
    "motors_along": lambda: ARM.motors_along(MOTION),
    "identify": lambda: ROBOT.identify(LOG),
    "payload": lambda: ROBOT.payload(LOG),
    "identify_stiffness": lambda: ARM.identify_stiffness(LOG, MOTION),
    "guard": lambda: ROBOT.guard(MOTION),
    "live": lambda: ROBOT.live(1e-3),
    "audit": ROBOT.audit,
    "base_parameters": ROBOT.base_parameters,
    "excite": lambda: ROBOT.excite(period=2.0),
}


@pytest.mark.parametrize("name", CALLS)
def test_symbols_are_refused_in_one_line(name):
    refusal(CALLS[name], "symbols")


def test_the_methods_of_one_state_take_them():
    Q = ROBOT.inverse_dynamics([0.1, 0.2], [1, 1], [1, 1])
    assert {str(x) for x in Q[0].free_symbols} == {"m1", "m2"}
