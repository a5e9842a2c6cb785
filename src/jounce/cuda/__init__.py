"""Quantities of a robot on NVIDIA GPUs: the CUDA code of `codegen`, compiled at run time and called on arrays there.

`compilation` checks what is asked for, `source` writes the code and compiles it through CuPy, `kernel` launches it,
`arrays` turns arrays into addresses and steps. CuPy is imported by `compile`.
"""

from jounce.cuda.compilation import compile  # noqa: A004
from jounce.cuda.kernel import CudaKernel as Kernel

__all__ = ["Kernel", "compile"]
