"""Text templates with fields: commands sent, and values read from answers."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.errors import RigctlError
from rigctl.rig.protocols.line_pattern import read_number, reply_pattern, resolution, send_template


@pytest.mark.parametrize(
    ("pattern", "line", "found"),
    [
        ("{t}", "23.5", {"t": "23.5"}),
        ("{t}", "  23.5 \r", {"t": "23.5"}),
        ("T={t} C", "T= 23.5 C", {"t": "23.5"}),
        ("{_},{p},{_}", "1,2,3,4", {"p": "2"}),
        ("{a},{b}", "1,2,3", {"a": "1", "b": "2,3"}),
        ("TCLab Firmware {version}", "TCLab Firmware 1.4.0 Arduino Uno", {"version": "1.4.0 Arduino Uno"}),
        ("OK", "OK", {}),
        ("OK", "OKAY", None),
        ("OK{_}", "OKAY", {}),
        ("0,{_}", '2,"over-pressure"', None),
        ("{a} bar", "3 Pa", None),
        ("{a}ab", "xab", {"a": "x"}),
        ("x{a}x", "x", None),
        ("{{{a}}}", "{7}", {"a": "7"}),
        ("#1 !{_}", '#1 !-221,"Settings conflict"', {}),
    ],
)
def test_fields_of_a_pattern_are_read(pattern: str, line: str, found: dict[str, str] | None) -> None:
    assert reply_pattern(pattern).match(line) == found


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=6))
def test_written_values_are_read_back(numbers: list[float]) -> None:
    pattern = reply_pattern(",".join(f"{{n{i}}}" for i in range(len(numbers))))
    found = pattern.match(",".join(f"{number:.6f}" for number in numbers))
    assert found is not None
    assert [read_number(text) for text in found.values()] == pytest.approx(numbers, abs=1e-6)


@given(st.text(max_size=200))
def test_any_answer_is_matched_or_rejected(line: str) -> None:
    for pattern in ("{a},{_};{b}", "x{a}", "{_}", "OK"):
        found = reply_pattern(pattern).match(line)
        assert found is None or all(isinstance(text, str) for text in found.values())


def test_matching_time_is_linear_in_the_line() -> None:
    pattern = reply_pattern(",".join(f"{{p{i}}}" for i in range(40)) + "!")
    assert pattern.match("," * 100_000) is None  # an exponential search would never end


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1.0),
        ("-2.50", -2.5),
        ("+3e2", 300.0),
        (".5", 0.5),
        ("1,5", None),
        ("0x1F", None),
        ("inf", None),
        ("", None),
    ],
)
def test_numbers_in_the_formats_of_devices_are_read(text: str, value: float | None) -> None:
    assert read_number(text) == value


def test_a_device_may_report_a_missing_number() -> None:
    number = read_number("NaN")
    assert number is not None
    assert math.isnan(number)


@pytest.mark.parametrize(("text", "worth"), [("35", 1.0), ("35.0", 0.1), ("-1.250", 1e-3), ("1.5e2", 10.0)])
def test_the_resolution_is_that_of_the_last_digit(text: str, worth: float) -> None:
    assert resolution(text) == pytest.approx(worth)


@pytest.mark.parametrize(
    ("template", "value", "sent"),
    [
        ("Q1 {value}", 40.0, "Q1 40"),
        ("Q1 {value:.2f}", 1.0 / 3.0, "Q1 0.33"),
        ("SOUR:PRES {value:d}", 511.5, "SOUR:PRES 512"),
        ("V {value};", "EXT", "V EXT;"),
        ("{{{value}}}", 1.0, "{1}"),
        ("X", 1.0, "X"),
    ],
)
def test_a_value_is_written_into_the_command_template(template: str, value: float | str, sent: str) -> None:
    assert send_template(template).fill(value) == sent


@pytest.mark.parametrize("text", ["{a}{b}", "{a},{a}", "{a", "a}", "{1}", "{a b}", "{}", "{a.__class__}"])
def test_an_invalid_reply_pattern_is_refused(text: str) -> None:
    with pytest.raises(RigctlError):
        reply_pattern(text)


@pytest.mark.parametrize(
    "text",
    ["", " ", "a\nb", "{v}", "{value} {value}", "{value:>10}", "{value!r}", "{value:.2f}{", "{value.real}"],
)
def test_an_invalid_command_template_is_refused(text: str) -> None:
    with pytest.raises(RigctlError):
        send_template(text)
