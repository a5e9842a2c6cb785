"""Random states of robots and inputs of computations, and waves with all their rates."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jounce.dynamics.computation import Port
from support.robots import random_pose


def random_rates(n: int, count: int, *batch: int, seed: int = 0, size: float = 2.0) -> list[np.ndarray]:
    """q, qd, ... (*batch, n), `count` of them, whose numbers are at most `size`."""
    return list(np.random.default_rng(seed).uniform(-size, size, (count, *batch, n)))


def random_inputs(ports: Sequence[Port], *batch: int, seed: Any = 0, size: float = 2.0) -> list[np.ndarray]:
    """An array for each input of a computation: poses of the base are poses; by a seed or a generator."""
    rng, arrays = np.random.default_rng(seed), []
    for port in ports:
        if port.is_pose:
            poses = [random_pose(rng) for _ in range(int(np.prod(batch)))]
            arrays.append(np.reshape(poses, (*batch, 4, 4)))
        else:
            arrays.append(rng.uniform(-size, size, (*batch, *port.shape)))
    return arrays


def sine_rates(t: Any, order: int, size: Any = 1.0, speed: Any = 1.0, phase: Any = 0.0) -> list[np.ndarray]:
    """size sin(speed t + phase) and its rates up to an order, a column for each entry of what are no numbers."""
    size, speed, phase = np.broadcast_arrays(size, speed, phase)
    angle = np.multiply.outer(np.asarray(t, dtype=float), speed) + phase
    return [size * speed**k * np.sin(angle + k * np.pi / 2) for k in range(order + 1)]
