"""Robot: what users hold. It checks at the door, then calls one function a method."""

from jounce.robot.bodies import Bodies
from jounce.robot.constructors import Construction
from jounce.robot.forces import Forces
from jounce.robot.models import Models


class Robot(Forces, Bodies, Construction, Models):
    """A robot: its mechanism, and the quantities of its equations of motion along a motion.

    Build one by `jounce.load` or by one of the constructors `Robot.from_...`.

    Conventions of every method:

    * SI units. Twists, screws and wrenches are (angular; linear).
    * Leading axes are batch axes and broadcast; the coordinate axis is last. Any real scalars: NumPy, JAX, or object
      arrays of CasADi SX, SymPy or other symbols.
    * A state may name its coordinates: a dict, a data frame or series, a structured array, matched by joint name.
      Results are arrays all the same, in the order of `joint_names`.
    * q is required; each further rate you give returns one more time derivative, up to order 100. With none to spare
      the result is a plain array, otherwise a tuple: the quantity, its rate, ...
    * What is missing, masked by NumPy or NA of pandas, is NaN, and so is what depends on it.
    * ``method`` picks the path: "kernel", native code, the default of float64 NumPy arrays where there is one;
      "recursion", the default of all else; "closed_form" or "paper". All agree. The first call that native code serves
      compiles it, in a fraction of a second, and keeps it on disk for the next process.
    * ``out`` takes the NumPy array (or the tuple of them) to write into; ``threads`` splits a batch for native code.

    Errors: `JounceError` for a wrong shape, a skipped rate, an unknown name or method, an `out` that does not fit.
    """


__all__ = ["Robot"]
