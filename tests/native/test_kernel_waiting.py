"""What is compiled unasked: nothing that a caller would wait for longer than some seconds, and how code grows."""

import numpy as np
import pytest

import jounce
from jounce.core.errors import JounceWarning
from jounce.dynamics.computation import Computation
from jounce.native import code_forms, jit, memory_layout
from jounce.native import kernel as module
from jounce.native.jit import host
from jounce.native.memory_layout import LongCompilationError
from support.robots import random_chain


@pytest.fixture
def impatient_compilations(monkeypatch, tmp_path):
    """A list that grows with every module that is compiled, the cache being empty and callers impatient."""
    done, assembled = [], jit.assemble
    monkeypatch.setattr(module.jit, "assemble", lambda *given: done.append(given) or assembled(*given))
    monkeypatch.setenv("JOUNCE_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(memory_layout, "MAX_COMPILE_SECONDS", 0.01)
    return done


KINDS = ("revolute", "prismatic")  # of joints, and so of their code
CALLS = {
    "a straight line": (
        4,
        "skew_coriolis_matrix",
        lambda robot, q, **o: robot.coriolis_matrix(*q[:3], form="skew", **o),
    ),
    "a loop": (101, "inverse_dynamics", lambda robot, q, **o: robot.inverse_dynamics(*q, **o)),
}


@pytest.mark.sweep(4)
@pytest.mark.parametrize("form", CALLS)
@pytest.mark.parametrize("way", ["compile", "method", "another process"])
def test_what_takes_long_to_compile_is_compiled_where_asked_alone(impatient_compilations, form, way):
    nb, name, law = CALLS[form]
    robot, q = jounce.Robot(random_chain(nb, KINDS, seed=3)), np.random.default_rng(0).uniform(-1, 1, (4, nb))
    expected = law(robot, q, method="recursion")
    with pytest.warns(JounceWarning, match=r"takes longer than 0\.01 s to compile, so the slower recursion") as told:
        np.testing.assert_array_equal(law(robot, q), expected)
    (warning,) = told
    assert f"robot.compile({name!r}, order=1) compiles it once" in str(warning.message)
    assert "\n" not in str(warning.message)
    assert warning.filename == __file__
    np.testing.assert_array_equal(law(robot, q), expected)  # and said once
    assert not impatient_compilations
    match way:
        case "compile":
            robot.compile(order=1, quantity=name)
        case "method":
            law(robot, q, method="kernel")
        case _:
            jounce.Robot(random_chain(nb, KINDS, seed=3)).compile(order=1, quantity=name)
            robot = jounce.Robot(random_chain(nb, KINDS, seed=3))
    assert len(impatient_compilations) == 1
    found = law(robot, q)
    for x, y, z in zip(found, law(robot, q, method="kernel"), expected, strict=True):
        np.testing.assert_array_equal(x, y)
        np.testing.assert_allclose(x, z, rtol=1e-10, atol=1e-10)
    assert len(impatient_compilations) == 1
    assert any((x != y).any() for x, y in zip(found, expected, strict=True))  # by native code


def test_what_was_compiled_serves_where_nothing_can_be_kept_on_disk(impatient_compilations, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("JOUNCE_CACHE_DIR", str(tmp_path / "file"))
    robot, q = jounce.Robot(random_chain(14, KINDS, seed=3)), np.ones((3, 14))
    kernel = robot.compile(order=0)
    np.testing.assert_array_equal(robot.inverse_dynamics(*q), kernel(*q))
    assert len(impatient_compilations) == 1


def test_what_is_compiled_in_seconds_is_compiled_unasked():
    """Bundled arms, a chain of 44 bodies and every loop to order 6; not chains of any joints to order 12."""
    quantities = [Computation(name, 2) for name in ("inverse_dynamics", "skew_coriolis_matrix")]
    for quantity in quantities:
        code_forms.kernel_modules(jounce.load("iiwa14").mechanism, quantity, host(), memory_layout.MAX_COMPILE_SECONDS)
    code_forms.kernel_modules(
        random_chain(44, KINDS, seed=3), Computation("inverse_dynamics", 2), host(), memory_layout.MAX_COMPILE_SECONDS
    )
    robot = jounce.Robot(random_chain(100, ("revolute", "prismatic", "helical"), seed=3))
    code_forms.kernel_modules(
        robot.mechanism, Computation("inverse_dynamics", 6, wrench=True), host(), memory_layout.MAX_COMPILE_SECONDS
    )
    with pytest.raises(LongCompilationError):
        code_forms.kernel_modules(
            robot.mechanism, Computation("inverse_dynamics", 12), host(), memory_layout.MAX_COMPILE_SECONDS
        )
    skew = Computation("skew_coriolis_matrix", 3)
    with pytest.raises(LongCompilationError):
        code_forms.kernel_modules(random_chain(12, KINDS, seed=3), skew, host(), memory_layout.MAX_COMPILE_SECONDS)


def test_instructions_of_the_loop_form_do_not_grow_with_the_robot():
    """What grows are tables, a line each."""
    counts = set()
    for nb in (50, 60):
        quantity = Computation("inverse_dynamics", 2, wrench=True)
        counts.add(code_forms.kernel_modules(random_chain(nb, KINDS, seed=3), quantity, host())[0].count("\n"))
    assert len(counts) == 1
