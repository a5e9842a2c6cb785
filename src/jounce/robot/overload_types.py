"""Types of arguments of methods with overloads: those of `core.typing`, or a type that nothing has.

Where an argument is wrong, mypy then names it in one line instead of listing all overloads: see `Nothing` there.
"""

from typing import Never, TypeAlias

from jounce.core import typing as types
from jounce.dynamics.quantities import names

Nothing: TypeAlias = types.Nothing[Never]
DriveTerms: TypeAlias = types.DriveTerms | Nothing
Form: TypeAlias = types.Form | Nothing
Frame: TypeAlias = types.Frame | Nothing
LoadFrame: TypeAlias = types.LoadFrame | Nothing
Method: TypeAlias = types.Method | Nothing
Out: TypeAlias = types.Out | Nothing
Product: TypeAlias = types.Product | Nothing
QuantityName: TypeAlias = names.QuantityName | Nothing
