"""CUDA source of a computation, and its compilation: the function that `codegen` writes, and a kernel over arrays.

A thread computes one state. Neighbouring threads read and write neighbouring numbers: directly where the states of an
entry lie one behind the other, through a tile of shared memory where the entries of a state do.
"""

from typing import TYPE_CHECKING

from jounce._codegen import render
from jounce._codegen.generate import trace_functions
from jounce._codegen.language import language
from jounce._codegen.options import CodegenOptions, check_size
from jounce._codegen.parametric import make_parametric
from jounce.core.errors import JounceError, one_line
from jounce.dynamics.computation import Computation
from jounce.model.mechanism import Mechanism

if TYPE_CHECKING:
    import cupy

THREADS_PER_BLOCK = 128  # with 255 registers each, two blocks fit on a multiprocessor
KERNEL_NAME = "states"  # of the function in the template


def source(mechanism: Mechanism, computation: Computation, single: bool) -> str:
    """Return CUDA source of a computation for a robot of numbers, unless it is too large for straight-line code."""
    check_size(mechanism, computation.order)
    options = CodegenOptions(
        make_parametric(mechanism, ()), language("cuda"), computation.order, {"compute": computation}, single, "jounce"
    )
    states = render.render_template(options, trace_functions(options), "_states.cu")
    return f"#define THREADS {THREADS_PER_BLOCK}\n{states}"


def require_gpu() -> None:
    """Raise `JounceError` if CuPy or a GPU is missing."""
    try:
        import cupy
    except ImportError:
        raise JounceError(
            "jounce.cuda needs CuPy; install it by: pip install 'jounce[cuda12]', or 'jounce[cuda13]' for drivers of"
            " CUDA 13"
        ) from None
    try:
        found = cupy.cuda.runtime.getDeviceCount() > 0
        why = ""
    except Exception as error:  # no driver, or one too old
        found, why = False, f": {one_line(error)}"
    if not found:
        raise JounceError(f"jounce.cuda needs an NVIDIA GPU; CuPy finds none{why}")


def compile_source(code: str) -> "cupy.RawKernel":
    """Return the kernel of CUDA source, compiled for the current GPU; for others it is at the first call there."""
    import cupy

    try:
        function = cupy.RawKernel(code, KERNEL_NAME, options=("-std=c++17",))
        function.compile()
    except Exception as error:  # libraries that are missing, and what NVRTC says
        raise JounceError(f"CUDA code was not compiled: {one_line(error)}") from None
    return function
