"""The part of a rig file for a line-based device: errors have their location."""

from __future__ import annotations

import re
from datetime import date

import pytest

from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig, parse_rig

DEVICE = """\
name: oven
backend:
  kind: serial
  lines:
    identify: {send: "*IDN?", reply: "ACME,OVEN,{firmware}"}
    queries:
      - {send: "T?", reply: "{temperature}"}
    actuators:
      power: {send: "P {value:.1f}", reply: "{_}", scale: [0, 255]}
      fan: {send: "F {value}", words: {off: "0", on: "1"}}
channels:
  temperature: {unit: degC, quantity: temperature}
actuators:
  power: {kind: level, unit: "%", low: 0 %, high: 100 %}
  fan: {kind: switch}
  door: {kind: switch, by: operator}
safe_state: {power: 0 %, fan: on}
"""


def test_a_complete_description_is_accepted() -> None:
    lines = parse_rig(DEVICE).backend.lines
    assert lines is not None
    assert lines.queries[0].places == ("temperature",)
    assert lines.actuators["power"].scale == (0.0, 255.0)
    assert (lines.send_ends, lines.timeout, lines.watchdog) == ("\n", 0.5, 2.0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('reply: "{temperature}"', 'reply: "{temprature}"', "7:29.*did you mean 'temperature'"),
        ('reply: "{temperature}"', 'reply: "{temperature"', "a lone brace"),
        ('reply: "{temperature}"', 'reply: "{_}"', "no answer holds channel 'temperature'"),
        ('{send: "T?", reply: "{temperature}"}', '{send: "T?"}', "a query without an answer"),
        (
            '      - {send: "T?"',
            '      - {send: "U?", reply: "{temperature}"}\n      - {send: "T?"',
            "read twice",
        ),
        (
            '      power: {send: "P {value:.1f}", reply: "{_}", scale: [0, 255]}\n',
            "",
            "nothing says how 'power'",
        ),
        ("      power: {send", "      pover: {send", "did you mean 'power'"),
        ('"P {value:.1f}"', '"P"', "no place for the value"),
        ('"P {value:.1f}"', '"P {power}"', "not a place that can be filled"),
        ('reply: "{_}", scale', 'reply: "{power}", scale', "unknown place in the answer"),
        ("scale: [0, 255]", "scale: [5, 5]", "both ends are the same"),
        ("scale: [0, 255]", "words: {off: a}", "a level has no words"),
        (", low: 0 %, high: 100 %}", "}", "the actuator has no range"),
        ('words: {off: "0", on: "1"}', 'words: {off: "0"}', "a position has none, got 'on'"),
        ('words: {off: "0", on: "1"}', 'words: {off: "0", on: "0"}', "two positions have the same"),
        ('words: {off: "0", on: "1"}', 'words: {of: "0", on: "1"}', "did you mean 'off'"),
        ('words: {off: "0", on: "1"}', 'words: {off: "0", on: "1"}, scale: [0, 1]', "a switch has no scale"),
        ('words: {off: "0", on: "1"}', "words: {off: 0, on: 1}", "expected text"),
        (
            '{send: "*IDN?", reply: "ACME,OVEN,{firmware}"}',
            '{send: "*IDN?"}',
            "identify: the answer is missing",
        ),
        ("    queries:", '    safe: [{send: "P {value}"}]\n    queries:', "no value to be sent here"),
        ("    queries:", '    keep_alive: {send: P, reply: "{x}"}\n    queries:', "nothing is read here"),
        ("    queries:", "    frame: 8X1\n    queries:", "frame: not allowed here"),
        ("    queries:", "    watchdog: 0.1 s\n    queries:", "at least 0.5 s"),
        ("    queries:", '    send_ends: ""\n    queries:', "send_ends"),
        (
            "    queries:",
            "    fastest: 5 Hz\n    queries:",
            "monitor_rate: more than the device.*at most 5 Hz",
        ),
        (
            "    queries:",
            '    safe: "P 0"\n    queries:',
            "not a list of commands, got 'P 0'.*send",
        ),
        ("    queries:", '    safe: ["P 0"]\n    queries:', "not a command with its answer, got 'P 0'.*send"),
        ("    queries:", "    terminator: CR\n    queries:", "unknown field"),
    ],
)
def test_mistakes_in_the_description_are_reported(old: str, new: str, message: str) -> None:
    assert old in DEVICE
    with pytest.raises(RigctlError) as caught:
        parse_rig(DEVICE.replace(old, new, 1))
    assert re.search(message, str(caught.value)), str(caught.value)


def test_the_schema_offers_its_fields() -> None:
    import jsonschema

    from rigctl.files.schema import json_schema
    from rigctl.files.yaml import parse_document
    from rigctl.rig import Rig

    schema = json_schema(Rig, title="rig")
    validator = jsonschema.Draft202012Validator(schema)
    document = parse_document(DEVICE).data
    validator.validate(document)
    document["backend"]["lines"]["queries"][0]["reply"] = ["{temperature}", "OK"]
    validator.validate(document)
    document["backend"]["lines"]["queries"][0]["reply"] = 5
    assert not validator.is_valid(document)


def test_an_output_that_nothing_reads_back_is_a_warning() -> None:
    rig = load_rig(shipped("rigs", "tclab-board.yaml"))
    assert not any("reads" in text for text in rig.warnings(date(2026, 10, 1)))
    blind = parse_rig(rig.text.replace('      - {send: R2, reply: "{heater_2}", every: 1 s}\n', ""))
    said = list(blind.warnings(date(2026, 10, 1)))
    assert any("nothing reads heater_2 back" in text for text in said)
    assert any("the device only acknowledges commands to heater_2" in text for text in said)
    assert not any("neither reports" in text for text in said)
    setting = 'heater_2: {send: "Q2 {value:.2f}", reply: "{value}"}'
    assert setting in blind.text
    silent = parse_rig(blind.text.replace(setting, 'heater_2: {send: "Q2 {value:.2f}"}'))
    said = list(silent.warnings(date(2026, 10, 1)))
    assert any("the device neither reports heater_2 nor answers their commands" in text for text in said)
    assert not any("only acknowledges" in text for text in said)
