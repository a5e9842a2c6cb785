"""Sections 3 and 4 of the paper as printed, corrected: an independent check of the product rule in `closed_form`.

Each line carries the label of its equation in the paper's source; a label on an unnumbered row stands for its equation.
Dense system matrices: M, A, a, b and C are the sans-serif ones, ``da, d2a`` the time derivatives of a, ``M1, C1`` the
paper's M^(1), C^(1). Errata, each with a test of its own:

* (M21) is printed with M^(1)(q, qd) as its first term; it must be M^(1)(q, q2d), as the sentence after it says.
* Before (Adot), the printed rate of Ad(C_ij) holds for j = i-1 only, which is where the paper uses it.
* After (Cbar), property 2) holds for every C; skew symmetry of gM' - 2C is what needs an arrangement, that of (Cbar).
* (CSys2dot), (C21) and (C22) print 3 a a' for 2 a a' + a' a, which is the same where every joint has one screw.
* (Qext), (Qextdot), (Qextddot) write W_EE and W_ext for one and the same vector, W here.
"""

from jounce.dynamics.paper.equations import Paper

__all__ = ["Paper"]
