"""Display of the channels' readings."""

from __future__ import annotations

import io
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from rigctl.live import Readings, readings_table
from rigctl.live.readings import BLOCKS, PLAIN_BLOCKS, least_span, limits_of, shown, sparkline
from rigctl.rig import Rig

VALUES = {"oil_temperature": 313.15, "supply_pressure": 30.2e5, "position": 0.0774}
COMMANDS = {"heater": 1.0, "valve": 0.0, "relief_valve": 30e5}


def printed(readings: Readings, *, unicode: bool = True) -> str:
    console = Console(file=io.StringIO(), width=110)
    console.print(readings_table(readings, unicode=unicode))
    return console.file.getvalue()  # type: ignore[attr-defined, no-any-return]


def test_values_commands_and_limits_are_in_display_units(rig: Rig) -> None:
    readings = Readings(rig)
    readings.update(VALUES, COMMANDS)
    lines = {line.split()[0]: line for line in printed(readings).splitlines()}
    assert "40.0 degC" in lines["oil_temperature"]
    assert "below 90 degC" in lines["oil_temperature"]
    assert "30.2 bar" in lines["supply_pressure"]
    assert "77.4 mm" in lines["position"]
    assert "-3 … 240 mm" in lines["position"]
    assert lines["heater"].split() == ["heater", "on"]
    assert lines["valve"].split() == ["valve", "neutral"]
    assert lines["relief_valve"].split() == ["relief_valve", "30", "bar"]


def test_missing_readings_are_shown(rig: Rig) -> None:
    assert printed(Readings(rig)).count("no value") == 3
    readings = Readings(rig)
    readings.update({"position": math.nan}, {})
    assert "no value" in printed(readings)


def test_only_displayed_values_are_kept(rig: Rig) -> None:
    readings = Readings(rig)
    for number in range(200):
        readings.update({"position": number * 1e-3}, {})
    assert len(readings.past("position")) == 24
    assert readings.past("position")[-1] == 0.199


def test_negative_zero_is_shown_as_zero(rig: Rig) -> None:
    assert shown(-1e-6, rig.channels["position"]) == "0.0 mm"


def test_only_limits_that_stop_a_run_are_shown(rig: Rig) -> None:
    assert limits_of("oil_temperature", rig.channels["oil_temperature"], rig) == "below 90 degC"
    none = rig.model_copy(update={"limits": {}})
    assert limits_of("oil_temperature", rig.channels["oil_temperature"], none) == ""


@given(st.lists(st.floats(allow_infinity=False) | st.none(), max_size=40), st.floats(0.0, 1e9), st.booleans())
def test_a_sparkline_has_a_block_for_each_value(
    values: list[float | None], span: float, unicode: bool
) -> None:
    given_values = [math.nan if value is None else value / 4.0 for value in values]
    line = sparkline(given_values, span, unicode=unicode)
    assert len(line) == len(values)
    assert set(line) <= set(" " + (BLOCKS if unicode else PLAIN_BLOCKS))
    assert [block == " " for block in line] == [math.isnan(value) for value in given_values]


def test_a_sparkline_rises_with_its_values() -> None:
    assert sparkline([0.0, 1.0, 2.0, math.nan, 7.0], 0.0) == "▁▂▃ █"
    assert sparkline([0.0, 7.0], 0.0, unicode=False) == "_@"


def test_noise_is_drawn_as_a_nearly_flat_sparkline(rig: Rig) -> None:
    channel = rig.channels["supply_pressure"]
    noise = [30e5, 30.1e5, 29.9e5, 30e5]
    assert len(set(sparkline(noise, least_span(channel, rig)))) <= 2
    without = channel.model_copy(update={"range": None})
    assert least_span(without, rig) == pytest.approx(4.0 * channel.resolution)


def test_an_ascii_terminal_gets_ascii(rig: Rig) -> None:
    readings = Readings(rig)
    readings.update(VALUES, COMMANDS, {"position": "stop"})
    assert not set(BLOCKS) & set(printed(readings, unicode=False))
