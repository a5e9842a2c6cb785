"""What libraries do beyond jounce, and those that a run does not measure, with figures of their own and the source."""

from dataclasses import dataclass

from benchmarks.rivals import RIVALS, identification, retiming


@dataclass(frozen=True)
class Cited:
    """A library that is not measured: what its authors state, where, and why nothing is measured here."""

    library: str
    figure: str
    source: str
    reason: str


ROWS = (
    Cited(
        "RoboKots",
        "577 us for the Jacobian of Q2d by q to q4d, 7 joints, in Rust",
        "[arXiv 2605.15845](https://arxiv.org/abs/2605.15845)",
        "no package on the index, its Rust core is not public; the torques of the Python code of April 2026 are wrong"
        " where a centre of mass is not at the origin of its frame",
    ),
    Cited(
        "GRiD (`grid-rbd`)",
        "up to 7.2 times a CPU of eight cores, 2.5 times with transfers: forward dynamics and gradients in batches, RTX"
        " 3080",
        "[the benchmarks of its paper](https://github.com/robot-acceleration/GRiDBenchmarks), 2022; figures of its"
        " release are pictures on [its site](https://a2r-lab.org/GRiD/)",
        "computes on a GPU of NVIDIA alone",
    ),
    Cited(
        "Newton on a GPU",
        "none for inverse dynamics",
        "[its documentation](https://newton-physics.github.io/newton/)",
        "measured above on the CPU, which it is not made for",
    ),
    Cited(
        "bard",
        "up to 64 times Pinocchio's throughput: poses of 4,096 states, 7 to 23 joints, H200",
        "[arXiv 2605.31481](https://arxiv.org/abs/2605.31481)",
        "made for a GPU",
    ),
    Cited(
        "dp3-topp",
        "none stated",
        "its published code, read and not run",
        "its dynamic program takes more than an hour for a path by its loop in Python",
    ),
    Cited(
        "skidy",
        "none stated",
        "[its README](https://pypi.org/project/skidy/)",
        "symbolic: `benchmarks/RESULTS.md` has the time from a robot of two and three joints to its equations",
    ),
    Cited(
        "mujoco.sysid on MCAP",
        "none stated",
        "[its README](https://github.com/google-deepmind/mujoco/blob/main/python/mujoco/sysid/README.md)",
        "measured above on the arrays of a log: version 4.0.0 of the package index has no reader of MCAP files",
    ),
)


def does_more() -> dict[str, str]:
    """Return what each library that is measured does beyond jounce."""
    found = {name: rival.does_more for name, rival in RIVALS.items() if rival.does_more}
    return found | {name: text for part in (retiming, identification) for name, text in part.DOES_MORE.items()}
