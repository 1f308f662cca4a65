"""Reading rig files: SI inside, and every mistake named with its place."""

from __future__ import annotations

import pickle
from datetime import date
from hashlib import sha256
from pathlib import Path

import pytest

from rigctl.errors import RigctlError, SeveralErrors
from rigctl.files.schema import json_schema
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, load_rig, parse_rig


def test_the_values_of_a_rig_are_in_si_units(small: str) -> None:
    rig = parse_rig(small)
    assert rig.channels["temperature"].noise == pytest.approx(0.1)
    assert rig.channels["pressure"].range == (-1e5, 1e7)
    assert rig.actuators["relief"].low == 1e6
    assert rig.actuators["heater"].power == 2000.0
    assert rig.roles.heat is not None
    assert rig.roles.heat.hysteresis == pytest.approx(0.2)
    assert rig.limits["hot"].threshold == pytest.approx(363.15)
    assert (rig.limits["hot"].bound, rig.limits["hot"].action, rig.limits["hot"].for_) == (
        "above",
        "stop",
        0.5,
    )
    assert rig.limits["surge"].threshold == 5e5
    assert rig.limits["surge"].of_rate
    assert rig.safe_state == {"heater": 0.0, "valve": 0.0}
    assert rig.simulation.initial == {"temperature": pytest.approx(293.15)}
    assert rig.simulation.scatter == {"relief": 0.002}
    assert (rig.monitor_rate, rig.stale_after, rig.backend.kind) == (10.0, 1.0, "simulated")


def test_the_words_of_a_move_are_read_as_valve_values(small: str) -> None:
    roles = parse_rig(small).roles
    assert roles.extend is not None
    assert roles.retract is not None
    assert (roles.extend.value, roles.retract.value) == (1.0, -1.0)


def test_a_loaded_rig_has_its_path_text_and_hash(small: str, tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(small, encoding="utf-8", newline="\n")
    rig = load_rig(path)
    assert rig.path == path
    assert rig.text == small
    assert rig.sha256 == sha256(small.encode()).hexdigest()


def test_a_rig_can_be_pickled_and_copied(small: str) -> None:
    rig = parse_rig(small)
    twin = pickle.loads(pickle.dumps(rig))
    assert twin == rig
    assert twin.sha256 == rig.sha256
    assert rig.model_copy(update={"monitor_rate": 5.0}).channels == rig.channels


def test_a_copy_of_a_rig_has_its_own_layout(small: str) -> None:
    rig = parse_rig(small)
    before = rig.layout
    channels = dict(list(rig.channels.items())[:1])
    copy = rig.model_copy(update={"channels": channels})
    assert copy.layout.channels == tuple(channels)
    assert rig.layout is before
    assert copy.sha256 == rig.sha256  # still the hash of the text that it was read from


def test_a_rig_is_immutable(small: str) -> None:
    with pytest.raises(ValueError, match="frozen"):
        parse_rig(small).name = "other"  # type: ignore[misc]


MISTAKES = [
    ("name: small bench", "nmae: small bench", "1:1: unknown field, got 'nmae'; did you mean 'name'?"),
    ("unit: degC", "unit: degc", "3:23: unit: unknown unit, got 'degc'; expected a unit such as bar"),
    (
        "unit: degC",
        "unit: bar",
        "3:23: unit: this is no unit of temperature, got 'bar'; expected a unit like K",
    ),
    (
        "noise: 0.1 degC",
        "noise: 0.1 bar",
        "3:59: noise: wrong dimension, got '0.1 bar'; expected a temperature diff",
    ),
    (
        "noise: 0.1 degC",
        "noise: 0.1",
        "3:59: noise: the unit is missing, got '0.1'; expected a temperature diff",
    ),
    (
        "[-1 bar, 100 bar]",
        "[-1 mm, 100 bar]",
        "4:53: range: wrong dimension, got '-1 mm'; expected a pressure",
    ),
    ("[-1 bar, 100 bar]", "[100 bar, -1 bar]", "4:52: range: the lower end is not below the upper one"),
    ("[-1 bar, 100 bar]", "[100 bar]", "4:52: too few entries; expected 2 or more"),
    (
        "quantity: pressure",
        "quantity: presure",
        "4:35: quantity: not a known value, got 'presure'; did you mean 'pressure'?",
    ),
    (
        "kind: switch",
        "kind: swich",
        "7:18: kind: not a known value, got 'swich'; expected switch, directional",
    ),
    ("kind: switch", "kind: switch, unit: bar", "7:26: a switch has no 'unit'; expected kind: level"),
    (
        "by: operator, unit: bar",
        "by: operator",
        "9:11: a level needs a unit, got 'relief'; expected 'unit: bar'",
    ),
    ("low: 10 bar", "low: 10 mm", "9:55: low: wrong dimension, got '10 mm'; expected a pressure"),
    ("power: 2 kW", "power: -2 kW", "7:33: power: too small, got '-2 kW'; expected at least 0 W"),
    (
        "actuator: heater, ",
        "actuator: haeter, ",
        "11:20: unknown actuator, got 'haeter'; did you mean 'heater'?",
    ),
    (
        "channel: pressure}",
        "channel: presure}",
        "12:45: unknown channel, got 'presure'; did you mean 'pressure'?",
    ),
    (
        "position: position}\n  retract",
        "position: positon}\n  retract",
        "unknown channel, got 'positon'; did you",
    ),
    ("value: extend", "value: extnd", "13:36: value: unknown position, got 'extnd'; did you mean 'extend'?"),
    (
        "value: extend",
        "value: on",
        "13:36: value: unknown position, got 'on'; expected one of extend, neutral",
    ),
    (
        "value: -1",
        "value: -2",
        "14:37: value: no position of this actuator, got '-2'; expected retract (-1), ne",
    ),
    (
        "channel: temperature, above",
        "channel: temprature, above",
        "16:18: unknown channel, got 'temprature'; did",
    ),
    (
        "above: 90 degC",
        "above: 90 bar",
        "16:38: above: wrong dimension, got '90 bar'; expected a temperature, e.g.",
    ),
    (
        "above: 90 degC, ",
        "",
        "16:8: hot: a limit needs a bound; expected one of above, below, rate_above, rate_below",
    ),
    (
        "above: 90 degC",
        "above: 90 degC, below: 0 K",
        "16:8: hot: a limit has one bound, here above, below; expected",
    ),
    (
        "rate_above: 5 bar/s",
        "rate_above: 5 bar",
        "17:42: rate_above: wrong dimension, got '5 bar'; expected a change per second, e.g. '5 bar/s'",
    ),
    (
        "action: warn",
        "action: wran",
        "17:70: action: not a known value, got 'wran'; expected warn or stop; did you",
    ),
    ("for: 0.5 s", "for: -1 s", "16:52: for: too small, got '-1 s'; expected at least 0 s"),
    (
        "{heater: off, ",
        "{",
        "18:13: safe_state does not say where 'heater' goes; expected every driven actuator",
    ),
    ("heater: off", "heater: of", "18:22: heater: unknown position, got 'of'; did you mean 'off'?"),
    (
        "heater: off",
        "heater: extend",
        "18:22: heater: unknown position, got 'extend'; expected one of off, on",
    ),
    (
        "heater: off",
        "heater: off, pump: off",
        "18:27: unknown actuator, got 'pump'; expected one of heater, relief",
    ),
    (
        "{temperature: 20 degC}",
        "{temprature: 20 degC}",
        "20:13: unknown channel, got 'temprature'; did you mean",
    ),
    (
        "{temperature: 20 degC}",
        "{temperature: 20}",
        "20:26: temperature: the unit is missing, got '20'; expected a t",
    ),
    ("{relief: 0.2 %}", "{relif: 0.2 %}", "21:13: unknown actuator, got 'relif'; did you mean 'relief'?"),
    ("{relief: 0.2 %}", "{relief: 200 %}", "21:21: relief: too large, got '200 %'; expected at most 1"),
    (
        "  position:",
        "  posi-tion:",
        "5:3: not a name, got 'posi-tion'; expected a letter, then letters, digits and _",
    ),
]


@pytest.mark.parametrize(("before", "after", "message"), MISTAKES)
def test_every_mistake_is_reported_with_its_place(small: str, before: str, after: str, message: str) -> None:
    assert before in small
    with pytest.raises(RigctlError) as caught:
        parse_rig(small.replace(before, after, 1), Path("rig.yaml"))
    first = str(caught.value).splitlines()[0]
    assert first.startswith("rig.yaml:")
    assert message in first


def test_several_mistakes_are_reported_in_file_order(small: str) -> None:
    text = small.replace("above: 90 degC", "above: 90 bar").replace("value: extend", "value: on")
    with pytest.raises(SeveralErrors) as caught:
        parse_rig(text)
    assert [error.where.line for error in caught.value.errors] == [13, 16]


@pytest.mark.parametrize("name", ["time", "record", "min", "and", "duration"])
def test_reserved_names_of_channels_are_refused(small: str, name: str) -> None:
    with pytest.raises(RigctlError, match=f"a meaning of its own, got '{name}'"):
        parse_rig(small.replace("  pressure: {", f"  {name}: {{", 1))


def test_a_channel_and_an_actuator_with_one_name_are_refused(small: str) -> None:
    with pytest.raises(RigctlError, match="the same name, got 'position'"):
        parse_rig(small.replace("  relief: {", "  position: {", 1))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("geometry: {boer: 50 mm}", "unknown name in geometry, got 'boer'; did you mean 'bore'?"),
        ("geometry: {bore: 50 bar}", "bore: wrong dimension, got '50 bar'; expected a length"),
        ("geometry: {bore: 50}", "bore: the unit is missing, got '50'; expected a length"),
        (
            "constants: {moving_mas: 12 kg}",
            "unknown name in constants, got 'moving_mas'; did you mean 'moving_mass'?",
        ),
        ("constants: {spool_time: 25 bar}", "spool_time: wrong dimension, got '25 bar'; expected a time"),
    ],
)
def test_constants_of_a_known_model_are_checked(small: str, line: str, message: str) -> None:
    with pytest.raises(RigctlError) as caught:
        parse_rig(f"{small}model: hydraulic_cylinder\n{line}\n")
    assert message in str(caught.value)


def test_a_rig_without_a_model_may_have_any_constants(small: str) -> None:
    rig = parse_rig(f"{small}geometry: {{beam: 2 m}}\nconstants: {{stiffness: 3 N/m}}\n")
    assert (rig.geometry["beam"], rig.constants["stiffness"]) == (2.0, 3.0)


CALIBRATED = "{unit: mm, quantity: position, calibration: {date: 2026-03-01, valid_for: 30 day}}"


@pytest.mark.parametrize(
    ("today", "words"),
    [
        (date(2026, 3, 30), None),
        (date(2026, 3, 31), "ran out on 2026-03-31"),
        (date(2026, 2, 1), "still to come"),
    ],
)
def test_an_expired_or_future_calibration_gives_a_warning(small: str, today: date, words: str | None) -> None:
    rig = parse_rig(small.replace("{unit: mm, quantity: position}", CALIBRATED))
    about = [warning for warning in rig.warnings(today) if "'position'" in warning]
    assert (about == []) if words is None else (words in about[0])


def test_missing_dates_and_interlocks_give_warnings(small: str) -> None:
    warnings = parse_rig(small).warnings(date(2026, 3, 1))
    assert "channel 'pressure' has no calibration date" in warnings
    no_stop = small.replace("for: 0.5 s", "action: warn")
    assert any("no interlock" in warning for warning in parse_rig(no_stop).warnings(date(2026, 3, 1)))


def test_sensors_without_a_range_give_one_warning_on_a_real_bench() -> None:
    text = load_rig(shipped("rigs", "tclab-board.yaml")).text
    bare = parse_rig(text.replace("    range: [-40 degC, 150 degC]", "    #"))
    said = [warning for warning in bare.warnings(date(2026, 3, 1)) if "'range'" in warning]
    assert len(said) == 1
    assert said[0].startswith("temperature_1, temperature_2: without a 'range'")
    simulated = bare.model_copy(update={"backend": bare.backend.model_copy(update={"kind": "simulated"})})
    assert not any("'range'" in warning for warning in simulated.warnings(date(2026, 3, 1)))


def test_a_calibration_valid_for_ever_does_not_overflow(small: str) -> None:
    eternal = CALIBRATED.replace("30 day", "1e9 day")
    rig = parse_rig(small.replace("{unit: mm, quantity: position}", eternal))
    assert not [warning for warning in rig.warnings(date(2026, 3, 1)) if "'position'" in warning]


def test_the_schema_describes_every_field() -> None:
    schema = json_schema(Rig, title="rigctl rig")
    assert schema["title"] == "rigctl rig"
    assert set(schema["required"]) == {"name", "channels"}
    for model in (schema, *schema["$defs"].values()):
        for name, field in model["properties"].items():
            assert field, name
    assert schema["$defs"]["Limit"]["properties"]["for"]["examples"]
    assert "for_" not in schema["$defs"]["Limit"]["properties"]
