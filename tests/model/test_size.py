"""Long chains: what is computed of them takes memory in proportion to its result, and their length is bounded early."""

import tracemalloc

import numpy as np
import pytest

import jounce
from jounce.checks.audit import check_massless, check_sizes
from jounce.model import screws
from jounce.model.mechanism import ancestors
from jounce.spatial.series import Series
from support.refusals import refusal
from support.robots import random_chain, random_mechanism


def peak(function, *arguments, **options):
    """The largest number of bytes that a call holds at a time, what it returns among them."""
    tracemalloc.start()
    try:
        function(*arguments, **options)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_the_mass_matrix_takes_memory_in_proportion_to_it():
    """A unit vector for each pair of joints took 150 times the result, kept intermediate terms 26 times."""
    robot = jounce.Robot(random_chain(300))
    q = np.linspace(-1, 1, 300)
    M = robot.mass_matrix(q, method="recursion")
    assert peak(robot.mass_matrix, q, method="recursion") < 20 * M.nbytes


@pytest.mark.parametrize(("kind", "times"), [(float, 2), (object, 1)])
def test_numbers_of_unkept_series_are_computed_again(kind, times):
    asked = []

    def term(k):
        asked.append(k)
        return np.full(2, k, dtype=kind)

    series = Series(term).unkept
    for _ in range(2):
        assert [list(series[k]) for k in range(3)] == [[k, k] for k in range(3)]
    assert [asked.count(k) for k in range(3)] == [times] * 3


@pytest.mark.parametrize("check", [check_sizes, check_massless])
def test_checks_of_a_chain_take_less_memory_than_a_matrix(check):
    n = 400
    assert peak(lambda m: list(check(m)), random_chain(n)) < 8 * n**2


def test_ancestors_of_a_tree():
    parent = [-1, 0, 0, 2, -1, 3]
    found = ancestors(random_mechanism(np.random.default_rng(0), parent, ["revolute"] * 6, [1.0] * 6))
    for i in range(6):
        carriers, body = set(), i
        while body >= 0:
            carriers.add(body)
            body = parent[body]
        assert set(np.flatnonzero(found[i])) == carriers
        assert found[i].max() == 1


def test_the_number_of_bodies_is_bounded():
    screws.check_size(screws.MAX_BODIES)
    words = f"{screws.MAX_BODIES + 1} movable joints", f"up to {screws.MAX_BODIES}", "JOUNCE_MAX_BODIES"
    refusal(lambda: screws.check_size(screws.MAX_BODIES + 1), *words)


def test_the_bound_is_raised_and_lowered(monkeypatch):
    monkeypatch.setenv("JOUNCE_MAX_BODIES", str(screws.MAX_BODIES + 1))
    screws.check_size(screws.MAX_BODIES + 1)
    monkeypatch.setenv("JOUNCE_MAX_BODIES", "3")
    random_chain(3)
    refusal(lambda: random_chain(4), "4 movable joints")
    for wrong in ("many", "-1", "1e4", "²"):
        monkeypatch.setenv("JOUNCE_MAX_BODIES", wrong)
        refusal(lambda: random_chain(1), "JOUNCE_MAX_BODIES", "expected")


def test_a_file_is_refused_before_its_links_are_read(tmp_path, monkeypatch):
    monkeypatch.setenv("JOUNCE_MAX_BODIES", "1")
    inertia = '<inertial><mass value="much"/></inertial>'
    joints = "".join(
        f'<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/></joint>'
        for i, kind in enumerate(["revolute", "fixed", "continuous"])
    )
    path = tmp_path / "chain.urdf"
    for links in ("<link name='l{}'/>", "<link name='l{}'>" + inertia + "</link>"):
        path.write_text(f"<robot name='chain'>{''.join(map(links.format, range(4)))}{joints}</robot>")
        refusal(lambda: jounce.load(path), "chain.urdf: 2 movable joints")
    monkeypatch.setenv("JOUNCE_MAX_BODIES", "2")
    refusal(lambda: jounce.load(path), "much")
