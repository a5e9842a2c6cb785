"""Motions of balls, planar and free joints: numbers of any length in tables and files, and the twists that follow."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jounce
from jounce import Motion
from jounce.io import tables
from jounce.io.motions import writing
from jounce.model import positions
from jounce.motion.base import compute_numbers, compute_twists
from jounce.spatial import groups
from jounce.spatial.lie import Ad, hat, inverse
from support.amid import amid
from support.refusals import expect_refusal, refusal

KINDS = ("ball", "planar", "free")
ROBOTS = {kind: amid(kind) for kind in KINDS}
kinds = pytest.mark.parametrize("kind", KINDS)


def joint_of(robot):
    [joint] = positions.list_multiscrew_joints(robot.mechanism)
    return joint


def analytic(kind, ground=False, scale=1.0, start=0.0, stop=1.0, count=101):
    """A motion in closed form: a turn about an axis that stays, of a quaternion that is not of length 1."""
    robot = amid(kind, ground)
    joint, rng = joint_of(robot), np.random.default_rng(7)
    terms = {
        name: {"cosines": [{"amplitude": 0.7, "frequency": 2.1, "phase": float(rng.uniform(0, 6))}]}
        for name in positions.names(robot.mechanism)
    }
    w = 1.3  # of half the angle, or of the angle in a plane
    turn = {"qx": (0.6, True), "qy": (0.0, True), "qz": (0.8, True), "qw": (1, False)}
    turn = {"cos": (1, False), "sin": (1, True)} if kind == "planar" else turn
    for name, (size, sine) in turn.items():
        phase = -np.pi / 2 if sine else 0.0
        terms[f"{joint.name}.{name}"] = {"cosines": [{"amplitude": scale * size, "frequency": w, "phase": phase}]}
    return robot, {"time": {"start": start, "stop": stop, "count": count}, "joints": terms}


def load_description(folder, robot, description, name="motion.json"):
    import json

    (folder / name).write_text(json.dumps(description))
    return jounce.load_motion(folder / name, robot)


def position_columns(robot, motion, t):
    return {"t": t, **dict(zip(positions.names(robot.mechanism), motion(t, 0)[0].T, strict=True))}


@kinds
@pytest.mark.parametrize("scale", [1.0, 3.0, 0.2])
def test_a_turn_about_an_axis_that_stays_is_exact(tmp_path, kind, scale):
    robot, description = analytic(kind, scale=scale)
    motion = load_description(tmp_path, robot, description)
    joint, t = joint_of(robot), np.linspace(0, 1, 9)
    rates = motion(t)
    assert [rate.shape for rate in rates] == [(9, robot.nq)] + [(9, robot.n)] * 4
    nu = [rate[:, joint.coordinates] for rate in rates[1:]]
    w = [1.3] if kind == "planar" else [1.3 * 2 * 0.6, 0, 1.3 * 2 * 0.8]
    np.testing.assert_allclose(nu[0][:, : len(w)], np.tile(w, (9, 1)), atol=1e-14)
    for rate in nu[1:]:
        np.testing.assert_allclose(rate[:, : len(w)], 0, atol=1e-12)


@kinds
def test_rates_of_twists_follow_their_derivatives(kind):
    """Of a random smooth curve, from any start and of any duration; q itself moves as its twist says."""
    robot, rng = ROBOTS[kind], np.random.default_rng(3)
    start, duration = rng.uniform(-5, 50), rng.uniform(0.3, 4)
    c = rng.uniform(-0.5, 0.5, (robot.nq, 5)) / duration ** np.arange(5)
    joint = joint_of(robot)
    c[joint.turn.stop - 1 if kind != "planar" else joint.turn.start, 0] += 2
    motion = Motion.polynomial(c, duration, start=start, joint_names=positions.names(robot.mechanism))
    along = robot.forces_along(motion, [start, start + duration / 3], order=2)
    h, t = 1e-4 * duration, start + duration * np.array([0.2, 0.5, 0.8])
    sides = [list(robot.forces_along(motion, x, order=2).rates) for x in (t, t + h, t - h)]
    for side in sides:  # their lengths change too
        side[0][:, joint.turn] /= np.linalg.norm(side[0][:, joint.turn], axis=1, keepdims=True)
    for k in range(4):
        slope = (sides[1][k] - sides[2][k]) / (2 * h)
        rate = sides[0][k + 1]
        rate = rate if k else (positions.rate_map(robot.mechanism, sides[0][0]) @ rate[..., None])[..., 0]
        np.testing.assert_allclose(rate, slope, atol=1e-5 * (1 + abs(slope).max()))
    for force, other in zip(along.forces, robot.inverse_dynamics(*along.rates), strict=True):
        np.testing.assert_array_equal(force, other)


@pytest.mark.parametrize("kind", KINDS)
def test_twists_and_rates_of_numbers_are_inverse_to_each_other(kind):
    group, rng = groups.GROUPS[kind], np.random.default_rng(4)
    p = rng.normal(size=(6, len(group.positions)))
    p[:, len(group.places) :] /= np.linalg.norm(p[:, len(group.places) :], axis=1, keepdims=True)
    nu = rng.normal(size=(4, 6, len(group.axes)))
    again = compute_twists(group, (p, *compute_numbers(group, p, nu)))
    np.testing.assert_allclose(again, nu, atol=1e-12)


@kinds
def test_a_table_of_samples_is_the_motion_that_it_samples(tmp_path, kind):
    """Q, Qd, Q2d agree with those of the closed form; signs and lengths of the rows do not matter, and are told."""
    rng = np.random.default_rng(2)
    start = float(rng.uniform(-3, 3))
    robot, description = analytic(kind, start=start, stop=start + 1.7, count=401)
    motion = load_description(tmp_path, robot, description)
    t, joint = motion.times, joint_of(robot)
    exact = robot.forces_along(motion, t[20:-20:7])
    columns = position_columns(robot, motion, t)
    plain = jounce.load_motion(columns, robot, degree=7)
    assert plain.notes == ()
    length = 1 + 0.4 * rng.uniform(size=t.size)
    flips = 1 if kind == "planar" else rng.choice([-1, 1], t.size)
    changed = columns | {name: columns[name] * length * flips for name in joint.names[len(joint.group.places) :]}
    other = jounce.load_motion(changed, robot, degree=7)
    told = [note for note in other.notes if note.startswith("ankle.")]
    assert [" of norm 1.0" in note for note in told] == ([True] if kind == "planar" else [False, True])
    assert all("\n" not in note for note in told)
    for found in (plain, other):
        along = robot.forces_along(found, exact.t)
        for k, tolerance in enumerate((1e-9, 1e-7, 1e-4)):
            size = abs(exact.forces[k]).max()
            np.testing.assert_allclose(along.forces[k], exact.forces[k], atol=tolerance * size)


@kinds
def test_forces_balance_the_momentum(tmp_path, kind):
    """The joint on the ground exerts what changes the momentum of all bodies, and carries their weight."""
    robot, description = analytic(kind, ground=True, scale=2.0)
    motion = load_description(tmp_path, robot, description)
    m, t, h = robot.mechanism, np.array([0.3, 0.6]), 1e-3
    joint, steps = joint_of(robot), np.arange(-3, 4)
    stencil = np.array([-1, 9, -45, 0, 45, -9, 1]) / (60 * h)
    q = motion.curve

    def poses(t):
        x = q.rates(t, 0)[0]
        C = m.B[0] @ joint.motion(x[..., None])
        own = Ad(inverse(C))
        turned = Rotation.from_rotvec(x[:, -1:] * [0, 0, 1]).as_matrix()
        H = np.tile(np.eye(4), (len(t), 1, 1))
        H[:, :3, :3] = turned
        return [C, C @ m.B[1] @ H], own

    def momentum(t):
        around = [poses(t + k * h)[0] for k in steps]
        total = 0
        for i, C in enumerate(poses(t)[0]):
            rate = sum(s * there[i] for s, there in zip(stencil, around, strict=True))
            V = inverse(C) @ rate
            twist = np.stack([V[:, 2, 1], V[:, 0, 2], V[:, 1, 0], *V[:, :3, 3].T], axis=1)
            total = total + (Ad(inverse(C)).mT @ m.M[i] @ twist[..., None])[..., 0]
        return total

    slope = sum(s * momentum(t + k * h) for k, s in zip(steps, stencil, strict=True))
    weight = 0
    for i, C in enumerate(poses(t)[0]):
        A = np.concatenate([np.zeros((2, 3)), C[:, :3, :3].mT @ m.gravity], axis=1)
        weight = weight + (Ad(inverse(C)).mT @ m.M[i] @ A[..., None])[..., 0]
    X = m.X[list(m.columns[0])]
    expected = (slope - weight)[:, None] @ Ad(poses(t)[0][0]) @ X.T
    Q = robot.forces_along(motion, t, order=0).forces[0]
    np.testing.assert_allclose(Q[:, joint.coordinates], expected[:, 0], atol=1e-7 * abs(Q).max())


@kinds
@pytest.mark.parametrize("suffix", ["csv", "npz"])
def test_what_is_written_is_read_again(tmp_path, kind, suffix):
    robot, description = analytic(kind, scale=1.4)
    motion = load_description(tmp_path, robot, description)
    tables.write_pieces(tmp_path / f"m.{suffix}", writing.motion_pieces(motion, robot.joint_names, 4))
    again = jounce.load_motion(tmp_path / f"m.{suffix}", robot)
    for ours, other in zip(again(motion.times), motion(motion.times), strict=True):
        np.testing.assert_array_equal(ours, other)
    names = tables.read(tmp_path / f"m.{suffix}")
    number = joint_of(robot).names[-1]
    assert {"turn.q", "turn.q4d", number, f"{number}d", f"{number}4d"} <= {*names}
    assert not any(".q.q" in name or name.startswith("ankle.w") for name in names)


@kinds
def test_smoothed_samples_have_deviations_that_are_read_again(tmp_path, kind):
    robot, description = analytic(kind, stop=2.0, count=401)
    motion = load_description(tmp_path, robot, description)
    rng, t = np.random.default_rng(1), motion.times
    noisy = position_columns(robot, motion, t)
    noisy |= {name: x + 1e-6 * rng.normal(size=x.size) for name, x in noisy.items() if name != "t"}
    found = jounce.load_motion(noisy, robot, order=0, bandwidth=3.0)
    inside = t[50:-50]
    off, far = found.deviations(inside, 2), found(inside, 2)
    assert [x.shape[1] for x in off] == [robot.nq, robot.n, robot.n]
    for k, exact in enumerate(motion(inside, 2)):
        ratio = np.sqrt(((far[k] - exact) ** 2).mean() / (off[k] ** 2).mean())
        assert 0.3 < ratio < 2, k
    along = robot.forces_along(found, inside[::20], order=0)
    assert along.deviations[0].all()
    tables.write_pieces(tmp_path / "m.npz", writing.motion_pieces(found, robot.joint_names, 2))
    again = jounce.load_motion(tmp_path / "m.npz", robot, order=0)
    for ours, other in zip(again.deviations(inside, 2), off, strict=True):
        np.testing.assert_allclose(ours, other, rtol=1e-6)


@kinds
def test_velocities_in_a_table_are_the_rates(tmp_path, kind):
    robot, description = analytic(kind)
    motion = load_description(tmp_path, robot, description)
    t, joint = motion.times, joint_of(robot)
    q, *rates = motion(t)
    columns = {"t": t} | dict(zip(joint.names, q[:, joint.numbers].T, strict=True))
    for name, at in (("turn", 0), ("tip", -1)):
        columns |= {f"{name}.q": q[:, at]}
        columns |= {f"{name}.q{d}": rate[:, at] for d, rate in zip(("d", "2d", "3d", "4d"), rates, strict=True)}
    for d, rate in zip(("", "d", "2d", "3d"), rates, strict=True):
        columns |= {f"{x}{d}": r for x, r in zip(joint.velocities, rate[:, joint.coordinates].T, strict=True)}
    found = jounce.load_motion(columns, robot)
    for ours, other in zip(found(t), motion(t), strict=True):
        np.testing.assert_allclose(ours, other, atol=1e-11 * (1 + abs(other).max()))
    between = (t[1:] + t[:-1]) / 2
    for ours, other in zip(found(between, 2), motion(between, 2), strict=True):
        np.testing.assert_allclose(ours, other, atol=1e-8 * (1 + abs(other).max()))
    degrees = {f"{name} [deg/s]" if name == "ankle.wz" else name: x for name, x in columns.items()}
    degrees["ankle.wz [deg/s]"] = np.rad2deg(columns["ankle.wz"])
    np.testing.assert_allclose(jounce.load_motion(degrees, robot)(t, 1)[1], motion(t, 1)[1], atol=1e-12)


@kinds
def test_velocities_are_never_ignored(tmp_path, kind):
    robot, description = analytic(kind)
    motion = load_description(tmp_path, robot, description)
    t, velocity = motion.times, joint_of(robot).velocities[0]
    samples = position_columns(robot, motion, t)
    message = refusal(lambda: jounce.load_motion(samples | {velocity: 0 * t}, robot))
    assert velocity in message or "both samples and columns of rates" in message
    tables.write_pieces(tmp_path / "m.npz", writing.motion_pieces(motion, robot.joint_names, 4))
    rates = tables.read(tmp_path / "m.npz")
    refusal(lambda: jounce.load_motion(rates | {velocity: 0 * t}, robot), "both rates of numbers and velocities")
    few = {name: x for name, x in rates.items() if name != f"{joint_of(robot).names[-1]}2d"}
    refusal(lambda: jounce.load_motion(few, robot), f"missing '{joint_of(robot).names[-1]}2d'")


@kinds
def test_exponential_coordinates_are_the_turns_that_they_say(tmp_path, kind):
    """w = x' - c1 x x x' + c2 x x (x x x'), also at and near zero; in a plane the angle."""
    robot, description = analytic(kind)
    joint, axes = joint_of(robot), "z" if kind == "planar" else "xyz"
    for name in joint.names[len(joint.group.places) :]:
        del description["joints"][name]
    powers = {"x": [0, 1e-3, 0.5], "y": [0, 2.0, 0, -0.3], "z": [0, -1.0, 0.2, 0.4]}
    description["joints"] |= {f"ankle.r{axis}": {"polynomial": powers[axis]} for axis in axes}
    motion = load_description(tmp_path, robot, description)
    t = np.array([0, 1e-9, 1e-4, 0.2, 0.7, 1.0])
    x, xd = (
        np.stack([np.polynomial.Polynomial(powers[a]).deriv(k)(t) if k else np.polynomial.Polynomial(powers[a])(t)
                  for a in axes], axis=1)
        for k in (0, 1)
    )  # fmt: skip
    q, nu = motion(t, 1)
    if kind == "planar":
        turn = np.concatenate([np.cos(x), np.sin(x)], axis=1)
        w = xd
    else:
        turn = Rotation.from_rotvec(x).as_quat()
        turn *= np.sign((turn * q[:, joint.turn]).sum(axis=1, keepdims=True))
        p = (x * x).sum(axis=1)[:, None]
        th = np.sqrt(np.where(p > 1e-6, p, 1))
        c1 = np.where(p > 1e-6, (1 - np.cos(th)) / th**2, 0.5 - p / 24)
        c2 = np.where(p > 1e-6, (1 - np.sin(th) / th) / th**2, 1 / 6 - p / 120)
        w = xd - c1 * np.cross(x, xd) + c2 * np.cross(x, np.cross(x, xd))
    np.testing.assert_allclose(q[:, joint.turn], turn, atol=1e-15)
    np.testing.assert_allclose(nu[:, joint.coordinates][:, : len(axes)], w, atol=1e-14)
    for k in range(1, 4):
        h, at = 1e-4, np.array([0.3, 0.999])
        slope = (motion(at + h, k)[k] - motion(at - h, k)[k]) / (2 * h)
        np.testing.assert_allclose(motion(at, k + 1)[k + 1], slope, atol=1e-5 * (1 + abs(slope).max()))
    beyond = description | {"joints": description["joints"] | {joint.names[-1]: {"offset": 1.0}}}
    refusal(lambda: load_description(tmp_path, robot, beyond, "beyond.json"), joint.names[-1])


@kinds
def test_arrays_have_a_column_for_each_number(tmp_path, kind):
    robot, description = analytic(kind, count=31)
    motion = load_description(tmp_path, robot, description)
    t, numbers = motion.times, positions.names(robot.mechanism)
    q = motion(t, 0)[0]
    expected = robot.forces_along(motion).forces
    turned = np.random.default_rng(0).permutation(len(numbers))
    for given in (
        Motion.through(t, q),
        Motion.through(t, q[:, turned], joint_names=[numbers[j] for j in turned]),
    ):
        along = robot.forces_along(given)
        for ours, other, tolerance in zip(along.forces, expected, (1e-7, 1e-5, 1e-2), strict=True):
            np.testing.assert_allclose(ours, other, atol=tolerance * abs(other).max())
    refusal(lambda: robot.forces_along(Motion.through(t, q[:, :-1])), f"has {', '.join(numbers[:2])}")
    through = Motion.polynomial(
        [[1, -2] if k == joint_of(robot).turn.stop - 1 else [0] * 2 for k in range(robot.nq)], 1.0
    )
    with expect_refusal("ankle: the rotation has the norm 0.095 at t = 0.45"):
        robot.forces_along(through, [0.0, 0.5], order=0)


@kinds
def test_motions_are_retimed_and_follow_each_other(tmp_path, kind):
    """Of quaternions the sign is free, as is the length of both; opposite cosines and sines are other positions."""
    robot, description = analytic(kind)
    motion = load_description(tmp_path, robot, description)
    t = motion.times
    slow = motion.scaled(2).shifted(3)
    for k, (ours, other) in enumerate(zip(slow(3 + 2 * t), motion(t), strict=True)):
        np.testing.assert_allclose(ours, other / 2**k, atol=1e-11 * (1 + abs(other).max()))
    end = dict(zip(positions.names(robot.mechanism), motion(t[-1], 0)[0], strict=True))
    signs = (3.0,) if kind == "planar" else (3.0, -3.0)
    joint = joint_of(robot)
    turned = joint.names[len(joint.group.places) :]
    for sign in signs:
        stay = {name: {"offset": float(x) * (sign if name in turned else 1)} for name, x in end.items()}
        whole = motion + load_description(tmp_path, robot, description | {"joints": stay}, "stay.json")
        assert {found.order for found in whole.breaks} == {1}
        robot.inverse_dynamics(*whole(1.5))
    away = {name: {"offset": float(x) * (-1 if name == turned[0] else 1)} for name, x in end.items()}
    refusal(
        lambda: motion + load_description(tmp_path, robot, description | {"joints": away}, "away.json"), "do not meet"
    )


@kinds
def test_turns_without_direction_and_units_of_numbers_are_refused(tmp_path, kind):
    robot, description = analytic(kind)
    motion = load_description(tmp_path, robot, description)
    joint, columns = joint_of(robot), position_columns(robot, motion, motion.times)
    turned = joint.names[len(joint.group.places) :]
    still = columns | {name: np.where(np.arange(101) == 7, 0, columns[name]) for name in turned}
    message = refusal(lambda: jounce.load_motion(still, robot, degree=7))
    assert message == f"the motion: row 7: {', '.join(turned)} have the norm 0; expected 1, as every rotation has"
    degrees = {name.replace(turned[0], f"{turned[0]} [deg]"): x for name, x in columns.items()}
    refusal(lambda: jounce.load_motion(degrees, robot, degree=7), "unknown unit 'deg'")
    half = {name: {"offset": 1.0} for name in positions.names(robot.mechanism)}
    half |= {name: {"polynomial": [1, -2] if name == turned[-1] else [0]} for name in turned}
    found = load_description(tmp_path, robot, description | {"joints": half}, "half.json")
    refusal(lambda: found(0.5, 1), "has the norm 0 at t = 0.5 s")
    missing = {name: x for name, x in columns.items() if name != turned[0]}
    refusal(lambda: jounce.load_motion(missing, robot), f"missing '{turned[0]}'")


@kinds
def test_angles_in_degrees_are_those_of_other_joints(tmp_path, kind):
    """A table in degrees is told by its revolute joints; quaternions and places have no such unit."""
    robot, description = analytic(kind, count=201)
    motion = load_description(tmp_path, robot, description)
    columns = position_columns(robot, motion, motion.times)
    degrees = {name: np.rad2deg(x) if name in ("turn", "tip") else x for name, x in columns.items()}
    found = jounce.load_motion(degrees, robot, degree=7, angles="deg")
    np.testing.assert_allclose(found(motion.times, 0)[0], motion(motion.times, 0)[0], atol=1e-12)
    refusal(lambda: jounce.load_motion(degrees, robot, degree=7), "angles='deg'")
    fast = {"t": motion.times, "turn": 0 * motion.times, "tip": 0 * motion.times}
    angle = 25 * motion.times
    turn = [np.cos(angle), np.sin(angle)] if kind == "planar" else [np.sin(angle), 0 * angle, 0 * angle, np.cos(angle)]
    fast |= {name: x for name, x in columns.items() if name not in fast}
    fast |= dict(zip(joint_of(robot).names[-len(turn) :], turn, strict=True))
    assert jounce.load_motion(fast, robot, degree=7).notes == ()


def test_neighbouring_motions_are_those_of_neighbouring_times():
    """Nothing else than the order of rows decides on signs."""
    robot = ROBOTS["ball"]
    t = np.linspace(0, 2, 201)
    turns = Rotation.from_rotvec(np.stack([3 * t, np.sin(t), t**2], axis=1))
    Q = turns.as_quat(canonical=True)
    assert any((x * y).sum() < 0 for x, y in pairwise(Q))
    columns = {"t": t, "turn": t, "tip": t} | dict(zip(joint_of(robot).names, Q.T, strict=True))
    motion = jounce.load_motion(columns, robot, degree=7)
    assert [note for note in motion.notes if "sign flips" in note]
    h = 1e-4
    w = (turns[90].inv() * turns[91]).as_rotvec() / 0.01
    np.testing.assert_allclose(motion((t[90] + t[91]) / 2, 1)[1][1:4], w, atol=1e-3)
    R = [joint_of(robot).group.pose(motion(1 + k * h, 0)[0][1:5])[:3, :3] for k in (-1, 0, 1)]
    np.testing.assert_allclose(R[1].T @ (R[2] - R[0]) / (2 * h), hat(motion(1.0, 1)[1][1:4]), atol=1e-6)
