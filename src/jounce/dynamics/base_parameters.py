"""Base inertial parameters: the combinations of inertial parameters that determine the generalized forces.

Problem: parameters p do not enter the forces if their inertia requires none at any state. The force of joint j on the
composite inertia I of the bodies that it carries, v . I X_j, must vanish for the velocities v that its screw X_j or any
joint before it can give the body, and for gravity. As the joints behind move, I = I_j + sum of phi(theta) I_c varies; a
linear function f of I vanishes at all positions if f(phi(theta) I_c) is constant for every child c, and f(I) is zero at
one. It is constant if f phi(theta) D vanishes on I_c, D the change of moments of mass by the motion of the joint. The
regrouping of `equivalent_mechanisms.reduce_inertias` is one case of this rule: what a joint does not move has D I = 0.

Algorithm: every body has a space of functions of ten parameters that must vanish, found from its parent's by closures
of subspaces, without states; base parameters are bases of these spaces, of composite inertias at theta = 0. Joints that
follow others are not independent: combinations that they leave out are found by the rank of the regressor at random
states (Gautier, "Numerical calculation of the base inertial parameters of robots", J. Robotic Systems 8(4), 1991).

Invariants: rows of spaces are orthonormal; lengths are taken in the largest distance from joint to joint, so that one
tolerance serves all moments of mass.

How often what runs: `_spaces` once per body, outward; the grouping of `_regroup_tree` once per body, inward; the
regressor at random states only where joints follow others.

Failure: a singular value within `REGROUPING_TOLERANCE` counts as zero, and its combination is left out without notice.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jounce.core.errors import JounceError
from jounce.dynamics import loop_assembly
from jounce.dynamics.quantities import QUANTITIES
from jounce.dynamics.state import JointMotion, State
from jounce.model import coordinates, positions
from jounce.model.mechanism import Mechanism, ancestors, reference_poses, robot_size
from jounce.spatial import inertia
from jounce.spatial.inertia import INERTIAL_PARAMETERS
from jounce.spatial.lie import Ad, ad, inverse, wedge
from jounce.spatial.series import column_series

REGROUPING_TOLERANCE = 1e-9  # of singular values, relative to the largest or 1: smaller ones are rounding
INTEGER_ROUNDING = 1e-12  # of factors of combinations: those as near to an integer are one
LENGTH_POWERS = np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])  # powers of a length in the units of the parameters
_UNIT_INERTIAS = inertia.from_parameters(np.eye(10))
_UNIT_MOMENTS = inertia.moment_matrix(_UNIT_INERTIAS)


@dataclass(frozen=True, eq=False, repr=False)
class BaseParameters:
    """The base inertial parameters of a robot: the fewest combinations that determine its generalized forces.

    Attributes
    ----------
    names : tuple of str
        Each is named after the inertial parameter that it contains with the factor 1, and that no other contains.
    matrix : (count, 10 nb)
        The combinations of `Robot.inertial_parameters`: Y p = Y[..., columns] (matrix p).
    columns : (count,)
        The places of the named parameters among all, and of their columns in the regressor.
    values : (count,)
        matrix p of the robot.
    parameters : tuple of str
        The names of all inertial parameters.

    Examples
    --------
    >>> import jounce
    >>> print(jounce.load("planar2r").base_parameters())
    6 base parameters of 20 inertial parameters
               2  body1 mcx + body2 m
               0  body1 mcy
               2  body1 Izz + body2 m
               1  body2 mcx
               0  body2 mcy
               1  body2 Izz
    """

    names: tuple[str, ...]
    matrix: np.ndarray
    columns: np.ndarray
    values: np.ndarray
    parameters: tuple[str, ...]

    @property
    def count(self) -> int:
        """The number of base parameters."""
        return len(self.names)

    @property
    def combinations(self) -> tuple[str, ...]:
        """The formula of each base parameter."""
        return tuple(_formula(row, self.parameters) for row in self.matrix)

    def __repr__(self) -> str:
        return f"<BaseParameters: {self.count} of {len(self.parameters)}>"

    def __str__(self) -> str:
        rows = [f"{value:12.6g}  {text}" for value, text in zip(self.values, self.combinations, strict=True)]
        return "\n".join([f"{self.count} base parameters of {len(self.parameters)} inertial parameters", *rows])


def base_parameters(m: Mechanism) -> BaseParameters:
    """Find the base inertial parameters of a mechanism.

    Raises
    ------
    JounceError : if it holds symbols.
    """
    if not m.is_numeric:
        raise JounceError(f"robot {m.name!r} contains symbols; base parameters need numbers")
    # The size of the robot as unit of length makes all moments comparable.
    length = robot_size(m)
    scale = np.tile(length**LENGTH_POWERS, m.nb)
    # Combinations as if every joint moved by itself: `places` of the named parameters, `rows` (count, 10 nb).
    places, rows = _regroup_tree(_scale_lengths(m, length))
    # Joints that follow others, as do those of closed loops, leave some of these combinations without effect.
    if m.n < len(m.joints):
        # Columns of the regressor that depend on others in every state are left out: Y = Y[:, named] combined, and
        # `combined` joins the parameters of all columns to those of the named ones.
        Y, sizes = _scale_columns(m, length, places, scale[places])
        independent_rows = _span(Y)
        named = _select_independent(independent_rows)
        combined = np.linalg.solve(independent_rows[:, named], independent_rows) * sizes / sizes[named, None]
        places, rows = places[named], combined @ rows
    # In the order of bodies, with integers but for rounding made integers, and in meters again.
    order = np.argsort(places)
    places, rows = places[order], rows[order]
    rows = np.where(np.abs(rows - np.rint(rows)) < INTEGER_ROUNDING, np.rint(rows) + 0.0, rows)
    matrix = rows * scale[places, None] / scale
    names = tuple(f"{body} {name}" for body in m.bodies for name in INERTIAL_PARAMETERS)
    values = matrix @ inertia.parameters(m.M).ravel()
    for array in (places, matrix, values):
        array.flags.writeable = False
    return BaseParameters(tuple(names[k] for k in places), matrix, places, values, names)


@dataclass(frozen=True)
class _Spaces:
    """Spaces of a body, as rows: functions of its composite inertia, and velocities of it.

    The functions must vanish, or be constant, at all positions of the joints beyond the body.
    """

    vanishing: np.ndarray  # (k, 10)
    constant: np.ndarray  # (k, 10), those that must vanish among them
    velocities: np.ndarray  # (k, 6), and what gravity is equivalent to


def _scale_lengths(m: Mechanism, length: float) -> Mechanism:
    """Return the mechanism in another unit of length."""
    B, X = np.array(m.B, dtype=float), np.array(m.X, dtype=float)
    B[:, :3, 3] /= length
    # Joints that turn have moments of their axes, in m; those that only slide have directions, without unit.
    X[X[:, :3].any(axis=1), 3:] /= length
    return replace(m, B=B, X=X)


def _regroup_tree(m: Mechanism) -> tuple[np.ndarray, np.ndarray]:
    """Return the places of named parameters, and their combinations.

    Combinations are (count, 10 nb). All joints count as independent.
    """
    poses, carries, size = reference_poses(m), ancestors(m), len(INERTIAL_PARAMETERS)
    # Outward: the spaces of each body from those of its parent. Nothing must vanish for the ground, which falls.
    nothing, gravity = np.zeros((0, size)), np.array([[0, 0, 0, *m.gravity]], dtype=float)
    fall = gravity / (np.linalg.norm(gravity) or 1.0)
    spaces = {-1: _Spaces(nothing, nothing, _span(fall))}
    for i in range(m.nb):
        spaces[i] = _spaces(spaces[m.parent[i]], m.B[i], coordinates.body_screws(m, i).T)
    # Inward: the functions of each composite inertia are base parameters.
    places, rows = np.zeros(0, dtype=int), np.zeros((0, size * m.nb))
    for j in reversed(range(m.nb)):
        # (k, 10) of the composite inertia of body j -> (k, nb, 10) of the bodies that joint j carries, at theta = 0.
        functions = spaces[j].vanishing
        composite = np.zeros((len(functions), m.nb, size))
        for k in range(j, m.nb):
            if carries[k, j]:
                composite[:, k] = functions @ transport_parameters(inverse(poses[j]) @ poses[k])
        # Solved for parameters of body j, which occur in no function of the bodies beyond it.
        named = _select_independent(functions)
        new_rows = np.linalg.solve(functions[:, named], composite.reshape(len(functions), -1))
        # Parameters that name combinations of bodies beyond are eliminated: each occurs in its own alone.
        new_rows = new_rows - new_rows[:, places] @ rows
        places, rows = np.append(named + size * j, places), np.concatenate([new_rows, rows])
    return places, rows


def _spaces(parent: _Spaces, B: np.ndarray, X: np.ndarray) -> _Spaces:
    """Return the spaces of a body from those of its parent.

    X, (k, 6), are the screws of its joint.
    """
    # Velocities of the parent at every position of the joint are a space closed under ad(X); the joint adds X.
    velocities = _span(np.concatenate([_close_space(parent.velocities @ Ad(inverse(B)).T, ad(X).mT), X]))
    # v . I X for all velocities v: functions of the ten parameters of I, by the momenta of unit parameters.
    momenta = np.concatenate([velocities @ (_UNIT_INERTIAS @ x).T for x in X])
    # D, (10, 10) of each screw: the change of parameters by a motion of the joint, Pi' = wedge(X) Pi + Pi wedge(X)^T.
    flows = np.stack([_moments_to_parameters(wedge(x) @ _UNIT_MOMENTS + _UNIT_MOMENTS @ wedge(x).T).T for x in X])
    # A function of the parent must be constant at every position of the joint: so at theta = 0, and for all its
    # changes f D, f D D, ...; that is, all f D must vanish.
    handed_on = parent.constant @ transport_parameters(B)
    constant = _close_space(handed_on, flows)
    vanishing = _span(np.concatenate([momenta, *(constant @ flow for flow in flows)]))
    return _Spaces(vanishing, _span(np.concatenate([vanishing, handed_on])), velocities)


def transport_parameters(T: np.ndarray) -> np.ndarray:
    """Return the map of inertial parameters to an outer frame.

    The map is (10, 10). The frame has the pose T in the outer one.
    """
    return _moments_to_parameters(T @ _UNIT_MOMENTS @ T.T).T


def _moments_to_parameters(Pi: np.ndarray) -> np.ndarray:
    """Return the inertial parameters (..., 10) of moments of mass.

    The shape is (..., 4, 4).
    """
    return inertia.parameters(inertia.from_moment_matrix(Pi))


def _close_space(rows: np.ndarray, matrices: np.ndarray) -> np.ndarray:
    """Return the smallest space with given rows that matrices map to itself."""
    rows = _span(rows)
    larger = _span(np.concatenate([rows, *(rows @ A for A in matrices)]))
    while len(larger) > len(rows):
        rows = larger
        larger = _span(np.concatenate([rows, *(rows @ A for A in matrices)]))
    return rows


def _span(rows: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis of the space of some rows."""
    _, s, basis = np.linalg.svd(rows, full_matrices=False)
    return basis[s > REGROUPING_TOLERANCE * max(1.0, s.max(initial=0))]


def _select_independent(rows: np.ndarray) -> np.ndarray:
    """Return columns that make independent rows a regular matrix.

    They are found by QR with column pivoting.
    """
    residuals, columns = rows.copy(), list[int]()
    for _ in rows:
        # The column that the chosen ones explain least. Lengths are rounded, so that of equal ones the first is taken:
        # names do not depend on the last digits.
        columns.append(int(np.argmax(np.round(np.linalg.norm(residuals, axis=0), 6))))
        u = residuals[:, columns[-1]] / np.linalg.norm(residuals[:, columns[-1]])
        residuals = residuals - np.outer(u, u @ residuals)
    return np.sort(np.array(columns, dtype=int))


def _scale_columns(m: Mechanism, length: float, places: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return columns of the regressor at random states, and their sizes.

    Columns are scaled to size 1. Columns of bodies that cannot move are rounding and stay so. Sizes are relative to
    those of independent joints, and to the largest at each state, as all grow near singular ones.
    """
    # The same robot with independent joints shows how large each column can be.
    free = replace(m.tree, G=np.eye(len(m.joints)), g=np.zeros(len(m.joints)), coordinates=m.joints)
    free_sizes = np.linalg.norm(_sample_regressor(free, length)[..., places] * scale, axis=(0, 1))
    Y = _sample_regressor(m, length)[..., places] * scale / free_sizes
    # Every state gets the same weight, then every column the length 1: (states, nv, places) -> (states nv, places).
    largest = np.abs(Y).max(axis=(1, 2), keepdims=True)
    Y = (Y / np.where(largest > 0, largest, 1.0)).reshape(-1, len(places))
    sizes = np.linalg.norm(Y, axis=0)
    sizes = np.where(sizes > REGROUPING_TOLERANCE * sizes.max(initial=0.0), sizes, sizes.max(initial=1.0))
    return Y / sizes, sizes * free_sizes


def _sample_regressor(m: Mechanism, length: float) -> np.ndarray:
    """Return the regressor at random states, (states, nv, 10 nb).

    It has at least twice as many rows as there are parameters.
    """
    rng, count = np.random.default_rng(0), 2 * len(INERTIAL_PARAMETERS) * m.nb // m.nv + 10
    # q, qd and q2d, (3, states, n): half a turn, or the size of the robot. Joints of several screws have positions of
    # other numbers than velocities.
    size = np.where(m.X[coordinates.leading_joints(m), :3].any(axis=1), np.pi, length)
    q = list(rng.uniform(-1, 1, (3, count, m.n)) * size)
    if positions.multiscrew_joints(m.tree):
        reach = np.where(np.array(coordinates.position_units(m)) == "m", length, 1.0)
        q[0] = rng.uniform(-1, 1, (count, positions.count(m))) * reach
    twist = np.repeat([1.0, length], 3)
    base = JointMotion(np.eye(4), column_series(list(rng.uniform(-2, 2, (2, count, 6)) * twist))) if m.floats else None
    # Closed robots are sampled where their loops are closed.
    tree = loop_assembly.sample_positions(m, count)[..., None] if m.takes_dependent else None
    if m.closure and tree is not None:
        q[0] = tree[:, list(m.closure.independent), 0]
    return np.asarray(
        QUANTITIES["regressor"].law("recursion", m)(m, State(column_series(q), base=base, position=tree))[0]
    )


def _formula(factors: np.ndarray, names: Sequence[str]) -> str:
    """Return a linear combination as text."""
    text = ""
    for k in np.flatnonzero(factors).tolist():
        sign = "-" if factors[k] < 0 else "+"
        size = "" if abs(factors[k]) == 1 else f"{abs(factors[k]):.6g} "
        text += f" {sign} {size}{names[k]}"
    # A sum begins without a plus.
    return text[3:] if text.startswith(" +") else text[1:]
