"""Every door takes the entries of joints by their names, or refuses them: no order of columns goes by in silence.

The calls are those of `test_arguments.py`, which cover every argument of every public function. Wherever one of them
takes an array with an axis as long as its robot has joints, it meets the same numbers with names, in another order.
"""

import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from test_arguments import ARM, CASES, LOGGED, ROBOT, SAMPLED, SAMPLES, TURNED, TWO, Case, call_with

import jounce
from jounce.motion.joint_matching import match_joints
from support.motion_tables import structured
from support.refusals import refusal

DEPTH = 12  # of what a call returns
LIMITED = ROBOT.with_limits(velocity=99)
FORCES = ROBOT.forces_along(SAMPLED, order=0).forces[0]
SPRINGS = dict.fromkeys(
    ROBOT.joint_names, jounce.AntagonisticSprings(jounce.CubicSpring(9.0, 9.0), jounce.CubicSpring(9.0, 9.0))
)
TWO_MOTORS = ROBOT.elastic(rotor=0.1, spring=SPRINGS)
MORE: dict[str, Case] = {  # arguments that `CASES` leaves out, or gives as one number
    "start of explain": (
        lambda start: LIMITED.explain(SAMPLED, rate=100.0, start=start), {"start": (0.1, 0.2)},
    ),
    "noise of live": (lambda noise: vars(ROBOT.live(1e-3, noise=noise).settings), {"noise": (1e-5, 2e-5)}),
    **{
        f"{label} of identify": (
            lambda x, label=label: ROBOT.identify(SAMPLED, FORCES, drives=False, **{label: x}), {"x": (1.0, 2.0)},
        )
        for label in ("weights", "deviations")
    },
    "arrays of elastic": (
        ROBOT.elastic, {"stiffness": (800.0, 900.0), "rotor": (0.1, 0.2), "damping": (1.0, 2.0)},
    ),
    "gear of identify_stiffness": (
        lambda gear: ARM.identify_stiffness(LOGGED, TURNED, gear=gear, rotor=0.1), {"gear": (1.0, 1.001)},
    ),
    "stiffness of joints with two motors": (
        lambda S: TWO_MOTORS.motor_commands(*np.ones((5, 2)), stiffness=(S, *np.zeros((2, 2)))), {"S": (30.0, 40.0)},
    ),
    "numbers of with_limits": (ROBOT.with_limits, dict.fromkeys(("velocity", "effort", "jerk"), (1.0, 2.0))),
    "ends of with_limits": (ROBOT.with_limits, {"lower": (-1.0, -2.0), "upper": (1.0, 2.0)}),
    "samples without joint_names": (lambda q: jounce.Motion.through(SAMPLES, q), {"q": TWO}),
    "polynomials without joint_names": (
        lambda c: jounce.Motion.polynomial(c, 1.0), {"c": np.arange(6.0).reshape(2, 3)},
    ),
}  # fmt: skip
CALLS = CASES | MORE


class Labelled:
    """An array of a library with labelled axes, as xarray has them: NumPy takes its numbers alone."""

    def __init__(self, numbers: np.ndarray, axis: int, labels: list[str]) -> None:
        self.numbers, self.dims, self.coords = numbers, [f"axis{k}" for k in range(numbers.ndim)], {}
        self.coords[self.dims[axis]] = np.array(labels)

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        return np.array(self.numbers, dtype=dtype)


def forms(x: np.ndarray, axis: int, names: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """The same numbers with names along an axis, in another order."""
    columns = {names[j]: x.take(j, axis) for j in (1, 0)}
    yield "dict", columns
    yield "labelled", Labelled(np.flip(x, axis), axis, [*columns])
    if x.ndim == 1:
        yield "series", pd.Series(columns)
        yield "list of scalars", [pd.Series({name: value}) for name, value in columns.items()]
    if x.ndim == 2:
        yield "columns", pd.DataFrame(columns)
        yield "table", pa.table({name: np.array(column) for name, column in columns.items()})
        yield "structured", structured(columns)
        if axis == 0:
            yield "rows", pd.DataFrame(columns).T
        else:
            yield "list of series", [row for _, row in pd.DataFrame(columns).iterrows()]


def content_of(x: Any, depth: int = 0) -> Any:
    """All numbers and texts of what a call returns, motions in the robot's order."""
    if isinstance(x, jounce.Motion):
        x = match_joints(x, ROBOT.mechanism) if x.curve.columns == ROBOT.n else x
        known = 2 if x.highest is None else min(x.highest, 2)
        return content_of(x(np.linspace(x.start, x.stop, 7), known))
    if isinstance(x, np.ndarray) and x.dtype != object:
        return x.dtype.str, x.shape, x.tobytes()
    if depth > DEPTH or (isinstance(x, Callable) and not isinstance(x, jounce.Robot)):  # type: ignore[arg-type]
        return None
    if isinstance(x, jounce.Robot):
        return content_of(x.mechanism, depth + 1)
    if isinstance(x, Mapping):
        return [(name, content_of(part, depth + 1)) for name, part in x.items()]
    if isinstance(x, tuple | list):
        return [content_of(part, depth + 1) for part in x]
    if is_dataclass(x):
        return [content_of(getattr(x, field.name), depth + 1) for field in fields(x)]
    return x if isinstance(x, str | int | float | bool) else None


def unequal_numbers(given: Any) -> np.ndarray | None:
    """An argument that holds numbers, those of equal joints made unequal."""
    try:
        x = np.asarray(given, dtype=float)
    except Exception:
        return None
    equal = x.ndim and x.size and np.ptp(x, axis=-1).max() == 0
    return x * np.arange(2, 2 + x.shape[-1]) / 2 if equal else x


def doors() -> Iterator[tuple[str, str, int]]:
    """The calls, arguments and axes along which there may be joints."""
    for name, (_, given) in CALLS.items():
        for argument, value in given.items():
            x = unequal_numbers(value)
            if x is not None:
                yield from ((name, argument, axis) for axis, size in enumerate(x.shape) if size == ROBOT.n)


def joints(function: Callable[..., Any]) -> tuple[str, ...]:
    robot = getattr(function, "__self__", ROBOT)
    return robot.joint_names if isinstance(robot, jounce.Robot) and robot.n == ROBOT.n else ROBOT.joint_names


def named_results(name: str, argument: str, axis: int) -> tuple[Any, dict[str, Any]]:
    """What a call returns of an array, and by form what it returns of names; None where it refuses them."""
    function, given = CALLS[name]
    x = unequal_numbers(given[argument])
    found: dict[str, Any] = {}
    assert x is not None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        expected = content_of(call_with(function, {**given, argument: x}))
        for form, value in forms(x, axis, joints(function)):
            try:
                found[form] = content_of(call_with(function, {**given, argument: value}))
            except jounce.JounceError:
                found[form] = None
    return expected, found


PIECES = ("Motion.piecewise", "coefficients", 1)  # an axis as long as there are joints, of something else
TAKEN = [  # where entries with names are wanted
    ("inverse_dynamics", "q", 0),
    ("forward_dynamics", "Q", 0),
    ("LiveRates.update", "q", 0),
    ("Motion.through", "q", 1),
    ("Motion.fit", "q", 1),
    ("Motion.polynomial", "coefficients", 0),
    ("Motion.fourier", "offset", 0),
    ("Motion.fourier", "sines", 1),
    ("Motion.piecewise", "coefficients", 2),
    ("Motion.trapezoidal", "positions", 1),
    ("Motion.trapezoidal", "acceleration", 0),
    ("identify", "forces", 1),
    ("elastic", "stiffness", 0),
    ("closed", "weights", 0),
    *((name, argument, 0) for name in MORE for argument in MORE[name][1] if name[:7] != "samples"),
    ("samples without joint_names", "q", 1),
]


@pytest.mark.sweep(160)
@pytest.mark.parametrize(("name", "argument", "axis"), [door for door in doors() if door != PIECES])
def test_entries_with_names_are_matched_or_refused(name, argument, axis):
    try:
        expected, found = named_results(name, argument, axis)
    except jounce.JounceError:
        pytest.skip("this call does not take these numbers")
    assert [form for form, result in found.items() if result is not None and result != expected] == []


@pytest.mark.parametrize(("name", "argument", "axis"), TAKEN)
def test_data_frames_series_and_dicts_are_taken_by_name(name, argument, axis):
    expected, found = named_results(name, argument, axis)
    assert found["dict"] == expected
    whole = found.keys() & ({"series"} if axis == 0 else {"columns", "table", "structured"})
    assert [form for form in whole if found[form] != expected] == []


def test_the_forces_of_swapped_columns_are_those_of_their_names():
    """The numbers of a report: (3.91, -0.44) by position, where (19.14, 3.76) is right."""
    t = np.linspace(0, 2, 81)
    q = pd.DataFrame({"joint2": 0.5 * np.cos(1.3 * t), "joint1": np.sin(t)})
    swapped, ordered = (jounce.Motion.fit(t, x, degree=7, intervals=1) for x in (q, q[["joint1", "joint2"]].to_numpy()))
    assert swapped.joint_names == ("joint2", "joint1")
    along = [ROBOT.forces_along(motion, order=1).forces for motion in (swapped, ordered)]
    np.testing.assert_allclose(along[0], along[1], rtol=1e-9, atol=1e-9)
    assert np.abs(along[0][0]).max() > 10


@pytest.mark.parametrize(("make", "said"), [
    (lambda: pd.DataFrame(TWO), "q: column 0 is not named by a string"),
    (lambda: pd.DataFrame(TWO.T, index=["joint2", "joint1"]), "q: column 0 is not named by a string"),
    (lambda: pd.DataFrame(TWO, columns=["joint1", "joint1"]), "q: repeated name 'joint1'"),
    (lambda: [pd.Series(row, index=["joint2", "joint1"]) for row in TWO], "q has entries with names, 'joint2'"),
    (lambda: Labelled(TWO, 1, ["joint2", "joint1"]), "q has entries with names, 'joint2', 'joint1', which"),
])  # fmt: skip
def test_names_that_cannot_be_matched_are_refused(make, said):
    refusal(lambda: jounce.Motion.fit(SAMPLES, make()), said)


def test_columns_and_joint_names_are_the_same():
    frame = pd.DataFrame(TWO, columns=["joint2", "joint1"])
    refusal(lambda: jounce.Motion.through(SAMPLES, frame, joint_names=["a", "b"]), "missing 'a', 'b'", "expected a, b")
    ordered = jounce.Motion.through(SAMPLES, frame, joint_names=["joint1", "joint2"])
    assert ordered.joint_names == ("joint1", "joint2")
    np.testing.assert_array_equal(ordered.samples[1], TWO[:, ::-1])


def test_arrays_without_names_next_to_names_need_their_order():
    positions = pd.DataFrame(TWO[::5], columns=["joint2", "joint1"])
    said = "positions names its joints, joint2, joint1, and velocity is an array without names"
    refusal(lambda: jounce.Motion.trapezoidal(positions, [1.0, 2.0], 1.0), said, "joint_names=")
    jounce.Motion.trapezoidal(positions, [1.0, 2.0], 1.0, joint_names=["joint1", "joint2"])
    jounce.Motion.trapezoidal(positions, 1.0, {"joint1": 1.0, "joint2": 2.0})


def test_labels_of_samples_are_no_names_of_joints():
    """Times of a series with an index of its own, and rows of a frame by time."""
    t = pd.Series(SAMPLES, index=pd.date_range("2024-01-01", periods=len(SAMPLES)))
    q = pd.DataFrame(TWO, columns=["joint1", "joint2"], index=SAMPLES)
    np.testing.assert_array_equal(jounce.Motion.through(t, q).samples[1], TWO)
