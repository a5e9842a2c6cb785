"""Contacts that come and leave along a motion: balance on both sides of a switch, blends, limits, what is refused."""

import json
import re

import numpy as np
import pytest

import jounce
from contacts.conftest import FEET, PAWS, SOLE, squat
from jounce.cli.motion_options import write_motion
from jounce.engine import contact_motion
from jounce.limits.contact_ratios import _find_ratios
from jounce.limits.limited_motion import LimitedMotion
from jounce.motion.composite_curves import MAX_BLEND_SHARE
from support.refusals import expect_refusal, refusal
from support.robots import differentiated_at_once, relative_error

BENT = np.tile([0, 0.6, -1.4], 4)  # the hind feet carry more
LEFT_UP, RIGHT_UP = PAWS[1:], [PAWS[0], *PAWS[2:]]
LIFTS = [(0, PAWS), (0.5, LEFT_UP), (1.0, PAWS), (1.25, RIGHT_UP), (1.75, PAWS)]
SLOPE = {"normal": (0, 0.6, 0.8)}


def lifted_knees(dog, lifts=LIFTS, stop=2):
    """A trunk that rests while the left front foot, then the right one is lifted; C^5 at the switches."""
    P = np.polynomial.Polynomial
    lift = (0.3 * (P([0, 4]) * P([1, -1])) ** 6)(P([0, 2])).coef[::-1]  # over half a second
    c = np.zeros((13, len(lifts), 12))
    c[-1] = BENT
    for piece, knee in ((1, 2), (3, 5))[: len(lifts) // 2]:
        c[:, piece, knee] -= lift
    motion = jounce.Motion.piecewise([s for s, _ in lifts] + [stop], c, joint_names=dog.joint_names)
    return motion.with_base(None, np.eye(4)).with_step(0.05)


@pytest.fixture(scope="module")
def lifting(dog):
    return lifted_knees(dog)


def on_points(dog, **options):
    return dog.contacts([jounce.Contact(paw, "point", **options) for paw in PAWS])


@pytest.fixture(scope="module")
def stepping(humanoid):
    """A squat on both feet, the trunk swaying; from 0.9 s on the right leg is lifted."""
    t = np.arange(55) / 30
    q = squat(humanoid, t, 0)[0]
    base = np.linalg.inv(humanoid.poses(q, body=FEET[0], base=np.eye(4), method="recursion"))
    q[:, humanoid.joint_names.index("waist_roll_joint")] = 0.3 * np.sin(5 * t)
    q[:, humanoid.joint_names.index("right_knee_joint")] += 0.5 * np.where(t > 0.9, t - 0.9, 0) ** 6
    motion = jounce.Motion.through(t, q, joint_names=humanoid.joint_names).with_base(t, base, degree=7)
    return motion.with_step(0.05).with_stances([(0, FEET), (0.9, FEET[:1])])


@pytest.mark.parametrize("options", [{}, SLOPE])
@pytest.mark.parametrize("blend", [0, 0.1])
def test_no_rate_of_the_base_rows_is_left(dog, lifting, options, blend):
    stand = on_points(dog, **options)
    along = stand.forces_along(lifting.with_stances(LIFTS, blend))
    assert all(np.abs(Q[:, :6]).max() < 1e-12 * np.abs(Q).max() for Q in along.forces)
    up = (along.t >= 0.5) & (along.t < 1)
    assert all(not f[up, 0].any() and (f[up, 1:, 5] != 0).all() for f in along.wrenches[:1])


def test_each_stance_is_that_of_its_contacts_alone(dog, lifting):
    along = on_points(dog).forces_along(lifting.with_stances(LIFTS))
    three = dog.contacts([jounce.Contact(paw, "point") for paw in PAWS[1:]])
    t = along.t[(along.t >= 0.5) & (along.t < 1)]
    rates, base = lifting(t), lifting.base(t)
    at = np.isin(along.t, t)
    for found, Q in zip(along.forces, three.inverse_dynamics(*rates, base=base, method="recursion"), strict=True):
        assert relative_error(found[at], Q) < 1e-12
    for found, f in zip(along.wrenches, three.contact_wrenches(*rates, base=base, method="recursion"), strict=True):
        assert np.abs(found[at, 1:] - f).max() < 1e-12 * np.abs(found).max()


def test_switches_are_breaks_with_their_jumps_and_causes(humanoid, stepping):
    stand = humanoid.contacts([jounce.Contact(foot, "plane", place=SOLE["place"]) for foot in FEET])
    along = stand.forces_along(stepping)
    [found] = along.breaks
    assert (found.t, found.order) == (0.9, 0)
    assert [(x.joint, x.symbol, x.order, x.jump) for x in found.causes] == [(FEET[1], "contact", 0, -1.0)]
    assert all(np.abs(Q[:, :6]).max() < 1e-12 * np.abs(Q).max() for Q in along.forces)
    before, after = (
        robot.inverse_dynamics(*stepping(0.9), base=stepping.base(0.9), method="recursion")
        for robot in (stand, humanoid.contacts(stand.mechanism.contacts[:1]))
    )
    for jump, a, b in zip((found.jump, *found.higher), before, after, strict=True):
        assert np.abs(jump - (b - a)).max() < 1e-11 * np.abs(b).max()
        assert np.abs(jump).max() > 1e-3 * np.abs(b).max()


@pytest.mark.parametrize("friction", [None, 0.5])
def test_blends_leave_torques_and_two_rates_continuous(dog, lifting, friction):
    stand = on_points(dog, normal=(0, 0, 1), friction=friction)
    motion = lifting.with_stances(LIFTS, 0.1)
    assert not motion.breaks
    along = stand.forces_along(motion)
    assert not [found for found in along.breaks if found.order == 0]
    ends = motion.stance_ends[1:-1]
    assert len(ends) == 8
    sides = stand.forces_along(motion, np.concatenate([ends - 1e-8, ends + 1e-8])).forces
    for k, (x, largest) in enumerate(zip(sides, along.forces, strict=True)):
        before, after = np.split(x, 2)
        if friction is None or k == 0:  # rates jump where a limit of friction begins or ends to be active
            assert np.abs(after - before).max() < 1e-5 * np.abs(largest).max()
    if friction is not None:
        return
    inside = np.array([0.42, 0.46, 1.04])  # while a foot leaves, and while it comes
    exact = stand.forces_along(motion, inside).forces
    for k in range(2):
        rate = differentiated_at_once(
            lambda s, k=k: stand.forces_along(motion, np.add.outer(s, inside).ravel()).forces[k].reshape(len(s), 3, -1),
            1e-3,
        )
        assert relative_error(rate, exact[k + 1]) < 1e-7


def test_a_blended_contact_has_its_weights_over_its_presence(dog, lifting):
    motion, t = lifting.with_stances(LIFTS, 0.1), 0.46
    u = 0.4  # of the blend is left
    p = 126 * u**5 - 420 * u**6 + 540 * u**7 - 315 * u**8 + 70 * u**9
    weighted = [jounce.Contact(paw, "point", weights=[1 / p if paw == PAWS[0] else 1] * 6) for paw in PAWS]
    f = dog.contacts(weighted).contact_wrenches(*motion(t, 2), base=motion.base(t, 2))
    assert relative_error(on_points(dog).forces_along(motion, [t], order=0).wrenches[0][0], f) < 1e-12


def test_stances_stay_with_a_motion_at_another_pace(dog, lifting):
    stand = on_points(dog)
    slow = lifting.with_stances(LIFTS, 0.1).scaled(2).shifted(1)
    other = lifting.scaled(2).shifted(1).with_stances([(1 + 2 * s, names) for s, names in LIFTS], 0.2)
    for x, y in zip(stand.forces_along(slow).forces, stand.forces_along(other).forces, strict=True):
        assert relative_error(x, y) < 1e-10
    refusal(lambda: slow + slow, "motions with stances are not joined")


def test_checks_of_effort_see_both_sides_of_a_switch(dog):
    stand, motion = on_points(dog), lifted_knees(dog, LIFTS[:3], 1.25).with_stances(LIFTS[:3]).with_step(0.25)
    largest = np.abs(stand.forces_along(motion, np.linspace(0, 1.25, 1251), order=0).forces[0][:, 6:]).max()
    found = stand.with_limits(effort=largest / 1.25).check(motion)
    assert not found.ok
    assert found.worst.ratio == pytest.approx(1.25, rel=1e-6)


def test_friction_over_a_switch(humanoid, stepping):
    """The right foot slips before the left one does; a leg alone needs a wide sole."""
    wide = {"place": (0.035, 0, -0.037), "sole": (0.2, 0.2)}
    stand = humanoid.contacts(
        [jounce.Contact(foot, "plane", **wide, friction=mu) for foot, mu in zip(FEET, (0.3, 0.06), strict=True)]
    )
    along = stand.forces_along(stepping, np.linspace(0.6, 1.2, 16), order=1)
    assert all(np.abs(Q[:, :6]).max() < 1e-11 * np.abs(Q).max() for Q in along.forces)
    assert [found.t for found in along.breaks if found.order == 0] == [0.9]
    limits = [found for found in along.breaks if found.order == 1]
    assert limits
    assert not any(found.causes for found in limits)
    for k, contact in enumerate(stand.mechanism.contacts):
        slack = along.wrenches[0][:, k] @ contact.limits.T
        assert slack.max() < 1e-8 * np.abs(along.wrenches[0]).max()


def test_in_flight_the_base_rows_are_what_is_missing(dog, lifting):
    stand = on_points(dog)
    motion = lifting.with_stances([(0, PAWS), (0.5, []), (1, PAWS), *LIFTS[3:]], 0.1)
    along = stand.forces_along(motion)
    up = (along.t >= 0.5) & (along.t < 1)
    free = dog.inverse_dynamics(*lifting(along.t[up]), base=lifting.base(along.t[up]))
    assert all(relative_error(x[up], Q) < 1e-12 for x, Q in zip(along.forces, free, strict=True))
    assert not along.wrenches[0][up].any()
    assert all(np.abs(Q[~up, :6]).max() < 1e-12 * np.abs(Q).max() for Q in along.forces)


def test_the_next_switch_is_that_of_bisection(humanoid):
    stand = humanoid.contacts([jounce.Contact(foot, "plane", **SOLE, friction=0.6) for foot in FEET])
    t = np.arange(46) / 30
    bend = (t * (2 - t)) ** 5
    q = squat(humanoid, t, 0)[0]
    q[:, humanoid.joint_names.index("waist_roll_joint")] = 0.25 * bend * np.sin(7 * t)
    base = np.linalg.inv(humanoid.poses(q, body=FEET[0], base=np.eye(4), method="recursion"))
    motion = jounce.Motion.through(t, q, joint_names=humanoid.joint_names).with_base(t, base, degree=7)
    breaks = [found.t for found in stand.forces_along(motion, np.linspace(0.6, 0.79, 20), order=1).breaks]
    assert len(breaks) == 3
    for before, at in zip([0.6, *breaks[:2]], breaks, strict=True):
        errors = []
        for ahead in (min(0.004, 0.4 * (at - before)), min(0.002, 0.2 * (at - before))):
            when, name = stand.next_switch(*motion(at - ahead, 5), base=motion.base(at - ahead, 5))
            errors.append(abs(when - ahead) / ahead)
            assert name.endswith("_ankle_roll_link'")
        assert errors[0] < 1e-3
        assert errors[1] < max(errors[0] / 3, 3e-5)  # of order three or more


def test_predictions_want_limits_rates_and_one_state(dog):
    still, base = [BENT, *np.zeros((4, 12))], (np.eye(4), *np.zeros((4, 6)))
    stand = on_points(dog, normal=(0, 0, 1), friction=0.5)
    assert stand.next_switch(*still, base=base) == (np.inf, "")
    with expect_refusal("no contacts with limits that begin and end; state friction="):
        on_points(dog).next_switch(*still, base=base)
    refusal(lambda: stand.next_switch(*still[:3], base=base[:3]), "expected one state, with q3d at least")


@pytest.mark.parametrize(("stances", "blend", "words"), [
    ([(0, ["FL_PAW"])], 0, "unknown contact of a stance 'FL_PAW'; available: FL_FOOT, "),
    ([(0, PAWS), (0.7, LEFT_UP), (0.5, PAWS)], 0, "stances begin at 0, 0.7, 0.5 s; expected times that increase"),
    ([(0, PAWS), (2, LEFT_UP)], 0, "stances begin at 0, 2 s; …, from 0 s on, to before 2 s"),
    ([(0.1, PAWS)], 0, "stances begin at 0.1 s; expected times that increase, from 0 s on"),
    ([PAWS], 0, "stances holds ['FL_FOOT', …; expected pairs (time in s, frames of the contacts)"),
    ([(0, [3])], 0, "stances hold 3; expected names of frames of contacts"),
    (LIFTS, 0.2, f"blend is 0.2; expected 0 to 0.1225 s, {MAX_BLEND_SHARE} of the shortest stance"),
    (LIFTS, -1, "blend is -1; expected 0 to"),
    ([(0, PAWS), (0.5, PAWS[:2])], 0, "at FL_FOOT, FR_FOOT do not balance the moment about the axis (…, at t = 0.5 s"),
    ([(0, LEFT_UP), (1.2, RIGHT_UP)], 0.1, "contacts at … do not balance the moment about …, at t = 1.2 s"),
])  # fmt: skip
def test_wrong_stances_are_refused(dog, stances, blend, words):
    at_rest = jounce.Motion.polynomial(BENT[:, None], 2.0).with_base(None, np.eye(4))
    with expect_refusal(words):
        on_points(dog).forces_along(at_rest.with_stances(stances, blend), [0.0, 0.5, 1.19, 1.2])


def test_feet_that_move_while_they_are_there_are_refused(dog, lifting):
    late = [(0, PAWS), (0.6, LEFT_UP), *LIFTS[2:]]
    with expect_refusal("^the motion moves contact 'FL_FOOT' along … by up to …, at t = 0.59"):
        on_points(dog).forces_along(lifting.with_stances(late))


def test_stances_want_contacts(dog, lifting):
    with expect_refusal("the motion has stances, and 'solo12' no contacts; state them: robot."):
        dog.forces_along(lifting.with_stances(LIFTS))
    dog.forces_along(lifting.with_stances(LIFTS).with_stances([]), order=0)


@pytest.mark.parametrize("kind", ["terms", "trajectory"])
def test_files_state_stances(dog, tmp_path, kind):
    names, q = list(dog.joint_names), BENT.tolist()
    if kind == "terms":
        data = {
            "time": {"stop": 2, "count": 5},
            "joints": {name: {"offset": x} for name, x in zip(names, q, strict=True)},
        }
        data["base"] = {"z": {"offset": 0.2}}
    else:
        points = [{"time_from_start": t, "positions": q} for t in (0, 2)]
        data = {"joint_names": names, "points": points}
    path = tmp_path / "stand.json"
    path.write_text(json.dumps(data | {"stance": [[0, PAWS], [1, PAWS[1:]]], "blend": 0.2}))
    motion = jounce.load_motion(path, dog)
    assert motion.stance_frames == tuple(PAWS)
    np.testing.assert_allclose(motion.presence.rates(np.array([0.5, 0.9, 1.5]), 0)[0][:, 0], [1, 0.5, 0], atol=1e-14)
    path.write_text(json.dumps(data | {"blend": 0.2}))
    refusal(lambda: jounce.load_motion(path, dog), "blend of … is 0.2; expected 'stance' too")
    path.write_text(json.dumps(data | {"stance": [[1, PAWS]]}))
    refusal(lambda: jounce.load_motion(path, dog), "stand.json: stances begin at 1 s")


def test_check_judges_the_contacts_that_are_there(humanoid, stepping):
    """After the right foot has left, the left one needs what it needs alone; before, both need less."""
    left, right = (jounce.Contact(foot, "plane", **SOLE, friction=2.0) for foot in FEET)
    both, alone = humanoid.contacts([left, right]), humanoid.contacts([left])
    rows = {row.joint: row for row in both.check(stepping).table}
    t = np.linspace(0.9, stepping.stop, 91)
    needs = _find_ratios(LimitedMotion(alone, stepping.with_stances([]), alone.limits, ()), t)[0]
    assert rows[FEET[0]].ratio == pytest.approx(needs.max(), rel=1e-3)
    assert rows[FEET[0]].t >= 0.9
    assert 0 < rows[FEET[1]].ratio < needs.max()
    assert rows[FEET[1]].t < 0.9
    with expect_refusal(re.compile(r"contacts at .* do not balance|no contact is there at t = 0")):
        alone.check(stepping.with_stances([(0, []), (0.9, FEET[:1])]))


@pytest.mark.parametrize(("share", "falls"), [(0.5, True), (2.0, False)])
def test_in_flight_the_base_must_fall(dog, share, falls):
    """With an acceleration that is a share of the tolerance too small."""
    t = np.linspace(0, 0.3, 31)
    C = np.tile(np.eye(4), (31, 1, 1))
    C[:, 2, 3] = 0.5 * (1 - share * contact_motion.FREE_FALL_TOLERANCE) * dog.gravity[2] * t**2
    drop = jounce.Motion.through(t, np.tile(BENT, (31, 1))).with_base(t, C, degree=7).with_stances([(0, [])])
    stand = dog.contacts([jounce.Contact(paw, "point", normal=(0, 0, 1), friction=0.8) for paw in PAWS])
    if falls:
        assert [row.ratio for row in stand.check(drop).table if row.joint in PAWS] == [0.0] * 4
    else:
        refusal(lambda: stand.check(drop), re.compile(r"no contact is there at t = .*, and the base takes 0\.\d+ N"))


def test_stances_that_do_not_balance_say_when(dog, lifting):
    grip = dog.contacts([jounce.Contact(foot, "point", normal=(0, 0, 1), friction=0.8) for foot in PAWS])
    with expect_refusal("contacts at … do not balance …, at t = 0.5"):
        grip.check(lifting.with_stances([(0, PAWS), (0.5, PAWS[1:3]), (1, PAWS), *LIFTS[3:]]))


def test_tables_say_that_they_state_no_stances(dog, lifting, tmp_path):
    with pytest.warns(jounce.JounceWarning, match="the stances of the motion are not written"):
        write_motion(tmp_path / "steps.csv", lifting.with_stances(LIFTS), dog.joint_names)
    write_motion(tmp_path / "stand.csv", lifting, dog.joint_names)
