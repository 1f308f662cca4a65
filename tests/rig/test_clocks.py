"""Clocks in a rig file: what each dates, and how far it may be off."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.errors import RigctlError
from rigctl.rig import parse_rig


def test_channels_share_the_offset_of_their_clock(small: str) -> None:
    rig = parse_rig(small + "clocks:\n  logger: {channels: [pressure, position], uncertainty: 50 ms}\n")
    assert rig.clocks["logger"].channels == ("pressure", "position")
    assert rig.clocks["logger"].uncertainty == 0.05
    assert parse_rig(small).clocks == {}


@pytest.mark.parametrize(
    ("clock", "message"),
    [
        ("{channels: [pressure], uncertainty: 50}", "rig.yaml:23:47: uncertainty: "),
        (
            "{channels: [pressure], uncertainty: 50 mm}",
            "wrong dimension, got '50 mm'; expected a time",
        ),
        ("{channels: [pressure], uncertainty: 0 s}", "must be greater than zero, got '0 s'"),
        ("{channels: [pressure], uncertainty: -5 ms}", "must be greater than zero, got '-5 ms'"),
        ("{channels: [pressure]}", "uncertainty"),
        ("{channels: [], uncertainty: 5 ms}", "channels"),
        ("{uncertainty: 5 ms}", "channels"),
        ("{channels: [presure], uncertainty: 5 ms}", "did you mean 'pressure'"),
        ("{channels: [relief], uncertainty: 5 ms}", "a command has no clock of its own"),
        ("{channels: [pressure, pressure], uncertainty: 5 ms}", "the channel is named twice, got 'pressure'"),
        (
            "{channels: [pressure], uncertainty: 5 ms}\n  other: {channels: [pressure], uncertainty: 9 ms}",
            "the channel is dated by 'logger' already, got 'pressure'",
        ),
    ],
)
def test_a_wrong_clock_is_refused_with_one_message(small: str, clock: str, message: str) -> None:
    with pytest.raises(RigctlError) as caught:
        parse_rig(f"{small}clocks:\n  logger: {clock}\n", Path("rig.yaml"))
    assert message in str(caught.value)
