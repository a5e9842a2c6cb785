"""`compile`: a quantity of a robot as a kernel for a GPU, its arguments checked."""

from typing import Any

import numpy as np

from jounce.arguments import requests
from jounce.core.errors import JounceError, check_choice, quote_value
from jounce.core.typing import Frame, Product
from jounce.cuda.kernel import CudaKernel
from jounce.dynamics import elastic
from jounce.dynamics.computation import SECOND_PRODUCTS
from jounce.dynamics.quantities.names import QuantityName
from jounce.dynamics.quantities.needs import ELASTIC
from jounce.engine.engine import Engine

DTYPES = ("float64", "float32")


def compile(  # noqa: A001  # what Robot.compile is to processors
    robot: Engine,
    quantity: QuantityName = "inverse_dynamics",
    order: int = 2,
    wrench: bool = False,
    *,
    body: str | None = None,
    frame: Frame = "body",
    product: Product | None = None,
    moving_base: bool = False,
    dtype: Any = "float64",
) -> CudaKernel:
    """Compile a quantity and its rates up to an order for a GPU.

    The code is that of `Robot.codegen`, straight-line CUDA for this robot, one state per thread. NVRTC compiles it
    through CuPy, which keeps it on disk.

    Parameters
    ----------
    robot : Robot
        A robot of numbers.
    quantity : str, optional
        The name of the method: "inverse_dynamics", "mass_matrix", "jacobian", ...
    order : int, optional
        The highest rate of the quantity, up to 4: 2 gives Q, Qd, Q2d.
    wrench : bool, optional
        Whether wrenches W, Wd, ... (..., nb, 6) follow the coordinates' rates in its calls.
    body, frame : str, optional
        Body or merged link, and frame, of poses, twists and Jacobians; all bodies by default.
    product : {"vjp", "jvp"}, optional
        Products of the derivatives by all inputs instead of the values, see `Robot.compile`.
    moving_base : bool, optional
        Whether the motion of the base, C, V, Vd, ..., follows in its calls; it always does if the robot floats.
    dtype : {"float64", "float32"}, optional
        Precision of the arrays and of the computation.

    Returns
    -------
    Kernel
        To call as ``kernel(q, qd, q2d, q3d, q4d)`` on arrays on a GPU.

    Raises
    ------
    JounceError
        If a name is unknown, the robot holds symbols or is too large for straight-line code, CuPy is missing, or there
        is no GPU.

    Examples
    --------
    >>> import cupy, jounce, jounce.cuda  # doctest: +SKIP
    >>> kernel = jounce.cuda.compile(jounce.load("iiwa14"), order=2)  # doctest: +SKIP
    >>> q, qd, q2d, q3d, q4d = cupy.ones((5, 100_000, 7))  # doctest: +SKIP
    >>> Q, Qd, Q2d = kernel(q, qd, q2d, q3d, q4d)  # doctest: +SKIP
    """
    if not isinstance(robot, Engine):
        raise JounceError(f"jounce.cuda.compile() expects a jounce.Robot, got {type(robot).__name__}; try jounce.load")
    asked = requests.build_computation(robot.mechanism, quantity, order, wrench, body, frame, product, moving_base)
    if product in SECOND_PRODUCTS:
        raise JounceError(f"CUDA code has no {product}; robot.compile(..., product={product!r}) runs on the CPU")
    if not robot.mechanism.is_numeric:
        raise JounceError("CUDA code needs a robot of numbers; this one contains symbols")
    if ELASTIC in asked.quantity.needs and (refusal := elastic.native_obstacle(robot.mechanism)):
        raise JounceError(f"CUDA code {refusal}")
    return CudaKernel(robot.mechanism, asked, _precision(dtype))


def _precision(dtype: Any) -> str:
    """The name of a precision that a caller gives as a string, a type or a dtype."""
    try:
        name = dtype if isinstance(dtype, str) or dtype is None else np.dtype(dtype).name
    except TypeError:
        name = quote_value(dtype)
    return check_choice("dtype", name, DTYPES)
