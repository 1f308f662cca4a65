"""The registers of a Modbus device, checked when its rig is loaded."""

from __future__ import annotations

import pytest

from rigctl.errors import RigctlError
from rigctl.rig import parse_rig

RIG = """
name: oven
backend:
  kind: modbus
  modbus:
    channels:
      bath: {{table: input, address: 0}}
    actuators:
      power: {{table: {table}, address: 1, type: {type}, scale: {scale}}}
      pump: {{table: holding, address: 9, values: {{off: 0, on: {on}}}}}
channels:
  bath: {{unit: degC, quantity: temperature}}
actuators:
  power: {{kind: level, unit: "%"{ends}}}
  pump: {{kind: switch}}
safe_state: {{power: {safe}, pump: off}}
"""
GOOD = {
    "table": "holding",
    "type": "uint16",
    "scale": "0.1",
    "ends": ", low: 0 %, high: 100 %",
    "safe": "0 %",
    "on": "1",
}


def test_levels_that_fit_into_their_register_are_accepted() -> None:
    parse_rig(RIG.format(**GOOD))
    parse_rig(RIG.format(**{**GOOD, "type": "float32", "scale": "1e-9"}))
    parse_rig(RIG.format(**{**GOOD, "type": "int16", "ends": ", low: -100 %, high: 100 %"}))


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"ends": ", low: -5 %, high: 100 %"}, "14:40: low: .* uint16 .*'-5 %'; expected 0 to 6553.5 %"),
        ({"scale": "0.001"}, "high: .* uint16 .*'100 %'; expected 0 to 65.535 %"),
        ({"type": "int16", "scale": "-0.001"}, "high: .* int16 .*expected -32.767 to 32.768 %"),
        ({"ends": "", "safe": "-1 %"}, "power: .* uint16 .*'-1 %'"),
        ({"table": "coil", "type": "bool", "scale": "1"}, "high: .* bool .*'100 %'; expected 0 to 1 %"),
        ({"on": "70000"}, "values: .* uint16 .*'70000'; expected 0 to 65535"),
        ({"on": "-1"}, "values: .* uint16 .*'-1'"),
    ],
)
def test_a_value_that_does_not_fit_into_its_register_is_refused(changed: dict[str, str], told: str) -> None:
    """It used to fail in the middle of a run, or when the outputs were to be made safe."""
    with pytest.raises(RigctlError, match=told):
        parse_rig(RIG.format(**{**GOOD, **changed}))
