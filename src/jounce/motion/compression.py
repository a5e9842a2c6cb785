"""Samples of a long log, compressed to ten rows per cell: the nodes and weights of Gauss' quadrature over them.

Sums over the samples of polynomials up to degree 19 are the same over these rows (Golub & Welsch, Mathematics of
Computation 23, 1969), hence normal equations too; the right sides are those of the polynomial that fits best.
"""

import numpy as np

from jounce.motion.bsplines import BASIS_WIDTH, POINTS_AT_ONCE


def compress_cells(
    t: np.ndarray, y: np.ndarray, weight: np.ndarray, starts: np.ndarray, edges: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times, right sides and weights of ten rows per cell, and the squares (n,) that no polynomial in a cell reaches.

    Cells (C,) have alike many samples, or one less; `starts` (C + 1,) are their first samples, `edges` their ends.
    """
    size, cells = int(np.diff(starts).max()), len(starts) - 1
    some = max(1, POINTS_AT_ONCE // size)
    parts = [
        _reduce_cells(t, y, weight, starts[k : k + some + 1], edges[k : k + some + 1], size)
        for k in range(0, cells, some)
    ]
    times, right, weights = (np.concatenate(column) for column in list(zip(*parts, strict=True))[:3])
    return times, right, weights, np.sum([part[3] for part in parts], axis=0)


def _reduce_cells(
    t: np.ndarray, y: np.ndarray, weight: np.ndarray, starts: np.ndarray, edges: np.ndarray, size: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times, right sides and weights of the ten rows of each of some cells, and the squares (n,) that they leave."""
    # samples by cell; a cell of one sample less has the first one of the next with the weight 0
    of_cell = starts[:-1, None] + np.arange(size)
    squares = np.where(of_cell < starts[1:, None], weight[of_cell.clip(max=len(t) - 1)], 0) ** 2
    of_cell = of_cell.clip(max=len(t) - 1)
    x, of_samples = (t[of_cell] - edges[:-1, None]) / np.diff(edges)[:, None] * 2 - 1, y[of_cell]
    # the best polynomial of degree 9 of each cell, and what it leaves
    polynomials, nodes, vectors = _gauss_nodes(x, squares)
    right = (polynomials * squares[:, None]) @ of_samples
    rest = of_samples - polynomials.mT @ right
    # its values at the nodes, whose weights are sqrt(sum of squares) times the first entries of eigenvectors
    total = np.sqrt(squares.sum(axis=1))[:, None]
    times = edges[:-1, None] + np.diff(edges)[:, None] * (nodes + 1) / 2
    values, weights = (vectors.mT @ right).reshape(times.size, -1), (total * vectors[:, 0]).ravel()
    return times.ravel(), values, weights, np.einsum("cs,csj->j", squares, rest**2)


def _gauss_nodes(x: np.ndarray, squares: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Polynomials (C, 10, S) orthonormal over points x (C, S) of squared weights, the zeros (C, 10) of the eleventh,
    and eigenvectors (C, 10, 10) of the Jacobi matrices, whose j-th columns are sqrt(weight_j) p_k(zero_j).

    Stieltjes' procedure: each polynomial is x times the one before, made orthogonal to all of them.
    """
    polynomials = np.empty((len(x), BASIS_WIDTH, x.shape[1]))
    jacobi = np.zeros((len(x), BASIS_WIDTH, BASIS_WIDTH))
    p, shares = np.ones(x.shape), np.zeros((len(x), 0, 1))
    for k in range(BASIS_WIDTH):
        p = p - (shares.mT @ polynomials[:, :k])[:, 0]
        polynomials[:, k] = p = p / np.sqrt((squares * p**2).sum(axis=1))[:, None]
        p = x * p
        shares = polynomials[:, : k + 1] @ (squares * p)[:, :, None]  # the last two would do, but for rounding
        jacobi[:, k, k] = shares[:, k, 0]
        if k:
            jacobi[:, k, k - 1] = jacobi[:, k - 1, k] = shares[:, k - 1, 0]
    nodes, vectors = np.linalg.eigh(jacobi)
    return polynomials, nodes, vectors * np.sign(vectors[:, :1])
