"""Robots out of other libraries' models."""

from typing import Any, Self

from jounce._scalars import Array
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
        from jounce.io.models import pinocchio  # what few programs need

        return cls(pinocchio.mechanism(model, gravity, base, root))

    @classmethod
    def from_mujoco(
        cls, model: Any, *, gravity: Array | None = None, base: str | None = None, root: str | None = None
    ) -> Self:
        """A robot from a model of MuJoCo: what `jounce.load` makes of an MJCF file, from a model that is there.

        Coordinates are MuJoCo's joint variables (rad, m), in its order; joints that an active equality constraint ties
        linearly to another follow it exactly, and are no coordinates. Bodies without a joint merge into those that
        carry them, named sites become merged links. Where a body has several joints, those before its last move
        massless links of their own, BODY:JOINT by name. What the model's flags disable is left out.

        Parameters
        ----------
        model : mujoco.MjModel
            The model; it is read, not kept.
        gravity : (3,)
            Gravitational acceleration in m/s^2; that of the model if left out.
        base, root : str
            ``base="fixed"`` welds ball and free joints where the model places their bodies; `root` names a body to
            start at, which then stands on the ground.

        Raises
        ------
        JounceError
            Where it is no model of MuJoCo, has a ball or free joint and no `base` or `root` is given, has no joint
            that moves, or holds a number that is not finite.

        Warns
        -----
        JounceWarning
            Of what MuJoCo's inverse dynamics has and ours leaves out: other equality constraints, tendons, gravity
            compensation, springs and dampers that are not linear, fluids; and of welded joints.

        Examples
        --------
        >>> import jounce, mujoco
        >>> body = "<body name='arm'><joint name='tilt' axis='0 1 0'/><geom size='0.1' pos='0 0 1'/></body>"
        >>> model = mujoco.MjModel.from_xml_string(f"<mujoco model='m'><worldbody>{body}</worldbody></mujoco>")
        >>> jounce.Robot.from_mujoco(model)
        <Robot 'm': 1 coordinates, 1 bodies>
        """
        from jounce.io.models import mujoco  # what few programs need

        return cls(mujoco.mechanism(model, gravity, base, root))
