"""The equations of motion as SymPy expressions: the recursion run on scalars that have a normal form.

`trig_polynomial` holds that scalar, `terms` converts it from and to SymPy expressions, `equations` is the public part.
"""

from jounce._codegen.symbolic.equations import Symbolic, symbolic

__all__ = ["Symbolic", "symbolic"]
