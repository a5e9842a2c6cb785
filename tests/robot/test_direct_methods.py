"""Methods of robots that native code serves: by keywords, with a base that moves, with loops to close."""

import numpy as np
import pytest

import jounce
from jounce.native import direct_interpreter
from jounce.robot import quantity_methods
from support.refusals import refusal

pytestmark = pytest.mark.skipif(not direct_interpreter.fits(), reason="direct calls are off on this interpreter")


class PythonCalledError(Exception):
    """The method in Python was called."""


@pytest.fixture
def natively(monkeypatch):
    """Call a method, where its Python must not run."""

    def refuse(*arguments, **options):
        raise PythonCalledError

    def call(called, *given, **options):
        with monkeypatch.context() as patch:
            patch.setattr(quantity_methods, "compute", refuse)
            return called(*given, **options)

    return call


def check_equal(found, expected):
    assert type(found) is type(expected)
    found, expected = (x if isinstance(x, tuple) else (x,) for x in (found, expected))
    for x, y in zip(found, expected, strict=True):
        assert np.array_equal(x, y)


RNG = np.random.default_rng(3)
STATE = RNG.uniform(-1, 1, (5, 7))
WRENCHES = RNG.uniform(-5, 5, (3, 7, 6))
CALLS = {
    "wrench": ("inverse_dynamics", 3, {"wrench": WRENCHES[0]}),
    "wrench with rates": ("inverse_dynamics", 5, {"wrench": tuple(WRENCHES)}),
    "body and frame": ("jacobian", 2, {"body": "link7", "frame": "world"}),
    "frame": ("twists", 3, {"frame": "spatial"}),
    "method": ("mass_matrix", 1, {"method": "kernel"}),
    "accelerations": ("forward_dynamics", 4, {"wrench": tuple(WRENCHES[:2])}),
}


@pytest.mark.parametrize("lists", [False, True])
@pytest.mark.parametrize("name", CALLS)
def test_keywords(natively, name, lists):
    quantity, count, options = CALLS[name]
    given = [x.tolist() if lists else x.copy() for x in STATE[:count]]
    method = getattr(jounce.load("iiwa14"), quantity)
    expected = [method(*given, **options) for _ in range(2)][-1]
    robot = method.__self__
    check_equal(natively(getattr(robot, quantity), *given, **options), expected)
    out = tuple(np.zeros_like(x) for x in (expected if isinstance(expected, tuple) else (expected,)))
    into = out if len(out) > 1 else out[0]
    found = natively(getattr(robot, quantity), *given, out=into, **options)
    check_equal(found, expected)
    assert all(x is y for x, y in zip(found if len(out) > 1 else (found,), out, strict=True))


@pytest.mark.parametrize("change", [
    {"wrench": WRENCHES[0, :6]}, {"wrench": (WRENCHES[0], WRENCHES[1])}, {"wrench": WRENCHES[0].tolist()},
    {"wrench": {"link7": [0.0] * 6}}, {"method": "recursion"}, {"wrench": None}, {"body": "link7"},
    {"out": [np.zeros(7)] * 2}, {"out": np.zeros(8)}, {"out": "text"}, {"unknown": 1},
])  # fmt: skip
def test_other_keywords_have_the_answers_of_the_method(change):
    def outcome(robot):
        try:
            return robot.inverse_dynamics(*STATE[:3], **({"wrench": WRENCHES[0]} | change))
        except (jounce.JounceError, TypeError) as error:
            return f"{type(error).__name__}: {error}"

    served, other = jounce.load("iiwa14"), jounce.load("iiwa14")
    for _ in range(2):
        served.inverse_dynamics(*STATE[:3], wrench=WRENCHES[0])
    found, expected = outcome(served), outcome(other)
    assert type(found) is type(expected)
    assert np.array_equal(found, expected)


def test_texts_that_are_equal_but_not_the_same_go_to_the_method():
    robot = jounce.load("iiwa14")
    expected = [robot.jacobian(STATE[0], body="link7") for _ in range(2)][-1]
    other = "".join(["li", "nk7"])
    assert other is not "link7"  # noqa: F632 - the identity is what the call compares
    check_equal(robot.jacobian(STATE[0], body=other), expected)


class TestBases:
    @pytest.fixture
    def dog(self):
        return jounce.load("solo12", base="floating")

    @pytest.fixture
    def given(self):
        rng = np.random.default_rng(4)
        pose = jounce.load("iiwa14").poses(rng.uniform(-1, 1, 7), body="link5")
        return [x.copy() for x in rng.uniform(-1, 1, (5, 12))], (pose, *rng.uniform(-1, 1, (4, 6)))

    @pytest.mark.parametrize(("quantity", "rates", "terms"), [
        ("inverse_dynamics", 3, 3), ("inverse_dynamics", 5, 5), ("mass_matrix", 1, 1), ("coriolis_matrix", 2, 2),
        ("poses", 2, 2), ("gravity_forces", 1, 1), ("center_of_mass", 3, 3),
    ])  # fmt: skip
    def test_they_are_served(self, natively, dog, given, quantity, rates, terms):
        rows, base = given[0][:rates], given[1][:terms]
        expected = [getattr(dog, quantity)(*rows, base=base) for _ in range(2)][-1]
        check_equal(natively(getattr(dog, quantity), *rows, base=base), expected)

    def test_matrices_that_are_no_poses_are_refused(self, natively, dog, given):
        rows, base = given[0][:3], given[1][:3]
        for _ in range(2):
            dog.inverse_dynamics(*rows, base=base)
            dog.mass_matrix(rows[0], base=base[:1])
        bad, verge = base[0].copy(), base[0].copy()
        bad[:3, :3] *= 1.001
        verge[0, 3] = np.nan
        for wrong in (bad, verge, np.zeros((4, 4)), base[0][:3], base[0].tolist()):
            with pytest.raises(PythonCalledError):
                natively(dog.inverse_dynamics, *rows, base=(wrong, *base[1:]))
            with pytest.raises(PythonCalledError):
                natively(dog.mass_matrix, rows[0], base=(wrong,))
        refusal(lambda: dog.mass_matrix(rows[0], base=(bad,)), "C is no pose")
        refusal(lambda: dog.mass_matrix(rows[0], base=(base[0], np.zeros(5))), "base")


CLOSED = {"delta": [0.6, 0.7, 0.8], "fivebar": None, "fourbar_leg": None, "gough_stewart": None}


class TestLoops:
    @pytest.fixture(params=CLOSED)
    def closed(self, request):
        robot = jounce.load(request.param)
        start = np.asarray(robot.mechanism.closure.start)[list(robot.mechanism.closure.independent)]
        q = np.array(CLOSED[request.param] or start + 1e-3)
        return robot, q, robot.coordinates(q)

    @pytest.mark.sweep(3)
    def test_nearly_closed_positions_are_served(self, natively, closed):
        robot, _, whole = closed
        rates = np.random.default_rng(1).uniform(-1, 1, (4, robot.n))
        near = whole + 1e-16
        for given in ((near,), (near, rates[0]), (near, *rates)):
            for _ in range(2):
                expected = robot.inverse_dynamics(*given) if len(given) > 2 else robot.gravity_forces(*given)
            method = robot.inverse_dynamics if len(given) > 2 else robot.gravity_forces
            check_equal(natively(method, *given), expected)
            check_equal(natively(method, *[x.tolist() for x in given]), expected)

    def test_open_loops_go_to_the_method(self, natively, closed):
        robot, q, whole = closed
        for _ in range(2):
            robot.gravity_forces(whole)
        off = whole.copy()
        off[robot.mechanism.closure.dependent[0]] += 1e-3
        with pytest.raises(PythonCalledError):
            natively(robot.gravity_forces, off)
        with pytest.raises(PythonCalledError):
            natively(robot.gravity_forces, q)
        check_equal(robot.gravity_forces(off), jounce.load(robot.name).gravity_forces(off))

    def test_positions_near_a_singularity_go_to_the_method(self, natively, monkeypatch, closed):
        robot, _, whole = closed
        monkeypatch.setattr("jounce.engine.certain_digits.max_condition", lambda asked: 1.0)
        for _ in range(2):
            robot.gravity_forces(whole)
        with pytest.raises(PythonCalledError):
            natively(robot.gravity_forces, whole)


def test_forms_are_served_up_to_a_number(monkeypatch):
    monkeypatch.setattr("jounce.engine.direct_methods.MAX_DIRECT_FORMS", 2)
    robot = jounce.load("iiwa14")
    for body in [*robot.body_names] * 2:
        check_equal(robot.jacobian(STATE[0], body=body), robot.jacobian(STATE[0], body=body, method="kernel"))
    assert sum(robot._kernels.forms.values()) <= 2 == len(robot._kernels.forms)
