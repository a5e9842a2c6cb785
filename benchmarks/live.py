"""``python -m benchmarks.live``: what a live estimator makes of encoders, by lag, resolution, rate and time stamps.

Errors of Q, Qd, Q2d are relative, rms over the joints of a Panda. With a given bandwidth it is the best one for the log
by the truth; the bank does not know it. `--log` adds a measured log whose motion is a series of harmonics.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import click
import numpy as np

import jounce
from benchmarks import machine
from benchmarks.tables import paragraph, table
from jounce.io import files
from jounce.live.estimator import correct, predict, process_noise, start_filters, transition

HOME = np.array([0, -0.8, 0, -1.8, 0, 1.8, 0.8])
BLEND = np.poly1d([70, -315, 540, -420, 126, 0, 0, 0, 0, 0])  # from rest to rest, with four continuous rates
GIVEN = 5.0 * 1.2 ** np.arange(9)  # Hz, of which the best for a log is its given bandwidth
BITS, RATES, LAGS, SKIP = (12, 16, 20), (500, 1000, 4000), (0.0, 0.005, 0.02, 0.05), 1.5
BANK_LAGS = (0.0, 0.02)  # s: at others the bank is measured where there is a figure to compare with, to save time
SEEDS = {"pick and place": 0, "harmonics": 1}
JITTER = 3e-4  # s, of time stamps, half the range
FIGURES = {  # of a prototype, Q, Qd, Q2d, by motion, bits, rate, lag: what is to be reached
    ("pick and place", 12, 1000, 0.0): (0.16, 0.67, 1.3),
    ("pick and place", 12, 1000, 0.02): (0.053, 0.34, 0.87),
    ("pick and place", 12, 1000, 0.05): (0.018, 0.084, 0.40),
    ("pick and place", 16, 1000, 0.0): (0.030, 0.21, 0.62),
    ("pick and place", 16, 1000, 0.005): (0.021, 0.16, 0.54),
    ("pick and place", 16, 1000, 0.02): (0.0043, 0.062, 0.32),
    ("pick and place", 16, 1000, 0.05): (0.0020, 0.015, 0.064),
    ("pick and place", 20, 1000, 0.0): (0.0048, 0.055, 0.28),
    ("pick and place", 20, 1000, 0.02): (0.0005, 0.0056, 0.072),
    ("pick and place", 20, 1000, 0.05): (0.0003, 0.0028, 0.025),
    ("harmonics", 16, 1000, 0.0): (0.0082, 0.067, 0.24),
    ("harmonics", 16, 1000, 0.02): (0.0025, 0.030, 0.14),
    ("harmonics", 16, 1000, 0.05): (0.00065, 0.0055, 0.047),
    ("harmonics", 20, 1000, 0.0): (0.0017, 0.022, 0.12),
    ("pick and place", 16, 500, 0.0): (0.029, 0.19, 0.56),
    ("pick and place", 16, 4000, 0.0): (0.024, 0.17, 0.54),
    ("pick and place", 16, 500, 0.02): (0.0048, 0.062, 0.32),
    ("pick and place", 16, 4000, 0.02): (0.0033, 0.046, 0.28),
}


def encoder_noise(bits: int) -> float:
    """The standard deviation of rounding to the steps of an encoder."""
    return float(2 * np.pi / 2**bits / np.sqrt(12))


def rounded(q: np.ndarray, bits: int) -> np.ndarray:
    """Angles as an encoder gives them."""
    step = 2 * np.pi / 2**bits
    return np.asarray(np.round(q / step) * step)


def pick_and_place(
    t: np.ndarray, seed: int, move: float = 0.6, rest: float = 0.2, reach: float = 0.8
) -> list[np.ndarray]:
    """Moves of degree 9 between random poses, at which the arm rests: q to q4d (N, 7) at times from 0 on."""
    random = np.random.default_rng(seed)
    poses = HOME + random.uniform(-reach, reach, (int(t[-1] / (move + rest)) + 2, 7))
    place = np.maximum(t // (move + rest), 0).astype(int)
    s = ((t - place * (move + rest)) / move).clip(0, 1)
    rates = [np.where(s < 1, BLEND.deriv(k)(s) / move**k, 0) if k else BLEND(s) for k in range(5)]
    q = [(poses[place + 1] - poses[place]) * rate[:, None] for rate in rates]
    return [q[0] + poses[place], *q[1:]]


def harmonics(t: np.ndarray, seed: int, amplitude: float = 0.18) -> list[np.ndarray]:
    """Five harmonics of 0.4 Hz with random amplitudes and phases."""
    random = np.random.default_rng(seed)
    a, phase = random.normal(0, amplitude, (5, 7)), random.uniform(0, 2 * np.pi, (5, 7))
    w = 2 * np.pi * 0.4 * np.arange(1, 6)
    q = [
        sum(a[i] * w[i] ** k * np.sin(w[i] * t[:, None] + phase[i] + k * np.pi / 2) for i in range(5)) for k in range(5)
    ]
    return [q[0] + HOME, *q[1:]]


MOTIONS = {"pick and place": pick_and_place, "harmonics": harmonics}


class Followed(NamedTuple):
    """What an estimator says after each sample: rates and deviations (N, 5, n), whom to trust, who moves (N, n)."""

    t: np.ndarray
    rates: np.ndarray
    deviations: np.ndarray
    good: np.ndarray
    moving: np.ndarray
    seconds: float


def follow(live: Any, t: np.ndarray, q: np.ndarray, skip: float = 0.0, stamps: bool = True) -> Followed:
    """What an estimator says of samples q (N, n), from a time on, and the median time of an update."""
    found, times = [], []
    for time, sample in zip(t, q, strict=True):
        begin = perf_counter()
        rates = live.update(sample, time if stamps else None)
        times.append(perf_counter() - begin)
        if time >= skip - 1e-9:
            trust = live.trust
            found.append((time - live.settings.lag, rates, live.deviations, trust.good, trust.moving))
    return Followed(*map(np.array, zip(*found, strict=True)), float(np.median(times)))


def panda() -> jounce.Robot:
    """A Panda without fingers."""
    robot = jounce.load(Path(__file__).parents[1] / "examples" / "panda.urdf")
    fingers = [name for name in robot.joint_names if "finger" in name]
    return robot.locked(dict.fromkeys(fingers, 0.0)) if fingers else robot


def force_errors(robot: jounce.Robot, rates: np.ndarray, truth: Sequence[np.ndarray]) -> np.ndarray:
    """Relative rms errors of Q, Qd, Q2d of rates (N, 5, n)."""
    found = robot.inverse_dynamics(*(np.ascontiguousarray(rates[:, k]) for k in range(5)))
    expected = robot.inverse_dynamics(*truth)
    return np.array([np.sqrt(((a - b) ** 2).mean() / (b**2).mean()) for a, b in zip(found, expected, strict=True)])


def given_rates(
    t: np.ndarray, q: np.ndarray, skip: float, stamps: np.ndarray | None = None
) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
    """Lag, times (N,) and rates (N, B, 5, n) of all given bandwidths, by one pass; stamps of uneven samples."""
    omega, dt, states = 2 * np.pi * GIVEN, (t[-1] - t[0]) / (len(t) - 1), 6
    spacing = max(round(LAGS[1] / dt / 2), 1) if dt < 1e-3 else 1
    kept = round(LAGS[-1] / dt / spacing) + 1
    filters = start_filters(q[0], len(omega), kept, states)
    F, W = transition(omega * dt, states), process_noise(omega * dt, omega * dt, states)
    found: dict[float, list[tuple[float, np.ndarray]]] = {lag: [] for lag in LAGS}
    for k in range(1, len(t)):
        if stamps is not None:
            scaled = omega * (stamps[k] - stamps[k - 1])
            F, W = transition(scaled, states), process_noise(scaled, omega * dt, states)
        predict(filters, F, W, keep=(k - 1) % spacing == 0)
        correct(filters, q[k] - filters.present)
        if t[k] >= skip and k % spacing == 0:
            for lag, rows in found.items():
                age = round(lag / dt / spacing)
                rows.append((t[k - age * spacing], filters.x[:, :, :5, filters.place(age)].swapaxes(1, 2).copy()))
    scale = omega[:, None, None] ** np.arange(5)[:, None]
    for lag, rows in found.items():
        yield lag, np.array([time for time, _ in rows]), np.array([x for _, x in rows]) * scale


def measure_cells(robot: jounce.Robot, duration: float) -> tuple[list[list[str]], list[np.ndarray], list[float]]:
    """Rows of the table, scores of deviations while joints move and are trusted, and times of an update."""
    lines, scores, seconds = [], [], []
    for kind, motion in MOTIONS.items():
        for bits in BITS:
            for rate in RATES:
                t = np.arange(round(duration * rate)) / rate
                q = rounded(motion(t, SEEDS[kind])[0], bits)
                for lag, times, rates in given_rates(t, q, SKIP):
                    truth = motion(times, SEEDS[kind])
                    errors = [force_errors(robot, rates[:, b], truth) for b in range(len(GIVEN))]
                    best = int(np.argmin([np.log(e).sum() for e in errors]))
                    bank, good, spread = np.full(3, np.nan), np.nan, np.nan
                    if (lag in BANK_LAGS and (rate < 4000 or bits == 20)) or (kind, bits, rate, lag) in FIGURES:
                        found = follow(robot.live(1 / rate, lag=lag), t, q, SKIP)
                        truth = motion(found.t, SEEDS[kind])
                        bank, good = force_errors(robot, found.rates, truth), found.good.mean()
                        z = (found.rates - np.stack(truth, axis=1)) / found.deviations
                        trusted = np.broadcast_to(found.good[:, None], z.shape)
                        moving = trusted & found.moving[:, None]
                        scores.append(np.stack([np.where(trusted, z, np.nan), np.where(moving, z, np.nan)]))
                        seconds.append(found.seconds)
                        spread = np.sqrt(np.nanmean(scores[-1][1] ** 2))
                    lines.append(_line(kind, bits, rate, lag, errors[best], GIVEN[best], bank, good, spread))
                    click.echo(" ".join(lines[-1]), err=True)
    return lines, scores, seconds


def _line(
    kind: str,
    bits: int,
    rate: int,
    lag: float,
    given: np.ndarray,
    f: float,
    bank: np.ndarray,
    good: float,
    spread: float,
) -> list[str]:
    target = FIGURES.get((kind, bits, rate, lag))
    ratios = ["", ""] if target is None else [f"{(x / target).max():.2f}" for x in (given, bank)]
    cells = ["-" if np.isnan(errors).any() else " ".join(f"{x:.2g}" for x in errors) for errors in (given, bank)]
    shares = ["-" if np.isnan(x) else f"{x:.2f}" for x in (good, spread)]
    return [f"{kind}, {bits} bits, {rate} Hz", f"{1000 * lag:g} ms", cells[0], f"{f:.1f}", cells[1], *ratios, *shares]


def stamped_errors(robot: jounce.Robot, bits: int, used: bool, duration: float) -> list[np.ndarray]:
    """Relative errors of pick and place by lag, of uneven samples whose times are used or not; best given bandwidth."""
    random, even = np.random.default_rng(7), np.arange(round(duration * 1000)) / 1000
    t = even + random.uniform(0, 2 * JITTER, len(even))
    found = []
    for _, times, rates in given_rates(t, rounded(pick_and_place(t, 0)[0], bits), SKIP, t if used else None):
        truth = pick_and_place(times, 0)
        errors = [force_errors(robot, rates[:, b], truth) for b in range(len(GIVEN))]
        found.append(min(errors, key=lambda x: np.log(x).sum()))
    return found


def draw(robot: jounce.Robot, path: Path, duration: float = 4.0) -> None:
    """The picture of errors over lag, by bits, with time stamps and without."""
    from matplotlib.figure import Figure

    from jounce.figures import canvas

    figure = Figure(figsize=(9, 3.4), layout="constrained")
    panels = figure.subplots(1, 3, sharex=True)
    for color, bits in zip(canvas.COLOURS, BITS, strict=False):
        for used, style in ((True, "-"), (False, ":")):
            errors = np.array(stamped_errors(robot, bits, used, duration))
            for k, panel in enumerate(panels):
                label = f"{bits} bits" + ("" if used else ", stamps not used")
                panel.semilogy(1000 * np.array(LAGS), errors[:, k], style, color=color, marker=".", label=label)
    for panel, name in zip(panels, ("Q", "Qd", "Q2d"), strict=True):
        panel.axhline(1, color="0.6", linewidth=0.8)
        panel.set(title=f"error of {name} / its rms", xlabel="lag in ms")
        panel.grid(alpha=0.3)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    canvas.save(figure, path)


def measure_log(path: Path, fundamental: float, begin: float) -> list[list[str]]:
    """Errors along a measured log of a Panda, against a fit of five harmonics, with time stamps and without."""
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    t, q, robot = rows[:, 0], rows[:, 1:8], panda()
    w = 2 * np.pi * fundamental * np.arange(1, 6)

    def basis(times: np.ndarray, k: int) -> np.ndarray:
        phase = w * times[:, None] + k * np.pi / 2
        return np.hstack([np.full((len(times), 1), float(k == 0)), w**k * np.cos(phase), w**k * np.sin(phase)])

    coefficients = np.linalg.lstsq(basis(t[t > begin], 0), q[t > begin], rcond=None)[0]
    lines = []
    for stamps in (True, False):
        for bandwidth in (1.5, 2.0, None):
            found = follow(robot.live(1e-3, bandwidth, 0.0), t, q, begin + 1.5, stamps)
            errors = force_errors(robot, found.rates, [basis(found.t, k) @ coefficients for k in range(5)])
            name = "bank" if bandwidth is None else f"{bandwidth:g} Hz"
            figures = " ".join(f"{x:.2g}" for x in errors)
            used = "used" if stamps else "not used"
            lines.append([f"stamps {used}", name, figures, f"{found.good.mean():.2f}"])
    return lines


@click.command()
@click.option("--duration", default=3.5, show_default=True, help="Of each log, s; 1.5 are left out.")
@click.option("--log", type=click.Path(path_type=Path), help="A measured log: time, seven joints, in columns.")
@click.option("--fundamental", default=0.075, show_default=True, help="Frequency of its harmonics, Hz.")
@click.option(
    "-o", "--output", default=Path(__file__).with_name("LIVE.md"), type=click.Path(path_type=Path), help="Page."
)
@click.option("--picture", type=click.Path(path_type=Path), help="Draw errors over lag too.")
def main(duration: float, log: Path | None, fundamental: float, output: Path, picture: Path | None) -> None:
    """Measure errors of rates and forces, and write a page about it."""
    before, robot = machine.load(), panda()
    lines, scores, seconds = measure_cells(robot, duration)
    if picture is not None:
        draw(robot, picture)
    moving = np.concatenate([z[1].ravel() for z in scores])
    by_log = [float(np.sqrt(np.nanmean(z[1] ** 2))) for z in scores]
    worst = max(float(np.nanmax(np.abs(z[0]))) for z in scores)
    head = [
        "log",
        "lag",
        "given bandwidth",
        "Hz",
        "bank",
        "given / prototype",
        "bank / prototype",
        "trusted",
        "error / deviation",
    ]
    text = ["# Rates while the robot moves", "", *paragraph(__doc__.partition("\n\n")[2])]
    text += [*table(head, lines), "## Deviations", ""]
    text += paragraph(f"""
        Errors of q to q4d over their stated deviations, of the bank, in {len(scores)} logs: rms
        {np.sqrt(np.nanmean(moving**2)):.2f} of trusted joints that move ({min(by_log):.2f} to {max(by_log):.2f} by
        log); largest of all trusted ones {worst:.1f}. An update takes {1e6 * min(seconds):.0f} to
        {1e6 * max(seconds):.0f} us in the median.
    """)
    if log is not None:
        text += [
            "## A measured log",
            "",
            *table(["log, no lag", "bandwidth", "Q Qd Q2d", "trusted"], measure_log(log, fundamental, 1.0)),
        ]
    text += ["## Machine", "", *(f"* {name}: {value}" for name, value in machine.described())]
    text += [f"* load before and after: {before}, {machine.load()}", ""]
    with files.write_whole(output) as part:
        part.write_text("\n".join(text), encoding="utf-8")


if __name__ == "__main__":
    main()
