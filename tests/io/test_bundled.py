"""The robots that come with jounce: files that hold what URDFs held, licence and source beside; `jounce robots`."""

import json
import warnings
from dataclasses import fields, is_dataclass, replace
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

import jounce
from jounce.io import bundled
from jounce.io.bundled import BUNDLED, read_notices
from jounce.model.mechanism import Mechanism
from support.closed_robots import LOOP_ROBOTS
from support.commands import call
from support.refusals import refusal, refused

FILES = [name for name, robot in BUNDLED.items() if robot.urdf]
FOLDER = Path(bundled.__file__).parent / "robots"
MERGED = 1e-15  # of its largest entry, what the order of products leaves of a pose or inertia of links that were merged
WORDS = {"Apache-2.0": "Apache License", "BSD-3-Clause": "Redistribution and use in source and binary forms"}


def urdf(name):
    """The description that a bundled file was converted from."""
    try:
        installed = metadata.files("example-robot-data") or []
    except metadata.PackageNotFoundError:
        pytest.skip("example-robot-data is not installed")
    (found,) = (file for file in installed if str(file).endswith(f"/robots/{BUNDLED[name].urdf}"))
    return Path(str(found.locate()))


def same_values(a, b):
    """Whether two values of a mechanism are equal, arrays to what processors leave that multiply in another order."""
    if isinstance(a, np.ndarray):
        return (a.dtype, a.shape) == (b.dtype, b.shape) and (np.array_equal(a, b) or is_near(a, b))
    if is_dataclass(a):
        return all(same_values(getattr(a, field.name), getattr(b, field.name)) for field in fields(a))
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same_values, a, b))
    return a == b


def is_near(a, b):
    axes = tuple(range(a.ndim))[-2:]
    return bool(np.isfinite(b).all() and np.all(np.abs(a - b).max(axes) <= MERGED * np.abs(b).max(axes)))


@pytest.mark.parametrize("name", BUNDLED)
def test_they_are_what_the_index_says(name):
    robot, said = jounce.load(name), BUNDLED[name]  # a warning would be an error
    assert (robot.name, said.name, robot.n, robot.mechanism.nb) == (name, name, said.n, said.nb)
    assert robot.mechanism.M[:, 3, 3].sum() == pytest.approx(said.mass, rel=1e-12)


def load_urdf(name, **options):
    """The robot of a package's file, whose massless links are named; the bundled one is known to have them."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*bodies without mass")
        return jounce.load(urdf(name), **options)


@pytest.mark.parametrize("name", FILES)
def test_their_files_hold_the_urdfs(name):
    ours, theirs = jounce.load(name).mechanism, load_urdf(name).mechanism
    differing = [
        field.name
        for field in fields(Mechanism)
        if not same_values(getattr(ours, field.name), getattr(theirs, field.name))
    ]
    assert set(differing) <= {"name", "meant"}


@pytest.mark.parametrize("name", [name for name, robot in BUNDLED.items() if robot.base])
def test_robots_with_legs_float_as_their_urdfs_do(name):
    ours = jounce.load(name, base="floating").mechanism
    theirs = load_urdf(name, base="floating").mechanism
    assert same_values(replace(theirs, name=name, meant=ours.meant), ours)
    assert (ours.bodies[0], ours.nv) == (BUNDLED[name].base, 6 + ours.n)


def test_robots_whose_base_has_no_known_inertia_do_not_float():
    refusal(lambda: jounce.load("panda", base="floating"), "panda has no floating base", "g1, anymal, solo12")
    refusal(lambda: jounce.load("iiwa14", base="floating"), "iiwa14 has no floating base", "g1, anymal, solo12")


@pytest.mark.parametrize("name", FILES)
def test_source_and_licence_go_with_the_numbers(name):
    robot, texts = BUNDLED[name], read_notices(name)
    head = (FOLDER / name / "robot.yaml").read_text().split("name:")[0]
    assert all(line.startswith("# ") for line in head.splitlines())
    assert {robot.source, robot.urdf} <= set(head.replace(",", " ").split())
    assert robot.source.startswith("https://")
    assert WORDS[robot.licence] in texts["LICENSE"]
    assert ("NOTICE" in texts) == (name == "panda")  # of the Apache licence, section 4 (d)


def test_every_folder_is_a_robot():
    assert {path.name for path in FOLDER.iterdir() if path.is_dir()} == {*FILES, *LOOP_ROBOTS}
    assert sum(path.stat().st_size for path in FOLDER.rglob("*")) < 300_000  # bytes


def test_parameters_are_those_of_files():
    gravity = np.array([0.0, 9.81, 0.0])
    assert np.array_equal(jounce.load("panda").mechanism.gravity, [0, 0, -9.81])
    assert np.array_equal(jounce.load("panda", gravity=gravity).mechanism.gravity, gravity)
    refusal(lambda: jounce.load("panda", L1=1.0), "panda has no parameter 'L1'", "gravity")
    refusal(lambda: jounce.load("panda", drive=True), "did you mean 'drives'?")


def test_drives_of_a_file_enter_where_asked_for():
    still, driven = jounce.load("xarm7"), jounce.load("xarm7", drives="damping")
    q, qd = np.zeros(7), np.ones(7)
    damping = driven.inverse_dynamics(q, qd, q) - still.inverse_dynamics(q, qd, q)
    assert np.allclose(damping, [10, 10, 5, 5, 5, 2, 2], rtol=0, atol=1e-12)


def test_the_verb_lists_them():
    lines = call("robots").stdout.splitlines()
    assert lines[0].split() == ["robot", "joints", "bodies", "mass", "kg", "what", "licence", "source"]
    assert [line.split()[0] for line in lines[1:]] == list(BUNDLED)
    for line, robot in zip(lines[1:], BUNDLED.values(), strict=True):
        for said in (f"  {robot.n} ", f"  {robot.nb} ", f"{robot.mass:.5g}", robot.kind, robot.licence, robot.source):
            assert said in line


def test_the_verb_lists_them_as_json():
    listed = json.loads(call("robots", "--json").stdout)
    keys = ("name", "kind", "n", "nb", "mass", "licence", "source", "urdf", "like", "base")
    assert listed == [{key: getattr(robot, key) for key in keys} for robot in BUNDLED.values()]


@pytest.mark.parametrize("name", BUNDLED)
def test_the_verb_shows_licences_in_full(name):
    said = call("robots", name).stdout
    assert BUNDLED[name].source in said
    assert all(text.strip() in said for text in read_notices(name).values())
    shown = json.loads(call("robots", name, "--json").stdout)
    assert (shown["name"], shown["notices"]) == (name, read_notices(name))


def test_the_verb_knows_no_others(tmp_path):
    refused(tmp_path, "robots pandas", "unknown bundled robot 'pandas'; did you mean 'panda'?")
