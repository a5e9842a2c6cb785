"""The table of quantities in the documentation: a row for each, and formulas that the site can show."""

import formulas
import pytest
import quantity_table

from jounce.dynamics.quantities import QUANTITIES


def test_every_quantity_has_its_row():
    rows = quantity_table.table().splitlines()[2:]
    for quantity, row in zip(QUANTITIES.values(), rows, strict=True):
        assert all(f"`{name}`" in row for name in quantity.names(0))
        assert all(part in row for part in (quantity.gives.unit, quantity.printed.caption, quantity.printed.tex))
        assert row.count(" | ") == len(quantity_table.HEAD) - 1


def test_the_page_has_the_table():
    page = quantity_table.PAGE.read_text(encoding="utf-8")
    assert quantity_table.with_table(page) == page
    assert quantity_table.table() in page


def test_methods_lead_to_their_descriptions_on_the_site():
    page = quantity_table.on_page_markdown(quantity_table.PAGE.read_text(encoding="utf-8"))
    assert [name for name in QUANTITIES if f"| [`{name}`][jounce.Robot.{name}] |" not in page] == []


@pytest.mark.parametrize("quantity", QUANTITIES.values(), ids=QUANTITIES)
def test_its_formula_is_shown_without_scripts(quantity):
    pytest.importorskip("latex2mathml")
    assert formulas.mathml(quantity.printed.tex, False).startswith("<math")


@pytest.mark.parametrize("quantity", QUANTITIES.values(), ids=QUANTITIES)
def test_what_wrenches_add_is_printed_where_they_enter(quantity):
    printed = quantity.printed
    assert (bool(printed.wrench_term), bool(printed.wrench_tex)) == (quantity.takes.wrenches,) * 2
