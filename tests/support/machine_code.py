"""Native code without LLVM's optimizations of machine code, and as users get it."""

import os
from contextlib import contextmanager

import pytest
from llvmlite.binding import Target

SHIPPED = Target.create_target_machine


def compile_quickly():
    """Leave the optimizations out from now on: compiling takes a fifth of the time, and no bit of results changes."""
    Target.create_target_machine = lambda target, **options: SHIPPED(target, **options | {"opt": 0})


@contextmanager
def optimized():
    """Inside, native code is compiled as users get it, and never read from what other tests have compiled without."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Target, "create_target_machine", SHIPPED)
        patch.setenv("JOUNCE_CACHE_DIR", os.environ["JOUNCE_CACHE_DIR"] + "-as-shipped")
        yield
