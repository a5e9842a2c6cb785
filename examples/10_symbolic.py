"""The equations of motion themselves, as SymPy expressions, with symbols for lengths and masses."""

import sympy

import jounce

L1, L2, m1, m2, g = sympy.symbols("L1 L2 m1 m2 g", positive=True)
robot = jounce.load("planar2r", L1=L1, L2=L2, m1=m1, m2=m2, g=g)
S = robot.symbolic()
sympy.pprint(S.M)  # the mass matrix
print(sympy.latex(S.Q[1]))  # a force
print(S.Qd[1])  # and its time derivative

assert sympy.expand(S.dot(S.Q[1]) - S.Qd[1]) == 0
J = S.jacobian("body2", frame="world", order=0)
numbers = {L1: 1, L2: 0.5, S.q[0]: 0.3, S.q[1]: -0.4}
print(sympy.N(J[0] if isinstance(J, tuple) else J, 4).subs(numbers))
