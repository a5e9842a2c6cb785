"""Robots out of other libraries' models."""

from typing import Any, Self

from jounce._scalars import Array
from jounce.models import pinocchio
from jounce.robot.data import Data


class Models(Data):
    """One constructor a library, each a line on its reader."""

    @classmethod
    def from_pinocchio(
        cls, model: Any, *, gravity: Array | None = None, base: str | None = None, root: str | None = None
    ) -> Self:
        """A robot of a model of Pinocchio's: the same Q as ``pinocchio.rnea(model, data, q, v, a)``, by the same names.

        The coordinates are in the order of Pinocchio's v, called after its joints; mimic joints are folded. What
        differs: a joint without bounds has its angle in q, not a cosine and a sine; joints of several coordinates
        (composite, universal, translation, sphericalZYX) are chains, ``NAME_1``, ``NAME_2``, ...; bodies are in the
        order of joints depth first, which is Pinocchio's own for a URDF. Armature (where it is 0, the rotor's inertia
        times the gear ratio squared), damping and friction become drives, see `with_drives`: Pinocchio's rnea takes
        armature in always, the others never. Bodies, operational frames and sensors may be named wherever a body may.

        Parameters
        ----------
        model : pinocchio.Model
            Of numbers.
        gravity : (3,)
            In m/s^2; the model's if left out.
        base : str
            "fixed" welds free-flyer, planar, spherical joints at zero, with a `JounceWarning`; else they are refused.
        root : str
            A body or frame to start at: what it carries remains, and it stands on the ground itself.

        Raises
        ------
        JounceError
            Where the model is none, holds a joint that is free, no joint that moves, or a number that is not finite.

        Examples
        --------
        >>> import jounce, pinocchio
        >>> model = pinocchio.buildSampleModelManipulator()
        >>> robot = jounce.Robot.from_pinocchio(model)
        >>> robot.joint_names == tuple(model.names)[1:]
        True
        """
        return cls(pinocchio.mechanism(model, gravity, base, root))
