"""Robots out of numbers: screws, body-fixed or spatial, and Denavit-Hartenberg tables."""

from collections.abc import Sequence
from typing import Any, Self

from jounce._scalars import Array
from jounce.model import dh, screws
from jounce.model.mechanism import GRAVITY
from jounce.robot.data import Data


class Construction(Data):
    """One constructor a kind of numbers, each a line on the function that checks them."""

    @classmethod
    def from_screws(
        cls,
        B: Array,
        X: Array,
        M: Array,
        parent: Sequence[int] | None = None,
        names: Sequence[str] | None = None,
        gravity: Array = GRAVITY,
        **data: Any,
    ) -> Self:
        """A robot from body-fixed data.

        Body i hangs on its parent by ``C_i = C_p B_i exp(X_i theta_i)`` with joint variables ``theta = G q + g``.

        Parameters
        ----------
        B : (nb, 4, 4)
            Pose of body i in the frame of its parent body at theta_i = 0.
        X : (nb, 6)
            Joint screw in the frame of body i, (xi; eta): revolute (e; x cross e), helical of pitch h
            (e; x cross e + h e), prismatic (0; e), with a unit vector e and a point x on the axis.
        M : (nb, 6, 6)
            Inertia matrix in the frame of body i, see `inertia_matrix`.
        parent : (nb,)
            Index of the parent body, smaller than i; -1 is the ground, several roots are allowed; a serial chain if
            left out.
        names : (nb,)
            Names of the bodies.
        gravity : (3,)
            Gravitational acceleration in the inertial frame, m/s^2; (0, 0, -9.81) if left out.
        **data : keywords
            joint_names, names of the n coordinates; G (nb, n) and g (nb,), constant, for joints that follow others,
            theta = q if left out; limits, a mapping of lower, upper, velocity, effort (nb,) of theta, each infinite if
            left out; drives, a mapping of armature, damping, friction, eps, stiffness, rest (nb,) of theta, each zero
            (eps 0.05) if left out, see `with_drives`; name, of the robot.

        Raises
        ------
        JounceError
            Where a shape or name is wrong, a number is not finite, a pose, screw or inertia has not its form, or a
            body comes before its parent.

        References
        ----------
        Müller & Kumar, (Ci), (Xi), (eqn_body_fixed_mass_inertia_matrix).

        Examples
        --------
        A pendulum of 2 kg at 0.5 m, turning about the y axis:

        >>> import numpy as np, jounce
        >>> M = jounce.inertia_matrix(2.0, [0, 0, -0.5], np.zeros((3, 3)))
        >>> pendulum = jounce.Robot.from_screws([np.eye(4)], [[0, 1, 0, 0, 0, 0]], [M])
        >>> pendulum.inverse_dynamics([np.pi / 2], [0.0], [0.0]).round(6)
        array([9.81])
        """
        return cls(screws.from_screws(B, X, M, parent, names, gravity, **data))

    @classmethod
    def from_spatial_screws(
        cls, A: Array, Y: Array, M: Array, parent: Sequence[int] | None = None, **data: Any
    ) -> Self:
        """A robot from spatial data, all in the inertial frame at theta = 0.

        ``B_i = A_p^-1 A_i``, ``X_i = Ad(A_i^-1) Y_i``.

        Parameters
        ----------
        A : (nb, 4, 4)
            Absolute poses of the bodies.
        Y : (nb, 6)
            Joint screws in the inertial frame.
        M : (nb, 6, 6)
            Inertia matrices, in the body frames.
        parent : (nb,)
            As in `from_screws`, with the same errors.
        **data : keywords
            names and gravity too, as in `from_screws`.

        Examples
        --------
        >>> import numpy as np, jounce
        >>> M = jounce.inertia_matrix(1.0, [0.1, 0, 0], 0.01 * np.eye(3))
        >>> robot = jounce.Robot.from_spatial_screws([np.eye(4)], [[0, 0, 0, 0, 0, 1]], [M])  # a vertical slide
        >>> robot.inverse_dynamics([0.3], [0.0], [1.0])
        array([10.81])
        """
        return cls(screws.from_spatial_screws(A, Y, M, parent, **data))

    @classmethod
    def from_dh(cls, table: Any, M: Array, convention: str, **options: Any) -> Self:
        """A serial robot from a Denavit-Hartenberg table.

        "standard": ``T_i = Rot_z(theta_i) Trans_z(d_i) Trans_x(a_i) Rot_x(alpha_i)``, frame i at the end of link i,
        the axis of joint i is z of frame i - 1.

        "modified" (Craig's): ``T_i = Rot_x(alpha_i) Trans_x(a_i) Rot_z(theta_i) Trans_z(d_i)``, frame i on the axis
        of joint i, its z; row i holds what Craig calls a_{i-1}, alpha_{i-1}, d_i, theta_i.

        The joint variable is added to theta_i, of a prismatic joint to d_i. **Body i has frame i**: inertias, wrenches
        and poses are those of this frame, which is another one in each convention.

        Parameters
        ----------
        table : (n, 4), or n mappings
            Rows **a, alpha, d, theta**, in this order, which is not that of every book; in m and rad. Rows that cannot
            be confused are mappings, ``{"theta": 0, "d": 0.1, "a": 0, "alpha": 1.2}``, with ``"type": "prismatic"``
            where the joint is one.
        M : (n, 6, 6)
            Inertia matrices in the frames of the table, see `inertia_matrix`.
        convention : str
            "standard" or "modified".
        **options : keywords
            types, of the joints where rows are numbers, "revolute" (all, if left out) or "prismatic"; degrees=True
            where alpha and theta are in degrees; base (4, 4), the pose of frame 0 in the inertial frame; tool (4, 4),
            the pose of a frame "tool" in frame n; names, gravity, joint_names, limits and the others of `from_screws`.

        Raises
        ------
        JounceError
            Where a row has not four finite numbers, a convention or type is unknown, or as in `from_screws`.

        Examples
        --------
        An arm of two links of 0.5 m, whose centres of mass are half a link before their ends:

        >>> import numpy as np, jounce
        >>> M = jounce.inertia_matrix(2.0, [-0.25, 0, 0], np.diag([0, 0.04, 0.04]))
        >>> arm = jounce.Robot.from_dh([[0.5, 0, 0, 0], [0.5, 0, 0, 0]], [M, M], "standard", gravity=(0, -9.81, 0))
        >>> arm.poses([np.pi / 2, 0.0], body="body2")[:3, 3].round(9) + 0.0
        array([0., 1., 0.])
        >>> arm.gravity_forces([0.0, 0.0])
        array([19.62 ,  4.905])
        """
        return cls(dh.from_dh(table, M, convention, **options))
