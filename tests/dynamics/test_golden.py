"""Against reference data computed to 50 digits from Lagrange's equations, sharing nothing with the paper's formulas."""

import pytest

from jounce.dynamics.closed_form import closed_form
from jounce.dynamics.paper import Paper
from jounce.spatial.series import column_series
from support import recursion
from support.robots import GOLDEN_NAMES, golden, loads, rates_of, relative_error

TOLERANCE = 1e-12
ENTRIES = {
    "Q": ("Q", "Qd", "Q2d", "Q3d", "Q4d"),
    "gM": ("M", "Mdot", "Mddot"),
    "Qgrav": ("Qgrav", "Qgrav_dot", "Qgrav_ddot"),
    "Qext": ("Qext", "Qext_dot", "Qext_ddot"),
}


def recursion_results(mechanism, q, W):
    return {
        "Q": recursion.inverse_dynamics(mechanism, q, W),
        "gM": recursion.mass_matrix(mechanism, q),
        "Qgrav": recursion.gravity_forces(mechanism, q),
        "Qext": recursion.external_forces(mechanism, q, W),
    }


METHODS = {
    "closed_form": (lambda *given: vars(closed_form(*given)), 4),
    "recursion": (recursion_results, 4),
    "paper": (lambda *given: {entry: getattr(Paper(*given), entry) for entry in ENTRIES}, 2),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", GOLDEN_NAMES)
def test_agrees_with_golden_data(name, method):
    mechanism, cases = golden(name)
    compute, highest = METHODS[method]
    assert len(cases) >= 5
    for case in cases:
        q, W = rates_of(case)
        found = compute(mechanism, column_series(q), loads(W))
        for entry, keys in ENTRIES.items():
            for k, key in enumerate(keys[: highest + 1]):
                result = found[entry][k]
                result = result if entry == "gM" else result[:, 0]
                assert relative_error(result, case[key]) < TOLERANCE, (case["name"], key)
