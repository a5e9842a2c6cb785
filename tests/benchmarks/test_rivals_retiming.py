"""The retiming of the benchmark beside other libraries: its judge, and what becomes of libraries with faults."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.retime import on_path
from benchmarks.rivals import retimers, retiming
from benchmarks.rivals.retimers import Answer, Problem, Retimer

import jounce

FRACTIONS = np.linspace(0, 1, retiming.FINER)
LINE = np.array([[0.1, 1.0], [-0.2, 0.5]])  # joints from (0.1, -0.2) by (1, 0.5)
SMOOTH = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])  # from rest to rest in one second
PEAK = 10 / np.sqrt(3)  # of its acceleration; its velocity peaks at 1.875


@pytest.fixture(scope="module")
def problem():
    robot = jounce.load("planar2r").with_limits(velocity=1.0, acceleration=4.0, jerk=40.0)
    return Problem("a line", robot, robot, LINE, on_path(LINE))


def along_line(laws, intervals):
    """An answer that moves along the line by u(t), t from 0 to 1, with so many intervals of equal time."""

    def rates(fractions):
        t = (np.arange(intervals)[:, None] + fractions) / intervals
        start, way = LINE.T
        q, *rest = (law(t)[..., None] * way for law in laws)
        return q + start, *rest

    return Answer(1.0, rates)


def laws(u, *changed):
    return [changed[k] if k < len(changed) else u.deriv(k) if k else u for k in range(4)]


def judged_rows(problem, *solvers):
    return retiming.measured_problem(problem, [Retimer(str(k), solve) for k, solve in enumerate(solvers)])


def smooth_law(problem):
    return along_line(laws(SMOOTH), 40)


def test_the_judge_finds_what_exceeds_a_limit_between_points(problem):
    robot = problem.robot.with_limits(velocity=1.875, acceleration=PEAK / 1.1, jerk=30.0)
    # With two intervals accelerations are zero at all points of the grid.
    found = retiming.shares(robot, along_line(laws(SMOOTH), 2).rates(FRACTIONS))
    assert found["velocity"] == pytest.approx(1, rel=1e-9)
    assert found["acceleration"] == pytest.approx(1.1, rel=2e-3)
    assert found["jerk"] == pytest.approx(2, rel=1e-9)


def test_torques_and_their_rates_are_those_of_inverse_dynamics(problem):
    robot = problem.robot.with_limits(effort=2.0, effort_rate=3.0)
    rates = along_line(laws(SMOOTH), 2).rates(FRACTIONS)
    Q, Qd = robot.inverse_dynamics(*(rate.reshape(-1, 2) for rate in rates), method="recursion")
    found = retiming.shares(robot, rates)
    assert found["torque"] == pytest.approx(np.abs(Q).max() / 2)
    assert found["torque rate"] == pytest.approx(np.abs(Qd).max() / 3)


def test_rates_of_accelerations_that_jump_have_no_share(problem):
    up = np.polynomial.Polynomial([0, 0, 2])
    down = np.polynomial.Polynomial([-1, 4, -2])
    # Half a second with an acceleration of 4, then with -4: each interval with its own, also at 0.5 s.
    first, second = (along_line(laws(half), 2).rates(FRACTIONS) for half in (up, down))
    rates = tuple(np.stack([x[0], y[1]]) for x, y in zip(first, second, strict=True))
    assert retiming.fault(problem, Answer(1.0, lambda _: rates), rates) == ""
    found = retiming.shares(problem.robot, rates)
    assert found["jerk"] is None
    assert found["acceleration"] == pytest.approx(1)


def test_a_library_that_is_missing_has_a_note(problem, monkeypatch):
    monkeypatch.setitem(sys.modules, "copp_py", None)
    missing, there = judged_rows(problem, retimers.copp(11), smooth_law)
    assert missing["note"] == "not installed: copp_py"
    assert missing["duration"] is missing["seconds"] is missing["kept"] is None
    assert there["note"] == ""
    assert there["duration"] == 1
    assert there["seconds"] > 0


class Panic(BaseException):
    """What Rust raises in Python."""


@pytest.mark.parametrize("kind", [RuntimeError, Panic])
@pytest.mark.parametrize("calls", [0, 2])
def test_a_library_that_raises_has_a_note(problem, kind, calls):
    made = []

    def solve(problem):
        made.append(None)
        if len(made) > calls:
            raise kind("no law\nfound")
        return smooth_law(problem)

    failing, there = judged_rows(problem, solve, smooth_law)
    assert failing["note"] == f"{kind.__name__}: no law"
    assert failing["duration"] is failing["seconds"] is None
    assert failing["shares"] == {}
    assert there["note"] == ""


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ((SMOOTH + 1e-3,), "it does not begin and end where the path does"),
        ((np.polynomial.Polynomial([0, 1]), np.polynomial.Polynomial([1.0])), "it does not begin and end at rest"),
        ((lambda t: np.full_like(t, np.nan),), "not finite"),
    ],
)
def test_a_wrong_motion_has_a_note(problem, changed, words):
    def solve(problem):
        return along_line(laws(SMOOTH, *changed), 40)

    wrong, there = judged_rows(problem, solve, smooth_law)
    assert words in wrong["note"]
    assert wrong["duration"] is None
    assert there["note"] == ""


@pytest.mark.parametrize(("rate", "change", "name"), [(0, 1e-3, "position"), (1, 1e-2, "velocity")])
def test_a_motion_that_jumps_has_a_note(problem, rate, change, name):
    def solve(problem):
        exact = smooth_law(problem)

        def rates(fractions):
            found = exact.rates(fractions)
            # In an interval in the middle alone.
            found[rate][20] += change * LINE[:, 1]
            return found

        return Answer(1.0, rates)

    (row,) = judged_rows(problem, solve)
    assert row["note"] == f"wrong: its {name} jumps"


def test_a_motion_that_leaves_the_path_has_a_note(problem):
    def solve(problem):
        exact = smooth_law(problem)

        def rates(fractions):
            q, *rest = exact.rates(fractions)
            return q + [0.0, 0.01] * np.sin(np.pi * (q[..., :1] - 0.1)) ** 2, *rest

        return Answer(1.0, rates)

    (row,) = judged_rows(problem, solve)
    assert row["note"] == "wrong: 0.009 rad off the path"


def test_a_motion_that_lasts_another_time_than_stated_has_a_note(problem):
    (row,) = judged_rows(problem, lambda problem: Answer(1.2, smooth_law(problem).rates))
    assert row["note"].startswith("wrong: it lasts 0.99")
    assert row["note"].endswith("s, and states 1.2 s")


def test_jounce_toppra_and_ruckig_keep_their_limits_on_a_line(problem):
    solvers = retimers.jounce(), retimers.ruckig, retimers.toppra(51)
    rows = [retiming.judged(problem, Retimer("", solve)) for solve in solvers]
    assert [row["note"] for row in rows] == [""] * 3
    assert [row["kept"] for row in rows] == [True, True, False]  # toppra knows no jerk
    ours, best, jumping = rows
    assert jumping["shares"]["jerk"] is None
    assert max(best["shares"].values()) == pytest.approx(1, abs=1e-6)
    assert jumping["duration"] < best["duration"] < ours["duration"] < 1.01 * best["duration"]


def test_time_laws_of_third_order_are_exact(problem):
    # s = (1 - cos(w t)) / 2 has s'' = w^2 (1 - 2 s) / 2, which is linear in s.
    w, u = 3.0, np.linspace(0, 1, 6)
    profile = SimpleNamespace(a=w**2 * u * (1 - u), b=w**2 * (1 - 2 * u) / 2, num_stationary=(0, 0))
    q, qd, q2d, q3d = retimers._quadratic_law(problem, u, profile)(FRACTIONS[1:-1])
    s = (u[:-1, None] + 0.2 * FRACTIONS[1:-1])[..., None]
    speed, way = w * np.sqrt(s * (1 - s)), LINE[:, 1]
    np.testing.assert_allclose(q, LINE[:, 0] + s * way)
    np.testing.assert_allclose(qd, speed * way)
    np.testing.assert_allclose(q2d, w**2 * (0.5 - s) * way, atol=1e-12)
    np.testing.assert_allclose(q3d, -(w**2) * speed * way)


def test_time_laws_next_to_rests_are_cubic(problem):
    # s = k t^3 up to s = 0.5, and the same backwards.
    k, u = 4.0, np.array([0, 0.25, 0.5, 0.75, 1])
    a = 9 * k ** (2 / 3) * np.minimum(u, 1 - u) ** (4 / 3)
    profile = SimpleNamespace(a=a, b=np.zeros(5), num_stationary=(2, 2))
    rates = retimers._quadratic_law(problem, u, profile)(FRACTIONS)
    s = u[:-1, None] + 0.25 * FRACTIONS
    t, sign = np.cbrt(np.minimum(s, 1 - s) / k), np.where(s < 0.5, 1, -1)
    sign[1, -1] = 1  # the end of the second interval
    for rate, law in zip(rates[1:], (3 * k * t**2, sign * 6 * k * t, 6 * k + 0 * t), strict=True):
        np.testing.assert_allclose(rate, law[..., None] * LINE[:, 1], atol=1e-9)
