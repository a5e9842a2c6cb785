"""Old names work for one release beside the new ones, and warn with them."""

import inspect

import pytest

from jounce import JounceError, JounceWarning
from jounce.core.deprecated import renamed, renamed_keywords


@renamed_keywords(base="moving_base")
def traced(order=2, *, moving_base=False):
    """What is traced."""
    return order, moving_base


def test_a_keyword_by_its_old_name_warns_with_the_new_one_where_it_is_written():
    with pytest.warns(JounceWarning, match=r"^base= of traced\(\) is deprecated, .*; write moving_base=$") as found:
        assert traced(1, base=True) == (1, True)
    assert found[0].filename == __file__
    assert traced(1, moving_base=True) == (1, True)


def test_a_keyword_by_both_names_is_refused():
    with pytest.raises(JounceError, match="write moving_base="):
        traced(base=True, moving_base=True)


def test_a_function_with_renamed_keywords_has_its_own_signature():
    assert list(inspect.signature(traced).parameters) == ["order", "moving_base"]
    assert traced.__doc__ == "What is traced."


def test_a_function_by_its_old_name_warns_with_the_new_call():
    with pytest.warns(JounceWarning, match=r"^report\(\) is deprecated, .*; write robot.report\(\.\.\.\)$"):
        assert renamed("report()", "robot.report(...)", max)(1, 2) == 2
