"""Arguments of kernels: what does not fit is refused in words, and those of products are put in a row."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from jounce.core import named_entries
from jounce.core.errors import JounceError
from jounce.core.foreign import has_mask
from jounce.core.scalars import is_traced
from jounce.dynamics.computation import Port, Shape, Signature


def refuse_names_and_masks(kernel: str, arrays: Sequence[Any], out: Sequence[Any]) -> None:
    """Raise `JounceError` for arrays with names or masks, both of which NumPy would drop, and for traced ones."""
    if any(map(is_traced, arrays)):
        raise JounceError(
            f"{kernel} takes arrays of numbers, not those that JAX traces; the methods of a Robot take both, under"
            " jax.jit, jax.vmap and jax.grad"
        )
    if any(named_entries.entry_names(x) is not None or named_entries.names_along_axes(x) for x in (*arrays, *out)):
        raise JounceError(
            f"{kernel} takes arrays without names, in the order of its joints; a Robot's methods match names"
        )
    with suppress(RecursionError):  # a list may hold itself, which NumPy refuses
        if has_mask(list(arrays)):
            raise JounceError(f"{kernel} takes arrays without masks; x.astype(float).filled(numpy.nan) is one")
        if has_mask(list(out)):
            raise JounceError(f"{kernel} writes into arrays without masks; numpy.empty(shape) is one")


def refuse_shapes(kernel: str, ports: Sequence[Port], arrays: Sequence[Any]) -> None:
    """Raise `JounceError` for the first array whose last axes do not fit; what has no shape, NumPy refuses."""
    for port, x in zip(ports, arrays, strict=True):
        try:
            shape = tuple(np.shape(x))
        except Exception:  # ragged lists, or foreign types, which may raise anything
            continue
        if shape[max(0, len(shape) - len(port.shape)) :] != port.shape:
            expected = ", ".join(map(str, ("...", *port.shape)))
            raise JounceError(f"{kernel}: {port.name} has shape {shape}; expected ({expected})")


def check_bound_arrays(
    kernel: str, signature: Signature, arrays: Sequence[np.ndarray], out: Sequence[np.ndarray]
) -> Shape:
    """Return the batch shape of arrays to bind, checked as native code trusts them."""
    taken, given = ([port.shape for port in ports] for ports in (signature.inputs, signature.outputs))
    if (len(arrays), len(out)) != (len(taken), len(given)):
        raise JounceError(
            f"{kernel} binds {len(taken)} arrays and {len(given)} to write into, not {len(arrays)} and {len(out)}:"
            f" it takes {', '.join(port.name for port in signature.inputs)}"
        )
    both = list(zip([*arrays, *out], [*taken, *given], strict=True))
    labels = [*(port.name for port in signature.inputs), *(f"out[{k}]" for k in range(len(out)))]
    for label, (array, shape) in zip(labels, both, strict=True):
        if not isinstance(array, np.ndarray) or array.dtype != np.float64:
            came = f"dtype {array.dtype}" if isinstance(array, np.ndarray) else f"type {type(array).__name__}"
            one = f"numpy.zeros({getattr(array, 'shape', shape)})"
            raise JounceError(
                f"{label} is of {came}, {one} is one to fill: {kernel} binds float64 arrays of NumPy only"
            )
    batch: Shape = both[0][0].shape[: -len(taken[0])]
    wrong = [array.shape for array, shape in both if array.shape != (*batch, *shape)]
    if wrong or len(batch) > 1:
        expected = ", ".join(str(shape) for shape in (*taken, *given))
        raise JounceError(f"{kernel} binds arrays {expected}, all with one batch axis or none, not {wrong or batch}")
    for k, result in enumerate(out):
        if not result.flags.writeable or any(np.shares_memory(result, x) for x in [*arrays, *out[:k]]):
            raise JounceError(f"out[{k}] is read-only or shares memory with another array; expected one of its own")
    return batch


def collect_product_arrays(
    caller: str, values: Signature, product: Signature, arrays: Any, others: Mapping[str, Any]
) -> list[Any]:
    """Return the arrays of a state, then its "weights", "directions" or both, checked, zeros in place of None."""
    found, start = [*_check_tuple(caller, "arrays", values.inputs, arrays)], len(values.inputs)
    for what, given in others.items():
        of_role = [port for port in product.inputs[start:] if (port.role == "weight") == (what == "weights")]
        single = len(of_role) == 1 and type(given) not in (tuple, list)
        checked = _check_tuple(caller, what, of_role, (given,) if single else given)
        found += [np.zeros(port.shape) if x is None else x for port, x in zip(of_role, checked, strict=True)]
    return found


def _check_tuple(caller: str, what: str, ports: Sequence[Port], given: Any) -> Sequence[Any]:
    expected = f"expected a tuple of {len(ports)}: {', '.join(port.name for port in ports)}"
    if type(given) not in (tuple, list):
        raise JounceError(f"{caller}: {what} are of type {type(given).__name__}; {expected}")
    if len(given) != len(ports):
        raise JounceError(f"{caller}: there are {len(given)} {what}; {expected}")
    return given
