"""Springs of a robot give deflections from forces, and forces from deflections.

Forces of links are columns (..., n, 1); deflections and forces of springs have a row per motor, (..., m, 1). Joints
with two springs have two motors, all others one. `deflect_springs` is the door from forces, `spring_force` and
`spring_energy` are those from deflections; their errors begin with the name of the joint.

Problem: the deflection delta of a spring that carries Q, and its rates: phi(delta) = Q, or with a damper D parallel to
the spring, ``phi(delta) + D delta' = Q``.

Algorithm: without a damper, delta by `spring_deflection.spring_deflection` and ``delta' = Q' / phi'(delta)`` for its
rates. With one, the deflection is a state with the time constant D / phi'. Where it is not integrated, at one instant,
it is an asymptotic series: fixed-point iterations ``delta = phi^-1(Q - D delta')``, each of which takes one more rate
of Q. Of a linear spring the terms are ``(-D / K)^k Q^(k) / K``. The first of them fall if the motion is slow compared
with the time constant. Joints with two springs take their stiffness as well (`spring_deflection.antagonist_series`).

How often what runs: `deflect_springs` once per evaluation of a law of motors; the solution of one spring once per joint
and evaluation, whose rates are computed when they are asked for.

Failure: `UnreachableError` beyond the ends of a spring, and for rates where a spring has no stiffness; `JounceError`
where the last term of a series is no smaller than those before it.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import reduce, singledispatch
from itertools import pairwise
from operator import add

import numpy as np

from jounce.core.errors import JounceError, quote_value
from jounce.core.scalars import Array, is_numeric, reciprocal
from jounce.dynamics.recursion.joints import take_rows
from jounce.model.elasticity import Elasticity, ElasticLaw
from jounce.model.mechanism import Mechanism
from jounce.model.series_functions import inverse
from jounce.model.spring_deflection import AntagonisticSprings, UnreachableError, antagonist_series, spring_deflection
from jounce.model.springs import CubicSpring, DampedSpring, Spring, force_along
from jounce.spatial.series import Series, from_rate, join_series

Pull = tuple[Series, Series]  # the deflection of a spring, and its force
FORCE_ROUNDING = 1e-8  # of the largest force: smaller ones have lost half their digits, all that rates near zero need
NEGLIGIBLE_TERM = 1e-13  # of a deflection: smaller terms of its series are rounding, and need not fall


@dataclass(frozen=True)
class SpringInputs:
    """What decides the deflections of springs together with their forces, by coordinate."""

    deflections: Mapping[int, Array] = field(default_factory=dict)  # of damped springs, (..., 1, 1), where integrated
    stiffness: Mapping[int, Series] = field(default_factory=dict)  # of joints with two motors, (..., 1, 1)


NO_INPUTS = SpringInputs()


def with_stiffness(m: Mechanism, S: Series) -> SpringInputs:
    """Return inputs with the stiffness of joints with two motors.

    S is (..., k, 1).
    """
    return SpringInputs(stiffness={j: take_rows(S, i, i + 1) for i, j in enumerate(elasticity_of(m).pairs)})


def elasticity_of(m: Mechanism) -> Elasticity:
    """Return the springs and motors of a mechanism that has some."""
    # Requests are refused for others, at the door.
    assert m.elasticity is not None, m.name
    return m.elasticity


def select_motors(m: Mechanism, q: Series) -> Series:
    """Return columns of coordinates with a row per motor.

    (..., n, 1) becomes (..., m, 1).
    """
    e = elasticity_of(m)
    return q.map(lambda q: q[..., e.joints_of_motors, :]) if e.pairs else q


def deflect_springs(m: Mechanism, Q: Series, inputs: SpringInputs = NO_INPUTS) -> Pull:
    """Return deflections and forces of the springs that carry Q.

    There is one row per motor.
    """
    e = elasticity_of(m)
    # Without a law of its own any spring is linear: delta = Q / K, and zero at rigid joints.
    if len(e.springs) == 0:
        return reciprocal(e.stiffness)[:, None] * Q, Q
    # Forces of all joints come from one sweep: they share the rounding of the largest. Symbols have none.
    largest = float(np.nanmax(np.abs(Q[0]), initial=0.0)) if is_numeric(Q[0]) else 0.0
    pulls: list[Pull] = []
    for j, law in enumerate(e.springs):
        Q_j = take_rows(Q, j, j + 1)
        if law is None:
            pulls.append((reciprocal(e.stiffness[j : j + 1])[:, None] * Q_j, Q_j))
        else:
            # Errors occur here or, of rates, later, when terms are computed.
            with _name_joint(m, j):
                pulls_of_joint = _solve_springs(law, Q_j, inputs.deflections.get(j), inputs.stiffness.get(j), largest)
            pulls += [(_name_joint_in_terms(m, j, delta), phi) for delta, phi in pulls_of_joint]
    delta, phi = (join_series([pull[k] for pull in pulls], axis=-2) for k in (0, 1))
    return delta, phi


def _solve_springs(
    law: ElasticLaw, Q: Series, deflection: Array | None, stiffness: Series | None, largest: float
) -> list[Pull]:
    """Return deflections and forces of the springs of one joint.

    Most joints have one spring, some have two.
    """
    if isinstance(law, AntagonisticSprings):
        # Two springs pull against each other: their forces add up to Q, their slopes to the stiffness.
        assert stiffness is not None, law  # requests are refused without
        deflections = antagonist_series(law, Q, stiffness)
        return [(d, force_along(spring, d)) for spring, d in zip((law.first, law.second), deflections, strict=True)]
    if isinstance(law, Spring):
        return [(deflect_spring(law, Q, largest), Q)]
    # With a damper: exact where the deflection is integrated as a state, else the asymptotic series.
    if deflection is not None:
        return [(damped_deflection_rates(law.spring, law.damping, Q, deflection), Q)]
    if not is_numeric(Q[0]):
        raise JounceError("a spring with a damper needs NumPy arrays of floats, on which its series is checked")
    sums = expand_damped_deflection(law.spring, law.damping, Q, law.terms)
    check_series(sums, law.time_constant)
    return [(sums[-1], Q)]


def _name_joint_in_terms(m: Mechanism, j: int, delta: Series) -> Series:
    """Return a series whose errors begin with the name of a joint.

    Errors occur when terms are computed.
    """

    def term(k: int) -> Array:
        with _name_joint(m, j):
            return delta[k]

    return Series(term)


@contextmanager
def _name_joint(m: Mechanism, j: int) -> Iterator[None]:
    """Let errors within this context begin with the name of a joint.

    Errors of one state keep the number of the state.
    """
    joint = f"joint {quote_value(m.coordinates[j])}"
    try:
        yield
    except UnreachableError as error:
        raise UnreachableError(f"{joint}: {error}", error.state) from None
    except JounceError as error:
        raise JounceError(f"{joint}: {error}") from None


def spring_force(m: Mechanism, delta: Series) -> Series:
    """Return phi(delta) + D delta' of springs and dampers.

    There is one row per motor. It is zero at rigid joints, whose force is unknown.
    """
    e = elasticity_of(m)
    _check_ends(m, delta[0])
    linear = _linear_stiffness(e) * delta
    parts = [
        take_rows(linear, i, i + 1) if law is None else _force(law, take_rows(delta, i, i + 1))
        for i, law in enumerate(e.laws)
    ]
    return join_series(parts, axis=-2) if len(e.springs) > 0 else linear


def _force(law: Spring | DampedSpring, delta: Series) -> Series:
    """Return the force of one spring with its damper."""
    if isinstance(law, Spring):
        return force_along(law, delta)
    return force_along(law.spring, delta) + delta.dot * law.damping


def _check_ends(m: Mechanism, delta: Array) -> None:
    """Raise `JounceError` where deflections exceed the ends of springs.

    Deflections are (..., m, 1).
    """
    e = elasticity_of(m)
    for i, (j, law) in enumerate(zip(e.joints_of_motors, e.laws, strict=False)):
        if law is not None:
            with _name_joint(m, j):
                (law.spring if isinstance(law, DampedSpring) else law).checked(delta[..., i, :])


def sum_on_joints(m: Mechanism, phi: Array) -> Array:
    """Sum the forces of springs on each joint.

    (..., m, 1) becomes (..., n, 1).
    """
    e = elasticity_of(m)
    return np.eye(m.n, dtype=int)[:, e.joints_of_motors] @ phi if e.pairs else phi


def spring_energy(m: Mechanism, delta: Array) -> Array:
    """Return the energy of the springs, (..., 1, 1)."""
    e = elasticity_of(m)
    _check_ends(m, delta)
    # K delta^2 / 2 of linear springs, in whose place the others have the integrals of their forces.
    linear = _linear_stiffness(e) * delta * delta * 0.5
    energies = [linear[..., i : i + 1, :] for i in range(delta.shape[-2])]
    for i, law in enumerate(e.laws):
        if law is not None:
            spring = law if isinstance(law, Spring) else law.spring
            energies[i] = spring._energy(delta[..., i : i + 1, :])
    return reduce(add, energies)


def _linear_stiffness(e: Elasticity) -> Array:
    """Return the stiffnesses as a column, 0 at rigid joints.

    There is one per motor.
    """
    e = e.of_motors
    return np.where(e.is_rigid, 0, e.stiffness)[:, None]


# One spring over series.
def deflect_spring(spring: Spring, Q: Series, largest: float = 0.0) -> Series:
    """Return delta with phi(delta) = Q.

    `largest` is the largest force of the robot, whose rounding the others have.
    """
    # A cubic spring without its cubic term is linear, and is left as such to symbols.
    if isinstance(spring, CubicSpring) and spring.k3 == 0:
        return Q * (1 / spring.k)
    return solve_deflection(Q[0], spring, Q, largest)


@singledispatch
def solve_deflection(force: Array, spring: Spring, Q: Series, largest: float) -> Series:
    """Return delta with phi(delta) = Q, where Q[0] is `force`.

    Other kinds of arrays may register a rule of their own.
    """

    # The rate is Q' over the slope of phi: only values take an iteration, rates follow from the series.
    def rate(delta: Series) -> Series:
        _check_stiffness(spring, Q, largest)
        return Q.dot * inverse(force_along(spring, delta, 1))

    return from_rate(spring_deflection(spring, force), rate)


def _check_stiffness(spring: Spring, Q: Series, largest: float) -> None:
    """Raise `UnreachableError` for rates where the spring has no stiffness.

    A force that crosses zero within 1e-8 s counts as zero.
    """
    if not (isinstance(spring, CubicSpring) and spring.k == 0):
        return
    # phi' = 3 k3 delta^2 vanishes with the force alone; rounding of the largest force hides smaller ones.
    slack = np.flatnonzero(np.abs(Q[0]) <= FORCE_ROUNDING * (largest + np.abs(Q[1])))
    if slack.size > 0:
        raise UnreachableError(
            f"the spring has no stiffness where it carries {Q[0].flat[slack[0]]:.3g}, so its motor would move"
            " infinitely fast; give CubicSpring a k above 0, or ask for motor positions without rates",
            int(slack[0]),
        )


def expand_damped_deflection(spring: Spring, damping: float, Q: Series, terms: int) -> list[Series]:
    """Return the sums of 0, 1, ... `terms` terms of delta.

    delta solves phi(delta) + D delta' = Q.
    """
    # Fixed-point iterations delta = phi^-1(Q - D delta'): the rate of a sum takes one more rate of Q than the sum.
    sums = [Q * 0, deflect_spring(spring, Q)]
    while len(sums) <= terms:
        sums.append(deflect_spring(spring, Q - sums[-1].dot * damping))
    return sums[: terms + 1]


def damped_deflection_rates(spring: Spring, damping: float, Q: Series, delta: Array) -> Series:
    """Return a given deflection with its rates.

    delta' = (Q - phi(delta)) / D.
    """
    return from_rate(delta, lambda delta: (Q - force_along(spring, delta)) * (1 / damping))


def check_series(sums: Sequence[Series], time_constant: float) -> None:
    """Raise `JounceError` if the last term does not fall.

    It is compared with the terms before it. The size of a term is its largest over the batch.
    """
    sizes = [float(np.nanmax(np.abs(b[0] - a[0]), initial=0.0)) for a, b in pairwise(sums)]
    if len(sizes) < 2:
        return
    # The first term is the deflection without the damper; corrections are compared with corrections where there are
    # several.
    sizes_before = sizes[1:-1] if len(sizes) > 2 else sizes[:1]
    if sizes[-1] >= max(sizes_before) and sizes[-1] > NEGLIGIBLE_TERM * sizes[0]:
        raise JounceError(
            f"the series of the damper does not converge: term {len(sizes)} is {sizes[-1]:.2g}, not below the one"
            f" before; the time constant D/K is {time_constant:.3g} s; use motors_along(motion), which is exact"
        )
