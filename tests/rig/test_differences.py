"""Channels that are temperature differences."""

from __future__ import annotations

import pytest

from rigctl.errors import RigctlError
from rigctl.rig import parse_rig

RIG = """
name: exchanger
channels:
  rise: {{unit: degC, quantity: temperature, difference: true, range: [{low}, 50 K]}}
limits:
  too_much: {{channel: rise, above: {bound}}}
"""


def test_a_limit_of_a_difference_is_an_interval() -> None:
    rig = parse_rig(RIG.format(low="-50 K", bound="5 K"))
    assert rig.limits["too_much"].threshold == pytest.approx(5.0)


@pytest.mark.parametrize(("low", "bound"), [("-50 K", "5 degC"), ("-50 degC", "5 K")])
def test_a_limit_of_a_difference_in_celsius_is_refused(low: str, bound: str) -> None:
    with pytest.raises(RigctlError, match=r"temperature difference.*kelvin"):
        parse_rig(RIG.format(low=low, bound=bound))
