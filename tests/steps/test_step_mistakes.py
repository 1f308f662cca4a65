"""The message for a wrong step: its place, the value, what was expected, the nearest name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from rigctl.errors import RigctlError
from rigctl.plan import Plan
from rigctl.rig import parse_rig

RIG = (Path(__file__).parents[2] / "rigs" / "hl32-bench.yaml").read_text(encoding="utf-8")

# the step, starting at line 3, column 3; line:column of the message; pieces of the message
MISTAKES: list[tuple[str, str, list[str]]] = [
    ("- heet: 40 degC", "3:11", ["unknown step", "'heet'", "did you mean 'heat'?"]),
    ("- wait", "3:5", ["this is not a step", "'wait: 2 s'"]),
    ("- {}", "3:5", ["this is not a step"]),
    ("- 3", "3:5", ["this is not a step", "'3'"]),
    ("- {wait: 1 s, heat: 20 degC}", "3:12", ["two steps in one", "heat and wait", "after each dash"]),
    ("- heat: {too: 40 degC}", "3:12", ["unknown field", "'too'", "did you mean 'to'?"]),
    ("- heat: {within: 1 K}", "3:11", ["'to' is missing"]),
    ("- heat: {to: 40 bar}", "3:16", ["wrong dimension", "'40 bar'", "a temperature, e.g. '40 degC'"]),
    ("- heat: {to: 40}", "3:16", ["the unit is missing", "'40'", "'40 degC'"]),
    ("- heat: {to: 40 degc}", "3:16", ["unknown unit", "'degc'", "did you mean 'degC'?"]),
    ("- heat: {to: [1]}", "3:16", ["a list where a quantity belongs"]),
    ("- wait: 1e308 s", "3:11", ["wait: too large", "'1e308 s'", "at most 1e+08 s"]),
    ("- heat: {to: 40 degC, within: 0 K}", "3:33", ["within: too small", "'0 K'", "more than zero"]),
    ("- heat: {to: 40 degC, timeout: -1 s}", "3:34", ["timeout: too small", "more than zero"]),
    ("- heat: 400 degC", "3:11", ["range of the channel 'oil_temperature'", "'400 degC'", "150 degC"]),
    ("- heat: 95 degC", "3:11", ["would trip the limit 'oil_too_hot'", "'95 degC'", "at most 90 degC"]),
    ("- heat: $oil", "3:11", ["unknown variable", "'oil'"]),
    ("- heat: $oil +", "3:11", ["heat: the expression ends after"]),
    ("- set_pressure: 60 bar", "3:19", ["the actuator 'relief_valve'", "'60 bar'", "10 bar to 55 bar"]),
    ("- extend: {}", "3:13", ["nothing ends this move", "for, until, to"]),
    ("- extend: {for: 1 s, until: position < 1 mm}", "3:13", ["more than one thing", "for and until"]),
    ("- extend: {for: 1 s, timeout: 2 s}", "3:33", ["a timeout goes with 'until' or 'to'"]),
    ("- extend: {for: 1 s, within: 2 mm}", "3:32", ["a tolerance goes with 'to'"]),
    ("- extend: {until: positoin < 1 mm}", "3:21", ["'positoin'", "did you mean 'position'?"]),
    ("- extend: {until: position < 1 bar}", "3:21", ["a length", "a pressure"]),
    ("- extend: {until: position + 1 mm}", "3:21", ["a condition, e.g. 'position < 1 mm'"]),
    ("- extend: {until: 3}", "3:21", ["no condition", "'3'"]),
    ("- extend: {until: position.real < 1 mm}", "3:21", ["until: "]),
    ("- extend: {to: 260 mm}", "3:18", ["'over_travel'", "'260 mm'", "at most 240 mm"]),
    ("- extend: {to: -2 mm}", "3:18", ["outside the stroke", "0 mm to 250 mm"]),
    ("- hold: {for: 1 s, channel: position, within: 1 bar}", "3:49", ["wrong dimension", "a length"]),
    ("- hold: {for: 1 s, channel: presure, within: 1 bar}", "3:31", ["unknown channel", "'presure'"]),
    ("- hold: {for: 1 s, channel: supply_pressure, at: 61 bar, within: 1 bar}", "3:52", ["over_pressure"]),
    ("- wait: 3", "3:11", ["the unit is missing", "a time, e.g. '2 s'"]),
    ("- wait: true", "3:11", ["wait: true/false where a quantity belongs"]),
    ("- wait: {for: 2 s, until: position < 1 mm}", "3:11", ["a wait needs exactly one end"]),
    ("- wait: {until: position < 1 mm}", "3:11", ["'until' needs a timeout"]),
    ("- set: {heeter: on}", "3:19", ["unknown actuator", "did you mean 'heater'?"]),
    ("- set: {heater: maybe}", "3:19", ["unknown position", "'maybe'", "off, on"]),
    ("- set: {valve: 2}", "3:18", ["no position of this actuator", "'2'"]),
    ("- set: {relief_valve: 3 bar}", "3:25", ["out of range", "'3 bar'", "10 bar to 55 bar"]),
    ("- set: {values: {relief_valve: 20 bar}, for: 2 s}", "3:34", ["no safe value to return to"]),
    ("- record: {name: a b}\n    do: [wait: 1 s]", "3:20", ["no name", "'a b'", "letters"]),
    ("- record: {name: a, channels: [positin]}\n    do: [wait: 1 s]", "3:34", ["did you mean 'position'?"]),
    ("- record: {name: a, channels: []}\n    do: [wait: 1 s]", "3:33", ["no channel is recorded"]),
    ("- record: {name: a, rate: 0 Hz}\n    do: [wait: 1 s]", "3:29", ["more than zero"]),
    ("- record: {name: a, rate: 1e12 Hz}\n    do: [wait: 1 s]", "3:29", ["too large", "at most 1e+06 Hz"]),
    ("- record: {name: a}", "3:5", ["'do' is missing"]),
    ("- record: {name: a}\n    do: []", "4:9", ["too few entries", "at least 1"]),
    (
        "- record: {name: a}\n    do:\n      - record: {name: b}\n        do: [wait: 1 s]",
        "5:17",
        ["a record inside a record", "'b'"],
    ),
    ("- measure: {name: a, value: max(positin), unit: mm}", "3:31", ["did you mean 'position'?"]),
    ("- measure: {name: a, value: max(position), unit: mm}", "3:14", ["no record is open here", "last: 2 s"]),
    (
        "- measure: {name: a, value: max(position), unit: bar, last: 1 s}",
        "3:31",
        ["the dimension of its unit"],
    ),
    (
        "- measure: {name: a, value: position, unit: mm, last: 1 s}",
        "3:31",
        ["one value of a channel", "mean(position)"],
    ),
    (
        "- measure: {name: position, value: max(position), unit: mm, last: 1 s}",
        "3:21",
        ["a meaning of its own"],
    ),
    (
        "- measure: {name: a, value: max(position), unit: mm, last: 1 s, low: 2 mm, high: 1 mm}",
        "3:72",
        ["larger than 'high'", "'2 mm'", "at most 1 mm"],
    ),
    (
        "- measure: {name: a, value: max(position), unit: mm, last: 1 s, over: phase}",
        "3:62",
        ["two stretches"],
    ),
    (
        "- measure: {name: a, value: max(position), unit: mm, last: 1 s, missed: ignore}",
        "3:75",
        ["'ignore'", "fail or continue"],
    ),
    (
        "- heat: {to: 30 degC, timeout: 1 min}",
        "3:34",
        ["before the reading can settle", "settling time, 60 s"],
    ),
    ("- set_pressure: {to: 30 bar, settle: 9 s, timeout: 5 s}", "3:54", ["'5 s'", "settling time, 9 s"]),
    ("- prompt: {question: hi, name: t}", "3:13", ["a typed answer needs a unit"]),
    ("- prompt: {question: hi, low: 1 s}", "3:33", ["only a named answer has this"]),
    ("- prompt: {question: hi, name: t, unit: sek}", "3:43", ["unknown unit", "'sek'"]),
    ("- prompt: {question: hi, name: t, unit: s, low: 2 s, simulated: 1 s}", "3:67", ["outside the bounds"]),
    ("- prompt: Is it at $oil?", "3:13", ["unknown variable", "'oil'"]),
    ("- if: position < 1 mm\n    then: [wait: 1 s]", "4:5", ["'do' is missing", "'then'"]),
    ("- repeat: 10000000\n    do: [wait: 1 s]", "3:13", ["too large", "'10000000'"]),
    ("- repeat: 1.5\n    do: [wait: 1 s]", "3:13", ["not a whole number", "'1.5'"]),
    ("- repeat: -1\n    do: [wait: 1 s]", "3:13", ["too small", "at least 0"]),
    (
        "- repeat: 2000\n    do:\n      - repeat: 2000\n        do: [wait: 1 s]",
        "5:17",
        ["repeated too often"],
    ),
]


@pytest.mark.parametrize(("step", "place", "pieces"), MISTAKES, ids=[m[0].split("\n")[0] for m in MISTAKES])
def test_a_mistake_is_reported_with_its_place(
    planned: Callable[..., Plan], step: str, place: str, pieces: list[str]
) -> None:
    with pytest.raises(RigctlError) as caught:
        planned(f"steps:\n  {step}\n")
    message = str(caught.value)
    assert f"test.yaml:{place}: " in message
    for piece in pieces:
        assert piece in message


def test_an_actuator_turned_by_hand_is_not_set_for_a_time(planned: Callable[..., Plan]) -> None:
    """The others would stay on until the operator answers."""
    rig = parse_rig(RIG.replace("\n  heater: off\n", "\n  heater: off\n  relief_valve: 10 bar\n"))
    step = "- set: {values: {heater: on, relief_valve: 20 bar}, for: 2 s}"
    with pytest.raises(RigctlError, match=r"test.yaml:3:46: .*turned by hand.*'relief_valve'.*without 'for'"):
        planned(f"steps:\n  {step}\n", rig)


@pytest.mark.parametrize(
    ("actuator", "step"), [("heater", "heat: 40 degC"), ("valve", "extend: 1 s"), ("valve", "retract: 1 s")]
)
def test_a_step_that_switches_an_actuator_is_refused_if_it_is_turned_by_hand(
    planned: Callable[..., Plan], actuator: str, step: str
) -> None:
    """Nobody was asked to turn it, and the run recorded that it had been."""
    rig = parse_rig(RIG)
    by_hand = rig.actuators[actuator].model_copy(update={"by": "operator"})
    rig = rig.model_copy(update={"actuators": {**rig.actuators, actuator: by_hand}})
    with pytest.raises(
        RigctlError, match=rf"test.yaml:3:\d+: {step.partition(':')[0]}: .*turned by hand.*'{actuator}'"
    ):
        planned(f"steps:\n  - {step}\n", rig)


def test_all_mistakes_of_a_file_are_reported_together(planned: Callable[..., Plan]) -> None:
    with pytest.raises(RigctlError) as caught:
        planned("steps:\n  - heet: 1\n  - wait: 3\n  - heat: {to: 3 bar}\n")
    assert [line.split(":")[1] for line in str(caught.value).splitlines()] == ["3", "4", "5"]


@pytest.mark.parametrize(
    ("step", "role"),
    [
        ("heat: 30 degC", "heat"),
        ("set_pressure: 30 bar", "set_pressure"),
        ("extend: 1 s", "extend"),
        ("retract: 1 s", "retract"),
    ],
)
def test_a_step_without_its_role_in_the_rig_is_refused(
    planned: Callable[..., Plan], step: str, role: str
) -> None:
    lines = RIG.splitlines()
    without = parse_rig("\n".join(line for line in lines if not line.startswith(f"  {role}: {{")))
    with pytest.raises(RigctlError) as caught:
        planned(f"steps:\n  - {step}\n", on=without)
    assert str(caught.value).startswith("test.yaml:3:")
    assert "the rig 'HL32 bench' cannot" in str(caught.value)
    assert "'roles'" in str(caught.value)


def test_a_move_to_a_position_needs_a_position_channel(planned: Callable[..., Plan]) -> None:
    without = parse_rig(RIG.replace("extend: {actuator: valve, value: extend, position: position}",
                                    "extend: {actuator: valve, value: extend}"))  # fmt: skip
    assert planned("steps: [{extend: 1 s}]", on=without)
    with pytest.raises(RigctlError, match="where the position of 'extend' is read"):
        planned("steps: [{extend: {to: 10 mm}}]", on=without)


def test_a_name_with_values_of_two_dimensions_is_refused(planned: Callable[..., Plan]) -> None:
    with pytest.raises(RigctlError, match="used for values of two dimensions"):
        planned("""
            steps:
              - prompt: {question: a?, name: x, unit: s}
              - prompt: {question: b?, name: x, unit: mm}
            """)


def test_a_wait_condition_on_an_answer_is_refused(planned: Callable[..., Plan]) -> None:
    with pytest.raises(RigctlError, match="does not change while a step waits"):
        planned("""
            steps:
              - prompt: {question: a?, name: x, unit: mm}
              - wait: {until: position > x, timeout: 1 s}
            """)
