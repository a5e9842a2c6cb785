"""Lines of parts of a log: what stands out is found, and what noise has more often at half the rate is none."""

import numpy as np
import pytest

from jounce.motion import vibrations

LENGTH = 64


@pytest.mark.parametrize(("share", "found"), [(0.25, [10 * LENGTH]), (0.5, [])])
def test_a_line_at_half_the_rate_is_left_out(share, found):
    """Waves of one deviation in one part, at a share of the rate: what leaks from half of it does not stand out."""
    k, rng = np.arange(40 * LENGTH), np.random.default_rng(0)
    size = 1.0 if share == 0.5 else 2.0  # of the same power: at half the rate all samples are crests
    wave = np.where(k // LENGTH == 10, size * np.cos(2 * np.pi * share * k), 0)
    lines = vibrations._find_part_lines(
        wave + rng.normal(size=len(k)), np.arange(0, len(k) - LENGTH + 1, LENGTH // 2), LENGTH, 0
    )
    assert [start for start, *_ in lines if start == 10 * LENGTH] == found
