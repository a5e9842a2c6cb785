"""Objects that many tasks share: every process unpickles them once and keeps them, with the native code of robots."""

import pickle
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Generic, TypeVar

from jounce.core.errors import JounceError, one_line

T = TypeVar("T")


@dataclass(frozen=True)
class Pickled(Generic[T]):
    """An object as bytes. `value` is the same object for all tasks of a process, as long as it uses few others."""

    data: bytes

    @property
    def value(self) -> T:
        """The object."""
        found: T = _load(self.data)
        return found


def pickle_object(value: T) -> Pickled[T]:
    """Pickle an object, functions that only this process knows included; `JounceError` if that is impossible."""
    import cloudpickle

    try:
        return Pickled(cloudpickle.dumps(value))
    except Exception as error:  # foreign types may raise anything
        raise JounceError(
            f"{type(value).__name__} cannot be sent to other processes: {one_line(error)}; functions in it, such as"
            " laws of springs, may refer to what can be pickled alone"
        ) from None


@lru_cache(maxsize=32)
def _load(data: bytes) -> Any:
    return pickle.loads(data)
