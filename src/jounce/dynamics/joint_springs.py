"""The springs of a robot: deflections from the forces that they carry, forces and energy from deflections.

Forces of links are columns (..., n, 1); deflections and forces of springs have a row per motor, (..., m, 1). Joints
with two springs have two motors, all others one.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import reduce
from operator import add

import numpy as np

from jounce.core.errors import JounceError, quote_value
from jounce.core.scalars import Array, is_numeric, reciprocal
from jounce.dynamics import deflections
from jounce.dynamics.recursion.joints import take_rows
from jounce.model import antagonists
from jounce.model.antagonists import AntagonisticSprings
from jounce.model.elasticity import Elasticity, ElasticLaw
from jounce.model.mechanism import Mechanism
from jounce.model.spring_deflection import UnreachableError
from jounce.model.springs import DampedSpring, Spring, force_along
from jounce.spatial.series import Series, join_series

Pull = tuple[Series, Series]  # the deflection of a spring, and its force


@dataclass(frozen=True)
class SpringInputs:
    """What decides the deflections of springs together with their forces, by coordinate."""

    deflections: Mapping[int, Array] = field(default_factory=dict)  # of damped springs, (..., 1, 1), where integrated
    stiffness: Mapping[int, Series] = field(default_factory=dict)  # of joints with two motors, (..., 1, 1)


NO_INPUTS = SpringInputs()


def with_stiffness(m: Mechanism, S: Series) -> SpringInputs:
    """What decides the deflections together with the forces, from the stiffness of joints with two motors."""
    return SpringInputs(stiffness={j: take_rows(S, i, i + 1) for i, j in enumerate(elasticity_of(m).pairs)})


def elasticity_of(m: Mechanism) -> Elasticity:
    """The springs and motors of a mechanism that has some: requests are refused for others."""
    assert m.elasticity is not None, m.name
    return m.elasticity


def select_motors(m: Mechanism, q: Series) -> Series:
    """Columns of coordinates with a row per motor."""
    e = elasticity_of(m)
    return q.map(lambda q: q[..., e.joints_of_motors, :]) if e.pairs else q


def deflect_springs(m: Mechanism, Q: Series, inputs: SpringInputs = NO_INPUTS) -> Pull:
    """The deflections of the springs that carry Q, and their forces, one row per motor."""
    e = elasticity_of(m)
    if not e.springs:
        return reciprocal(e.stiffness)[:, None] * Q, Q
    largest = float(np.nanmax(np.abs(Q[0]), initial=0.0)) if is_numeric(Q[0]) else 0.0
    pulls: list[Pull] = []
    for j, law in enumerate(e.springs):
        own = take_rows(Q, j, j + 1)
        if law is None:
            pulls.append((reciprocal(e.stiffness[j : j + 1])[:, None] * own, own))
        else:
            with _name_joint(m, j):
                found = _solve_springs(law, own, inputs.deflections.get(j), inputs.stiffness.get(j), largest)
            pulls += [(_name_joint_in_terms(m, j, delta), phi) for delta, phi in found]
    delta, phi = (join_series([pull[k] for pull in pulls], axis=-2) for k in (0, 1))
    return delta, phi


def _solve_springs(
    law: ElasticLaw, Q: Series, known: Array | None, stiffness: Series | None, largest: float
) -> list[Pull]:
    if isinstance(law, AntagonisticSprings):
        assert stiffness is not None, law  # requests are refused without
        both = antagonists.antagonist_series(law, Q, stiffness)
        return [(d, force_along(spring, d)) for spring, d in zip((law.first, law.second), both, strict=True)]
    if isinstance(law, Spring):
        return [(deflections.deflect_spring(law, Q, largest), Q)]
    if known is not None:
        return [(deflections.damped_deflection_rates(law.spring, law.damping, Q, known), Q)]
    if not is_numeric(Q[0]):
        raise JounceError("a spring with a damper needs NumPy arrays of floats, on which its series is checked")
    sums = deflections.expand_damped_deflection(law.spring, law.damping, Q, law.terms)
    deflections.check_series(sums, law.time_constant)
    return [(sums[-1], Q)]


def _name_joint_in_terms(m: Mechanism, j: int, delta: Series) -> Series:
    """A series whose terms, computed when they are asked for, raise errors that begin with the name of a joint."""

    def term(k: int) -> Array:
        with _name_joint(m, j):
            return delta[k]

    return Series(term)


@contextmanager
def _name_joint(m: Mechanism, j: int) -> Iterator[None]:
    """Within this context, errors begin with the name of a joint; those of one state keep its number."""
    joint = f"joint {quote_value(m.coordinates[j])}"
    try:
        yield
    except UnreachableError as error:
        raise UnreachableError(f"{joint}: {error}", error.state) from None
    except JounceError as error:
        raise JounceError(f"{joint}: {error}") from None


def spring_force(m: Mechanism, delta: Series) -> Series:
    """phi(delta) + D delta' of springs and dampers, one row per motor; zero at rigid joints, whose force is unknown."""
    e = elasticity_of(m)
    _check_ends(m, delta[0])
    linear = _linear_stiffness(e) * delta
    parts = [
        take_rows(linear, i, i + 1) if law is None else _force(law, take_rows(delta, i, i + 1))
        for i, law in enumerate(e.laws)
    ]
    return join_series(parts, axis=-2) if e.springs else linear


def _force(law: Spring | DampedSpring, delta: Series) -> Series:
    if isinstance(law, Spring):
        return force_along(law, delta)
    return force_along(law.spring, delta) + delta.dot * law.damping


def _check_ends(m: Mechanism, delta: Array) -> None:
    """Raise `JounceError` where a deflection, (..., m, 1), is beyond the ends of its spring."""
    e = elasticity_of(m)
    for i, (j, law) in enumerate(zip(e.joints_of_motors, e.laws, strict=False)):
        if law is not None:
            with _name_joint(m, j):
                (law.spring if isinstance(law, DampedSpring) else law).checked(delta[..., i, :])


def sum_on_joints(m: Mechanism, phi: Array) -> Array:
    """The forces on the links of those of springs, (..., m, 1) to (..., n, 1)."""
    e = elasticity_of(m)
    return np.eye(m.n, dtype=int)[:, e.joints_of_motors] @ phi if e.pairs else phi


def spring_energy(m: Mechanism, delta: Array) -> Array:
    """The energy of the springs, (..., 1, 1)."""
    e = elasticity_of(m)
    _check_ends(m, delta)
    linear = _linear_stiffness(e) * delta * delta * 0.5
    energies = [linear[..., i : i + 1, :] for i in range(delta.shape[-2])]
    for i, law in enumerate(e.laws):
        if law is not None:
            spring = law if isinstance(law, Spring) else law.spring
            energies[i] = spring._energy(delta[..., i : i + 1, :])
    return reduce(add, energies)


def _linear_stiffness(e: Elasticity) -> Array:
    """A column of stiffnesses, one per motor, 0 at rigid joints."""
    e = e.of_motors
    return np.where(e.is_rigid, 0, e.stiffness)[:, None]
