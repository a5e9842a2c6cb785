"""jounce beside other libraries, measured by anybody: ``python -m benchmarks.rivals`` (``pip install '.[rivals]'``).

* `robots` writes three robots as URDF files, which all libraries read.
* `tasks` says what is computed, from which inputs, in which convention, and how a result is judged.
* One module per library (`RIVALS`) says how it computes them; its authors need to read that module alone.
* `worker` runs one library in a process of its own; `calls` measures all of them in turn.
* `first`, `accuracy`, `retiming` and `identification` measure the rest; `page` makes RIVALS.md from RIVALS.json.

A library that is missing, fails, takes too long or returns other numbers has a cell that says so; the run goes on.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Rival:
    """A library that is measured: its module here, its package, how it is called, and what it does beyond jounce."""

    name: str
    module: str
    package: str
    called: str
    does_more: str = ""
    settings: tuple[tuple[str, str], ...] = ()  # of the environment, set before it is imported
    # Joints up to which a task is compiled, by task, or for all tasks without a number of their own: with more, its
    # code takes too long to compile for a run of 20 minutes. No cell is left out so in which the library was faster.
    largest: tuple[tuple[str, int], ...] = ()
    patience: float = 60.0  # s to compile a call and run it once
    span: float = 0.0  # s of further samples of each cell, where times change for seconds on end

    def compiles(self, task: str, joints: int) -> bool:
        """Return whether a task of a robot with so many joints is compiled in a run."""
        largest = dict(self.largest)
        limit = largest.get(task, largest.get(ALL_TASKS))
        return limit is None or joints <= limit


# What the README of frax recommends for a CPU, and the older of two runtimes, with which a call takes less time: its
# README recommends jax 0.4.30, which has no other, but adam needs a later one. jax takes them from its environment.
JAX_SETTINGS = (
    ("JAX_ENABLE_X64", "1"),
    ("JAX_PLATFORMS", "cpu"),
    ("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false --xla_cpu_use_thunk_runtime=false"),
)

JAX_SPAN = 4.0  # XLA hands a call to a thread of its own, whose wake-up is quick or slow for seconds on end
ALL_TASKS = "all"
RATES = ("force_rates", "mass_matrix_rates")
LONG_DERIVATIVES = ("acceleration_derivatives", "second_derivatives")

JOUNCE = "jounce"
BOUND = "jounce, bound"
RIVALS = {
    rival.name: rival
    for rival in (
        Rival(
            JOUNCE,
            "benchmarks.rivals.ours",
            "jounce",
            called="methods of `Robot` on arrays of NumPy",
        ),
        Rival(
            BOUND,
            "benchmarks.rivals.bound",
            "jounce",
            called="kernels that are bound to their arrays once: `Robot.compile`, `bind`",
            largest=(("second_derivatives", 29),),
        ),
        Rival(
            "Pinocchio",
            "benchmarks.rivals.pinocchio",
            "pin",
            called="its Python functions; `rneaInParallel` and `abaInParallel` on one thread",
            does_more="collisions, constraints with their derivatives, models that change while a program runs, C++",
        ),
        Rival(
            "CasADi",
            "benchmarks.rivals.casadi",
            "casadi",
            called="adam's equations as C code by `gcc -O3 -march=native`, called through buffers; batches by `map`",
            does_more="solvers of optimal control; whatever can be written as an expression",
            largest=(
                ("forces", 29),
                ("mass_matrix", 29),
                *((task, 7) for task in ("accelerations", *RATES, "force_derivatives")),
                *((task, 0) for task in LONG_DERIVATIVES),
            ),
        ),
        Rival(
            "MuJoCo",
            "benchmarks.rivals.mujoco",
            "mujoco",
            called="its Python functions, `mj_inverse`, `mj_forward`, ...; batches of forward dynamics by `Batch`",
            does_more="simulation with contacts, tendons, muscles, sensors",
        ),
        Rival(
            "dynibo",
            "benchmarks.rivals.dynibo",
            "dynibo",
            called="its methods, results into `out=`",
            does_more="inverse kinematics of a target link; a Rust crate without Python",
        ),
        Rival(
            "adam",
            "benchmarks.rivals.adam",
            "adam-robotics",
            called="`adam.jax` under `jit`; batches by `vmap`",
            does_more="parametric links, tensors of PyTorch, USD",
            settings=JAX_SETTINGS,
            span=JAX_SPAN,
            largest=(
                (ALL_TASKS, 7),
                *((task, 0) for task in (*RATES, "jacobian_rate", "force_derivatives", *LONG_DERIVATIVES)),
            ),
        ),
        Rival(
            "frax",
            "benchmarks.rivals.frax",
            "frax",
            called="under `jit`; batches by `vmap`",
            does_more="collision spheres; GPU and TPU by XLA",
            settings=JAX_SETTINGS,
            span=JAX_SPAN,
            largest=(
                ("force_rates", 29),
                *((task, 7) for task in ("mass_matrix_rates", "force_derivatives", "acceleration_derivatives")),
                ("second_derivatives", 0),
            ),
        ),
        Rival(
            "Newton",
            "benchmarks.rivals.newton",
            "newton",
            called="its experimental inverse dynamics on the CPU, in single precision",
            does_more="simulation in batches on GPUs, several solvers, contacts, soft bodies",
            patience=90.0,  # it compiles its kernels once for all robots, and keeps them
        ),
    )
}
