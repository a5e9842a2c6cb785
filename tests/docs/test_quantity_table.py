"""The table of quantities in the documentation: a row for each, and formulas that the site can show."""

import inspect

import formulas
import pytest
import quantity_table

from jounce.dynamics.quantities import QUANTITIES


def test_every_quantity_has_its_row():
    rows = quantity_table.on_page_markdown("# Quantities\n\n@quantities\n").splitlines()[4:]
    for quantity, row in zip(QUANTITIES.values(), rows, strict=True):
        assert all(f"`{name}`" in row for name in quantity.names(0))
        assert all(part in row for part in (quantity.unit, quantity.caption, quantity.tex))
        assert row.count(" | ") == len(quantity_table.HEAD) - 1


@pytest.mark.parametrize("quantity", QUANTITIES.values(), ids=QUANTITIES)
def test_a_quantity_is_computed_by_the_method_that_is_named(quantity):
    owner, name, called = quantity_table.method(quantity)
    parameters = inspect.signature(getattr(owner, name)).parameters
    assert list(parameters)[1 : quantity.rates + 1] == list(quantity.input_names(quantity.rates))
    assert called == name or called == f'{name}(form="skew")'
    for option, taken in (("wrench", quantity.wrenches), ("body", quantity.of_bodies), ("frame", quantity.frames)):
        assert (option in parameters) == bool(taken)


@pytest.mark.parametrize("quantity", QUANTITIES.values(), ids=QUANTITIES)
def test_its_formula_is_shown_without_scripts(quantity):
    pytest.importorskip("latex2mathml")
    assert formulas.mathml(quantity.tex, False).startswith("<math")
