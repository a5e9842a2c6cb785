"""What is computed: inputs, the convention of results, and a judge.

Each library's module has a class `Library`, made of an `Arm`, with a method of each task's name that it serves. The
method takes the inputs (q, qd, ...), arrays (n,) of one state or (states, n), and returns a `Call`: a function to be
timed, and one that returns the results in the convention below.

Forces Q: (states, n), M: (states, n, n), J: (states, 6, n) of the link `Arm.tip`, (angular; linear), of its origin in
the axes of the world. Derivatives of Q: by q and qd, row i column k the derivative of Q_i by q_k; of accelerations: by
q, qd and Q. Second derivatives of Q: the tensors (states, n, n, n) by (q, q), by (q, qd), by (qd, qd) and by (q2d, q),
that of index i, k, l of Q_i by the variable k of the first and l of the second.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import jounce

COMPARED = 16  # states of a batch whose results are compared


@dataclass(frozen=True)
class Task:
    """A quantity: its title, the inputs that it takes, and what jounce's slow closed form or recursion gives."""

    name: str
    title: str
    inputs: int  # so many of q, qd, q2d (or Q of forward dynamics), q3d, q4d
    reference: Callable[["jounce.Robot", str, Sequence[np.ndarray]], tuple[np.ndarray, ...]]


@dataclass(frozen=True)
class Call:
    """A call: what is timed, and how its results are read afterwards."""

    run: Callable[[], Any]
    results: Callable[[], Sequence[np.ndarray]]


def _first_two(x: np.ndarray) -> tuple[np.ndarray, ...]:
    return x[..., 0, :, :], x[..., 1, :, :]


def _tuple(x: Any) -> tuple[np.ndarray, ...]:
    return tuple(x) if isinstance(x, tuple) else (x,)


TASKS = {
    task.name: task
    for task in (
        Task("forces", "Q", 3, lambda r, tip, x: _tuple(r.inverse_dynamics(*x, method="recursion"))),
        Task("force_rates", "Q, Qd, Q2d", 5, lambda r, tip, x: _tuple(r.inverse_dynamics(*x, method="recursion"))),
        Task("mass_matrix", "M", 1, lambda r, tip, x: _tuple(r.mass_matrix(*x, method="recursion"))),
        Task("mass_matrix_rates", "M, Md, M2d", 3, lambda r, tip, x: _tuple(r.mass_matrix(*x, method="recursion"))),
        Task(
            "jacobian", "J", 1, lambda r, tip, x: _tuple(r.jacobian(*x, body=tip, frame="world", method="recursion"))
        ),
        Task(
            "jacobian_rate", "J, Jd", 2,
            lambda r, tip, x: _tuple(r.jacobian(*x, body=tip, frame="world", method="recursion")),
        ),
        Task(
            "accelerations", "q2d, forward dynamics", 3,
            lambda r, tip, x: _tuple(r.forward_dynamics(*x, method="recursion")),
        ),
        Task(
            "force_derivatives", "dQ/dq, dQ/dqd", 3,
            lambda r, tip, x: _first_two(r.inverse_dynamics_partials(*x, method="recursion")),
        ),
        Task(
            "acceleration_derivatives", "dq2d/dq, dq2d/dqd, dq2d/dQ", 3,
            lambda r, tip, x: _tuple(r.forward_dynamics_partials(*x, method="recursion")),
        ),
        Task(
            "second_derivatives", "second derivatives of Q", 3,
            lambda r, tip, x: _tuple(r.inverse_dynamics_second_partials(*x, method="recursion")),
        ),
    )
}  # fmt: skip


def error(found: Sequence[np.ndarray], expected: Sequence[np.ndarray]) -> float:
    """Return the largest difference over the largest entry, of the results of a task."""
    worst = 0.0
    for x, y in zip(found, expected, strict=True):
        array = np.asarray(x, float)
        if array.shape != y.shape or not np.isfinite(array).all():
            return np.inf
        worst = max(worst, float(np.abs(array - y).max() / np.abs(y).max()))
    return worst
