"""The paper's planar 2R: with symbols for its parameters, and its six printed expressions.

Shares with jounce: nothing, in what is printed.
"""

import sympy

import jounce

L1, L2, m1, m2, g = PARAMETERS = sympy.symbols("L1 L2 m1 m2 g")


def symbolic_planar2r():
    """The planar 2R whose lengths, masses and gravity are symbols."""
    return jounce.load("planar2r", L1=L1, L2=L2, m1=m1, m2=m2, g=g)


def printed(L1, L2, m1, m2, g, q, qd, q2d, q3d, q4d):
    """tau, tau-dot and tau-ddot as the paper prints them."""
    from numpy import cos, sin

    (q1, q2), (v1, v2), (a1, a2), (j1, j2), (s1, s2) = q, qd, q2d, q3d, q4d
    c1, c2, c12, n1, n2, n12 = cos(q1), cos(q2), cos(q1 + q2), sin(q1), sin(q2), sin(q1 + q2)
    tau1 = (
        L1**2 * a1 * m1 + L1**2 * a1 * m2 + L2**2 * a1 * m2 + L2**2 * a2 * m2 + L2 * g * m2 * c12 + L1 * g * m1 * c1
        + L1 * g * m2 * c1 - L1 * L2 * v2**2 * m2 * n2 + 2 * L1 * L2 * a1 * m2 * c2 + L1 * L2 * a2 * m2 * c2
        - 2 * L1 * L2 * v1 * v2 * m2 * n2
    )  # fmt: skip
    tau2 = L2 * m2 * (L1 * n2 * v1**2 + L2 * a1 + L2 * a2 + g * c12 + L1 * a1 * c2)
    tau1d = (
        L1**2 * j1 * m1 + L1**2 * j1 * m2 + L2**2 * j1 * m2 + L2**2 * j2 * m2 - L2 * v1 * g * m2 * n12
        - L2 * v2 * g * m2 * n12 + 2 * L1 * L2 * j1 * m2 * c2 + L1 * L2 * j2 * m2 * c2 - L1 * v1 * g * m1 * n1
        - L1 * v1 * g * m2 * n1 - L1 * L2 * v2**3 * m2 * c2 - 4 * L1 * L2 * a1 * v2 * m2 * n2
        - 2 * L1 * L2 * a2 * v1 * m2 * n2 - 3 * L1 * L2 * a2 * v2 * m2 * n2 - 2 * L1 * L2 * v1 * v2**2 * m2 * c2
    )  # fmt: skip
    tau2d = L2 * m2 * (
        L2 * j1 + L2 * j2 - v1 * g * n12 - v2 * g * n12 + L1 * j1 * c2 + 2 * L1 * a1 * v1 * n2 - L1 * a1 * v2 * n2
        + L1 * v1**2 * v2 * c2
    )  # fmt: skip
    tau1dd = (
        L1**2 * s1 * m1 + L1**2 * s1 * m2 + L2**2 * s1 * m2 + L2**2 * s2 * m2 - 3 * L1 * L2 * a2**2 * m2 * n2
        + L1 * L2 * v2**4 * m2 * n2 - L1 * v1**2 * g * m1 * c1 - L1 * v1**2 * g * m2 * c1 - L2 * a1 * g * m2 * n12
        - L2 * a2 * g * m2 * n12 + 2 * L1 * L2 * s1 * m2 * c2 + L1 * L2 * s2 * m2 * c2 - L1 * a1 * g * m1 * n1
        - L1 * a1 * g * m2 * n1 - L2 * v1**2 * g * m2 * c12 - L2 * v2**2 * g * m2 * c12
        - 6 * L1 * L2 * a1 * a2 * m2 * n2 - 6 * L1 * L2 * j1 * v2 * m2 * n2 - 2 * L1 * L2 * j2 * v1 * m2 * n2
        - 4 * L1 * L2 * j2 * v2 * m2 * n2 - 6 * L1 * L2 * a1 * v2**2 * m2 * c2 - 6 * L1 * L2 * a2 * v2**2 * m2 * c2
        + 2 * L1 * L2 * v1 * v2**3 * m2 * n2 - 2 * L2 * v1 * v2 * g * m2 * c12 - 6 * L1 * L2 * a2 * v1 * v2 * m2 * c2
    )  # fmt: skip
    tau2dd = -L2 * m2 * (
        v1**2 * g * c12 - L2 * s2 - L2 * s1 + v2**2 * g * c12 - 2 * L1 * a1**2 * n2 + a1 * g * n12 + a2 * g * n12
        - L1 * s1 * c2 + L1 * v1**2 * v2**2 * n2 + 2 * v1 * v2 * g * c12 + L1 * a1 * a2 * n2 - 2 * L1 * j1 * v1 * n2
        + 2 * L1 * j1 * v2 * n2 + L1 * a1 * v2**2 * c2 - L1 * a2 * v1**2 * c2 - 4 * L1 * a1 * v1 * v2 * c2
    )  # fmt: skip
    return [tau1, tau2], [tau1d, tau2d], [tau1dd, tau2dd]
