"""Joints that follow others by polynomials, as knees of anatomical models slide.

``theta_i = sum_p c_p theta_j^p``: the ratio of both velocities varies, so that the followers are no rows of G. They are
dependent coordinates of a closed robot whose leaders are independent: `FollowerRatios` has their powers, and nothing is
solved. Where the slope of a polynomial vanishes the follower is at rest for a moment, which is no singular position.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial

from jounce.core.errors import JounceError, check_choice, quote_value
from jounce.model import positions
from jounce.model.loops import Closure, FollowerRatios
from jounce.model.mechanism import Mechanism, with_closure


@dataclass(frozen=True)
class PolynomialLaw:
    """The law of a coordinate that follows another: ascending coefficients of its variable."""

    leader: str
    coefficients: tuple[float, ...]

    @property
    def words(self) -> str:
        """The polynomial as people write it."""
        powers = ["", self.leader, *(f"{self.leader}^{p}" for p in range(2, len(self.coefficients)))]
        terms = [f"{c:g} {power}".rstrip() for c, power in zip(self.coefficients, powers, strict=False) if c != 0]
        return " + ".join(terms).replace("+ -", "- ") or "0"


def with_polynomials(m: Mechanism, laws: Mapping[str, PolynomialLaw]) -> Mechanism:
    """Return the robot whose coordinates follow others by laws, by name.

    The coordinates are those that remain, and have the motors.

    Raises `JounceError` if a law names no coordinate, laws lead in a circle, or the robot has joints of several screws.
    """
    positions.check_single_screws(m, "joints that follow by polynomials")
    for name, law in laws.items():
        check_choice("coordinate", name, m.coordinates)
        check_choice("coordinate", law.leader, m.coordinates, f"the leader of {quote_value(name)}")
    polynomials = {name: _follow_leaders(name, laws) for name in laws}
    independent = [j for j, name in enumerate(m.coordinates) if name not in laws]
    places = [j for j, name in enumerate(m.coordinates) if name in laws]
    # Coefficients by power, of each of the k followers at its leader among the n independent coordinates.
    degree = max(polynomial.degree() for _, polynomial in polynomials.values())
    by_power = np.zeros((max(degree, 1) + 1, len(places), len(independent)))
    for row, j in enumerate(places):
        leader, polynomial = polynomials[m.coordinates[j]]
        column = independent.index(m.coordinates.index(leader))
        by_power[: polynomial.degree() + 1, row, column] = polynomial.coef
    offset, F, *powers = by_power
    start = np.zeros(m.n)
    start[places] = offset.sum(axis=1)
    closure = Closure(
        coordinates=m.coordinates,
        G=m.G,
        g=m.g,
        independent=tuple(independent),
        start=start,
        actuated=tuple(independent),
        weights=np.ones(len(independent)),
        ratios=FollowerRatios(tuple(places), F, offset.sum(axis=1), tuple(powers)),
    )
    return with_closure(m, closure)


def _follow_leaders(name: str, laws: Mapping[str, PolynomialLaw]) -> tuple[str, Polynomial]:
    """Return the coordinate that leads a follower, and its law.

    The law is that of all followers between them.
    """
    path, law = [name], Polynomial([0.0, 1.0])
    while path[-1] in laws:
        next_law = laws[path[-1]]
        law = law(Polynomial(next_law.coefficients))
        if next_law.leader in path:
            circle = " -> ".join([*path, next_law.leader])
            raise JounceError(f"joints follow each other in a circle: {circle}; expected one that leads")
        path.append(next_law.leader)
    return path[-1], law


def polynomial_laws(m: Mechanism) -> dict[str, PolynomialLaw]:
    """Return the laws of the coordinates that follow others by polynomials."""
    if m.closure is None or m.has_constant_ratios:
        return {}
    ratios, laws = m.closure.ratios, {}
    for row, j in enumerate(ratios.places):
        table = np.stack([P[row] for P in (ratios.F, *ratios.powers)]).astype(float)  # (powers, n)
        leaders = np.flatnonzero(table.any(axis=0))
        leader = int(leaders[0]) if len(leaders) > 0 else 0
        coefficients = np.trim_zeros(np.array([ratios.offset[row], *table[:, leader]], dtype=float), "b")
        laws[m.closure.coordinates[j]] = PolynomialLaw(m.coordinates[leader], tuple(float(c) for c in coefficients))
    return laws
