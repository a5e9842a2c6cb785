"""Robots in the YAML or JSON description of the generator skidy 0.0.1, if every symbol has a number.

The format, and the places where skidy's own reader interprets a file differently from what it states:

* Twists, screws and wrenches are (angular; linear), gravity is an acceleration: all as here.
* ``representation: spatial`` (where left out) states absolute poses A_i and screws Y_i in the inertial frame,
  ``body_fixed`` poses B_i relative to the parent and screws X_i in the body frame.
* Bodies count from 1; parent 0 is the world. skidy takes a tree only where `parent` and `support` both stand, and a
  chain otherwise, whatever `parent` says: a tree without `support` is refused here. Its own template counts `child`
  wrongly, and nothing depends on it: it is passed over.
* ``inertia`` is about the origin of the body in ``frame: body`` (where left out), about the COM in ``frame: com``. Once
  one body says ``com``, skidy takes it for all later ones that leave `frame` out: such files are refused here.
* Axes and quaternions are not normalised there; here they must have unit length.
"""

from jounce.io.skidy.reading import read

__all__ = ["read"]
