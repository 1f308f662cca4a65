"""The columns of a sample."""

from __future__ import annotations

import pytest

from rigctl.expressions import BOOLEAN, parse, type_of_unit
from rigctl.rig import parse_rig


def test_columns_and_units_are_in_the_order_of_the_file(small: str) -> None:
    layout = parse_rig(small).layout
    assert layout.columns == (
        "time",
        "record",
        "temperature",
        "pressure",
        "position",
        "heater",
        "valve",
        "relief",
    )
    assert layout.units == ("s", "1", "degC", "bar", "mm", "1", "1", "bar")
    assert layout.signals == layout.channels + layout.commands
    assert layout.unit("relief") == "bar"
    assert len(layout.units) == len(layout.columns)


def test_conditions_are_checked_and_compiled_for_the_columns(small: str) -> None:
    layout = parse_rig(small).layout
    condition = parse("position < 1 mm and temperature > 40 degC and valve == 1 and relief < 30 bar")
    assert condition.check(layout.types(), expected=BOOLEAN) == BOOLEAN
    compiled = condition.compile(layout.types(), layout.signals)
    assert compiled((320.0, 0.0, 0.0, 0.0, 1.0, 2e6)) is True


def test_a_channel_of_temperature_differences_has_that_type(small: str) -> None:
    text = small.replace("temperature: {unit: degC,", "temperature: {unit: degC, difference: true,")
    text = text.replace("above: 90 degC", "above: 90 K").replace("temperature: 20 degC", "temperature: 20 K")
    layout = parse_rig(text).layout
    assert layout.types()["temperature"] == type_of_unit("K", difference=True)
    assert layout.types()["position"] == type_of_unit("mm")


def test_an_unknown_column_is_an_error(small: str) -> None:
    with pytest.raises(ValueError, match="not in tuple"):
        parse_rig(small).layout.unit("nothing")
