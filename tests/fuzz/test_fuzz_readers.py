"""Mutated files: every reader takes them, or refuses them in one line."""

import numpy as np
import pytest
from hypothesis import strategies as st

import jounce
from fuzz.contract import kept, refusal_or, shallow, workshop
from fuzz.mutations import mutated
from fuzz.originals import LIMITS, MOTIONS, PACKAGE, ROBOTS
from support.robots import parts

PLANAR = jounce.load("planar2r")
RANDOM = st.randoms(note_method_calls=False, use_true_random=False)
EXAMPLES = {  # of a round: of a second each; `make fuzz` makes many
    "urdf": 300, "mjcf": 300, "xacro": 300, "own": 80, "dh": 140,
    "csv": 400, "npz": 250, "echo": 20, "terms": 40, "limits": 150,
}  # fmt: skip
pytestmark = pytest.mark.filterwarnings("ignore::jounce.JounceWarning")


def mutated_file(folder, rng, originals):
    """A mutated file."""
    name, content = rng.choice(originals)
    path = folder / name
    path.write_bytes(mutated(rng, path.suffix, content))
    return path


def check_robot(path):
    """A robot that is read is of finite numbers, and is written and read again without a loss."""
    robot, again = refusal_or(jounce.load, path), path.with_name("again.json")
    if robot is None:
        return
    m = robot.mechanism
    assert all(np.isfinite(array).all() for array in (m.B, m.X, m.M, m.G, m.g, m.gravity))
    if refusal_or(lambda: jounce.save(robot, again) or True):
        assert parts(jounce.load(again)) == parts(robot)


def check_motion(path, order):
    motion = refusal_or(jounce.load_motion, path, PLANAR, order=order)
    if motion is not None:
        rates = refusal_or(motion, motion.times, order + 2) or ()  # analytic terms may overflow
        assert all(np.isfinite(rate).all() and rate.shape == (len(motion.times), 2) for rate in rates)


def attack_robots(budget, reader, examples):
    with workshop(reader) as folder:
        for name, text in PACKAGE.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(text)

        def check(rng):
            path = mutated_file(folder, rng, ROBOTS[reader])
            with kept(reader, path), shallow():
                check_robot(path)

        budget.attack(check, examples, rng=RANDOM)


@pytest.mark.parametrize("reader", ROBOTS)
def test_robots(budget, reader):
    attack_robots(budget, reader, EXAMPLES[reader])


@pytest.mark.parametrize("reader", MOTIONS)
def test_motions(budget, reader):
    with workshop(reader) as folder:

        def check(rng):
            path = mutated_file(folder, rng, MOTIONS[reader])
            with kept(reader, path):
                check_motion(path, rng.choice((0, 1, 2, 4)))

        budget.attack(check, EXAMPLES[reader], rng=RANDOM)


def test_limits(budget):
    """Limits that are read are numbers in order, and tags never reach what is no angle."""
    with workshop("limits") as folder:

        def check(rng):
            path = mutated_file(folder, rng, LIMITS)
            with kept("limits", path):
                robot = refusal_or(PLANAR.with_limits, path)
                if robot is not None:
                    table = robot.limits.table
                    assert not np.isnan(table).any()

        budget.attack(check, EXAMPLES["limits"], rng=RANDOM)
