"""`jounce.cuda`: results, layouts, launches, refusals; by a shim on the processor, and on a GPU where there is one."""

import pickle
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import jounce
import jounce.cuda
from jounce import cuda as device
from jounce.cuda import THREADS_PER_BLOCK, source
from jounce.engine import generic_methods
from support import cupy_on_cpu
from support.refusals import expect_refusal, refusal
from support.robots import relative_error
from support.tools import obstacle

BATCH = 2 * THREADS_PER_BLOCK + 37  # three blocks, the last one not full


def gpu():
    """CuPy where there is a GPU."""
    cupy = pytest.importorskip("cupy", reason="CuPy is not installed")
    try:
        cupy.cuda.runtime.getDeviceCount()
    except Exception as error:
        pytest.skip(f"no GPU: {error}")
    return cupy


@pytest.fixture(scope="module", params=["shim", "GPU"])
def cupy(request):
    if request.param == "GPU":
        yield gpu()
        return
    if found := obstacle("g++"):
        pytest.skip(found)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "cupy", cupy_on_cpu)
        yield cupy_on_cpu


CASES = {  # arrays of few numbers, of one, and wider than a tile; with wrenches and the motion of the base
    "forces": ("inverse_dynamics", {"order": 1, "wrench": True, "moving_base": True}),
    "matrix": ("mass_matrix", {"order": 0}),
    "poses": ("poses", {"order": 0}),
    "energy": ("kinetic_energy", {"order": 1}),
    "single": ("inverse_dynamics", {"order": 0, "dtype": np.float32}),
}


@pytest.fixture(scope="module")
def kernels(cupy):
    """Kernels by the names of cases, each compiled once."""
    robot, made = jounce.load("planar2r"), {}

    def kernel(case):
        if case not in made:
            quantity, options = CASES[case]
            made[case] = (
                jounce.cuda.compile(robot, quantity, **options),
                robot.compile(quantity, **{key: x for key, x in options.items() if key != "dtype"}),
            )
        return made[case]

    return kernel


def kernel_arrays(kernel, *batch):
    rng = np.random.default_rng(0)
    return [rng.normal(size=(*batch, *port.shape)).astype(kernel.dtype) for port in kernel.signature.inputs]


def host_numbers(x):
    """The numbers of an array on a GPU."""
    return x.get() if hasattr(x, "get") else np.asarray(x)


def assert_agree(found, expected, dtype):
    for x, y in zip(generic_methods.as_tuple(found), generic_methods.as_tuple(expected), strict=True):
        assert (x.shape, x.dtype) == (y.shape, dtype)
        assert relative_error(host_numbers(x).astype(float), y) < (1e-13 if dtype == np.float64 else 1e-5)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("batch", [(BATCH,), (), (1,), (0,), (3, 1, 50)])
def test_agrees_with_native_code(cupy, kernels, case, batch):
    kernel, native = kernels(case)
    arrays = kernel_arrays(kernel, *batch)
    found = kernel(*map(cupy.asarray, arrays))
    assert all(isinstance(x, cupy.ndarray) for x in generic_methods.as_tuple(found))
    assert_agree(found, native(*arrays), kernel.dtype)


LAYOUTS = {
    "states behind one another": lambda x: np.asfortranarray(x),
    "every other state": lambda x: np.repeat(x, 2, axis=0)[::2],
    "every other entry": lambda x: np.repeat(x, 2, axis=-1)[..., ::2],
    "reversed": lambda x: x[::-1].copy()[::-1],
    "padded rows": lambda x: np.concatenate([x, x], axis=1)[:, : x.shape[1]],
    "transposed entries": lambda x: x.swapaxes(-1, -2).copy().swapaxes(-1, -2) if x.ndim > 2 else x,
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("case", ["forces", "matrix", "energy"])
def test_arrays_and_results_may_have_any_layout(cupy, kernels, case, layout):
    kernel, native = kernels(case)
    arrays = kernel_arrays(kernel, BATCH)
    expected = generic_methods.as_tuple(native(*arrays))
    assert_agree(kernel(*(cupy.asarray(LAYOUTS[layout](x)) for x in arrays)), expected, kernel.dtype)
    out = [
        cupy.asarray(LAYOUTS[layout](np.full(x.shape, np.nan)) if x.ndim > 1 else np.zeros(x.shape)) for x in expected
    ]
    found = kernel(*map(cupy.asarray, arrays), out=tuple(out))
    assert all(x is y for x, y in zip(generic_methods.as_tuple(found), out, strict=True))
    assert_agree(found, expected, kernel.dtype)


def test_nothing_is_written_beside_the_results(cupy, kernels):
    kernel, native = kernels("matrix")
    [q] = kernel_arrays(kernel, BATCH)
    for around in (np.full((BATCH + 40, 2, 2), np.nan), np.full((2, 2, BATCH + 40), np.nan).transpose(2, 0, 1)):
        whole = cupy.asarray(around)
        kernel(cupy.asarray(q), out=whole[20:-20])
        assert np.isnan(host_numbers(whole)[:20]).all()
        assert np.isnan(host_numbers(whole)[-20:]).all()
        assert relative_error(host_numbers(whole)[20:-20], native(q)) < 1e-13


@pytest.mark.parametrize("leads", [[(BATCH,), ()], [(3, 1), (1, 60)], [(1,), (200,)], [(4, 1, 1), (1, 5, 7)]])
def test_batches_are_broadcast(cupy, kernels, leads):
    kernel, native = kernels("forces")
    arrays = [x for k, _ in enumerate(kernel_arrays(kernel)) for x in [kernel_arrays(kernel, *leads[k % 2])[k]]]
    assert_agree(kernel(*map(cupy.asarray, arrays)), native(*arrays), kernel.dtype)


@pytest.mark.parametrize("over", [slice(None), slice(None, None, -1)])
def test_results_may_lie_over_the_states(cupy, kernels, over):
    kernel, native = kernels("single")
    arrays = kernel_arrays(kernel, BATCH)
    expected = native(*(x.astype(float) for x in arrays))
    q, *others = map(cupy.asarray, [x.copy() for x in arrays])
    assert_agree(kernel(q, *others, out=q[over]), expected, kernel.dtype)


def test_arrays_that_have_steps_are_read_and_written_in_place(cupy):
    x = cupy.asarray(np.zeros((4, 5, 6, 7)))
    assert device.steps(x, 2) == (42, 1)
    assert device.steps(x[:, :, 0], 1) == (42, 1)
    assert device.steps(x.transpose(2, 3, 0, 1), 2) == (1, 42)
    assert device.steps(x[:, ::2, 0], 1) is None
    assert device.steps(x[1:2, ::2, ::-1], 1) is None
    assert device.steps(x[1, 2, ::-1], 1) == (-7, 1)
    assert device.steps(cupy.broadcast_to(x[0, 0, 0], (9, 3, 7)), 1) == (0, 1)
    assert device.steps(x[0, 0], 0) == (1, 0)
    assert np.shares_memory(device.addresses(x[1]), device.addresses(x[:2]))
    assert not np.shares_memory(device.addresses(x[..., ::2]), device.addresses(x[..., 1::2]))


def test_a_kernel_launches_one_thread_per_state():
    calls = []
    kernel = object.__new__(jounce.cuda.Kernel)
    robot = jounce.load("planar2r")
    kernel.mechanism, kernel.computation = robot.mechanism, robot.compile("gravity_forces", order=0).computation
    kernel.signature, kernel.dtype = kernel.computation.signature(robot.mechanism), np.dtype(float)
    kernel._function = lambda *call: calls.append(call)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "cupy", cupy_on_cpu)
        for count in (1, THREADS_PER_BLOCK, THREADS_PER_BLOCK + 1, 10 * THREADS_PER_BLOCK):
            kernel(cupy_on_cpu.asarray(np.zeros((count, 2))))
        kernel(cupy_on_cpu.asarray(np.zeros((0, 2))))
    assert [(grid, block) for grid, block, _ in calls] == [((k,), (THREADS_PER_BLOCK,)) for k in (1, 1, 2, 10)]
    counts = 1, THREADS_PER_BLOCK, THREADS_PER_BLOCK + 1
    for (_, _, (count, q, *q_steps, G, step, apart)), expected in zip(calls, counts, strict=False):
        assert (count, q.shape, G.shape) == (expected, (expected, 2), (expected, 2))
        assert ([*q_steps], step, apart) == ([step, 1], 2 if expected > 1 else 0, 1)
        assert all(type(x) is np.int64 for x in (count, step, apart))


def test_arrays_of_jax_come_back_as_such(cupy, kernels, monkeypatch):
    jax = pytest.importorskip("jax")
    kernel, native = kernels("forces")
    if cupy is cupy_on_cpu:
        monkeypatch.setattr(device, "_check_one_gpu", lambda name, x: x)
    elif jax.default_backend() != "gpu":
        pytest.skip("this JAX has no GPU")
    arrays = kernel_arrays(kernel, BATCH)
    with jax.enable_x64(True):
        found = kernel(*map(jax.numpy.asarray, arrays))
        assert all(isinstance(x, jax.Array) for x in found)
        assert_agree(found, native(*arrays), kernel.dtype)
        with expect_refusal("^out holds arrays of JAX, which cannot be written into; "):
            kernel(*map(jax.numpy.asarray, arrays), out=found)


def test_arrays_of_jax_elsewhere_are_told_apart(cupy, kernels):
    jax = pytest.importorskip("jax")
    kernel, _ = kernels("matrix")
    q = jax.device_put(np.zeros((4, 2), np.float32), jax.devices("cpu")[0])
    refusal(lambda: kernel(q), "^q is an array of JAX on cpu:0; expected one GPU: jax.device_put")
    refusal(lambda: jax.jit(kernel)(q), "takes arrays of numbers, not those that JAX traces; the methods")


def test_arrays_of_other_libraries_are_read_in_place(cupy, kernels):
    kernel, native = kernels("matrix")
    [q] = kernel_arrays(kernel, 5)
    own = cupy.asarray(q)
    data = {"data": (own.data.ptr, False), "shape": q.shape, "strides": None, "typestr": "<f8", "version": 3}
    assert_agree(kernel(SimpleNamespace(__cuda_array_interface__=data)), native(q), kernel.dtype)


@pytest.mark.skipif(bool(obstacle("g++")), reason="no g++")
def test_kernels_can_be_pickled(cupy, kernels):
    kernel, native = kernels("matrix")
    again = pickle.loads(pickle.dumps(kernel))
    [q] = kernel_arrays(kernel, 3)
    assert_agree(again(cupy.asarray(q)), native(q), kernel.dtype)
    assert repr(again) == repr(kernel) == "<cuda.Kernel, float64: mass_matrix of 'planar2r' to order 0>"


ONES = np.ones((4, 2))
REFUSED = {
    "number": (lambda a: [a(ONES)] * 2, {}, "expects 1 arrays, got 2$"),
    "NumPy": (lambda a: [ONES], {}, "^q is a numpy.ndarray; expected an array on the GPU, which cupy.asarray makes"),
    "list": (lambda a: [[0, 1]], {}, "^q is a builtins.list; expected an array on the GPU"),
    "dtype": (lambda a: [a(ONES.astype("f4"))], {},
        "^q has dtype float32, but the kernel computes in float64: x.ast"),
    "shape": (lambda a: [a(ONES[:, :1])], {}, ": q has shape (4, 1); expected (..., 2)$"),
    "out, number": (lambda a: [a(ONES)], {"out": []}, "^out has 0 arrays; expected 1, one for each result$"),
    "out, shape": (lambda a: [a(ONES)], {"out": ONES}, "^out[0] has shape (4, 2); expected (4, 2, 2)$"),
    "out, dtype": (lambda a: [a(ONES)], {"out": np.ones((4, 2, 2), "f4")}, "^out[0] has dtype float32, but"),
    "out, broadcast": (lambda a: [a(ONES)], {"out": np.broadcast_to(1.0, (4, 2, 2))},
        "^out[0] is broadcast, several"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_does_not_fit_is_refused_in_one_line(cupy, kernels, case):
    arrays, options, words = REFUSED[case]
    out = {k: cupy.asarray(x) if isinstance(x, np.ndarray) else x for k, x in options.items()}
    if case == "out, broadcast":
        out = {"out": cupy.broadcast_to(cupy.asarray(np.ones((4, 2, 1))), (4, 2, 2))}
    kernel, _ = kernels("matrix")
    refusal(lambda: kernel(*arrays(cupy.asarray), **out), words)


def test_overlapping_results_and_differing_batches_are_refused(cupy, kernels):
    kernel, _ = kernels("forces")
    arrays = kernel_arrays(kernel, 4)
    x = cupy.asarray(np.zeros((5, 2)))
    with expect_refusal("^out[1] shares memory with another array of out"):
        kernel(*map(cupy.asarray, arrays), out=(x[:4], x[1:]))
    arrays[1] = arrays[1][:3]
    refusal(lambda: kernel(*map(cupy.asarray, arrays)), "^batch axes do not fit together: q (4,), qd (3,)")


@pytest.mark.parametrize(("error", "match"), [
    (cupy_on_cpu.OutOfMemoryError("allocating 9,000 bytes"), r"not enough memory on the GPU; use fewer states: alloc"),
    (cupy_on_cpu.CUDADriverError("CUDA_ERROR_OUT_OF_MEMORY: out of memory"), "failed on the GPU: …; threads keep"),
    (cupy_on_cpu.CUDADriverError("CUDA_ERROR_ILLEGAL\nADDRESS"), "failed on the GPU: CUDA_ERROR_ILLEGAL ADDRESS$"),
])  # fmt: skip
def test_errors_of_the_gpu_are_one_line(error, match, monkeypatch):
    monkeypatch.setitem(sys.modules, "cupy", cupy_on_cpu)

    def fails(*_):
        raise error

    monkeypatch.setattr(cupy_on_cpu.RawKernel, "compile", lambda self: None)
    kernel = jounce.cuda.compile(jounce.load("planar2r"), "gravity_forces", order=0)
    kernel._function = fails
    refusal(lambda: kernel(cupy_on_cpu.asarray(ONES)), match)


@pytest.mark.parametrize(("options", "match"), [
    ({"dtype": "float16"}, "^unknown dtype 'float16'; …available: float64, float32"),
    ({"dtype": None}, "^unknown dtype None"),
    ({"dtype": "f8"}, "^unknown dtype 'f8'"),
    ({"quantity": "torque"}, "^unknown quantity 'torque'"),
    ({"order": 5}, "^order is 5; expected 0 to 4$"),
])  # fmt: skip
def test_what_cannot_be_compiled_is_refused(options, match, monkeypatch):
    monkeypatch.setitem(sys.modules, "cupy", cupy_on_cpu)
    refusal(lambda: jounce.cuda.compile(jounce.load("planar2r"), **options), match)
    with expect_refusal("^jounce.cuda.compile() expects a jounce.Robot, got str; try jounce.load"):
        jounce.cuda.compile("planar2r")


def test_without_cupy_or_a_gpu_a_call_says_so(monkeypatch):
    robot = jounce.load("planar2r")
    monkeypatch.setitem(sys.modules, "cupy", None)
    refusal(lambda: jounce.cuda.compile(robot), "^jounce.cuda needs CuPy; install it by: pip install 'jounce[cuda12]'")

    def no_driver():
        raise cupy_on_cpu.CUDARuntimeError("cudaErrorNoDevice:\nno device")

    monkeypatch.setitem(sys.modules, "cupy", cupy_on_cpu)
    for count, words in ((no_driver, "CuPy finds none: cudaErrorNoDevice: no device$"), (lambda: 0, "finds none$")):
        monkeypatch.setattr(cupy_on_cpu.cuda.runtime, "getDeviceCount", count)
        refusal(lambda: jounce.cuda.compile(robot), f"^jounce.cuda needs an NVIDIA GPU; …{words}")


@pytest.mark.parametrize(("quantity", "dtype"), [("inverse_dynamics", "float64"), ("coriolis_matrix", "float32")])
def test_nvrtc_compiles_without_a_gpu(quantity, dtype):
    nvrtc = pytest.importorskip("cupy", reason="CuPy is not installed").cuda.nvrtc
    try:
        nvrtc.getVersion()
    except Exception as error:
        pytest.skip(f"NVRTC is missing: {error}")
    robot = jounce.load("iiwa14")
    code = source(robot.mechanism, robot.compile(quantity, order=1).computation, dtype == "float32")
    program = nvrtc.createProgram(code, "states.cu", (), ())
    nvrtc.compileProgram(program, ["--gpu-architecture=compute_80", "-std=c++17"])
    assert not nvrtc.getProgramLog(program).strip("\0\n")  # no warning
    assert b".entry states(" in bytes(nvrtc.getPTX(program))
