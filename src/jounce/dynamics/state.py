"""What laws take: a mechanism, and the state of a motion at an instant."""

from collections.abc import Callable
from dataclasses import dataclass

from jounce.core.scalars import Array
from jounce.dynamics.joint_motion import BASE_AT_REST, JointMotion
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series

_NO_SERIES = Series.of(())


@dataclass(frozen=True)
class State:
    """The argument of laws: a motion at an instant, with its rates, and the body and frame of the quantity.

    Coordinates are columns (..., n, 1), forces (..., nv, 1), wrenches on the bodies (..., 6nb, 1).
    """

    q: Series
    W: Series | None = None
    Q: Series = _NO_SERIES  # generalized forces, where a quantity takes them
    motors: Series = _NO_SERIES  # theta, thetad, and tau or q4d, where a quantity takes them: no rates of each other
    base: JointMotion | None = None  # None: the ground of a fixed robot, at rest, or of no effect
    body: str | None = None  # a body or a link merged into one; None: all bodies
    frame: str = "body"  # of twists: "body", "world" or "spatial"
    stiffness: Series | None = None  # of joints with two motors, (..., k, 1)
    active: Array | None = None  # of contacts, (..., r): 1 where a row of their limits holds with equality, else 0
    position: Array | None = None  # of a closed robot, all coordinates (..., N, 1) of its tree, with loops closed

    @property
    def motion_of_base(self) -> JointMotion:
        """The motion of the base: at rest at the inertial frame unless it is given."""
        return self.base or BASE_AT_REST


Law = Callable[[Mechanism, State], Series]
