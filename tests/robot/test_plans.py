"""The short way of plans: the bits of the long way for what it serves, the long way's answers for all else."""

import traceback
import warnings
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction

import numpy as np
import pytest

import jounce
from jounce.engine import plan
from jounce.native.kernel import Kernel
from support.quantities import tupled
from support.refusals import refusal

RNG = np.random.default_rng(3)
STATE = RNG.uniform(-1, 1, (5, 7))
WRENCHES = RNG.uniform(-5, 5, (3, 7, 6))


class LongWayError(Exception):
    """The short way declined."""


@pytest.fixture
def shortly(monkeypatch):
    """Call a method where its long way must not run."""

    def refuse(*arguments):
        raise LongWayError

    def call(called, *given, **options):
        with monkeypatch.context() as patch:
            patch.setattr(plan.Plan, "compute", refuse)
            return called(*given, **options)

    return call


def check_same_bits(found, expected):
    assert type(found) is type(expected)
    for x, y in zip(tupled(found), tupled(expected), strict=True):
        assert type(x) is type(y)
        assert (x.shape, x.dtype) == (y.shape, y.dtype)
        assert np.array_equal(x, y)


CALLS = {
    "rates": ("inverse_dynamics", 5, {}),
    "wrench": ("inverse_dynamics", 3, {"wrench": WRENCHES[0]}),
    "wrench with rates": ("inverse_dynamics", 5, {"wrench": tuple(WRENCHES)}),
    "body and frame": ("jacobian", 2, {"body": "link7", "frame": "world"}),
    "frame": ("twists", 3, {"frame": "spatial"}),
    "method": ("mass_matrix", 1, {"method": "kernel"}),
    "a scalar": ("kinetic_energy", 2, {}),
    "accelerations": ("forward_dynamics", 4, {"wrench": tuple(WRENCHES[:2])}),
}


@pytest.mark.parametrize("lists", [False, True])
@pytest.mark.parametrize("name", CALLS)
def test_second_calls_go_the_short_way_with_the_same_bits(shortly, name, lists):
    quantity, count, options = CALLS[name]
    given = [x.tolist() if lists else x.copy() for x in STATE[:count]]
    method = getattr(jounce.load("iiwa14"), quantity)
    expected = method(*given, **options)
    check_same_bits(shortly(method, *given, **options), expected)
    out = tuple(np.zeros_like(x) for x in tupled(expected))
    found = shortly(method, *given, out=out if len(out) > 1 else out[0], **options)
    assert all(x is y for x, y in zip(tupled(found), out, strict=True))
    assert all(map(np.array_equal, out, tupled(expected)))


def test_further_rates_without_names_count_by_what_they_are(shortly):
    robot, given = jounce.load("iiwa14"), RNG.uniform(-1, 1, (7, 7))
    expected = robot.inverse_dynamics(*given)
    check_same_bits(shortly(robot.inverse_dynamics, *given), expected)
    check_same_bits(robot.inverse_dynamics(*given[:6], None), robot.inverse_dynamics(*given[:6]))
    check_same_bits(robot.inverse_dynamics(*given[:5], None, None), robot.inverse_dynamics(*given[:5]))
    refusal(lambda: robot.inverse_dynamics(*given[:5], None, given[6]), "q5d is None")
    check_same_bits(robot.inverse_dynamics(*given[:6], given[6].tolist()), expected)


@pytest.mark.parametrize("rows", [(5, 7), (2, 3, 7)])
def test_batches_go_the_short_way(shortly, rows):
    robot, given = jounce.load("iiwa14"), RNG.uniform(-1, 1, (5, *rows))
    expected = robot.inverse_dynamics(*given)
    check_same_bits(shortly(robot.inverse_dynamics, *given), expected)


LISTED = {
    "texts": ["1.0"] * 7,
    "text among numbers": [1.0] * 6 + ["2.0"],
    "truths": [True] * 7,
    "truth among numbers": [0.5] * 6 + [True],
    "none": [None] * 7,
    "huge integers": [10**400] * 7,
    "a huge integer": [0.5] * 6 + [10**400],
    "nested": [[0.1] * 7, [0.2] * 7],
    "ragged": [[0.1], 0.2],
    "short": [0.1] * 6,
    "empty": [],
    "fractions": [Fraction(1, 3)] * 7,
}


@pytest.mark.parametrize("case", LISTED)
def test_lists_have_the_answer_of_the_first_call(case):
    def answer(robot):
        try:
            return robot.mass_matrix(LISTED[case])
        except jounce.JounceError as error:
            return str(error)

    served = jounce.load("iiwa14")
    served.mass_matrix([0.1] * 7)
    found, expected = answer(served), answer(jounce.load("iiwa14"))
    assert type(found) is type(expected)
    assert np.array_equal(found, expected)


class Subclass(np.ndarray):
    """An array of another type."""


class BadHash:
    """An option whose hash raises what nobody expects."""

    def __hash__(self):
        raise RuntimeError("no hash")

    def __repr__(self):
        return "BadHash()"


@pytest.mark.parametrize(
    "change",
    [
        {"wrench": WRENCHES[0, :6]},
        {"wrench": (WRENCHES[0], WRENCHES[1])},
        {"wrench": WRENCHES[0].tolist()},
        {"wrench": {"link7": [0.0] * 6}},
        {"method": "recursion"},
        {"wrench": None},
        {"body": "link7"},
        {"out": [np.zeros(7)] * 2},
        {"out": np.zeros(8)},
        {"out": "text"},
        {"unknown": 1},
        {"method": BadHash()},
        {"threads": BadHash()},
        {"threads": np.array([1, 2])},
    ],
    ids=repr,
)
def test_other_options_have_the_answer_of_the_first_call(change):
    def answer(robot):
        try:
            return robot.inverse_dynamics(*STATE[:3], **({"wrench": WRENCHES[0]} | change))
        except (jounce.JounceError, TypeError) as error:
            return f"{type(error).__name__}: {error}"

    served = jounce.load("iiwa14")
    served.inverse_dynamics(*STATE[:3], wrench=WRENCHES[0])
    found, expected = answer(served), answer(jounce.load("iiwa14"))
    assert type(found) is type(expected)
    assert np.array_equal(found, expected)


OTHERS = {
    "subclass": lambda q: q.view(Subclass),
    "mask": np.ma.masked_array,
    "names": lambda q: {f"joint{k + 1}": x for k, x in enumerate(q)},
    "tuple": tuple,
}


@pytest.mark.parametrize("kind", OTHERS)
def test_what_is_no_array_of_numpy_meets_no_plan_of_arrays(shortly, kind):
    robot, given = jounce.load("iiwa14"), OTHERS[kind](STATE[0])
    expected = robot.mass_matrix(STATE[0])
    check_same_bits(robot.mass_matrix(given), expected)
    with pytest.raises(LongWayError):
        shortly(robot.mass_matrix, given)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200, 1e-200])
def test_warnings_are_those_of_the_ufunc(value):
    robot, given = jounce.load("iiwa14"), [x.copy() for x in STATE]
    robot.inverse_dynamics(*given)
    given[1][3] = value

    def outcome(call):
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            results = call(*given)
        raised = ""
        with np.errstate(all="raise"):
            try:
                call(*given)
            except FloatingPointError as error:
                raised = str(error)
        return [str(x.message) for x in found], raised, [x.tobytes() for x in results]

    assert outcome(robot.inverse_dynamics) == outcome(robot.compile(order=2).ufunc)


@pytest.mark.parametrize("place", ["step", "short way", "long way"])
def test_a_bug_in_the_way_of_plans_reaches_the_user(monkeypatch, place):
    def broken(*given):
        raise NameError("planted")

    robot, given, base = jounce.load("solo12", base="floating"), RNG.uniform(-1, 1, (3, 12)), np.eye(4)
    options = {"base": (base, np.zeros(6), np.zeros(6))}
    robot.inverse_dynamics(*given, **options)
    if place == "step":
        monkeypatch.setattr(plan, "are_poses", broken)
    elif place == "short way":
        monkeypatch.setattr(plan._KernelCalls, "_prepare", broken)
    else:
        monkeypatch.setattr(plan.Plan, "compute", broken)
        options = {"base": tuple(x.tolist() for x in options["base"])}
        monkeypatch.setattr(plan, "NUMBERS", frozenset())
    with pytest.raises(NameError, match="planted"):
        robot.inverse_dynamics(*given, **options)


def test_a_wrong_shape_shows_two_of_our_frames_at_most():
    robot = jounce.load("iiwa14")
    for _ in range(2):
        try:
            robot.inverse_dynamics(STATE[0][:6], *STATE[1:3])
        except jounce.JounceError as error:
            frames = traceback.extract_tb(error.__traceback__)
        assert len([x for x in frames if "jounce/" in x.filename.replace("\\", "/") and "tests" not in x.filename]) <= 2
        robot.inverse_dynamics(*STATE[:3])


def test_a_method_that_was_taken_earlier_goes_the_short_way_too(shortly):
    method = jounce.load("iiwa14").gravity_forces
    expected = method(STATE[0])
    check_same_bits(shortly(method, STATE[0]), expected)


def test_another_precision_at_first_leaves_the_short_way_open(shortly):
    robot = jounce.load("iiwa14")
    robot.gravity_forces(STATE[0].astype(np.longdouble))
    with pytest.raises(LongWayError):
        shortly(robot.gravity_forces, STATE[0])
    expected = robot.gravity_forces(STATE[0])
    check_same_bits(shortly(robot.gravity_forces, STATE[0]), expected)


def test_methods_of_subclasses_stay(shortly):
    class Doubled(jounce.Robot):
        def gravity_forces(self, *given, **options):
            return 2 * super().gravity_forces(*given, **options)

    robot, once = Doubled(jounce.load("iiwa14").mechanism), jounce.load("iiwa14").gravity_forces(STATE[0])
    for _ in range(2):
        assert np.array_equal(robot.gravity_forces(STATE[0]), 2 * once)
    assert np.array_equal(shortly(robot.gravity_forces, STATE[0]), 2 * once)


def test_threads_share_plans():
    robot = jounce.load("iiwa14")
    expected = robot.compile(order=2)(*STATE)

    def run(_):
        return all(np.array_equal(robot.inverse_dynamics(*STATE)[2], expected[2]) for _ in range(200))

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(run, range(8)))


class TestBases:
    @pytest.fixture
    def dog(self):
        return jounce.load("solo12", base="floating")

    @pytest.fixture
    def given(self):
        rng = np.random.default_rng(4)
        pose = jounce.load("iiwa14").poses(rng.uniform(-1, 1, 7), body="link5")
        return [x.copy() for x in rng.uniform(-1, 1, (5, 12))], (pose, *rng.uniform(-1, 1, (4, 6)))

    @pytest.mark.parametrize(
        ("quantity", "rates", "terms"),
        [
            ("inverse_dynamics", 3, 3),
            ("inverse_dynamics", 5, 5),
            ("mass_matrix", 1, 1),
            ("coriolis_matrix", 2, 2),
            ("poses", 2, 2),
            ("gravity_forces", 1, 1),
            ("center_of_mass", 3, 3),
        ],
    )
    def test_they_are_checked_on_the_short_way(self, shortly, dog, given, quantity, rates, terms):
        rows, base, method = given[0][:rates], given[1][:terms], getattr(dog, quantity)
        expected = method(*rows, base=base)
        check_same_bits(shortly(method, *rows, base=base), expected)
        for wrong in (base[0] * 1.001, base[0] * np.nan, np.zeros((4, 4)), base[0][:3], base[0].astype(np.longdouble)):
            with pytest.raises(LongWayError):
                shortly(method, *rows, base=(wrong, *base[1:]))
        refusal(lambda: method(*rows, base=(base[0] * 1.001, *base[1:])), "C is no pose")

    def test_a_twist_that_does_not_enter_is_checked(self, shortly, dog, given):
        q, (C, V, *_) = given[0][0], given[1]
        dog.coriolis_matrix(q, q, base=(C, V)), dog.mass_matrix(q, q, base=(C, V))
        for wrong in (V[:5], V.astype(np.longdouble)):
            with pytest.raises(LongWayError):
                shortly(dog.mass_matrix, q, q, base=(C, wrong))
        refusal(lambda: dog.mass_matrix(q, q, base=(C, V[:5])), "base")

    def test_terms_that_do_not_enter_are_counted(self, dog, given):
        q, (C, V, A, *_) = given[0][0], given[1]
        dog.mass_matrix(q, base=(C,))
        refusal(lambda: dog.mass_matrix(q, base=(C, V, A)), "base gives 3 terms")
        dog.mass_matrix(q, q, base=(C, V))
        refusal(lambda: dog.mass_matrix(q, q, base=(C,)), "base gives C alone")

    @pytest.mark.parametrize("batch", [(), (3,)])
    @pytest.mark.parametrize("quantity", ["inverse_dynamics", "gravity_forces", "mass_matrix", "forward_dynamics"])
    def test_whole_states_go_the_short_way(self, shortly, dog, quantity, batch):
        rng = np.random.default_rng(6)
        q = rng.uniform(-1, 1, (*batch, dog.nq))
        rates = {"inverse_dynamics": 2, "forward_dynamics": 2}.get(quantity, 0)
        given, method = [q, *rng.uniform(-1, 1, (rates, *batch, dog.nv))], getattr(dog, quantity)
        expected = method(*given)
        check_same_bits(shortly(method, *given), expected)
        other = method(*given, method="recursion")
        assert np.allclose(expected, other, rtol=0, atol=1e-10 * np.abs(other).max())
        for wrong in (q[..., :-1], q.astype(np.longdouble)):
            with pytest.raises(LongWayError):
                shortly(method, wrong, *given[1:])
        if rates:
            with pytest.raises(LongWayError):
                shortly(method, q, given[1][..., :-1], given[2])

    def test_a_quaternion_of_zeros_goes_the_long_way(self, shortly, dog):
        q = np.ones(dog.nq)
        dog.gravity_forces(q)
        q[3:7] = 0
        with pytest.raises(LongWayError), np.errstate(all="ignore"):
            shortly(dog.gravity_forces, q)


CLOSED = {"delta": [0.6, 0.7, 0.8], "fivebar": None, "fourbar_leg": None, "gough_stewart": None}


class TestLoops:
    @pytest.fixture(params=CLOSED)
    def closed(self, request):
        robot = jounce.load(request.param)
        start = np.asarray(robot.mechanism.closure.start)[list(robot.mechanism.closure.independent)]
        q = np.array(CLOSED[request.param] or start + 1e-3)
        return robot, q, robot.coordinates(q)

    @pytest.mark.sweep(3)
    def test_nearly_closed_positions_go_the_short_way(self, shortly, closed):
        robot, _, whole = closed
        rates = np.random.default_rng(1).uniform(-1, 1, (4, robot.n))
        for given in ((whole + 1e-16,), (whole + 1e-16, rates[0]), (whole + 1e-16, *rates)):
            method = robot.inverse_dynamics if len(given) > 2 else robot.gravity_forces
            expected = method(*given)
            check_same_bits(shortly(method, *given), expected)

    def test_open_loops_go_the_long_way(self, shortly, closed):
        robot, q, whole = closed
        robot.gravity_forces(whole)
        off = whole.copy()
        off[robot.mechanism.closure.dependent[0]] += 1e-3
        with pytest.raises(LongWayError):
            shortly(robot.gravity_forces, q)
        with pytest.raises(LongWayError):
            shortly(robot.gravity_forces, whole.astype(np.longdouble))
        check_same_bits(robot.gravity_forces(off), jounce.load(robot.name).gravity_forces(off))

    def test_positions_near_a_singularity_go_the_long_way(self, shortly, monkeypatch, closed):
        robot, _, whole = closed
        monkeypatch.setattr("jounce.engine.certain_digits.max_condition", lambda asked: 1.0)
        robot.gravity_forces(whole)
        with pytest.raises(LongWayError):
            shortly(robot.gravity_forces, whole)


def test_without_ufuncs_of_numpy_results_are_written_as_with_one(monkeypatch):
    expected = jounce.load("iiwa14").inverse_dynamics(*STATE)
    monkeypatch.setattr("jounce.native.jit.has_known_table", lambda: False)
    robot = jounce.load("iiwa14")
    kernel = Kernel(robot.mechanism, robot.compile(order=2).computation)
    robot._kernels.known[kernel.computation] = kernel, None
    for _ in range(2):
        out = tuple(np.zeros((3, 7)))
        robot.inverse_dynamics(*STATE, out=out)
        assert all(map(np.array_equal, out, expected))
