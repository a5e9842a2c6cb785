"""States and motions by joint name: the same digits whatever the form and order of names, and every slip told."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
import sympy

import casadi
import jounce
from jounce.io import tables
from support.files import BODY, LINKS, joint, link, robot_file
from support.motion_tables import structured
from support.refusals import refusal, refusals
from support.states import random_rates

jax.config.update("jax_enable_x64", True)

PANDA = jounce.load(Path(__file__).parents[2] / "examples" / "panda.urdf")  # with a joint that follows another
PLANAR = jounce.load("planar2r")
LEAST = {"inverse_dynamics": 3, "mass_matrix": 1, "jacobian": 1, "momentum": 2, "poses": 1}
BATCH = 5


class Listing:
    """A data frame of another library: it lists its columns, gives each by name, and knows nothing else."""

    def __init__(self, columns, attribute):
        self._columns = columns
        setattr(self, attribute, list(columns))

    def __getitem__(self, name):
        return self._columns[name].tolist()


FORMS = {
    "dict": dict,
    "dict of lists": lambda columns: {name: column.tolist() for name, column in columns.items()},
    "DataFrame": pd.DataFrame,
    "structured array": structured,
    "record array": lambda columns: structured(columns).view(np.recarray),
    "listed columns": lambda columns: Listing(columns, "columns"),
    "listed column names": lambda columns: Listing(columns, "column_names"),
}
ONE_STATE = {
    "dict": lambda columns: {name: column[0] for name, column in columns.items()},
    "Series": lambda columns: pd.DataFrame(columns).iloc[0],
    "structured array": lambda columns: structured(columns)[0],
}


def named(robot, q, k=0):
    """The columns of one rate, in an order of their own."""
    order = np.random.default_rng(k).permutation(robot.n)
    return {robot.joint_names[j]: q[:, j] for j in order}


def identical(found, expected):
    found, expected = (x if isinstance(x, tuple) else (x,) for x in (found, expected))
    assert len(found) == len(expected)
    for x, y in zip(found, expected, strict=True):
        assert type(x) is np.ndarray
        assert np.array_equal(x, y)


ALL_FORMS = [*FORMS, *(f"one {form}" for form in ONE_STATE)]


def test_forms_mix_and_go_to_every_method():
    q, qd, q2d = random_rates(PANDA.n, 3, BATCH)
    by_name = pd.DataFrame(named(PANDA, q)), qd, named(PANDA, q2d)
    for method in ("kernel", "recursion", "closed_form", "paper"):
        identical(PANDA.inverse_dynamics(*by_name, method=method), PANDA.inverse_dynamics(q, qd, q2d, method=method))
    identical(PANDA.coriolis_matrix(*by_name[:2]), PANDA.coriolis_matrix(q, qd))
    identical(PANDA.gravity_forces(by_name[0]), PANDA.gravity_forces(q))
    identical(PANDA.base_wrench(*by_name), PANDA.base_wrench(q, qd, q2d))
    load = {"body": "panda_hand_tcp", "force": (0, 0, -9.81)}
    identical(PANDA.wrench(*by_name[:2], **load), PANDA.wrench(q, qd, **load))
    out = np.empty((BATCH, PANDA.n))
    assert PANDA.inverse_dynamics(*by_name, out=out, threads=2) is out
    identical(out, PANDA.inverse_dynamics(q, qd, q2d))


def test_entries_broadcast():
    q = dict.fromkeys(PANDA.joint_names, 0.0) | {"panda_joint2": np.linspace(0, 1, 4), "panda_joint4": [[-1], [-2]]}
    array = np.zeros((2, 4, PANDA.n))
    array[..., 1], array[..., 3] = np.linspace(0, 1, 4), [[-1], [-2]]
    identical(PANDA.mass_matrix(q), PANDA.mass_matrix(array))


def test_the_digits_of_every_kind_of_number_are_kept():
    q = {"joint1": np.longdouble(1) / 3, "joint2": np.float32(0.1)}
    expected = np.array([np.longdouble(1) / 3, np.float32(0.1)], dtype=np.longdouble)
    found = PLANAR.mass_matrix(q)
    assert found.dtype == np.longdouble
    identical(found, PLANAR.mass_matrix(expected))
    identical(PLANAR.mass_matrix({"joint1": 1, "joint2": True}), PLANAR.mass_matrix([1, 1]))


ALL = "expected joint1, joint2"


def test_joints_that_follow_others_are_no_coordinates(tmp_path):
    q = dict.fromkeys(PANDA.mechanism.joints, 0.0)
    follower = "leave out 'panda_finger_joint2', which follows panda_finger_joint1 (mimic); expected panda_joint1"
    refusal(lambda: PANDA.mass_matrix(q), f"q: {follower}")
    refusal(lambda: PANDA.mass_matrix(structured({name: [x] for name, x in q.items()})), f"q: {follower}")
    two = tmp_path / "two.urdf"
    items = (*LINKS, link("tip", BODY), joint("turn", "base", "arm"))
    grip = joint("grip", "arm", "tip", inner='<mimic joint="turn" multiplier="-2" offset="1"/>')
    robot = jounce.load(robot_file(tmp_path, *items, grip, name=two.name))
    refusal(lambda: robot.mass_matrix({"grip": 0.0}), "q: missing 'turn'; leave out 'grip', which follows turn (mimic)")


def test_jax_traces_states_by_name():
    q, qd, q2d = random_rates(PLANAR.n, 3, BATCH)
    states = [{name: jnp.asarray(column) for name, column in named(PLANAR, x).items()} for x in (q, qd, q2d)]
    expected = PLANAR.inverse_dynamics(q, qd, q2d, method="recursion")
    found = jax.jit(jax.vmap(PLANAR.inverse_dynamics))(*states)
    assert isinstance(found, jax.Array)
    assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()
    first = {name: column[0] for name, column in states[0].items()}
    slope = jax.jit(jax.jacobian(lambda q: PLANAR.gravity_forces(q | {"joint1": 0.0})))(first)
    assert set(slope) == set(PLANAR.joint_names)
    exact = jax.jit(jax.jacobian(PLANAR.gravity_forces))(jnp.asarray(q[0]).at[0].set(0.0))
    np.testing.assert_allclose(slope["joint2"], exact[:, 1], atol=1e-12)


def test_symbols_by_name():
    x = sympy.Symbol("x")
    found = PLANAR.mass_matrix({"joint2": x, "joint1": 0})
    assert (found == PLANAR.mass_matrix([0, x])).all()
    assert not sympy.Matrix(found).atoms(sympy.Float)  # a number beside symbols leaves no 0.0
    assert PLANAR.gravity_forces({"joint2": [x, 2 * x], "joint1": 0.5})[1, 0].has(x)


@pytest.mark.parametrize("kind", [casadi.SX, casadi.MX])
def test_casadi_scalars_by_name(kind):
    x, y = kind.sym("x"), kind.sym("y")
    M = PLANAR.mass_matrix({"joint2": y, "joint1": x})
    G = PLANAR.gravity_forces({"joint2": y, "joint1": 0.3})
    function = casadi.Function("f", [x, y], [M[0, 0], G[1]])
    exact = PLANAR.mass_matrix([0.3, 0.7])[0, 0], PLANAR.gravity_forces([0.3, 0.7])[1]
    np.testing.assert_allclose([float(value) for value in function(0.3, 0.7)], exact, rtol=1e-14)


@pytest.mark.parametrize("form", ["dict", "DataFrame", "structured array"])
@pytest.mark.parametrize(
    "options", [{}, {"threads": 2}, {"out": np.empty((BATCH, 2))}], ids=["plain", "threads", "out"]
)
def test_kernels_take_no_names_rather_than_pass_them_over(form, options):
    kernel, q = PLANAR.compile(order=0), random_rates(PLANAR.n, 3, BATCH)
    states = [FORMS[form](named(PLANAR, x, k)) for k, x in enumerate(q)]
    refusal(lambda: kernel(*states, **options), "takes arrays without names, in the order of its joints")
    identical(kernel(*(x.tolist() for x in q)), PLANAR.inverse_dynamics(*q))


T = np.linspace(0, 1, 41)
SAMPLES = {"joint2": np.sin(T), "t": T, "body2.fx": 5 * T**2, "joint1": np.cos(2 * T)}


@pytest.mark.sweep(11)
@pytest.mark.parametrize("form", [*FORMS, "csv", "npz", "npz of a structured array"])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_motions_of_files_and_of_columns_are_the_same(tmp_path, form, order):
    source = FORMS[form](SAMPLES) if form in FORMS else tmp_path / f"m.{form[:3]}"
    if form.endswith("structured array") and form not in FORMS:
        np.savez(source, structured(SAMPLES))
    elif form not in FORMS:
        tables.write(source, SAMPLES)
    motion = jounce.load_motion(source, PLANAR, order)
    assert isinstance(motion, jounce.motion.Motion)
    assert np.array_equal(motion.times, T)
    rates = motion(T, order + 2)
    np.testing.assert_allclose(rates[0], np.stack([np.cos(2 * T), np.sin(T)], axis=1), atol=1e-14)
    Q = PLANAR.inverse_dynamics(*rates, wrench=motion.wrench(T, order))
    highest = Q if order == 0 else Q[order]
    expected = PLANAR.inverse_dynamics(*rates)
    assert np.abs(highest - (expected if order == 0 else expected[order])).max() > 0.1  # the wrench enters
    assert np.array_equal(rates[-1], jounce.load_motion(dict(SAMPLES), PLANAR, order)(T, order + 2)[-1])


def test_motions_by_name_of_a_file_and_with_a_spline_of_choice(tmp_path):
    arm = jounce.load("iiwa14")
    motion = jounce.load_motion("paper", arm, order=1)
    assert motion.wrench(1.0) is None
    assert len(jounce.load_motion("paper-wrench", arm, order=1).wrench(1.0, 1)) == 2
    fit = jounce.load_motion(SAMPLES, PLANAR, degree=5, intervals=4)
    assert "degree 5 (C^4), fitted by least squares in 4 intervals" in fit.source
    assert 0 < fit.residual.max() < 1e-4
    every = {f"{name}.{rate}": T * k for name in PLANAR.joint_names for k, rate in enumerate(("q", "qd", "q2d"))}
    assert np.array_equal(jounce.load_motion({"t": T, **every}, PLANAR, order=0)(T, 2)[2][:, 1], 2 * T)


def samples_without(*names):
    return {name: column for name, column in SAMPLES.items() if name not in names}


BAD_MOTIONS = {
    "names": ({**samples_without("joint1", "t"), "jont1": T, "clock": T}, {},
        ["the motion: missing 't', 'joint1'; unknown 'jont1' (did you mean 'joint1'?), 'clock'; expected t and "]),
    "no columns": ({}, {}, ["the motion: no columns or no rows; expected named columns of numbers"]),
    "no rows": (pd.DataFrame(columns=["t", "joint1", "joint2"], dtype=float), {}, ["the motion: no columns or no"]),
    "no text": ({**SAMPLES, 3: T}, {}, ["the motion: column 3 is not named by a string"]),
    "rows": ({**SAMPLES, "joint1": T[1:]}, {}, ["the motion: column 'joint1' is float64 of shape (40,); expected"]),
    "scalar": ({**SAMPLES, "joint1": 0.0}, {}, ["column 'joint1' is float64 of shape (); expected"]),
    "text": ({**SAMPLES, "joint1": ["a"] * 41}, {}, ["the motion: column 'joint1' holds text"]),
    "dates": ({**SAMPLES, "t": np.arange(41).astype("M8[s]")}, {}, ["the motion: column 't' holds dates"]),
    "symbols": ({**SAMPLES, "joint1": sympy.symbols("x:41")}, {}, ["column 'joint1' is object of shape (41,)"]),
    "not finite": ({**SAMPLES, "joint1": np.where(T, T, np.nan)}, {}, ["row 0 from 0: column 'joint1' holds nan"]),
    "repeated": (pd.DataFrame(np.zeros((9, 3)), columns=["t", "joint1", "joint1"]), {},
        ["the motion: repeated name 'joint1'"]),
    "array": (np.zeros((9, 3)), {}, ["load_motion() expects a path, one of paper, "]),
    "number": (3, {}, ["columns, got int"]),
    "file": ("no.csv", {}, ["no.csv: no such file"]),
    "name": ("papr", {}, ["unknown motion 'papr'; did you mean 'paper'?"]),
    "order": (SAMPLES, {"order": -1}, ["order is -1; expected 0 to"]),
    "order of text": (SAMPLES, {"order": "2"}, ["order is '2'; expected 0 to"]),
    "degree": (SAMPLES, {"degree": 6}, ["a spline of degree 6 is not supported; expected 5 or 7"]),
    "degree as a float": (SAMPLES, {"degree": 7.0}, ["a spline of degree 7.0 is not supported"]),
    "intervals": (SAMPLES, {"intervals": 99}, ["the motion: 99 intervals for 41 samples; expected 1 to 34"]),
    "half an interval": (SAMPLES, {"intervals": 1.5}, ["the motion: 1.5 intervals for 41 samples"]),
    "fit of exact terms": ("paper", {"intervals": 4}, ["intervals is for samples: leave it out"]),
}  # fmt: skip


@pytest.mark.parametrize(("source", "options", "words"), BAD_MOTIONS.values(), ids=BAD_MOTIONS)
def test_refuses_bad_motions(source, options, words):
    refusal(lambda: jounce.load_motion(source, PLANAR, **options), *words)


ZERO = dict.fromkeys(PLANAR.joint_names, 0.0)
FOLLOWED = "; leave out joints that follow others: panda_finger_joint2$"
test_other_refusals = refusals({
    "values of joints that follow others": (lambda: PANDA.gravity_forces(np.zeros(9)), [FOLLOWED]),
    "the rate that is wrong": (lambda: PLANAR.inverse_dynamics(ZERO, ZERO, {"joint1": 0.0}), ["q2d: missing 'joint2'"]),
    "a name": (lambda: jounce.load_motion("paper", "iiwa14"), ["load_motion() expects a jounce.Robot, got str"]),
    "data of a robot": (lambda: jounce.load_motion("paper", PLANAR.mechanism), ["got Mechanism"]),
})  # fmt: skip


def test_warns_of_columns_as_of_files():
    with pytest.warns(jounce.JounceWarning, match="the motion: velocity jumps at 1 knot"):
        jounce.load_motion({"t": T, "joint1": abs(T - 0.5), "joint2": T}, PLANAR, degree=7)
