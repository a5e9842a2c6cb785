"""``python -m benchmarks.coverage``: how often smoothed logs lie within their stated deviations, by joint and rate.

Logs of seven joints are simulated, so that q to q4d are known; the share of errors within 1.96 standard deviations is
counted at even times, between `Fit.ends` and outside of them.
"""

from collections.abc import Callable

import click
import numpy as np

from jounce.motion import reliability
from jounce.motion.sample_curves import fit
from jounce.spatial.series import rate_name

JOINTS, ORDER, TIMES = 7, 4, 400
Truth = Callable[..., np.ndarray]  # (t, order) -> (N, JOINTS)


def harmonics(random: np.random.Generator) -> Truth:
    """Five harmonics of 0.1 Hz, which differ by joint."""
    k = 2 * np.pi * 0.1 * np.arange(1, 6)[:, None]
    sine, cosine = (0.6 * random.normal(size=(5, JOINTS)) / np.arange(1, 6)[:, None] for _ in "sc")

    def truth(t: np.ndarray, order: int = 0) -> np.ndarray:
        phase = k * t[:, None, None] + order * np.pi / 2
        return np.asarray((k**order * (sine * np.sin(phase) + cosine * np.cos(phase))).sum(axis=1))

    return truth


def encoder(q: np.ndarray, bits: int) -> np.ndarray:
    """Positions rounded to the steps of an encoder."""
    step = 2 * np.pi / 2**bits
    return np.asarray(step * np.round(q / step))


def simulate(kind: str, seed: int) -> tuple[np.ndarray, np.ndarray, Truth]:
    """Times, samples and truth of a log of a kind."""
    random = np.random.default_rng(seed)
    truth = harmonics(random)
    rate, seconds = {"white 1e-4": (1000, 8), "17 bits": (1000, 8), "16 bits, 100 Hz, uneven": (100, 20)}.get(
        kind, (1000, 10)
    )
    t = np.arange(rate * seconds) / rate
    match kind:
        case "white 1e-4":
            q = truth(t) + 1e-4 * random.normal(size=(len(t), JOINTS))
        case "17 bits":
            q = encoder(truth(t), 17)
        case "16 bits, 100 Hz, uneven":
            t = np.sort(t + random.uniform(-0.003, 0.003, len(t)))
            q = encoder(truth(t), 16)
        case _:  # stamps that scatter, and rows that repeat older positions
            q = np.round(truth(t), 6)
            t = np.sort(t + random.uniform(-5e-4, 5e-4, len(t)))
            stale = 1 + np.flatnonzero(random.random(len(t) - 1) < 0.05)
            q[stale] = q[stale - 1]
    return t, q, truth


KINDS = ("white 1e-4", "17 bits", "16 bits, 100 Hz, uneven", "stamps scatter by 0.3 ms")


def measure(kind: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Whether errors lie within the band of 95 %, (ORDER + 1, TIMES, JOINTS), between the ends, and outside of them."""
    t, q, truth = simulate(kind, seed)
    smooth = fit(t, q)
    first, last = smooth.ends
    inside = np.linspace(first, last, TIMES)
    outside = np.concatenate([np.linspace(t[0], first, TIMES // 2), np.linspace(last, t[-1], TIMES // 2)])
    found = []
    for s in (inside, outside):
        off = smooth.deviations(s, ORDER)
        errors = [np.abs(smooth.spline(s, nu=k) - truth(s, k)) for k in range(ORDER + 1)]
        found.append(np.array([e < reliability.BAND_DEVIATIONS * d for e, d in zip(errors, off, strict=True)]))
    return found[0], found[1]


@click.command()
@click.option("--logs", default=10, show_default=True, type=click.IntRange(1), help="Number of logs of each kind.")
def main(logs: int) -> None:
    """Print the coverage by kind of log and by joint as tables."""
    names = [rate_name("q", k) for k in range(ORDER + 1)]
    head = f"| | {' | '.join(names)} |\n|---|{'---|' * len(names)}"
    every = {kind: np.array([measure(kind, seed) for seed in range(logs)]) for kind in KINDS}  # (logs, 2, rates, ...)
    rows = {kind: found[:, 0].mean(axis=(0, 2, 3)) for kind, found in every.items()}
    pooled = np.array(list(every.values()))
    rows |= {f"joint {j + 1}": pooled[:, :, 0, :, :, j].mean(axis=(0, 1, 3)) for j in range(JOINTS)}
    rows |= {
        "all": pooled[:, :, 0].mean(axis=(0, 1, 3, 4)),
        "all, outside of the ends": pooled[:, :, 1].mean(axis=(0, 1, 3, 4)),
    }
    lines = [f"| {name} | {' | '.join(f'{100 * share:.0f} %' for share in shares)} |" for name, shares in rows.items()]
    click.echo("\n".join([f"{logs} logs of each kind, seeds 0 to {logs - 1}", "", head, *lines]))


if __name__ == "__main__":
    main()
