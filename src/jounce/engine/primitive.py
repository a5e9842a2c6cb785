"""Register quantities of robots as one primitive of JAX.

It has rules for batches, derivatives and compilation. On the CPU a call is compiled to a custom call of native code, in
double precision whatever the type of the arrays; a jaxlib that does not accept its handler calls Python back instead.
On other platforms, and where there is no native code, XLA compiles the traced law. First and second derivatives are
native products of the derivatives: "jvp" and "vjp", each the transpose of the other, and their derivatives by the
state, "jjvp" and "hvp". Derivatives of these by the state are those of the traced law.

Only backends imports this module, and only for arrays of JAX: it imports JAX itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from math import prod
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import enable_x64, lax
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from jounce.core.scalars import Array, broadcast, is_jax, is_numeric
from jounce.dynamics.computation import (
    SECOND_PRODUCTS,
    Computation,
    Port,
    Signature,
    change,
    commutator,
    displacement,
)
from jounce.engine import generic_methods
from jounce.model.mechanism import Mechanism
from jounce.native import memory_layout, xla
from jounce.native.kernel import Kernel, compile_kernel

TRANSPOSES = {"jvp": "vjp", "vjp": "jvp", "hvp": "jjvp", "jjvp": "hvp"}  # in what follows the state first
DERIVED = {"jvp": None, "jjvp": "jvp", "hvp": "vjp"}  # each of another product along the state, in what comes last
DERIVATIVES = {product: derivative for derivative, product in DERIVED.items()}

quantity_p = Primitive("jounce_quantity")
quantity_p.multiple_results = True


@dataclass(frozen=True)
class Request:
    """A quantity of one robot, or a product of its derivatives: the parameter of the primitive."""

    mechanism: Mechanism
    computation: Computation

    def __repr__(self) -> str:
        return f"<{self.computation.spelling} of {self.mechanism.name!r} to order {self.computation.order}>"

    @cached_property
    def signature(self) -> Signature:
        """The ports of its arrays."""
        return self.computation.signature(self.mechanism)

    @cached_property
    def state(self) -> tuple[Port, ...]:
        """The ports of the quantity itself, of which its products take more."""
        return self.product(None).signature.inputs

    def product(self, name: str | None) -> "Request":
        """Return the request for a product; None is the quantity."""
        return replace(self, computation=replace(self.computation, product=name))

    def split(self, linear_inputs: Sequence[Any]) -> list[Sequence[Any]]:
        """Split what follows the state into linear groups.

        The product is linear in each.
        """
        product = self.computation.product
        # A second product has the weights or directions of the product that it derives, then its own directions.
        first_product = DERIVED[product] if product in SECOND_PRODUCTS else product
        count = len(self.product(first_product).signature.inputs) - len(self.state)
        return [group for group in (linear_inputs[:count], linear_inputs[count:]) if len(group) > 0]

    def kernel(self) -> Kernel | None:
        """Return its native code, or None if it has none.

        However long it takes to compile, XLA would take longer.
        """
        supported = memory_layout.obstacle(self.computation, self.mechanism) is None
        return compile_kernel(self.mechanism, self.computation) if supported else None


def obstacle(arrays: Sequence[Array]) -> str | None:
    """Return why native code does not support arrays, or None.

    The reason is the end of a sentence that begins with "native code".
    """
    if not all(is_jax(x) or is_numeric(x) for x in arrays) or any(x.dtype.kind == "c" for x in arrays):
        return "needs arrays of real numbers"
    sharded = not all(jax.typeof(x).sharding.mesh.empty for x in arrays if is_jax(x))
    return "needs arrays on one device" if sharded else None


request_of = lru_cache(maxsize=256)(Request)  # whose signatures are kept


def compute(request: Request, arrays: Sequence[Array]) -> tuple[Array, ...]:
    """Return the results for arrays of JAX and NumPy.

    They have the common type of the arrays.
    """
    dtype = jnp.result_type(*arrays, float)
    converted = [x if is_jax(x) and x.dtype == dtype else jnp.asarray(x, dtype) for x in arrays]
    operands = _align(request.signature.inputs, converted)
    return tuple(quantity_p.bind(*operands, request=request))


def _align(ports: Sequence[Port], arrays: Sequence[Array]) -> list[Array]:
    """Return arrays that have all batch axes of the results, or none.

    One state that serves a batch has none: native code reads it with a stride of 0, and no copies are made.
    """
    batch, aligned = generic_methods.batch_shape(ports, arrays), []
    for port, x in zip(ports, arrays, strict=True):
        x_batch = x.shape[: x.ndim - len(port.shape)]
        if x_batch == batch:
            aligned.append(x)
        elif prod(x_batch) == 1:
            aligned.append(x.reshape(port.shape))
        else:
            aligned.append(jnp.broadcast_to(x, batch + port.shape))
    return aligned


def _batch(ports: Sequence[Port], arrays: Sequence[Array]) -> tuple[int, ...]:
    """Return the batch shape of aligned arrays: that of all which have one."""
    batches = (x.shape[: x.ndim - len(port.shape)] for port, x in zip(ports, arrays, strict=True))
    return max(batches, key=len)


def _abstract_results(*arrays: Any, request: Request) -> list[ShapedArray]:
    """Return the shapes and the type of the results, without computing them."""
    batch = _batch(request.signature.inputs, arrays)
    return [ShapedArray((*batch, *port.shape), arrays[0].dtype) for port in request.signature.outputs]


def _map_over_axes(
    arrays: Sequence[Array], axes: Sequence[int | None], *, request: Request
) -> tuple[list[Array], list[int]]:
    """Map the primitive over axes: the rule of `jax.vmap`.

    The mapped axis becomes the first batch axis of the same call.
    """
    ports = request.signature.inputs
    # The number of batch axes that each array has without the mapped one.
    batch_axes = [
        x.ndim - (axis is not None) - len(port.shape) for port, x, axis in zip(ports, arrays, axes, strict=True)
    ]
    expanded = []
    for x, axis, count in zip(arrays, axes, batch_axes, strict=True):
        # Fewer batch axes are filled up behind the mapped one, so that those of all arrays stay aligned.
        first = x[None] if axis is None else jnp.moveaxis(x, axis, 0)
        expanded.append(first.reshape((first.shape[0], *[1] * (max(batch_axes) - count), *first.shape[1:])))
    results = quantity_p.bind(*_align(ports, expanded), request=request)
    return results, [0] * len(results)


def _differentiate(
    primals: Sequence[Array], tangents: Sequence[Any], *, request: Request
) -> tuple[list[Array], list[Array]]:
    """Differentiate the primitive along tangents: the rule of `jax.jvp`.

    It is native along weights and directions, and along the state for the quantity and its first products.
    """
    results = quantity_p.bind(*primals, request=request)
    count = len(request.state)
    state, linear_inputs = primals[:count], primals[count:]
    state_tangents, linear_tangents = tangents[:count], tangents[count:]
    # A product is linear in each group of weights or directions: its derivative along a group is the product itself,
    # with the tangents in the place of that group.
    groups, terms = request.split(linear_inputs), []
    for group, along in zip(groups, request.split(linear_tangents), strict=True):
        if not all(type(x) is ad.Zero for x in along):
            inputs = [x for y in groups for x in (along if y is group else y)]
            terms.append(_bind_linear(request, state, inputs))
    # Along the state, the derivative is another product, if there is one, in the directions of displacements: a pose
    # has 16 entries and 6 of these.
    derivative = DERIVATIVES.get(request.computation.product)
    if all(type(x) is ad.Zero for x in state_tangents):
        pass
    elif derivative is not None:
        free = [x for x in zip(request.state, state, state_tangents, strict=True) if x[0].is_free]
        displacement_of = partial(displacement, request.mechanism)
        directions = [dx if type(dx) is ad.Zero else displacement_of(port, x, dx) for port, x, dx in free]
        terms.append(_bind_linear(request.product(derivative), state, [*linear_inputs, *directions]))
    # Third derivatives are those of the traced law.
    else:
        along = tuple(map(ad.instantiate_zeros, state_tangents))
        terms.append(jax.jvp(lambda *x: _trace(*x, *linear_inputs, request=request), tuple(state), along)[1])
    sums = [sum(parts[1:], parts[0]) for parts in zip(*terms, strict=True)]
    return results, [jnp.broadcast_to(x, y.shape) for x, y in zip(sums, results, strict=True)]


def _transpose(cotangents: Sequence[Any], *operands: Any, request: Request) -> list[Array | None]:
    """Transpose a product of the derivatives: the rule of reverse accumulation.

    A product is linear in its weights or directions, of which one group is undefined here.
    """
    count, product = len(request.state), str(request.computation.product)
    state, (first, *second) = operands[:count], request.split(operands[count:])
    # Linear in the first group, weights or directions: cotangents take their place in the transposed product.
    if any(map(ad.is_undefined_primal, first)):
        linear, inputs = first, [*cotangents, *(x for group in second for x in group)]
        transposed = _bind_linear(request.product(TRANSPOSES[product]), state, inputs)
    # Linear in the second group, the directions of second derivatives: the product of the transposed Hessian. "hvp" has
    # weights of its own, "jjvp" gets them as cotangents.
    else:
        (linear,), pair = second, (first, cotangents) if product == "hvp" else (cotangents, first)
        transposed = _bind_transposed_hessian(request, state, *pair)
    gradients = {
        id(x): _fit(y, x.aval.shape) for x, y in zip(linear, transposed, strict=True) if ad.is_undefined_primal(x)
    }
    return [gradients.get(id(x)) for x in operands]


def _bind_transposed_hessian(
    request: Request, state: Sequence[Array], weights: Sequence[Any], along: Sequence[Any]
) -> list[Array]:
    """Return H^T d.

    It differs from H d, the product "hvp", where displacements do not commute.
    """
    products = _bind_linear(request.product("hvp"), state, [*weights, *along])
    free = [port for port in request.state if port.is_free]
    displaced = [k for k, port in enumerate(free) if port.displacement != port.shape and type(along[k]) is not ad.Zero]
    # H^T d = H d - A^T g, with the gradient g and A of the commutator of displacements along d.
    if len(displaced) > 0:
        gradients = _bind_linear(request.product("vjp"), state, weights)
        for k in displaced:
            A = commutator(request.mechanism, free[k], along[k])
            products[k] = products[k] - (A.mT @ gradients[k][..., None])[..., 0]
    return products


def _bind_linear(request: Request, state: Sequence[Array], linear_inputs: Sequence[Any]) -> list[Array]:
    """Return a product of the derivatives.

    Weights or directions may be zeros of JAX.
    """
    ports, dtype = request.signature.inputs[len(state) :], state[0].dtype
    # Zeros are one state for all.
    arrays = [
        jnp.zeros(port.shape, dtype) if type(x) is ad.Zero else x for port, x in zip(ports, linear_inputs, strict=True)
    ]
    return quantity_p.bind(*state, *arrays, request=request)


def _fit(x: Array, shape: tuple[int, ...]) -> Array:
    """Return gradients of states as those by a smaller array.

    They are summed over batch axes that an array of this shape lacks.
    """
    return x.sum(tuple(range(x.ndim - len(shape)))) if x.ndim > len(shape) else jnp.broadcast_to(x, shape)


def _trace(*given: Array, request: Request) -> tuple[Array, ...]:
    """Compute the law, or a product, in operations of JAX."""
    ports, values = request.signature.inputs, request.product(None).computation
    arrays = broadcast(given, [len(port.shape) for port in ports], [port.name for port in ports])
    method, product, dtype = next(iter(values.quantity.laws)), request.computation.product, arrays[0].dtype

    def law(*x: Array) -> tuple[Array, ...]:
        return tuple(y.astype(dtype) for y in generic_methods.compute_by_method(values, method, request.mechanism, x))

    count = len(request.state)
    x, more = arrays[:count], arrays[count:]
    if product is None:
        return law(*x)

    free = [port for port in request.state if port.is_free]
    # A second product is the derivative of a first one along directions, by forward mode. Dependent coordinates, the
    # last input, are no free ones: they have no direction of their own.
    if product in SECOND_PRODUCTS:
        first, directions = request.split(more)
        lower = request.product(DERIVED[product])
        changes = [change(request.mechanism, port, a, d) for port, a, d in zip(free, x, directions, strict=False)]
        changes += [jnp.zeros_like(a) for a in x[len(free) :]]
        return jax.jvp(lambda *x: _trace(*x, *first, request=lower), tuple(x), tuple(changes))[1]

    def displaced(*d: Array) -> tuple[Array, ...]:
        """Return the law at displaced inputs, to first order in d."""
        inputs = (a + change(request.mechanism, port, a, y) for port, a, y in zip(free, x, d, strict=False))
        return law(*inputs, *x[len(free) :])

    # First products are derivatives by displacements, at 0.
    start = [jnp.zeros((*_batch([port], [a]), *port.displacement), dtype) for port, a in zip(free, x, strict=False)]
    return jax.jvp(displaced, start, more)[1] if product == "jvp" else jax.vjp(displaced, *start)[1](tuple(more))


def _call_kernel(*arrays: Array, request: Request) -> tuple[Array, ...]:
    """Call native code, or else the traced law."""
    kernel = request.kernel()
    if kernel is None:
        return _trace(*arrays, request=request)
    ports, dtype = request.signature.inputs, arrays[0].dtype
    batch = _batch(ports, arrays)
    # Handlers have one batch axis, also for one state: (batch, ...) -> (N, ...). What is one state for all stays that.
    shapes = [(prod(batch), *port.shape) for port in request.signature.outputs]
    rows = [
        x.reshape((prod(batch), *port.shape)) if x.ndim > len(port.shape) else x
        for port, x in zip(ports, arrays, strict=True)
    ]
    inside = np.dtype(np.float32 if dtype == np.float32 else np.float64)
    name = xla.register_target(kernel, inside)
    if name is None:
        results = jax.pure_callback(partial(_call_back, kernel), _arrays(shapes, dtype), *rows)
    else:
        # Doubles are enabled inside the compiled function only: what comes and goes has the caller's type.
        with enable_x64(True):
            converted = [lax.convert_element_type(x, inside) for x in rows]
            native_results = jax.ffi.ffi_call(name, _arrays(shapes, inside))(*converted)
            results = [lax.convert_element_type(y, dtype) for y in native_results]
    return tuple(y.reshape((*batch, *y.shape[1:])) for y in results)


def _arrays(shapes: Sequence[tuple[int, ...]], dtype: Any) -> list[jax.ShapeDtypeStruct]:
    return [jax.ShapeDtypeStruct(shape, dtype) for shape in shapes]


def _call_back(kernel: Kernel, *arrays: Any) -> list[np.ndarray]:
    """Return results of native code that Python calls.

    They have a batch axis.
    """
    rows = [np.asarray(x) for x in arrays]
    results = generic_methods.as_tuple(kernel(*(x.astype(np.float64) for x in rows)))
    ports = kernel.signature.outputs
    return [y.astype(rows[0].dtype).reshape((-1, *port.shape)) for port, y in zip(ports, results, strict=True)]


@partial(jax.jit, static_argnames="request")
def _run(*arrays: Array, request: Request) -> list[Array]:
    """Run a call outside of `jax.jit`, compiled once for each shape."""
    return quantity_p.bind(*arrays, request=request)


quantity_p.def_impl(_run)
quantity_p.def_abstract_eval(_abstract_results)
batching.primitive_batchers[quantity_p] = _map_over_axes
ad.primitive_jvps[quantity_p] = _differentiate
ad.primitive_transposes[quantity_p] = _transpose
mlir.register_lowering(quantity_p, mlir.lower_fun(_trace, multiple_results=True))
mlir.register_lowering(quantity_p, mlir.lower_fun(_call_kernel, multiple_results=True), platform="cpu")
