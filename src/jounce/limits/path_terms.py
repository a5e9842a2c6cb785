"""Rates and forces along a path are sums of products.

The path is q(sigma), and the products are those of sigma's time derivatives.

    Q   = a s2 + b s1^2 + v s1 + g
    Qd  = a s3 + (a' + 2b) s1 s2 + b' s1^3 + v s2 + v' s1^2 + g' s1
    Q2d = a s4 + (2a' + 2b) s1 s3 + (a' + 2b) s2^2 + (a'' + 5b') s1^2 s2 + b'' s1^4
          + v s3 + 3v' s1 s2 + v'' s1^3 + g'' s1^2 + g' s2

with sk the k-th time derivative of sigma and ' for d/dsigma: a = M q' is the generalized momentum of the path, v what
damping takes, g what does not depend on speed: gravity, springs, and wrenches, which go with the path.

The factors do not depend on the time law: `sample_path` computes them once for each point, and a `Path` returns those
of a rate as `Terms`, by the product that they multiply. The time law is x(sigma) = sigma'(t)^2: with s = sqrt(x),
sigma' = s, sigma'' = x'/2, sigma''' = s x''/2, sigma'''' = x'x''/4 + x x'''/2. `products` evaluates the twelve products
at jets x, x', x'', x''', and `derivatives` their gradients and Hessians, in every step of a search for x.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce.core.scalars import Array
from jounce.dynamics.quantities import DEFAULT_QUANTITY, QUANTITIES
from jounce.engine import along, closed_path
from jounce.engine.engine import Engine
from jounce.engine.motion_states import MotionStates
from jounce.limits.joints import (
    compute_at_speed,
    compute_gravity,
    drop_base,
    effort_quantity,
    has_motors,
    joint_rates,
    motors_of_coordinates,
    scatter_columns,
)

if TYPE_CHECKING:
    from jounce.motion import Motion


JET_SIZE = 4  # x, x', x'', x''' at a point of the path: the rate Q2d takes sigma'''' and no higher one
# The powers of sigma', sigma'', sigma''', sigma'''' in each product; their order is that of the factors' axis.
PRODUCT_POWERS = (
    (0, 0, 0, 0), (1, 0, 0, 0), (2, 0, 0, 0), (0, 1, 0, 0), (3, 0, 0, 0), (1, 1, 0, 0),
    (0, 0, 1, 0), (4, 0, 0, 0), (2, 1, 0, 0), (0, 2, 0, 0), (1, 0, 1, 0), (0, 0, 0, 1),
)  # fmt: skip
ONE, S1, S1_2, S2, S1_3, S1_S2, S3, S1_4, S1_2_S2, S2_2, S1_S3, S4 = range(len(PRODUCT_POWERS))


def products(jet: np.ndarray) -> np.ndarray:
    """Evaluate the twelve products (12, N) at jets (4, N).

    Jets are x, x', x'', x'''.
    """
    # With s = sqrt(x): s1 = s, s2 = x'/2, s3 = s x''/2, s4 = x'x''/4 + x x'''/2, in the order of `PRODUCT_POWERS`.
    x, x1, x2, x3 = jet
    s = np.sqrt(x)
    return np.stack([
        np.ones_like(x), s, x, x1 / 2, x * s, s * x1 / 2,
        s * x2 / 2, x * x, x * x1 / 2, x1 * x1 / 4, x * x2 / 2, x1 * x2 / 4 + x * x3 / 2,
    ])  # fmt: skip


def derivatives(jet: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Evaluate the derivatives of the products at jets (4, N).

    Returns gradients (12, 4, N) and Hessians (12, 4, 4, N) by the jets.
    """
    x, x1, x2, x3 = jet
    s = np.sqrt(x)
    # Of each product its derivatives by x, x', ..., as far as they are not zero.
    gradient: dict[int, tuple[Any, ...]] = {
        S1: (0.5 / s,),
        S1_2: (1,),
        S2: (0, 0.5),
        S1_3: (1.5 * s,),
        S1_S2: (x1 / (4 * s), s / 2),
        S3: (x2 / (4 * s), 0, s / 2),
        S1_4: (2 * x,),
        S1_2_S2: (x1 / 2, x / 2),
        S2_2: (0, x1 / 2),
        S1_S3: (x2 / 2, 0, x / 2),
        S4: (x3 / 2, x2 / 4, x1 / 4, x / 2),
    }
    # Of each product its second derivatives that are not zero; a Hessian is symmetric, so that one of two is enough.
    curvature: dict[int, dict[tuple[int, int], Any]] = {
        S1: {(0, 0): -0.25 / (x * s)},
        S1_3: {(0, 0): 0.75 / s},
        S1_S2: {(0, 0): -x1 / (8 * x * s), (0, 1): 0.25 / s},
        S3: {(0, 0): -x2 / (8 * x * s), (0, 2): 0.25 / s},
        S1_4: {(0, 0): 2},
        S1_2_S2: {(0, 1): 0.5},
        S2_2: {(1, 1): 0.5},
        S1_S3: {(0, 2): 0.5},
        S4: {(0, 3): 0.5, (1, 2): 0.25},
    }
    # Scatter the entries, which are numbers or (N,), into full arrays.
    first, second = (
        np.zeros((len(PRODUCT_POWERS), JET_SIZE, len(x))),
        np.zeros((len(PRODUCT_POWERS), JET_SIZE, JET_SIZE, len(x))),
    )
    for k, row in gradient.items():
        for i, term in enumerate(row):
            first[k, i] = term
    for k, entries in curvature.items():
        for (i, j), term in entries.items():
            second[k, i, j] = second[k, j, i] = term
    return first, second


Terms = dict[int, np.ndarray]  # factors (N, n) by the product of sigma's rates that they multiply
# The product of each term of Q, multiplied by s1: Q qd is made of these.
TIMES_S1 = {S2: S1_S2, S1_2: S1_3, S1: S1_2, ONE: S1}


@dataclass(frozen=True, eq=False)
class Path:
    """The path of a motion at N values of sigma: q and its derivatives by sigma, and the factors of its forces.

    Each is a list of (N, n), the derivatives by sigma in their order; `gravity` is that part of `g` which is Qgrav.
    `driven` are the columns of motors, whose powers add up.
    """

    q: tuple[np.ndarray, ...]
    a: list[np.ndarray]
    b: list[np.ndarray]
    v: list[np.ndarray]
    g: list[np.ndarray]
    gravity: list[np.ndarray]
    driven: np.ndarray

    def join_points(self, other: "Path") -> "Path":
        """Return the path at the points of both."""
        # Each field is a list of (N, n): the points of `other` follow those of this path.
        names = [name for name in vars(self) if name != "driven"]
        q, a, b, v, g, gravity = (
            [np.concatenate(pair) for pair in zip(getattr(self, name), getattr(other, name), strict=True)]
            for name in names
        )
        return Path(tuple(q), a, b, v, g, gravity, self.driven)

    def rate(self, order: int) -> Terms:
        """Return the terms of q, or of a time derivative.

        `order` is 0 to 4. The terms follow from Faa di Bruno's formula for q(sigma(t)).
        """
        q = self.q
        if order == 0:
            return {ONE: q[0]}
        if order == 1:
            return {S1: q[1]}
        if order == 2:
            return {S2: q[1], S1_2: q[2]}
        if order == 3:
            return {S3: q[1], S1_S2: 3 * q[2], S1_3: q[3]}
        return {
            S4: q[1],
            S1_S3: 4 * q[2],
            S2_2: 3 * q[2],
            S1_2_S2: 6 * q[3],
            S1_4: q[4],
        }

    def force(self, order: int, without_gravity: bool = False) -> Terms:
        """Return the terms of Q, or of a time derivative.

        `order` is 0 to 2. The terms are those of Q, Qd and Q2d in the head of this module; without gravity, those of Q
        - Qgrav and its rates.
        """
        a, b, v = self.a, self.b, self.v
        g = [x - y for x, y in zip(self.g, self.gravity, strict=True)] if without_gravity else self.g
        if order == 0:
            return {S2: a[0], S1_2: b[0], S1: v[0], ONE: g[0]}
        if order == 1:
            return {
                S3: a[0],
                S1_S2: a[1] + 2 * b[0],
                S1_3: b[1],
                S2: v[0],
                S1_2: v[1],
                S1: g[1],
            }
        return {
            S4: a[0],
            S1_S3: 2 * (a[1] + b[0]),
            S2_2: a[1] + 2 * b[0],
            S1_2_S2: a[2] + 5 * b[1],
            S1_4: b[2],
            S3: v[0],
            S1_S2: 3 * v[1],
            S1_3: v[2],
            S1_2: g[2],
            S2: g[1],
        }

    def power(self) -> Terms:
        """Return the terms of the drive power, Q times qd."""
        # qd = q' s1, so that each product of Q is multiplied by s1 once more.
        return {TIMES_S1[k]: self.q[1] * term for k, term in self.force(0).items()}


def add_terms(*parts: tuple[Array, Terms]) -> Terms:
    """Return the sum of terms, each times a factor (n,)."""
    return {
        k: sum(factor * terms[k] for factor, terms in parts if k in terms)
        for k in dict.fromkeys(k for _, terms in parts for k in terms)
    }


def sample_path(robot: Engine, motion: "Motion", sigma: np.ndarray, order: int, left: bool = False) -> Path:
    """Sample the path of a motion at times sigma (N,).

    Its forces have derivatives up to an order.

    Inverse dynamics at the speeds 1, -1 and 2 along the path separates what does not depend on speed, what is linear in
    it, and what is quadratic.
    """
    with closed_path.name_errors_by_time(sigma):
        m, side = robot.mechanism, along.SIDES[not left]
        states = MotionStates.sample(robot, motion, sigma, [(DEFAULT_QUANTITY, order)], side)
        # Forces are those that limits bound; with loops they are Q, as `build_problem` refuses motors elsewhere.
        row = DEFAULT_QUANTITY if m.takes_dependent else effort_quantity(m)

        # At a uniform speed c along the path d/dt = c d/dsigma: the k-th rate of Q over c^k
        # is the k-th derivative of g + c v + c^2 b.
        def forces(speed: float) -> list[np.ndarray]:
            rates_of_Q = scatter_columns(m, compute_at_speed(robot, states, row, order, speed), row)
            return [rate / speed**k for k, rate in enumerate(rates_of_Q)]

        # Solve for the three parts from c = 1, -1 and 2: g + v + b, g - v + b and g + 2v + 4b.
        b, v, g = [], [], []
        for ahead, back, double in zip(forces(1.0), forces(-1.0), forces(2.0), strict=True):
            even, odd = (ahead + back) / 2, (ahead - back) / 2
            b.append((double - 2 * odd - even) / 3)
            v.append(odd)
            g.append(even - b[-1])
        # a = M q' is the momentum of the motion at its own speed; wrenches have none.
        momentum = QUANTITIES["generalized_momentum"]
        p = replace(states.upto(momentum, order), wrench=None).compute(robot, momentum.name)
        a = drop_base(m, p, momentum)
        # Motors at other joints than the coordinates.
        if row is not DEFAULT_QUANTITY:
            a = [x @ motors_of_coordinates(m) for x in a]
        a = scatter_columns(m, a, row)
        weight = scatter_columns(m, compute_gravity(robot, states, order), DEFAULT_QUANTITY)
        return Path(joint_rates(robot, states.rates, states.near), a, b, v, g, weight, np.flatnonzero(has_motors(m)))
