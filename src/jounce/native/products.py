"""Compute products of the derivatives of kernels.

A kernel compiles a product when it is first asked for it, and keeps it.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Generic

import numpy as np

from jounce.core.errors import JounceError, check_bool
from jounce.core.typing import ArrayLike, Floats, Product
from jounce.dynamics.computation import Computation, Port, Signature, commutator, number_scalars
from jounce.model.mechanism import Mechanism
from jounce.native import memory_layout

if TYPE_CHECKING:
    from typing_extensions import TypeVar  # type checkers have it, and know its defaults

    Results = TypeVar("Results", default=Any)
else:
    from typing import TypeVar

    Results = TypeVar("Results")


class DerivativeProducts(ABC, Generic[Results]):
    """What a `Kernel` computes of the derivatives of its quantity."""

    mechanism: Mechanism
    computation: Computation
    signature: Signature
    _products: dict[Product, "DerivativeProducts[Any]"]  # the kernels that it has compiled

    @abstractmethod
    def _compile(self, computation: Computation, patience: float) -> "DerivativeProducts[Any]":
        """The kernel of another computation of the robot."""

    def vjp(
        self,
        arrays: Sequence[ArrayLike],
        weights: ArrayLike | Sequence[ArrayLike | None],
        *,
        out: Floats | Sequence[Floats] | None = None,
        threads: int = 1,
    ) -> tuple[Floats, ...]:
        """Compute a vector-Jacobian product: the gradients, by all inputs, of a weighted sum of all results.

        ``gx = sum_y (dy/dx)^T wy`` over the results y, such as Q, Qd, Q2d, for every input x, such as q, qd, q2d. This
        is the gradient of a cost c(Q, Qd, Q2d) where the weights are its derivatives by Q, Qd and Q2d. It is exact,
        and takes about 2.5 times the operations of the results. Native code of it is compiled at the first call and
        kept on disk.

        Parameters
        ----------
        arrays : tuple of arrays, each (..., n), then (..., nb, 6), then (..., 4, 4) and (..., 6)
            What a call of the kernel takes: q, qd, ..., W, Wd, ..., C, V, Vd, ...
        weights : array or tuple of arrays, each of the shape of a result
            wQ, wQd, ..., one for each result; None is zero. Where the kernel returns one array, an array.
        out : tuple of arrays, optional
            Arrays to write the gradients into.
        threads : int, optional
            Number of threads to split the batch among.

        Returns
        -------
        tuple of arrays
            gq, gqd, ..., gW, ..., one for each input, in the unit of the weighted sum per unit of the input. Batch axes
            broadcast: there is a gradient for each state, also by an input that all states share. Wrenches are constant
            in the axes of their bodies while q varies. The gradient by the pose C of the base, (..., 6), is that along
            twists d in its axes, for steps C exp(wedge(d)). Dependent coordinates of a closed robot follow q: there is
            no gradient by them, the one by q contains it.

        Raises
        ------
        JounceError
            If the number of arrays or weights, a shape or a dtype is wrong, an array has names or a mask, the kernel is
            one of products itself, or compiling takes longer than three seconds, which `Robot.compile` is for.

        References
        ----------
        .. [1] A. Griewank, A. Walther, *Evaluating Derivatives*, 2nd ed., SIAM 2008, chapter 3.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> kernel = jounce.load("planar2r").compile(order=1)
        >>> q, qd, q2d, q3d = np.ones((4, 2))
        >>> Q, Qd = kernel(q, qd, q2d, q3d)
        >>> gq, gqd, gq2d, gq3d = kernel.vjp((q, qd, q2d, q3d), (None, 2 * Qd))  # of the cost |Qd|^2
        >>> h = np.array([1e-6, 0])
        >>> higher, lower = (np.sum(kernel(x, qd, q2d, q3d)[1] ** 2) for x in (q + h, q - h))
        >>> bool(np.isclose(gq[0], (higher - lower) / 2e-6))
        True
        """
        kernel, given = self._product("vjp", arrays, weights=weights)
        gradients = kernel(*given, out=out, threads=threads)
        return gradients if isinstance(gradients, tuple) else (gradients,)

    def jvp(
        self,
        arrays: Sequence[ArrayLike],
        directions: Sequence[ArrayLike | None],
        *,
        out: Floats | Sequence[Floats] | None = None,
        threads: int = 1,
    ) -> Results:
        """Compute a Jacobian-vector product: the derivatives of all results along one direction of all inputs.

        ``dy = sum_x (dy/dx) dx`` over the inputs x, such as q, qd, q2d, for every result y, such as Q, Qd, Q2d. Native
        code of it is compiled at the first call and kept on disk.

        Parameters
        ----------
        arrays : tuple of arrays, each (..., n), then (..., nb, 6), then (..., 4, 4) and (..., 6)
            What a call of the kernel takes: q, qd, ..., W, Wd, ..., C, V, Vd, ...
        directions : tuple of arrays, each of the shape of an input
            dq, dqd, ..., dW, ..., one for each input; None is zero. That of the pose C of the base is a twist d in its
            axes, (..., 6), of a step C exp(wedge(d)). Dependent coordinates of a closed robot have none: they follow q.
        out : array or tuple of arrays, optional
            Arrays to write the tangents into.
        threads : int, optional
            Number of threads to split the batch among.

        Returns
        -------
        array, or for orders above 0 a tuple of arrays
            dQ, dQd, ..., one for each result, as a call of the kernel returns them.

        Raises
        ------
        JounceError
            As in `vjp`.

        References
        ----------
        .. [1] A. Griewank, A. Walther, *Evaluating Derivatives*, 2nd ed., SIAM 2008, chapter 3.

        Examples
        --------
        Along the rates themselves, the tangent of Q is its time derivative:

        >>> import jounce, numpy as np
        >>> kernel = jounce.load("planar2r").compile(order=1)
        >>> q, qd, q2d, q3d = np.random.default_rng(0).normal(size=(4, 2))
        >>> Q, Qd = kernel(q, qd, q2d, q3d)
        >>> dQ, dQd = kernel.jvp((q, qd, q2d, q3d), (qd, q2d, q3d, None))
        >>> bool(np.allclose(dQ, Qd))
        True
        """
        kernel, given = self._product("jvp", arrays, directions=directions)
        result: Results = kernel(*given, out=out, threads=threads)
        return result

    def hvp(
        self,
        arrays: Sequence[ArrayLike],
        weights: ArrayLike | Sequence[ArrayLike | None],
        directions: Sequence[ArrayLike | None],
        *,
        symmetric: bool = False,
        out: Floats | Sequence[Floats] | None = None,
        threads: int = 1,
    ) -> tuple[Floats, ...]:
        """Compute a Hessian-vector product: the derivatives of the gradients of `vjp` along a direction.

        ``hx = sum_z (d2f/dx dz) dz`` with ``f = sum_y y . wy``, for every input x; z are all inputs too. It takes about
        2.4 times the operations of `vjp`. The weights are constant; what is not said here is as in `vjp` and `jvp`.

        Parameters
        ----------
        arrays, weights, directions : tuple of arrays
            q, qd, ..., then wQ, wQd, ..., then dq, dqd, ...; None is zero.
        symmetric : bool, optional
            Displacements of a pose C, by C exp(wedge(d)), and of one joint of several columns do not commute: with the
            Hessian H and the gradient g, ``a . H b - b . H a = g . [b, a]``, of twists ``ad(b) a``. False: H b is the
            derivative of the gradient along b. True: it is the mean of both orders, the Hessian of f as a function of d
            at 0, which steps of solvers take. By other inputs, H is symmetric.
        out, threads : optional
            As in `vjp`.

        Returns
        -------
        tuple of arrays
            hq, hqd, ..., of the shapes that `vjp` returns.

        Raises
        ------
        JounceError
            As in `vjp`.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> kernel = jounce.load("planar2r").compile(order=0)
        >>> (*x, w), d = np.ones((4, 2)), np.array([1.0, 0.0])
        >>> hq, hqd, hq2d = kernel.hvp(x, w, (d, None, None))
        >>> H = kernel.hessian(x, w)
        >>> bool(np.allclose(hqd, H["qd", "q"] @ d))
        True
        """
        kernel, given = self._product("hvp", arrays, weights=weights, directions=directions)
        # H d is the derivative of the gradient along d.
        products = kernel(*given, out=out, threads=threads)
        products = products if isinstance(products, tuple) else (products,)
        free = [port for port in self.signature.inputs if port.is_free]
        displaced = [k for k, port in enumerate(free) if port.displacement != port.shape]
        about = "whether the mean of both orders of derivatives is the result"
        # The mean of H d and H^T d: they differ by g . [d, .] for inputs whose displacements do not commute.
        if check_bool("symmetric", symmetric, about) and len(displaced) > 0:
            gradients, along = self.vjp(arrays, weights, threads=threads), given[-len(free) :]
            for k in displaced:
                A = commutator(self.mechanism, free[k], np.asarray(along[k], float))
                products[k][...] -= 0.5 * (A.mT @ gradients[k][..., None])[..., 0]
        return products

    def hessian(
        self,
        arrays: Sequence[ArrayLike],
        weights: ArrayLike | Sequence[ArrayLike | None],
        *,
        symmetric: bool = False,
        out: Floats | None = None,
        threads: int = 1,
    ) -> dict[tuple[str, str], Floats]:
        """Compute the Hessian of a weighted sum of all results, in blocks.

        ``H[x, z] = d2f/dx dz`` with ``f = sum_y y . wy``. One program computes all blocks in the time of about four
        calls of `hvp`. The weights are constant; what is not said here is as in `vjp`.

        Parameters
        ----------
        arrays, weights : tuple of arrays
            q, qd, ..., then wQ, wQd, ...
        symmetric : bool, optional
            Whether blocks by a pose, and by joints of several columns, are made symmetric, see `hvp`.
        out : array (..., N, N), optional
            Array to write the whole matrix into, the N entries of all inputs one after the other.
        threads : int, optional
            As in `vjp`.

        Returns
        -------
        dict of arrays
            Blocks by the names of two inputs, for all pairs: ``H["q", "qd"]`` is (..., n, n); a wrench has two axes.
            They are views of one matrix, which ``robot.compile(..., product="hessian")`` returns.

        Raises
        ------
        JounceError
            As in `vjp`.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> robot, q = jounce.load("planar2r"), np.ones(2)
        >>> H = robot.compile("potential_energy", order=0).hessian((q,), 1.0)
        >>> bool(np.allclose(H["q", "q"], robot.inverse_dynamics_partials(q, 0 * q, 0 * q)[0]))
        True
        """
        kernel, given = self._product("hessian", arrays, weights=weights)
        H = kernel(*given, out=out, threads=threads)
        if check_bool("symmetric", symmetric, "whether blocks of displacements are made symmetric"):
            H[...] = (H + H.mT) / 2
        # Blocks are views of H, (..., N, N), by the displacements of the free inputs one after the other.
        free = number_scalars([replace(x, shape=x.displacement) for x in self.signature.inputs if x.is_free])
        return {
            (x.name, z.name): H[..., x.start : x.end, z.start : z.end].reshape((*H.shape[:-2], *x.shape, *z.shape))
            for x in free
            for z in free
        }

    def _product(self, name: Product, arrays: Any, **others: Any) -> tuple[Any, list[Any]]:
        """Return the kernel of a product, and all its arrays."""
        try:
            kernel = self._products.get(name)
            if kernel is None:
                kernel = self._products[name] = self._compile_product(name)
            given = collect_product_arrays(f"{name} of {self!r}", self.signature, kernel.signature, arrays, others)
        except JounceError as error:
            # A copy, as of `door`: users see their line, the method and this one.
            raise copy(error) from None
        return kernel, given

    def _compile_product(self, name: Product) -> "DerivativeProducts[Any]":
        """Compile the kernel of a product, unless that takes long."""
        if self.computation.product is not None:
            raise JounceError(f"{self!r} has no {name}: it computes derivatives itself; compile the values for theirs")
        computation = replace(self.computation, product=name)
        refusal = memory_layout.obstacle(computation, self.mechanism)
        if refusal is not None:
            raise JounceError(f"{name} of {self!r}: native code {refusal}; choose a lower order")
        cure = ", or hvp computes its columns" if name == "hessian" else ""
        try:
            return self._compile(computation, memory_layout.MAX_COMPILE_SECONDS)
        except memory_layout.LongCompilationError:
            raise JounceError(
                f"{name} of {self!r} takes longer than {memory_layout.MAX_COMPILE_SECONDS:g} s to compile;"
                f" robot.compile({', '.join(computation.keywords())}) compiles it once{cure}"
            ) from None


def collect_product_arrays(
    caller: str, values: Signature, product: Signature, arrays: Any, others: Mapping[str, Any]
) -> list[Any]:
    """Return the arrays of a product, checked.

    They are those of a state, then "weights", "directions" or both. None stands for zeros.
    """
    collected, start = [*_check_tuple(caller, "arrays", values.inputs, arrays)], len(values.inputs)
    for what, terms in others.items():
        ports = [port for port in product.inputs[start:] if (port.role == "weight") == (what == "weights")]
        # A kernel with one result takes one array of weights, without a tuple around it.
        is_single = len(ports) == 1 and type(terms) not in (tuple, list)
        checked = _check_tuple(caller, what, ports, (terms,) if is_single else terms)
        collected += [np.zeros(port.shape) if x is None else x for port, x in zip(ports, checked, strict=True)]
    return collected


def _check_tuple(caller: str, what: str, ports: Sequence[Port], terms: Any) -> Sequence[Any]:
    """Return a tuple or list with one entry for each port, checked."""
    expected = f"expected a tuple of {len(ports)}: {', '.join(port.name for port in ports)}"
    if type(terms) not in (tuple, list):
        raise JounceError(f"{caller}: {what} are of type {type(terms).__name__}; {expected}")
    if len(terms) != len(ports):
        raise JounceError(f"{caller}: there are {len(terms)} {what}; {expected}")
    return terms
