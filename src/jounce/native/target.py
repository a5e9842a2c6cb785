"""The host: how many states its vectors hold, and whether it fuses products with sums."""

from dataclasses import dataclass
from functools import cache


@dataclass(frozen=True)
class Target:
    """What a program is compiled for."""

    cpu: str
    features: str
    lanes: int  # doubles in a vector
    fma: bool


@cache
def host() -> Target:
    """This machine's processor."""
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features()
    lanes = 8 if features.get("avx512f") else 4 if features.get("avx") else 2
    fma = features.get("fma") or features.get("neon") or features.get("fp-armv8") or False
    return Target(llvm.get_host_cpu_name(), features.flatten(), lanes, bool(fma))
