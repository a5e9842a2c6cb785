"""Motions of a base, and mechanisms whose base moves: floating ones, and fixed ones on ground that moves.

Shares with jounce: the series, by which `base_path` differentiates its exponentials.
"""

import numpy as np
from hypothesis import strategies as st

from jounce.dynamics.state import JointMotion
from jounce.model.mechanism import Mechanism
from jounce.spatial.lie import Ad, ad, exp
from jounce.spatial.series import Series, column_series, from_rate
from support.robots import floating, harmonic, mechanisms, random_pose, random_screw
from support.units import SI


@st.composite
def moved_mechanisms(draw: st.DrawFn, largest: int = 4) -> tuple[Mechanism, np.random.Generator]:
    """Trees and forests on a floating base or on ground that moves; with a generator for states."""
    mechanism, rng = draw(
        mechanisms(largest=largest, units=st.just(SI))
    )  # bases and their twists are some kg and some m/s
    return floating(mechanism, rng) if draw(st.booleans()) else mechanism, rng


def random_base(rng: np.random.Generator, count: int) -> tuple[np.ndarray, ...]:
    """The first `count` terms C, V, Vd, ... of a motion of the base."""
    return random_pose(rng), *rng.uniform(-2, 2, (count - 1, 6))


def motion_of(base: tuple[np.ndarray, ...]) -> JointMotion:
    return JointMotion(base[0], column_series(base[1:]))


def base_path(rng: np.random.Generator, order: int):
    """C(t) = C exp(X f(t)) exp(Y g(t)) as a function of t that returns C, V, Vd, ... up to the order of C."""
    C, X, Y = random_pose(rng), random_screw(rng, "helical"), random_screw(rng, "helical")
    angles = harmonic(rng, 2, order)

    def motion(t):
        f, g = (Series.of([a[..., k : k + 1, None] for a in angles(t)]) for k in range(2))
        back = from_rate(Ad(exp(Y, -g[0])), lambda A: -(g.dot * (ad(Y) @ A)))
        V = back @ X[:, None] * f.dot + Y[:, None] * g.dot
        return C @ exp(X, f[0]) @ exp(Y, g[0]), *(V[k][..., 0] for k in range(order))

    return motion
