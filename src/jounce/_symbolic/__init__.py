"""The equations of motion as SymPy expressions: the recursion run on scalars that have a normal form.

`waves` is that scalar, `terms` takes SymPy expressions in and gives them out, `equations` is what users hold.
"""

from jounce._symbolic.equations import Symbolic, symbolic

__all__ = ["Symbolic", "symbolic"]
