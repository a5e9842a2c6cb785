"""Drives add terms along a path: Coulomb friction, and motors behind linear springs.

Friction adds to the products of sigma's rates that rows of limits are sums of. With ' for d/dsigma, theta a joint
variable, w = 1 / eps and u = w theta' s1, one unit of friction is

    F    = tanh(u)
    Fd   = w tanh'(u) A,                           A = theta' s2 + theta'' s1^2
    F2d  = w^2 tanh''(u) A^2 + w tanh'(u) B,       B = theta' s3 + 3 theta'' s1 s2 + theta''' s1^3

and F s1 is that of the power where theta' is 1. All are functions of x, x', x'' and of the path. The velocity of a
motor behind a spring has more terms than theta' s1; its friction enters torques, and not their rates.

Friction changes fastest where a joint turns round: these times are zeros of its velocity between neighbours of given
times, and `turns` and `reversals` return times around each at distances in a geometric series. A joint that turns round
twice between two of the given times is not noticed.

Limits of motors bound terms of the same products, `MotorTerms`:

    theta^(k) = q^(k) + Q^(k) / K,    tau = Q + B theta2d + d thetad,    i = tau / (r k),    u = R i + r k thetad

Coulomb friction f tanh(thetad / eps) comes on top of tau. The power of all motors, the sum of tau thetad or of i u, is
a quadratic form of the products, `PowerAlong`: with tau = A p and thetad = B p it is p^T S p, S = A^T B. Q2d takes the
fourth rate of sigma, and rows take no higher one: voltages of windings with an inductance, which take Q3d, have no
terms (`find_motor_obstacle`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import product
from operator import add
from typing import Any, NamedTuple

import numpy as np

from jounce.core import scalars
from jounce.core.errors import join_names
from jounce.core.scalars import Array
from jounce.dynamics import elastic
from jounce.dynamics.quantities import DEFAULT_QUANTITY
from jounce.limits import path_terms
from jounce.limits.joints import columns_of_coordinates, power_factors, scatter_columns
from jounce.limits.root_finding import find_roots
from jounce.model.elasticity import Elasticity, ElasticLaw
from jounce.model.limits import LIMIT_KINDS
from jounce.model.mechanism import Mechanism
from jounce.model.springs import CubicSpring, DampedSpring
from jounce.model.transmissions import with_followers
from jounce.motion import Motion
from jounce.program import operations
from jounce.spatial.series import Series

_TURN_OFFSETS = 0.5 ** np.arange(8, 20, 0.25)  # of the duration: how far from a turn points are added, 4e-3 to 1e-6
_TURN_SHARES = 0.5 ** np.arange(1, 44)  # of the time from a turn to the next row, down to the rounding of times
_TANH_RANGE = (1 / 16, 32.0)  # eps: velocities between which tanh changes; beyond, by less than rounding
_STRIBECK_RANGE = 6.0  # its velocities: beyond, exp(-36) is left of Stribeck friction, less than rounding


class Smooth(NamedTuple):
    """Functions of a jet with their first and second derivatives.

    Values are (m, N), gradients (m, 4, N), Hessians (m, 4, 4, N); sums and products follow Leibniz' rule.
    """

    value: np.ndarray
    first: np.ndarray
    second: np.ndarray

    def __add__(self, other: "Smooth") -> "Smooth":  # type: ignore[override]
        return Smooth(*(x + y for x, y in zip(self, other, strict=True)))

    def __mul__(self, other: "Smooth") -> "Smooth":  # type: ignore[override]
        f, g = self.value[:, None], other.value[:, None]
        cross = self.first[:, :, None] * other.first[:, None]
        return Smooth(
            self.value * other.value,
            f * other.first + g * self.first,
            f[:, None] * other.second + g[:, None] * self.second + cross + cross.swapaxes(1, 2),
        )


@dataclass(frozen=True, eq=False)
class Friction:
    """Coulomb friction of m joint variables.

    Their velocities are theta' = ratios q', and a unit of friction adds `onto` (m, n) to Q. `slope` (m, 1) is 1 / eps.
    Speeds above `fastest` (m,) in eps change no friction, Stribeck's included.
    """

    ratios: np.ndarray
    onto: np.ndarray
    slope: np.ndarray
    fastest: np.ndarray
    others: bool  # whether Stribeck friction, or friction by the load, acts too; products and rows do not hold it

    def turns(self, motion: Motion, columns: list[int], count: int) -> np.ndarray:
        """Return times near which a joint with friction turns round.

        A turn is where a joint begins to move, stops or turns round, as `count` even times show. Times around each turn
        are at distances in a geometric series.
        """
        velocity = _velocity(motion, self.ratios[:, columns].T)
        turns, _, _ = _find_zeros(velocity, np.linspace(motion.start, motion.stop, count))
        near = turns[:, None] + motion.duration * np.concatenate([-_TURN_OFFSETS, [0.0], _TURN_OFFSETS])
        return near[(near >= motion.start) & (near <= motion.stop)]

    def reversals(self, motion: Motion, t: np.ndarray) -> np.ndarray:
        """Return times between which friction is as smooth as a polynomial.

        They are around the changes of its sign between two of the times t. There its rates have peaks as narrow as eps
        is small.
        """
        # Zeros of velocities in units of eps, where tanh is not linear between neighbours of t.
        velocity = _velocity(motion, self.ratios.T * self.slope.T)
        turns, before, joint = _find_zeros(velocity, t, least=_TANH_RANGE[0])
        turn, low, high = (x[:, None] for x in (turns, t[before], t[before + 1]))
        # Times at halves, quarters, ... of the way to both neighbours; those where tanh changes are kept: (turns, 86).
        near = np.concatenate([turn - (turn - low) * _TURN_SHARES, turn + (high - turn) * _TURN_SHARES], axis=1)
        # Of each time the velocity of the joint that turns there alone.
        velocities = velocity(near.ravel())[np.arange(near.size), np.repeat(joint, near.shape[1])]
        speed = np.abs(velocities).reshape(near.shape)
        return np.concatenate([turns, near[(speed >= _TANH_RANGE[0]) & (speed <= self.fastest[joint, None])]])

    def along(self, rates: Sequence[path_terms.Terms], kinds: tuple[str, ...]) -> "FrictionAlong":
        """Return the friction along a path.

        `rates` are the terms of what rubs, velocities first, then their rates; `kinds` are the limits that take the
        friction.
        """
        joint_rates = [{k: self.ratios @ term.T for k, term in terms.items()} for terms in rates]
        return FrictionAlong(self, tuple(joint_rates), kinds)


def coulomb_friction(ratios: np.ndarray, onto: np.ndarray, eps: np.ndarray) -> Friction:
    """Return Coulomb friction alone, with smoothing velocities (m,)."""
    return Friction(ratios, onto, 1 / eps[:, None], np.full(len(eps), _TANH_RANGE[1]), others=False)


@dataclass(frozen=True, eq=False)
class FrictionAlong:
    """Coulomb friction along a path: a product for each kind and joint.

    `rates` are terms (m, N) of velocities and their rates.
    """

    friction: Friction
    rates: tuple[path_terms.Terms, ...]
    kinds: tuple[str, ...]

    def select(self, points: np.ndarray | slice) -> "FrictionAlong":
        """Return the friction at some of the points."""
        rates = [{k: term[:, points] for k, term in terms.items()} for terms in self.rates]
        return replace(self, rates=tuple(rates))

    @property
    def highest_jet(self) -> tuple[int, ...]:
        """Return of each product the highest derivative of x that it takes.

        That of motors takes what their torques take anyway.
        """
        return tuple(np.repeat([LIMIT_KINDS[kind].rate for kind in self.kinds], len(self.friction.slope)).tolist())

    def terms(self, kind: str, share: Array) -> path_terms.Terms:
        """Return the factors of the products for a kind of limit.

        They are shares (N, n) or (n,) of what friction adds.
        """
        if kind not in self.kinds:
            return {}
        # Products of friction follow those of the path, kind by kind.
        first = len(path_terms.PRODUCT_POWERS) + self.kinds.index(kind) * len(self.friction.onto)
        return {first + i: onto * share for i, onto in enumerate(self.friction.onto)}

    def products(self, jet: np.ndarray) -> np.ndarray:
        """Evaluate the products (M, N) at jets (4, N)."""
        path_products = path_terms.products(jet)

        def sum_terms(terms: path_terms.Terms) -> Any:
            return sum(c * path_products[k] for k, c in terms.items())

        return np.concatenate(self._evaluate(self._tanh_derivatives(sum_terms(self.rates[0])), sum_terms))

    def derivatives(self, jet: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Evaluate the derivatives of the products by the jets.

        Returns gradients (M, 4, N) and Hessians (M, 4, 4, N).
        """
        values, (first, second) = path_terms.products(jet), path_terms.derivatives(jet)

        def sum_terms(terms: path_terms.Terms) -> Smooth:
            parts = [
                Smooth(c * values[k], c[:, None] * first[k], c[:, None, None] * second[k]) for k, c in terms.items()
            ]
            return reduce(add, parts)

        # The chain rule for f(v): gradient f' v', Hessian f'' v' v'^T + f' v'', for f = tanh, tanh' and tanh''.
        velocity = sum_terms(self.rates[0])
        outer_product = velocity.first[:, :, None] * velocity.first[:, None]
        tanh = [x[:, None] for x in self._tanh_derivatives(velocity.value)]
        smooth = [
            Smooth(
                x[:, 0],
                slope * velocity.first,
                curvature[:, None] * outer_product + slope[:, None] * velocity.second,
            )
            for x, slope, curvature in zip(tanh, tanh[1:], tanh[2:], strict=False)
        ]
        products = self._evaluate(smooth, sum_terms)
        return np.concatenate([x.first for x in products]), np.concatenate([x.second for x in products])

    def _tanh_derivatives(self, velocity: np.ndarray) -> list[np.ndarray]:
        """Return tanh(w v) of velocities v and its first four derivatives.

        Velocities v and all results are (m, N).
        """
        w = self.friction.slope
        y = np.tanh(w * velocity)
        # tanh' = 1 - tanh^2 loses all digits where tanh is near 1: sech^2 does not.
        slope = operations.square_sech(w * velocity, y, np.exp)
        by_wv = [y, slope, -2 * y * slope, slope * (6 * y * y - 2), slope * y * (16 - 24 * y * y)]
        return [w**k * x for k, x in enumerate(by_wv)]

    def _evaluate(self, tanh: list[Any], sum_terms: Callable[[path_terms.Terms], Any]) -> list[Any]:
        """Evaluate the products by kind, as arrays or `Smooth`.

        `tanh` are its derivatives at the velocities, and `sum_terms` evaluates sums of products: A and B in the head of
        this module are those of the first and the second rate.
        """
        products = []
        for kind in self.kinds:
            order = LIMIT_KINDS[kind].rate
            if LIMIT_KINDS[kind].of == "P":
                s1 = sum_terms({path_terms.S1: np.ones_like(self.rates[0][path_terms.S1])})
                products.append(tanh[0] * s1)
            elif order == 0:
                products.append(tanh[0])
            else:
                A = sum_terms(self.rates[1])
                if order == 2:
                    products.append(tanh[2] * A * A + tanh[1] * sum_terms(self.rates[2]))
                else:
                    products.append(tanh[1] * A)
        return products


def _velocity(motion: Motion, onto: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Return the velocities (N, m) of joints as a function.

    The function takes times (N,); `onto` (n, m) are the factors of the coordinates' velocities.
    """
    return lambda t: np.asarray(motion(t, 1)[1] @ onto)


def _find_zeros(
    velocity: Callable[[np.ndarray], np.ndarray], t: np.ndarray, least: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find when velocities change their sign between neighbours of the times t.

    One of the two is faster than `least`. Returns the times, the places in t before them, and the joints.
    """
    v = velocity(t)
    changes = np.sign(v[1:]) != np.sign(v[:-1])
    before, joint = np.nonzero(changes & (np.maximum(np.abs(v[1:]), np.abs(v[:-1])) > least))

    def velocity_of_joint(t: np.ndarray, places: np.ndarray) -> np.ndarray:
        return velocity(t)[np.arange(len(t)), joint[places]]

    zeros = find_roots(velocity_of_joint, t[before], t[before + 1])
    return zeros, before, joint


def acting_friction(m: Mechanism) -> Friction | None:
    """Return the friction that acts in a robot; None without.

    The friction acts by speed or by load; joint variables without any are left out.
    """
    d = m.drives
    coulomb, stribeck, by_load = (getattr(d, x) * (x in m.acting) for x in ("friction", "stribeck", "load_friction"))
    which = np.flatnonzero(coulomb + stribeck + by_load)
    if which.size == 0:
        return None
    # Stribeck friction changes at velocities of its own, which may be faster than those of tanh.
    ratios, reach = m.tree.G[which], _STRIBECK_RANGE * (d.stribeck_velocity / d.eps * (stribeck > 0))[which]
    fastest = np.maximum(_TANH_RANGE[1], reach)
    # Motors that move joints together, without loops, bear the friction of these.
    onto = ratios
    if m.closure is not None and not m.takes_dependent and m.has_constant_ratios:
        onto = with_followers(m).G[which] @ columns_of_coordinates(m)
    onto, others = onto * coulomb[which, None], bool((stribeck + by_load).any())
    return Friction(ratios, onto, 1 / d.eps[which, None], fastest, others)


# Motors behind linear springs.
@dataclass(frozen=True, eq=False)
class MotorTerms:
    """The motors of a robot, whose limits bound a motion."""

    mechanism: Mechanism
    elasticity: Elasticity

    def terms(self, path: path_terms.Path, kind: str) -> path_terms.Terms:
        """Return the terms of what limits of a kind bound, without friction."""
        row = LIMIT_KINDS[kind]
        if row.of == "theta":
            return self.position(path, row.rate)
        # A torque, current or voltage is of_tau (Q + B theta2d + d thetad) + of_velocity thetad.
        of_tau, of_velocity = self.shares(kind)
        rotor, viscous = self._columns(self.elasticity.rotor, self.elasticity.viscous)
        return path_terms.add_terms(
            (of_tau, path.force(0)),
            (of_tau * rotor, self.position(path, 2)),
            (of_tau * viscous + of_velocity, self.position(path, 1)),
        )

    def position(self, path: path_terms.Path, order: int) -> path_terms.Terms:
        """Return the terms of theta, or of a rate of it: q + Q / K."""
        [compliance] = self._columns(scalars.reciprocal(self.elasticity.stiffness))
        return path_terms.add_terms((np.ones_like(compliance), path.rate(order)), (compliance, path.force(order)))

    def shares(self, kind: str) -> list[Array]:
        """Return the factors of tau and thetad in a limited value.

        Both are (n,).
        """
        e, one = self.elasticity, np.ones(self.mechanism.n)
        if kind == "motor_torque":
            return self._columns(one, 0 * one)
        if kind == "motor_current":
            return self._columns(elastic.currents(e, Series.of([one]))[0], 0 * one)
        # The law of voltages is linear: a unit of tau or of thetad yields its factor.
        tau, theta = (Series.of([x, y]) for x, y in ((one, 0 * one), (0 * one, one)))
        nothing = Series.of([0 * one] * 2)
        return self._columns(elastic.voltages(e, nothing, tau)[0], elastic.voltages(e, theta, nothing)[0])

    def power(self, path: path_terms.Path, kinds: tuple[str, ...]) -> "PowerAlong":
        """Return the powers of all motors together along a path."""
        forms = np.zeros((len(kinds), len(path.q[0]), *[len(path_terms.PRODUCT_POWERS)] * 2))
        for form, kind in zip(forms, kinds, strict=True):
            first, second = (self.terms(path, factor) for factor in power_factors(self.mechanism, kind))
            for (k, x), (i, y) in product(first.items(), second.items()):
                # Half of it on either side of the diagonal: forms are symmetric.
                S = (x * y).sum(axis=1) / 2
                form[:, k, i] += S
                form[:, i, k] += S
        return PowerAlong(kinds, forms)

    def friction(self) -> Friction | None:
        """Return the Coulomb friction of the motors; None without."""
        amounts, eps = self._columns(self.elasticity.friction, self.elasticity.eps)
        which = np.flatnonzero(amounts)
        if which.size == 0:
            return None
        ratios = np.eye(len(amounts))[which]
        return coulomb_friction(ratios, ratios * amounts, eps[which])

    def _columns(self, *arrays: Array) -> list[Array]:
        """Return columns of all joints from those of motors.

        They are 0 for joints without a motor or without the data.
        """
        return scatter_columns(self.mechanism, [np.nan_to_num(x) for x in arrays], DEFAULT_QUANTITY)


@dataclass(frozen=True, eq=False)
class PowerAlong:
    """The power of all motors along a path.

    It is a product for each kind. `forms` (kinds, N, K, K) are symmetric, of the K products of the path.
    """

    kinds: tuple[str, ...]
    forms: np.ndarray

    def select(self, points: np.ndarray | slice) -> "PowerAlong":
        """Return the powers at some of the points."""
        return replace(self, forms=self.forms[:, points])

    @property
    def highest_jet(self) -> tuple[int, ...]:
        """Return of each product the highest derivative of x that it takes."""
        return (path_terms.JET_SIZE - 1,) * len(self.kinds)

    @property
    def static(self) -> np.ndarray:
        """The powers at rest, (kinds, N)."""
        return self.forms[..., path_terms.ONE, path_terms.ONE]

    def products(self, jet: np.ndarray) -> np.ndarray:
        """Evaluate the products (kinds, N) at jets (4, N)."""
        p = path_terms.products(jet)
        return np.einsum("kn,tnkl,ln->tn", p, self.forms, p, optimize=True)

    def derivatives(self, jet: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Evaluate the derivatives of the products by the jets.

        Returns gradients (kinds, 4, N) and Hessians (kinds, 4, 4, N).
        """
        p, (first, second) = path_terms.products(jet), path_terms.derivatives(jet)
        # Of p^T S p the gradient is 2 p'^T S p, and the Hessian 2 p'^T S p' + 2 (S p) . p''.
        Sp = np.einsum("tnkl,ln->tkn", self.forms, p)
        gradients = 2 * np.einsum("tkn,kin->tin", Sp, first)
        S_first = np.einsum("tnkl,ljn->tkjn", self.forms, first)
        hessians = np.einsum("kin,tkjn->tijn", first, S_first) + np.einsum("tkn,kijn->tijn", Sp, second)
        return gradients, 2 * hessians


def find_motor_obstacle(e: Elasticity, kinds: list[str]) -> str | None:
    """Describe why limits of motors are no sums of products.

    Returns None where limits of these kinds are sums of products along every path.
    """
    inductive = e.is_inductive and "motor_voltage" in kinds
    rubs = bool(e.friction.any()) and any(LIMIT_KINDS[kind].is_total for kind in kinds)
    obstacles = {
        "two motors on a joint": bool(e.pairs),
        "springs with dampers": bool(e.dampers),
        "springs that are not linear": any(map(is_nonlinear, e.springs)),
        "rotors that links carry (coupling)": e.level is not None,
        "windings with an inductance under limits of voltage": inductive,
        "Coulomb friction of motors under limits of the whole robot": rubs,
    }
    present = [obstacle for obstacle, is_present in obstacles.items() if is_present]
    return join_names(present) if len(present) > 0 else None


def is_nonlinear(law: ElasticLaw | None) -> bool:
    """Whether the force of a spring is not proportional to its deflection."""
    spring = law.spring if isinstance(law, DampedSpring) else law
    return spring is not None and not (isinstance(spring, CubicSpring) and spring.k3 == 0)
