"""How fast jounce is, beside others and beside what the processor can do: `make bench`, or ``python -m benchmarks``.

All figures of a run are taken in turn, round after round, so that whatever else the machine does falls on all of them
alike; each is the median of its rounds. One thread everywhere, unless a row says otherwise.
"""

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):  # before any library reads them
    os.environ[_name] = "1"
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false"
os.environ["JAX_PLATFORMS"] = "cpu"
