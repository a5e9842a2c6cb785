"""Generated C++, CUDA and Rust: what `test_codegen` does not ask of every language."""

import subprocess
from importlib.util import find_spec
from pathlib import Path

import pytest
from test_codegen import ALL, CASES, FLOATING, PARAMETERS, STRICT, passes, texts, write_files

from jounce._codegen import printer
from support.tools import needs, obstacles

CASADI = find_spec("casadi")  # which brings the headers of Eigen along
PLACES = [Path("/usr/include/eigen3"), Path(CASADI.origin or "").parent / "include" / "eigen3" if CASADI else Path()]
EIGEN = next((place for place in PLACES if (place / "Eigen").is_dir()), PLACES[0])
EVERYTHING = {"order": 1, "outputs": ALL, "wrench": True, "parameters": PARAMETERS}
eigen = pytest.mark.skipif(not EIGEN.exists() or bool(obstacles("make")), reason=obstacles("make") or "no Eigen")


@eigen
@pytest.mark.parametrize(
    ("compiler", "robot", "single", "outputs"),
    [
        pytest.param("g++", "planar2r", False, ALL, marks=needs("g++")),
        pytest.param("clang++", "floating", True, FLOATING, marks=needs("clang++")),
    ],
)
def test_eigen_gives_the_same(compiler, robot, single, outputs, tmp_path):
    parameters = PARAMETERS if robot == "planar2r" else ()
    files = texts(robot, "cpp", 10, order=1, outputs=outputs, wrench=True, parameters=parameters, float32=single)
    passed, output = passes(write_files(tmp_path, files), "cpp", f"CXX={compiler}", f"EIGEN={EIGEN}")
    assert passed, output
    assert output.count("plain arrays and Eigen: worst") == len(outputs)


VIEWS = """
#include "planar2r_eigen.hpp"
int main()
{
    Eigen::VectorXd state(4), forces(5);
    Eigen::MatrixXd M(3, 3);
    double Q[2];
    state << 0.1, 0.2, 0.3, 0.4;
    forces.setZero();
    planar2r::inverse_dynamics(state.head(2), 2 * state.tail(2), state.tail(2), forces.segment<2>(1));
    planar2r::inverse_dynamics(state.head(2), 2 * state.tail(2), state.tail(2), Eigen::Map<planar2r::Vector>(Q));
    M.setZero();
    planar2r::mass_matrix(state.head(2), M.bottomRightCorner<2, 2>());
    const bool outside = forces(0) != 0 || forces(3) != 0 || M(0, 0) != 0 || M(1, 0) != 0 || M(0, 1) != 0;
    return outside || Q[0] == 0 || forces(1) != Q[0] || forces(2) != Q[1] || M(1, 1) == 0 || M(1, 2) != M(2, 1);
}
"""


@eigen
@needs("g++")
def test_eigen_takes_expressions_and_writes_into_views(tmp_path):
    files = texts("planar2r", "cpp", count=1, order=0, outputs=("inverse_dynamics", "mass_matrix"))
    write_files(tmp_path, files | {"views.cpp": VIEWS})
    flags = STRICT.replace("c99", "c++14").split()
    subprocess.run(["g++", *flags, "-isystem", EIGEN, "views.cpp", "-o", "views"], cwd=tmp_path, check=True)
    subprocess.run([tmp_path / "views"], check=True)


@needs("clang++", "make")
def test_clang_warns_of_nothing_in_the_shim(tmp_path):
    files = texts("planar2r", "cuda", 10, float32=True, **EVERYTHING)
    passed, output = passes(write_files(tmp_path, files), "cuda", "CXX=clang++")
    assert passed, output


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("if (k >= count)", "if (k > count)"),
        ("x[j] = all[j * count + k]", "x[j] = all[k * SIZE + j]"),
        ("all[j * count + k] = x[j]", "all[k * SIZE + j] = x[j]"),
        ("blockIdx.x * blockDim.x", "blockIdx.x"),
        ("&params[k]", "params"),
    ],
)
@needs("g++", "make")
def test_kernels_that_take_wrong_states_fail(right, wrong, tmp_path):
    files = texts("planar2r", "cuda", count=10, order=0, parameters=("payload",))
    assert files["planar2r.cu"].count(right) == 1
    changed = files | {"planar2r.cu": files["planar2r.cu"].replace(right, wrong)}
    passed, output = passes(write_files(tmp_path, changed), "cuda", "CXXFLAGS=-std=c++17")
    assert not passed, output
    assert (tmp_path / "test_planar2r").exists()  # it was compiled


@needs("nvcc", "make")
@pytest.mark.parametrize("cut", [False, True])
def test_nvcc_warns_of_nothing(cut, tmp_path, monkeypatch):
    """Where there is a device the kernels are run, too."""
    robot, options, *_ = CASES["driven"]
    if cut:
        monkeypatch.setattr(printer, "MAX_UNDIVIDED_STATEMENTS", 50)
        monkeypatch.setattr(printer, "STATEMENTS_PER_PART", 60)
        robot, options = "planar2r", EVERYTHING | {"float32": True, "order": 0}
    folder = write_files(tmp_path, texts(robot, "cuda", 10, **options))
    flags = "-O1 -std=c++17 -Werror all-warnings -Xcompiler -Wall,-Wextra"
    passed, output = passes(folder, "cuda", "NVCC=nvcc", f"NVCCFLAGS={flags}")
    assert passed, output
    assert "function and kernel: worst" in output or "function, no device for the kernel: worst" in output


@needs("cargo")
def test_cargo_tests_the_crate_without_a_network(tmp_path):
    folder = write_files(tmp_path, texts("planar2r", "rust", count=10, **EVERYTHING))
    done = subprocess.run(["cargo", "test", "--offline"], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "warning" not in done.stderr
    assert done.stdout.count("over 10 states") == len(ALL)


EMBEDDED = """
#![no_std]
extern "C" {
    fn sin(x: f64) -> f64;
    fn cos(x: f64) -> f64;
}
struct C;
impl iiwa14::Functions for C {
    fn sin(x: f64) -> f64 {
        unsafe { sin(x) }
    }
    fn cos(x: f64) -> f64 {
        unsafe { cos(x) }
    }
}
#[no_mangle]
pub extern "C" fn forces(x: &[[f64; 7]; 5], Q: &mut [[f64; 7]; 3]) {
    (Q[0], Q[1], Q[2]) = iiwa14::inverse_dynamics::<C>(&x[0], &x[1], &x[2], &x[3], &x[4]);
}
"""


@needs("rustc", "nm", "make")
def test_rust_needs_sine_and_cosine_and_cannot_panic(tmp_path):
    folder = write_files(tmp_path, texts("iiwa14", "rust", count=1) | {"embedded.rs": EMBEDDED})
    subprocess.run(["make", "-C", folder, "libiiwa14.rlib"], check=True, capture_output=True)
    options = "--edition 2021 -O -A non_snake_case --crate-type lib --extern iiwa14=libiiwa14.rlib --emit obj"
    subprocess.run(["rustc", *options.split(), "embedded.rs"], cwd=folder, check=True)
    listed = subprocess.run(["nm", "-u", folder / "embedded.o"], capture_output=True, text=True, check=True)
    assert set(listed.stdout.split()) - {"U", "memcpy", "memset"} == {"sin", "cos"}
