"""The sliders of a model, in the units that its file has them in."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.model.load import parse_model
from rigctl.workbench.controls import switches


@pytest.mark.parametrize("written", ["5 K", "9 degF"])
def test_a_slider_of_a_difference_of_temperatures_is_in_kelvin(written: str) -> None:
    text = Path("models/hl32-textbook.yaml").read_text("utf-8")
    model = parse_model(
        text.replace("effects: {}", f"effects: {{thermocouple_offset: {{offset: {written}}}}}")
    )
    (switch,) = [one for one in switches(model) if one.name == "thermocouple_offset"]
    (slider,) = switch.sliders
    assert slider.unit == "K"
    assert (slider.value - slider.offset) / slider.factor == pytest.approx(5.0)
