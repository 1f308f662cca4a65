"""Display of p-values."""

from __future__ import annotations

import pytest

from rigctl.wording import chance, chance_text


@pytest.mark.parametrize(
    ("p_value", "read", "said"),
    [
        (0.031, "0.031", "p = 0.031"),
        (1.0, "1", "p = 1"),
        (1e-9, "< 1e-6", "p < 1e-6"),
        (0.0, "< 1e-6", "p < 1e-6"),
    ],
)
def test_p_values_below_1e_6_are_shown_as_a_bound(p_value: float, read: str, said: str) -> None:
    assert (chance(p_value), chance_text(p_value)) == (read, said)
