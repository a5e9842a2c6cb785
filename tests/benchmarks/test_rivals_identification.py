"""Identification beside others: a fault has a note, and the truth judges errors and stated deviations."""

import numpy as np
import pytest
from benchmarks.rivals import identification
from benchmarks.rivals.arms import Arm
from benchmarks.rivals.identification import Identifier, Truth, judged, measured_log, of_deviations
from benchmarks.rivals.identifiers import Estimate, Log

from support import fake_identifiers

ARM = Arm("two", "", ("a", "b"), ("a", "b"), "b")
LOG = Log("a log", ARM, np.zeros(4), np.zeros((4, 2)), np.zeros((4, 2)), (), np.zeros((1, 20)), np.zeros((1, 20)))
TRUTH = Truth(np.zeros(3), np.zeros((4, 2)), np.ones((4, 2)), np.ones(2), np.ones((4, 2), bool))


@pytest.mark.parametrize(
    ("name", "note"),
    [
        ("missing", "not installed: No module named 'rival'"),
        ("raising", "ValueError: it wants"),
        ("crashing", "its process ended"),
        ("never_ending", "stopped after 8 s"),
        ("not_finite", "what it returns is not finite"),
    ],
)
def test_an_identification_with_a_fault_has_a_note(name, note):
    limit = 8.0 if name == "never_ending" else 60.0
    chosen = [
        Identifier(name, getattr(fake_identifiers, name), limit),
        Identifier("right", fake_identifiers.right, 60.0),
    ]
    bad, good = measured_log(LOG, TRUTH, chosen, lambda text: None)
    assert (bad["note"], bad["force_error"], bad["seconds"]) == (note, None, None)
    assert (good["note"], good["force_error"], good["chi2"]) == ("", 0.0, 0.0)
    assert good["seconds"] >= 0


def test_stated_deviations_are_right_where_errors_are_drawn_from_them():
    rng = np.random.default_rng(0)
    scale = np.array([1e-3, 1.0, 1e3])
    covariance = np.outer(scale, scale) * np.array([[1, 0.9, 0], [0.9, 1, 0], [0, 0, 1]])
    drawn = rng.multivariate_normal(np.zeros(3), covariance, 2000)
    chi2, beyond = np.mean([of_deviations(errors, covariance) for errors in drawn], axis=0)
    assert abs(chi2 - 1) < 0.05
    assert abs(beyond - 0.046) < 0.01


def test_deviations_that_are_too_small_are_seen():
    rng = np.random.default_rng(0)
    found = [of_deviations(errors, 0.01 * np.eye(3)) for errors in rng.normal(size=(500, 3))]
    chi2, beyond = np.mean(found, axis=0)
    assert chi2 > 50
    assert beyond > 0.8


@pytest.mark.parametrize("covariance", [None, np.full((3, 3), np.inf), np.zeros((3, 3)), -np.eye(3)])
def test_deviations_that_nobody_stated_are_not_judged(covariance):
    assert of_deviations(np.ones(3), covariance) == (None, None)


def test_forces_worse_than_those_of_the_model_are_no_identification():
    found = judged(Estimate(np.zeros(3), None, np.full((4, 2), 2.0)), TRUTH)
    assert found["note"] == "worse than the model: forces off by 2 deviations, 1 of it"
    assert found["force_error"] is None
    assert judged(Estimate(np.zeros(3), None, np.full((4, 2), 0.5)), TRUTH)["force_error"] == 0.5


def test_a_result_of_another_shape_is_named():
    assert judged(Estimate(np.zeros(2), None, np.zeros((4, 2))), TRUTH)["note"].startswith("it returns shapes")


def test_figures_of_each_identifier_are_of_what_it_does_more():
    names = " ".join(identifier.name for identifier in identification.IDENTIFIERS)
    assert all(name in names for name in identification.DOES_MORE)
