"""What `jounce.cuda` uses of CuPy, on the processor: arrays are NumPy's, kernels are compiled by g++ through a shim.

Threads of a block are coroutines that take turns at `__syncthreads()`: each runs as far as it can before the next one
begins, so that one that is missing shows in the results.
"""

import ctypes
import subprocess
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import numpy as np

SHIM = """
#include <math.h>
#include <stddef.h>
#include <ucontext.h>
#include <utility>
#include <vector>
#define __device__
#define __global__
#define __shared__ static
#define __launch_bounds__(threads)
struct Index { unsigned x; };
static Index blockIdx, threadIdx;
static ucontext_t caller, *current;
static void __syncthreads() { swapcontext(current, &caller); }
"""
LAUNCH = """
static void **given;
static bool *ended;
template <typename... T, size_t... I>
static void call(void (*kernel)(T...), std::index_sequence<I...>) { kernel(*static_cast<T *>(given[I])...); }
template <typename... T>
static void call(void (*kernel)(T...)) { call(kernel, std::index_sequence_for<T...>{}); }
static void thread() { call(states); *ended = true; }

extern "C" int launch(unsigned blocks, void **arguments)
{
    static char stacks[THREADS][1 << 16];
    static ucontext_t contexts[THREADS];
    given = arguments;
    for (blockIdx.x = 0; blockIdx.x < blocks; blockIdx.x++) {
        std::vector<char> done(THREADS);
        for (unsigned k = 0; k < THREADS; k++) {
            getcontext(&contexts[k]);
            contexts[k].uc_stack.ss_sp = stacks[k];
            contexts[k].uc_stack.ss_size = sizeof stacks[k];
            contexts[k].uc_link = &caller;
            makecontext(&contexts[k], thread, 0);
        }
        for (unsigned left = THREADS; left;) {
            const unsigned before = left;
            for (threadIdx.x = 0; threadIdx.x < THREADS; threadIdx.x++) {
                if (done[threadIdx.x])
                    continue;
                bool end = false;
                ended = &end;
                current = &contexts[threadIdx.x];
                swapcontext(&caller, current);
                done[threadIdx.x] = end;
                left -= end;
            }
            if (left && left != before)
                return 1; /* some threads ended while others wait for them: a GPU would hang */
        }
    }
    return 0;
}
"""


class Device:
    """The only one."""

    id = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


class ndarray(np.ndarray):  # noqa: N801
    """An array of NumPy that tells where it is as one of CuPy does."""

    @property
    def data(self):
        return SimpleNamespace(ptr=self.__array_interface__["data"][0])

    @property
    def device(self):
        return Device()


class CUDARuntimeError(RuntimeError):
    pass


class CUDADriverError(RuntimeError):
    pass


class OutOfMemoryError(MemoryError):
    pass


@cache
def library(code):
    """The shared library of CUDA source."""
    with TemporaryDirectory() as folder:
        source, made = Path(folder, "kernel.cpp"), Path(folder, "kernel.so")
        source.write_text(f"{SHIM}\n{code}\n{LAUNCH}")
        command = ["g++", "-std=c++17", "-O0", "-shared", "-fPIC", "-Wall", "-Wno-unknown-pragmas", "-o", made, source]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode or done.stderr:
            raise RuntimeError(done.stderr)
        return ctypes.CDLL(made)


class RawKernel:
    """A kernel of CUDA source with the name `states`."""

    def __init__(self, code, name, options):
        assert (name, options) == ("states", ("-std=c++17",))
        self.code = code

    def compile(self):
        self.library = library(self.code)

    def __call__(self, grid, block, args):
        assert len(grid) == len(block) == 1
        values = [ctypes.c_void_p(x.data.ptr) if isinstance(x, ndarray) else ctypes.c_longlong(x) for x in args]
        assert all(isinstance(x, ndarray | np.int64) for x in args)
        places = (ctypes.c_void_p * len(values))(*(ctypes.addressof(value) for value in values))
        if self.library.launch(grid[0], places):
            raise CUDADriverError("CUDA_ERROR_LAUNCH_FAILED: threads of a block do not meet")


def asarray(x):
    interface = getattr(x, "__cuda_array_interface__", None)
    return np.asarray(x if interface is None else SimpleNamespace(__array_interface__=interface)).view(ndarray)


def empty(shape, dtype):
    return np.full(shape, np.nan, dtype).view(ndarray)


def ones(shape):
    return np.ones(shape).view(ndarray)


def from_dlpack(x):
    return np.from_dlpack(x).view(ndarray)


def broadcast_to(x, shape):
    return np.broadcast_to(x, shape, subok=True)


def ascontiguousarray(x):
    return np.ascontiguousarray(x).view(ndarray)


may_share_memory = np.may_share_memory
cuda = SimpleNamespace(
    runtime=SimpleNamespace(getDeviceCount=lambda: 1, CUDARuntimeError=CUDARuntimeError),
    driver=SimpleNamespace(CUDADriverError=CUDADriverError),
    memory=SimpleNamespace(OutOfMemoryError=OutOfMemoryError),
    get_current_stream=lambda: SimpleNamespace(synchronize=lambda: None),
)
