"""A library for tests of `benchmarks.rivals`: it behaves as the setting FAKE_RIVAL says."""

import os
import time

import numpy as np
from benchmarks.rivals import ours
from benchmarks.rivals.tasks import Call

KIND = os.environ.get("FAKE_RIVAL", "right")  # pytest imports modules for their examples, without a setting
FACTORS = {"wrong": 1.5, "single precision": 1 + 1e-6, "not finite": np.nan}

if KIND == "missing":
    raise ModuleNotFoundError("No module named 'rival'")


class Library(ours.Library):
    """jounce, with a fault."""

    def forces(self, x):
        if KIND == "crashes":
            os._exit(1)
        if KIND == "hangs":
            time.sleep(60)
        if KIND == "raises":
            raise ValueError("it wants\nanother state")
        call = super().forces(x)
        return Call(call.run, lambda: [array * FACTORS.get(KIND, 1) for array in call.results()])
