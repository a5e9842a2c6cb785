"""`dir(robot)` lists what this robot has, and the doors to what others have."""

import numpy as np
import pytest

import jounce
from jounce.dynamics.quantities import QUANTITIES

FEET = [jounce.Contact(f"{leg}_FOOT", "point", normal=(0, 0, 1)) for leg in ("FL", "FR", "HL", "HR")]
ROBOTS = {
    "rigid arm": lambda: jounce.load("ur5"),
    "elastic arm": lambda: jounce.load("ur5").elastic(1e4, 0.5),
    "parallel": lambda: jounce.load("fivebar"),
    "floating": lambda: jounce.load("solo12", base="floating"),
    "standing": lambda: jounce.load("solo12", base="floating").contacts(FEET),
}
DOORS = {"elastic", "closed", "contacts", "with_transmission", "with_limits", "with_drives"}
OF_MOTORS = {"motor_torques", "motor_positions", "motors_along", "elastic_energy"}
OF_CONTACTS = {"contact_wrenches", "center_of_pressure", "next_switch"}


@pytest.fixture(params=ROBOTS, scope="module")
def titled(request):
    return request.param, ROBOTS[request.param]()


def test_doors_are_always_listed(titled):
    assert {*dir(titled[1])} >= DOORS


def test_nothing_listed_lacks_what_it_needs(titled):
    _, robot = titled
    listed = {*dir(robot)}
    assert [row.name for row in QUANTITIES.values() if row.name in listed and row.obstacle(robot.mechanism)] == []
    values = [getattr(robot, name) for name in listed]  # none of which raises
    assert len(values) > 90


def test_motors_and_contacts_are_those_of_robots_that_have_them(titled):
    name, robot = titled
    listed = {*dir(robot)}
    assert bool(OF_MOTORS & listed) == (name == "elastic arm") == (listed >= OF_MOTORS)
    assert bool(OF_CONTACTS & listed) == (name == "standing") == (listed >= OF_CONTACTS)


def test_what_is_not_listed_says_why():
    with pytest.raises(jounce.JounceError, match="its joints are rigid"):
        jounce.load("ur5").motor_torques(*np.zeros((5, 6)))
