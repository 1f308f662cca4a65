"""Validity ranges and provenance of effect files: read with units, refused with their place, and shown."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import commands
import rigctl
from rigctl.effects import Effect
from rigctl.effects.document import effect_document
from rigctl.effects.user import parse_effect
from rigctl.errors import RigctlError
from rigctl.model.validity import quantity

BOX = """
valid:
  velocity: [-300 mm/s, 0.3 m/s]
  pressure_a - pressure_b: [0 bar, 80 bar]
  oil_temperature: [20 degC, 60 degC]
  oil_temperature - 20 degC: [0 K, 40 K]
provenance:
  runs: [20261121-064412-campaign]
  model: hl32-textbook@2
  method: 12
  discovery: 2
  date: 2026-11-22
  tier: B
  statement: grows as v^0.62
"""


def text(more: str = BOX) -> str:
    return (
        "effect: mine\nsummary: A test.\nslot: friction\nterm: size*velocity/(1 m/s)\n"
        "parameters: {size: {null_value: 0 N, start: 50 N, bounds: [0 N, 500 N]}}\n" + more
    )


def box(effect: Effect) -> dict[str, dict[str, Any]]:
    return {one["over"]: one for one in effect_document(effect)["valid"]}


def refused(more: str) -> str:
    with pytest.raises(RigctlError) as caught:
        parse_effect(text(more), Path("mine.yaml"))
    return str(caught.value)


def test_ranges_and_provenance_are_read_with_their_units() -> None:
    effect = parse_effect(text())
    ranges = {one.over: one for one in effect.valid}
    assert (ranges["velocity"].low, ranges["velocity"].high) == (-0.3, 0.3)
    assert ranges["oil_temperature"].low == pytest.approx(293.15)
    assert ranges["oil_temperature - 20 degC"].high == pytest.approx(40.0)
    assert box(effect)["pressure_a - pressure_b"] == {
        "over": "pressure_a - pressure_b",
        "unit": "bar",
        "low": 0.0,
        "high": 80.0,
    }
    assert effect_document(effect)["provenance"] == {
        "runs": ["20261121-064412-campaign"],
        "model": "hl32-textbook@2",
        "method": 12,
        "discovery": 2,
        "date": "2026-11-22",
        "tier": "B",
        "statement": "grows as v^0.62",
    }


def test_validity_and_provenance_are_shown_only_for_effects_that_have_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").write_text(text(), encoding="utf-8")
    Path("plain.yaml").write_text(text(""), encoding="utf-8")
    shown = " ".join(commands.told("effects", "show", "mine.yaml", "--no-picture").split())
    assert "velocity from -300 mm/s to 300 mm/s" in shown
    assert (
        "found 2026-11-22 by method 12 and search 2 from 20261121-064412-campaign beside hl32-textbook@2"
        in shown
    )
    assert "grows as v^0.62" in shown
    plain = commands.told("effects", "show", "plain.yaml", "--no-picture")
    assert "valid over" not in plain
    assert "provenance" not in plain


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (
            "valid: {velocty: [0 m/s, 1 m/s]}",
            "mine.yaml:6:9: unknown name, got 'velocty'; did you mean 'velocity'",
        ),
        ("valid: {velocity: [0 bar, 1 m/s]}", "the range of velocity has another unit than velocity"),
        ("valid: {velocity: [0, 1]}", "expected a speed, e.g. '0.1 m/s'"),
        ("valid: {velocity: [1 m/s, 0 m/s]}", "the range of velocity is empty, got '[1 m/s, 0 m/s]'"),
        ("valid: {velocity - bore: [1 m/s, 2 m/s]}", "cannot subtract"),
        ("valid: {abs(velocity): [1 m/s, 2 m/s]}", "Write absolute(x, width)"),
        ("valid: {velocity > 0 m/s: [0, 1]}", "may not branch"),
        ("valid: {size: [1 N, 2 N]}", "unknown name, got 'size'"),
        ("provenance: {teir: A}", "did you mean 'tier'"),
        ("provenance: {tier: C}", "expected A, B, curve or law"),
        ("provenance: {date: yesterday}", "date"),
        ("provenance: {method: twelve}", "method"),
        ("provenance: {discovery: 0}", "discovery"),
    ],
)
def test_mistakes_are_refused_with_one_clear_message(more: str, said: str) -> None:
    message = refused(more)
    assert said in message
    assert message.startswith("mine.yaml:")
    assert "\n" not in message


@given(st.floats(-1e3, 1e3), st.floats(1e-3, 1e3), st.sampled_from(["m/s", "mm/s", "km/h"]))
def test_a_range_is_shown_in_the_unit_it_was_written_in(low: float, width: float, unit: str) -> None:
    effect = parse_effect(text(f"valid: {{velocity: [{low!r} {unit}, {low + width!r} {unit}]}}"))
    found = box(effect)["velocity"]
    assert found["unit"] == unit
    assert found["low"] == pytest.approx(low, rel=1e-9, abs=1e-12)
    assert found["high"] == pytest.approx(low + width, rel=1e-9, abs=1e-12)


def test_a_range_may_refer_to_any_variable_of_the_equations() -> None:
    effect = parse_effect(text("valid: {density*velocity^2: [0 Pa, 100 Pa]}"))
    family = effect.model_family
    known = {one.name: one.value for one in family.parameters} | {s.name: s.start for s in family.states}
    value = float(quantity(effect.valid[0], family, [effect], known | {"velocity": 0.2, "mine.size": 50.0}))
    assert 20.0 < value < 50.0  # of an oil of 900 kg/m^3: 36 Pa


def test_a_simulated_bench_reports_leaving_the_range_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    commands.create_project(tmp_path)
    monkeypatch.chdir(tmp_path)
    box = "valid: {velocity: [-50 mm/s, 50 mm/s], oil_temperature: [0 degC, 100 degC]}\n"
    Path("mine.yaml").write_text(text(box), encoding="utf-8")
    found = commands.answer("simulate", "procedures/quick-check.yaml", "--with", "mine.yaml", "--seed", "1")
    (warning,) = found["warnings"]
    assert warning["message"].startswith("mine was learned for velocity from -50 mm/s to 50 mm/s, and it is ")
    assert warning["time"] > 0.0
    events = rigctl.open_run(Path(found["path"])).events
    (event,) = events[events["message"] == warning["message"]].to_dict("records")
    assert (warning["time"], warning["record"]) == (event["time"], event["record"])
    inside = "valid: {velocity: [-5 m/s, 5 m/s]}\n"
    Path("mine.yaml").write_text(text(inside), encoding="utf-8")
    found = commands.answer("simulate", "procedures/quick-check.yaml", "--with", "mine.yaml", "--seed", "1")
    assert found["warnings"] == []
