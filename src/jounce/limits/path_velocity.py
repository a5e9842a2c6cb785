"""The time derivatives of sigma along a path in terms of x(sigma) = sigma'(t)^2, and the products that forces take.

With ' for d/dsigma and s = sqrt(x): sigma' = s, sigma'' = x'/2, sigma''' = s x''/2, sigma'''' = x'x''/4 + x x'''/2.
Every rate of q, Q, Qd and Q2d along a path is a sum of the twelve products below, with factors that only depend on
the path.
"""

from typing import Any

import numpy as np

JET_SIZE = 4  # x, x', x'', x''' at a point of the path: the rate Q2d takes sigma'''' and no higher one
# The powers of sigma', sigma'', sigma''', sigma'''' in each product; their order is that of the factors' axis.
PRODUCT_POWERS = (
    (0, 0, 0, 0), (1, 0, 0, 0), (2, 0, 0, 0), (0, 1, 0, 0), (3, 0, 0, 0), (1, 1, 0, 0),
    (0, 0, 1, 0), (4, 0, 0, 0), (2, 1, 0, 0), (0, 2, 0, 0), (1, 0, 1, 0), (0, 0, 0, 1),
)  # fmt: skip
ONE, S1, S1_2, S2, S1_3, S1_S2, S3, S1_4, S1_2_S2, S2_2, S1_S3, S4 = range(len(PRODUCT_POWERS))


def products(jet: np.ndarray) -> np.ndarray:
    """The twelve products (12, N) at jets x, x', x'', x''' (4, N)."""
    x, x1, x2, x3 = jet
    s = np.sqrt(x)
    return np.stack([
        np.ones_like(x), s, x, x1 / 2, x * s, s * x1 / 2,
        s * x2 / 2, x * x, x * x1 / 2, x1 * x1 / 4, x * x2 / 2, x1 * x2 / 4 + x * x3 / 2,
    ])  # fmt: skip


def derivatives(jet: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradients (12, 4, N) and Hessians (12, 4, 4, N) of the products with respect to the jets (4, N)."""
    x, x1, x2, x3 = jet
    s = np.sqrt(x)
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
