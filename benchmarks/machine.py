"""What the figures were taken on."""

import os
import platform
import re
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from shutil import which

PACKAGES = ("jounce", "numpy", "llvmlite", "pin", "casadi", "jax", "skidy")


def described() -> list[tuple[str, str]]:
    """The processor, its cores, the system, and the versions of what was measured."""
    return [*hardware(), *((name, version_of(name)) for name in PACKAGES)]


def hardware() -> list[tuple[str, str]]:
    """The processor, its cores, the system, and the compiler."""
    from jounce.native.jit import host

    target = host()
    vectors = f"{target.lanes} doubles, {'with' if target.fma else 'without'} fused multiply-add"
    return [
        ("processor", f"{_processor()} ({target.cpu} to LLVM)"),
        ("cores", f"{os.cpu_count()}, of which {cores()} for this process"),
        ("vectors", vectors),
        ("system", f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"),
        ("compiler", _compiler()),
    ]


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def load() -> str:
    """How busy the machine is: processes that ran in the last minute, on average."""
    return f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    found = re.search(r"model name\s*: (.+)", info.read_text()) if info.exists() else None
    return found[1] if found else platform.processor() or platform.machine()


def _compiler() -> str:
    if which("gcc") is None:
        return "none"
    return subprocess.run(["gcc", "--version"], capture_output=True, text=True, check=True).stdout.splitlines()[0]


def version_of(name: str) -> str:
    """The version of an installed package, or that there is none."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
