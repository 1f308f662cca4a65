"""A preview in a terminal and as JSON."""

from __future__ import annotations

import json
from collections.abc import Callable
from io import StringIO

import pytest
from rich.console import Console

from rigctl.planning import Preview
from rigctl.planning.document import as_document
from rigctl.planning.outline import clock_time, outline, printable
from rigctl.rig import Rig

See = Callable[..., Preview]

SWEEP = """
    steps:
      - for: {oil: [20 degC, 30 degC, 40 degC, 84 degC]}
        do:
          - heat: {to: $oil, within: 2 K}
          - record: {name: r, rate: 10 Hz}
            do: [wait: 2 s]
        on_failure: [wait: 1 s]
    """


def printed(preview: Preview, *, everything: bool = False) -> str:
    stream = StringIO()
    console = Console(file=stream, width=200)
    for part in outline(preview, ["a calibration ran out"], everything=everything):
        console.print(part)
    return stream.getvalue()


def test_long_sweeps_show_their_first_point(previewed: See) -> None:
    text = printed(previewed(SWEEP))
    assert text.startswith("test on HL32 bench\n4 records, 80 samples, about ")
    start = "oil_temperature 20 degC, supply_pressure 20 bar, position 0 mm"
    assert f"expected to start at {start} (simulation.initial of the rig file)" in text
    assert text.count("record 'r' at 10 Hz") == 1
    assert "3 more: oil=30 degC, oil=40 degC, oil=84 degC" in text
    assert "on_failure (only then)" in text
    assert "limit oil_hot touched: oil_temperature is expected up to 86 degC, warn above 85 degC" in text
    assert text.endswith("warning: a calibration ran out\n")


def test_all_points_of_a_sweep_can_be_shown(previewed: See) -> None:
    text = printed(previewed(SWEEP), everything=True)
    assert text.count("record 'r' at 10 Hz") == 4
    assert "more:" not in text


def test_many_points_are_named_by_the_first_and_the_last(previewed: See) -> None:
    text = printed(previewed("steps:\n  - for: {a: {from: 1 s, to: 99 s, step: 1 s}}\n    do: [wait: $a]"))
    assert "98 more: a=2 s … a=99 s  1 h 22 min" in text


def test_the_heading_states_the_basis_of_the_duration(previewed: See, serial_rig: Rig) -> None:
    assert "(every step is timed)" in printed(previewed("steps: [wait: 1 s]"))
    assert "people are assumed" in printed(previewed("steps: [prompt: Ready?]", on=serial_rig))
    text = printed(previewed("steps: [{while: valve == 0, do: [wait: 1 s]}]"))
    assert "0 records or more" in text
    assert "one round shown" in text


def test_user_text_cannot_send_control_sequences_to_the_terminal(previewed: See) -> None:
    seen = previewed('steps:\n  - prompt: "clear \\e[2J and [red]mark[/red] \\u009b2J"')
    text = printed(seen)
    assert "\x1b" not in text
    assert "\x9b" not in text
    assert "[red]mark[/red]" in text
    assert printable("a\tb") == "a\N{REPLACEMENT CHARACTER}b"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "0 s"),
        (3.75, "3.75 s"),
        (59.94, "59.9 s"),
        (59.96, "1 min"),
        (521.0, "8 min 41 s"),
        (599.6, "10 min"),
        (3059.0, "51 min"),
        (3569.0, "59 min"),
        (3571.0, "1 h"),
        (5100.0, "1 h 25 min"),
        (360000.0, "100 h"),
    ],
)
def test_durations_are_printed_in_suitable_units(seconds: float, text: str) -> None:
    assert clock_time(seconds) == text


def test_the_json_document_has_records_start_sweeps_limits_and_steps(previewed: See) -> None:
    document = json.loads(json.dumps(as_document(previewed(SWEEP), ["old"]), allow_nan=False))
    assert (document["procedure"], document["records"], document["samples"]) == ("test", 4, 80)
    assert document["start"] == {"oil_temperature": 20.0, "supply_pressure": 20.0, "position": 0.0}
    assert document["duration_basis"] == "estimated"
    assert document["sweeps"] == [{"path": "1/for", "variables": ["oil"], "points": 4}]
    (hot,) = [limit for limit in document["limits"] if limit["name"] == "oil_hot"]
    assert hot == {
        "name": "oil_hot", "channel": "oil_temperature", "action": "warn", "above": 85.0, "closest": 86.0,
        "unit": "degC", "state": "touched",
    }  # fmt: skip
    assert document["warnings"][-1]["message"] == "old"
    point = document["steps"][0]["steps"][0]["steps"][1]
    assert point["values"] == {"oil": "30 degC"}
    assert point["steps"][0]["where"] == "test.yaml:6:9"
    failure = document["steps"][0]["steps"][0]["steps"][-1]
    assert failure["only_if_needed"] is True


def test_a_plan_that_asks_shows_how_long_it_waits_for_nobody(previewed: See, rig: Rig) -> None:
    asks = "steps:\n  - if: position > 0 mm\n    do: [prompt: Ready?]\n"
    waits_only = (
        "steps:\n  - set_pressure: {to: 30 bar, within: 1 bar}\n"  # an operator's request with a timeout
    )
    assert as_document(previewed(asks))["unattended_for"] == 600.0
    assert "asks the operator; with outputs on and nobody there it ends after 10 min\n" in printed(
        previewed(asks)
    )
    assert as_document(previewed(waits_only))["unattended_for"] is None
    assert "nobody" not in printed(previewed(waits_only))
    soon = rig.model_copy(update={"unattended_for": 45.0})
    assert "nobody there it ends after 45 s\n" in printed(previewed(asks, soon))
