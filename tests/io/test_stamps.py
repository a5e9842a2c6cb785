"""Stamps since 1970, which have more digits than doubles: the first one is subtracted in all digits of the file."""

import json

import numpy as np
import pytest

import jounce
from jounce.io import tables
from support.commands import call
from support.refusals import refusal
from support.states import sine_rates

ROBOT = jounce.load("planar2r")
START = 1_732_287_600  # s
RATES = ("q", "qd", "q2d", "q3d", "q4d")


def nanoseconds(rng):
    """Stamps in ns since a random start, of random duration and spacing."""
    step = int(rng.choice([4_000_000, 5_000_000, 10_000_000]))
    count, jitter = rng.integers(40, 200), rng.choice([0, 1])
    since = np.arange(count) * step + jitter * rng.integers(0, step // 3, count)
    return START * 10**9 + int(rng.integers(0, 10**16)) + since


def truths(t):
    return sine_rates(t, 4, [4, 1], [3, 2], np.pi / 2)


def stamped(stamps, found, time="t"):
    return {time: stamps} | {f"joint{j + 1}.{RATES[k]}": x[:, j] for k, x in enumerate(found) for j in (0, 1)}


def in_seconds(stamps):
    return [f"{x // 10**9}.{x % 10**9:09d}" for x in stamps.tolist()]


def write_csv(path, texts, found, time="t", mark=","):
    others = list(stamped(None, found).items())[1:]
    lines = [mark.join([time, *(name for name, _ in others)])]
    lines += [mark.join([text, *(repr(float(x[i])) for _, x in others)]) for i, text in enumerate(texts)]
    path.write_text("\n".join(lines))


def write_jsonl(path, texts, found):
    others = stamped(None, found)
    others.pop("t")
    rows = [{name: float(x[i]) for name, x in others.items()} for i in range(len(texts))]
    path.write_text("\n".join(f'{{"t": {text}, {json.dumps(row)[1:]}' for text, row in zip(texts, rows, strict=True)))


TABLES = ["seconds.csv", "ns.csv", "us.csv", "seconds.jsonl", "ns.npz", "ns.parquet", "arrays", "commas.txt"]


@pytest.fixture(params=TABLES)
def tabled(request, tmp_path):
    """How stamps (ns) with rates come as a table: the source, and options to read it."""

    def make(stamps, found):
        path = tmp_path / request.param
        match request.param:
            case "seconds.csv":
                write_csv(path, in_seconds(stamps), found)
            case "commas.txt":
                write_csv(path, in_seconds(stamps), found, mark=";")
                head, *lines = path.read_text().splitlines()
                path.write_text("\n".join([head, *(line.replace(".", ",") for line in lines)]))
            case "ns.csv":
                write_csv(path, map(str, stamps.tolist()), found, "t [ns]")
            case "us.csv":
                write_csv(path, [f"{x // 1000}.{x % 1000:03d}" for x in stamps.tolist()], found, "t [us]")
            case "seconds.jsonl":
                write_jsonl(path, in_seconds(stamps), found)
            case "ns.npz":
                np.savez(path, **stamped(stamps, found, "t (ns)"))
            case "ns.parquet":
                arrow = pytest.importorskip("pyarrow")
                pytest.importorskip("pyarrow.parquet").write_table(arrow.table(stamped(stamps, found, "t [ns]")), path)
            case "arrays":
                return stamped(stamps, found, "t [ns]")
        return path

    return make


@pytest.mark.parametrize("seed", range(3))
def test_times_are_since_the_first_row_in_all_digits(tabled, seed):
    stamps = nanoseconds(np.random.default_rng(seed))
    since = (stamps - stamps[0]) * 1e-9
    motion = jounce.load_motion(tabled(stamps, truths(since)), ROBOT)
    assert motion.times == pytest.approx(since, rel=1e-15, abs=1e-15)
    middle = (since[1:] + since[:-1]) / 2
    assert motion(middle)[4] == pytest.approx(truths(middle)[4], abs=1e-2)
    [note] = [note for note in motion.notes if "since the first row" in note]
    first = in_seconds(stamps)[0].rstrip("0").rstrip(".")
    assert note.startswith(f"times are since the first row, at {first} s, 202")
    assert motion.deviations(middle) is None


@pytest.mark.parametrize("form", ["%.9f", "%.17g", "%r"])
def test_doubles_of_microseconds_are_these(tmp_path, form):
    """As a double, 1732287600.001 s is 7e-8 s off."""
    since = np.cumsum(np.random.default_rng(1).integers(900, 1100, 100)) / 1e6
    since -= since[0]
    stamps = START + since
    write_csv(tmp_path / "log.csv", [form % float(x) for x in stamps], truths(since))
    np.savez(tmp_path / "log.npz", **stamped(stamps, truths(since)))
    for name in ("log.csv", "log.npz"):
        motion = jounce.load_motion(tmp_path / name, ROBOT)
        assert motion.times == pytest.approx(since, abs=1e-15)
        assert not any("doubles" in note for note in motion.notes)


def test_rounding_of_doubles_is_in_the_deviations_and_is_said():
    rng = np.random.default_rng(2)
    since = np.sort(rng.uniform(0, 0.5, 500))[::5]
    stamps = START + since
    motion = jounce.load_motion(stamped(stamps, truths(since - since[0])), ROBOT, order=0)
    assert any("stamps are doubles, in steps of 2.4e-07 s" in note for note in motion.notes)
    t = np.linspace(0.01, motion.stop - 0.01, 997)
    with pytest.warns(jounce.JounceWarning, match="rounding of joint2.q or t may make up 100% of joint2.q4d between"):
        found = motion(t, 4)
    off = [np.abs(a - b) for a, b in zip(found, truths(t), strict=True)]
    deviations = motion.deviations(t, 4)
    share = [np.mean(a < 3 * d + 1e-9) for a, d in zip(off, deviations, strict=True)]
    assert min(share) > 0.97
    assert max(np.mean(a > 0.003 * d) for a, d in zip(off, deviations, strict=True)) > 0.5


def test_splines_warn_where_rounding_of_doubles_shows():
    since = np.arange(400) / 1000 + np.random.default_rng(0).uniform(0, 1e-5, 400)
    q = truths(since - since[0])[0]
    given = {"t": START + since, "joint1": q[:, 0], "joint2": q[:, 1]}
    with pytest.warns(jounce.JounceWarning, match="rounding of the samples makes up 100% of the largest q4d"):
        jounce.load_motion(given, ROBOT, degree=7)
    assert jounce.load_motion(given, ROBOT, bandwidth=20, allow_noise=True).times[-1] < 1


@pytest.mark.parametrize(("start", "expected"), [(86399.0, 86399.0), (86400.5, 0.0), (0.0, 0.0), (-5.0, -5.0)])
def test_only_stamps_beyond_a_day_are_since_the_first_row(start, expected):
    t = np.arange(50) / 64
    motion = jounce.load_motion(stamped(start + t, truths(t)), ROBOT)
    assert motion.start == expected
    assert any("since the first row, at 86400.5 s" in note for note in motion.notes) == (expected != start)


def test_rows_that_go_back_are_refused_in_times_since_the_first():
    t = START + np.array([0, 0.1, 0.2, 0.15, 0.3])
    refusal(lambda: jounce.load_motion(stamped(t, truths(t)), ROBOT), "does not increase: 0.2", " comes before 0.1")


def test_commands_print_times_since_the_first_row_and_the_date_once(tmp_path):
    stamps = START * 10**9 + np.arange(200) * 10**7
    write_csv(tmp_path / "log.csv", in_seconds(stamps), truths((stamps - stamps[0]) * 1e-9))
    result = call("run", "planar2r", tmp_path / "log.csv", "-o", tmp_path / "out.npz")
    assert result.exit_code == 0, result.output
    assert "200 states, t = 0 .. 1.99 s" in result.output
    assert result.output.count("2024-11-22 15:00:00 UTC") == 1
    assert "e+09" not in result.output


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".parquet"])
@pytest.mark.parametrize("sampled", [True, False])
def test_tables_read_by_parts_have_the_same_times(tmp_path, suffix, sampled):
    """Of two motions in one table, since its first row; whole motions and rows of all rates."""
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    since = np.arange(400) / 500
    found = truths(since)[: 1 if sampled else 5]
    given = stamped(since, found)
    if sampled:
        given = {name.removesuffix(".q"): x for name, x in given.items()}
    (tmp_path / "in").mkdir()
    (tmp_path / "epoch").mkdir()
    tables.write(tmp_path / "in" / f"a{suffix}", given)
    tables.write(tmp_path / "epoch" / f"a{suffix}", given | {"t": START + since})
    outputs = []
    for folder in ("in", "epoch"):
        words = ["run", "planar2r", str(tmp_path / folder), "-o", str(tmp_path / f"{folder}.npz"), "--json"]
        result = call(*words)
        assert result.exit_code == 0, result.output
        outputs.append(tables.read(tmp_path / f"{folder}.npz", lambda names: [n for n in names if n != "motion"]))
        notes = json.loads(result.stdout)["notes"]
    assert any("since the first row" in note for note in notes)
    for name, column in outputs[0].items():
        assert outputs[1][name] == pytest.approx(column, rel=1e-9, abs=1e-9 * np.abs(column).max()), name
