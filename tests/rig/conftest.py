"""A small rig file for the tests of this folder."""

from __future__ import annotations

import pytest

SMALL = """\
name: small bench
channels:
  temperature: {unit: degC, quantity: temperature, noise: 0.1 degC}
  pressure: {unit: bar, quantity: pressure, range: [-1 bar, 100 bar]}
  position: {unit: mm, quantity: position}
actuators:
  heater: {kind: switch, power: 2 kW}
  valve: {kind: directional_valve}
  relief: {kind: level, by: operator, unit: bar, low: 10 bar, high: 55 bar}
roles:
  heat: {actuator: heater, channel: temperature, hysteresis: 0.2 degC}
  set_pressure: {actuator: relief, channel: pressure}
  extend: {actuator: valve, value: extend, position: position}
  retract: {actuator: valve, value: -1, position: position}
limits:
  hot: {channel: temperature, above: 90 degC, for: 0.5 s}
  surge: {channel: pressure, rate_above: 5 bar/s, over: 2 s, action: warn}
safe_state: {heater: off, valve: neutral}
simulation:
  initial: {temperature: 20 degC}
  scatter: {relief: 0.2 %}
"""


@pytest.fixture
def small() -> str:
    """The text of a rig file that uses every part."""
    return SMALL
