"""MAT tables: the variables of a MATLAB file, with fields of structs as STRUCT.FIELD."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from jounce.core.errors import JounceError, one_line
from jounce.io.columns import Columns, Select, checked, flatten, select_columns
from jounce.io.files import opened


def pieces(path: Path, select: Select | None = None) -> Iterator[Columns]:
    """The table of a file, in one piece: vectors are columns, matrices columns NAME[0], NAME[1], ..."""
    from scipy.io import loadmat  # half a second to import, and only for such files

    with opened(path) as file:
        try:
            content = loadmat(cast(Any, file), simplify_cells=True)
        except NotImplementedError:
            raise JounceError(f"{path}: MAT file of version 7.3; save it in MATLAB with -v7") from None
        except Exception as error:  # damaged files raise whatever their reader stumbles over
            raise JounceError(f"{path}: not a MAT file: {one_line(error) or type(error).__name__}") from None
    arrays = flatten(dict(_arrays({k: v for k, v in content.items() if not k.startswith("__")}, "")))
    yield checked(path, select_columns(arrays, select))


def _arrays(content: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, np.ndarray]]:
    for name, value in content.items():
        if isinstance(value, Mapping):
            yield from _arrays(value, f"{prefix}{name}.")
        elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
            yield f"{prefix}{name}", value
