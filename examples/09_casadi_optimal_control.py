"""From rest to rest with the least change of torques, found by CasADi and Ipopt: Qd is exact, and so are gradients."""

import numpy as np

import casadi
import jounce

robot = jounce.load("planar2r")
n, degree, count, seconds, largest = robot.n, 9, 25, 1.5, 40.0  # N m
begin, end = np.array([-1.5, 0.3]), np.array([0.6, 0.9])  # rad

forces = robot.casadi_function(order=1).map(count)  # Q and Qd from q to q3d, at all times
opti, s = casadi.Opti(), np.linspace(0, 1, count)
c = opti.variable(n, degree + 1)  # polynomials of time, as multiples of powers of s = t / seconds


def rate(k):
    """The k-th time derivatives of the coordinates at all times, (n, count)."""
    powers = [np.polynomial.Polynomial.basis(j).deriv(k)(s) / seconds**k for j in range(degree + 1)]
    return c @ np.array(powers)


rates = [rate(k) for k in range(4)]
Q, Qd = forces(*rates)
for k, (first, last) in enumerate(((begin, end), (0, 0), (0, 0))):
    opti.subject_to(rates[k][:, 0] == first)
    opti.subject_to(rates[k][:, -1] == last)
opti.subject_to(opti.bounded(-largest, casadi.vec(Q), largest))
opti.minimize(casadi.sumsqr(Qd) / count)
opti.set_initial(c[:, 0], begin)
opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
found = opti.solve()
print(
    f"torques up to {np.abs(found.value(Q)).max():.1f} N m, their rates up to {np.abs(found.value(Qd)).max():.1f} N m/s"
)
assert np.abs(found.value(Q)).max() <= largest + 1e-6
