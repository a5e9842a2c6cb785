"""The benchmarks compute what they say: figures are medians, counts are right."""

from collections import Counter
from itertools import count

import numpy as np
import pytest
from benchmarks.forces import PEERS, Gathered, computed
from benchmarks.peers import MissingError
from benchmarks.results import Run
from benchmarks.tables import figure, paragraph, share, table

import jounce
from benchmarks import bound, coverage, cuda, machine, measure, peaks, pictures, quantities, results, robots, threads
from jounce.program.program import Program, Step
from support.refusals import expect_refusal, refusal
from support.robots import relative_error

LIGHT = [peer for peer in PEERS if peer.name.startswith("jounce") or "pin.rnea" in peer.name]
PROGRAM = Program(
    (
        Step("input", value=0.0),
        Step("input", value=3.0),
        Step("sin", (0,)),
        Step("cos", (0,)),
        Step("mul", (1, 2)),
        Step("add", (3, 4)),
        Step("constant", value=0.1),
        Step("sub", (5, 6)),
        Step("neg", (7,)),
    ),
    outputs=(7, 8),
    inputs=4,
)


@pytest.mark.parametrize("order", [0, 2])
@pytest.mark.parametrize("peer", LIGHT, ids=lambda peer: peer.name)
@pytest.mark.parametrize("states", [1, 24])
def test_peers_compute_the_forces(peer, order, states):
    if order not in peer.orders:
        pytest.skip("of another order")
    robot, rates = jounce.load("iiwa14"), robots.states(7, states, order)
    out = [np.empty_like(rates[0]) for _ in range(order + 1)]
    try:
        call = peer.build(robot, order)(rates, out)
    except (ImportError, MissingError) as error:
        pytest.skip(str(error))
    exact = robot.inverse_dynamics(*rates, method="closed_form")
    for Q, expected in zip(computed(call, out), exact if order else (exact,), strict=True):
        assert relative_error(Q, expected) < (1e-5 if "five-point" in peer.name else 1e-13)


def test_arithmetic_is_counted_fused():
    assert bound.of_program(PROGRAM) == bound.Count(products=1, sums=1)
    assert bound.of_circles(PROGRAM).products > 12  # two polynomials of degree 5
    twice = Program((*PROGRAM.steps, Step("sin", (1,))), (7, 9), 4)
    assert bound.of_circles(twice).products == 2 * bound.of_circles(PROGRAM).products


@pytest.mark.parametrize(
    ("seconds", "expected"),
    [
        ({"fma": 1.0, "add": 1.0, "both": 0.5}, 30.0),  # pipes of their own: sums hide behind products
        ({"fma": 1.0, "add": 1.0, "both": 1.0}, 40.0),  # shared pipes
        ({"fma": 1.0, "add": 4.0, "both": 0.5}, 40.0),  # slow sums
    ],
)
def test_the_bound_is_the_largest_of_what_pipes_take(seconds, expected):
    assert bound.Count(30, 10).seconds(seconds) == expected


@pytest.mark.parametrize("kinds", [("fma",), ("add",), ("fma", "add")])
def test_the_loops_do_what_is_counted(kinds):
    call = peaks.loop(kinds)
    room = call.alive[1]
    call()
    operations = peaks.TURNS * peaks.LENGTH
    per_chain = [2.0 if kinds[j % len(kinds)] == "fma" else float(operations) for j in range(peaks.CHAINS)]
    assert room.reshape(peaks.CHAINS, -1).tolist() == [[x] * (room.size // peaks.CHAINS) for x in per_chain]


def test_figures_are_medians_over_rounds_taken_in_turn(monkeypatch):
    clock, order, took = count(), [], {"a": [5, 1, 3], "b": [8, 8, 2]}
    monkeypatch.setattr(measure, "roughly", lambda call: 1.0)
    monkeypatch.setattr(measure, "perf_counter", lambda: now[0])
    now = [0.0]

    def case(name):
        turns = iter(took[name])

        def call():
            order.append(name)
            now[0] += next(turns)

        return measure.Case((name,), call, states=2)

    rounds = Counter()
    found = measure.medians([case("a"), case("b")], 3, lambda: rounds.update([next(clock)]))
    assert found == {("a",): 1.5, ("b",): 4.0}
    assert order == ["a", "b"] * 3
    assert rounds.total() == 3


def test_short_calls_are_repeated_and_warmed(monkeypatch):
    calls = []
    monkeypatch.setattr(measure, "roughly", lambda call: measure.SAMPLE / 7)
    measure.medians([measure.Case(("a",), lambda: calls.append(None))], 2, lambda: None)
    assert len(calls) == 2 * (1 + 7)


def test_tables():
    assert table(("a", "b"), [("x", "1")]) == ["| a | b |", "| --- | ---: |", "| x | 1 |", ""]
    assert [figure(x) for x in (None, 0.0312, 1.5, 99.96, 1234.5)] == ["-", "0.0312", "1.50", "100", "1,234"]
    assert [share(x) for x in (None, 0.0, 3.4e-16)] == ["-", "0", "3e-16"]
    assert all(len(line) <= 120 for line in paragraph("word " * 100)[0].splitlines())


@pytest.mark.parametrize("row", [*quantities.ROWS[::4], quantities.DERIVATIVES[0]], ids=lambda row: row.label)
def test_quantities_are_compared_with_the_closed_form_first(row, monkeypatch):
    robot = jounce.load("iiwa14")
    batch, call = quantities._cases("iiwa", robot, row, robot.body_names[-1])
    assert batch.states == quantities.COUNT
    for case in (batch, call):
        case.call()
    monkeypatch.setattr(quantities, "WRONG", 0.0)
    with expect_refusal("^results are … from those of the closed form$"):
        list(quantities._cases("iiwa", robot, row, robot.body_names[-1]))


def test_pictures_tell_jounce_from_others_without_colour(monkeypatch):
    """Generated code is jounce's too; hatches and hollow marks are seen on a grey print."""
    monkeypatch.setattr(pictures, "floor", lambda *_: 1e-9)
    monkeypatch.setattr(pictures, "programs", lambda *_: (None, None))
    names = [peer.name for peer in PEERS if 2 in peer.orders]
    times = {("iiwa14", name, k, 1_000): 1e-8 for name in names for k in range(5)}
    drawn = pictures.pictures(Run(times, Gathered(), (), ("", ""), 1))
    hatched = {bar.get_y() for bar in drawn["paths"].axes[0].patches if bar.get_width() and bar.get_hatch()}
    labels = [label.get_text() for label in drawn["paths"].axes[0].get_yticklabels()]
    others = {labels[round(y + 0.325)] for y in hatched}
    assert others == {name for name in names if not name.startswith("jounce")}
    assert "jounce codegen's C, gcc" in labels
    assert others
    hollow = [line for line in drawn["orders"].axes[0].get_lines() if line.get_markerfacecolor() == "white"]
    assert len(hollow) == len(others)


ASSEMBLED = """\
ptxas info    : Compiling entry function 'states' for 'sm_90'
ptxas info    : Function properties for states
    832 bytes stack frame, 788 bytes spill stores, 812 bytes spill loads
ptxas info    : Used 255 registers, used 1 barriers, 832 bytes cumulative stack size, 17408 bytes smem
ptxas info    : Function properties for __internal_trig_reduction_slowpathd
    0 bytes stack frame, 0 bytes spill stores, 0 bytes spill loads
"""


def test_what_a_kernel_takes_of_a_gpu_is_read():
    found = cuda.read(ASSEMBLED)
    assert (found.registers, found.stack, found.stores, found.loads, found.shared) == (255, 832, 788, 812, 17408)
    assert found.threads == 256  # two blocks of 128 threads with 255 registers fit
    refusal(lambda: cuda.read(""), "^ptxas says nothing of the kernel")


@pytest.mark.parametrize(("cores", "expected"), [(1, [1]), (2, [1, 2]), (6, [1, 2, 4, 6]), (8, [1, 2, 4, 8])])
def test_scaling_is_measured_on_all_cores(monkeypatch, cores, expected):
    monkeypatch.setattr(machine, "cores", lambda: cores)
    assert threads.counts() == expected
    keys = [(name, count) for name, batches in threads.ROBOTS.items() for count in batches]
    times = {("threads", *key, k): 8e-9 / k for key in [*keys, (threads.REGISTERS,)] for k in expected}
    rows = list(results._threads(Run(times, Gathered(), (), ("", ""), 1)))
    for label in ("iiwa14", threads.REGISTERS):
        row = next(line for line in rows if line.startswith(f"| {label}"))
        found = [float(cell) for cell in row.strip("| ").split(" | ")[1:]]
        assert found == pytest.approx([*(8 / k for k in expected), *(1 / k for k in expected[1:])], rel=1e-2)


@pytest.mark.parametrize("kind", coverage.KINDS)
def test_stated_deviations_cover_the_errors_of_simulated_logs(kind):
    t, q, truth = coverage.simulate(kind, 1)
    np.testing.assert_allclose(truth(t[:9] + 1e-5, 1) - truth(t[:9], 1), 1e-5 * truth(t[:9], 2), atol=1e-8)
    assert np.abs(q - truth(t)).max() < 0.01
    inside, outside = coverage.measure(kind, 1)
    assert inside.shape == (coverage.ORDER + 1, coverage.TIMES, coverage.JOINTS)
    assert (inside.mean(axis=(1, 2)) > 0.85).all()
    assert (outside.mean(axis=(1, 2)) > 0.8).all()
