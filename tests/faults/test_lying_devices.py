"""A device that acknowledges 'off' and stays on: said at every ending, in virtual time."""

from __future__ import annotations

import json
import signal
from datetime import date
from pathlib import Path

import pytest

from bench_stand import Stand
from rigctl.live import view
from run_workshop import Workshop

HEATING = """\
steps:
  - set: {heater_1: 60 %}
  - wait: 4 s
  - set: {heater_1: 0 %}
  - wait: WAIT s
  - WHAT
"""
#: how the run ends -> its last step, s before it, and the signal at 6 s, if one comes
ENDINGS = {
    "finish": ("wait: 0.1 s", 0.1, None),
    "finish after a moment": ("wait: 0.1 s", 3.0, None),
    "fail": ("wait: {until: temperature_1 > 200 degC, timeout: 1 s}", 0.1, None),
    "abort": ("wait: 1 h", 0.1, signal.SIGINT),
    "terminate": ("wait: 1 h", 0.1, signal.SIGTERM),
}


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("lying", [True, False])
def test_an_off_that_is_not_carried_out_is_reported_at_every_ending(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str, lying: bool
) -> None:
    step, wait, number = ENDINGS[ending]
    stand = Stand("lines", Workshop(tmp_path), monkeypatch)

    def lie() -> None:
        assert stand.port is not None
        if lying:
            stand.port.sketch.always |= {"X": b"X\r\n", "Q1 0.00": b"0.00\r\n"}

    stand.clock.at(2.0, lie)
    if number is not None:
        stand.signal_at(6.0, number=number)
    done = stand.run(HEATING.replace("WAIT", f"{wait:g}").replace("WHAT", step))
    result = done.result
    assert stand.is_off() is not lying
    assert (result.unconfirmed == "heater_1 60 %") is lying
    kept = json.loads((Path(str(result.folder)) / "run.json").read_text(encoding="utf-8"))
    assert kept["unconfirmed"] == result.unconfirmed
    if lying:
        assert result.exit_code == 1
        assert "OUTPUTS NOT CONFIRMED SAFE: heater_1 60 % may still be on" in str(result.reason)
        assert result.status != "finished"


def test_an_output_that_nothing_confirms_is_reported_if_it_was_driven(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its commands are not answered, and no query reads its state."""
    stand = Stand("lines", Workshop(tmp_path), monkeypatch)
    rig = stand.rig(
        ('heater_2: {send: "Q2 {value:.2f}", reply: "{value}"}', 'heater_2: {send: "Q2 {value:.2f}"}'),
        ('      - {send: R2, reply: "{heater_2}", every: 1 s}\n', ""),
    )

    def silent() -> None:
        assert stand.port is not None
        stand.port.sketch.always |= {"Q2 0.00": b""}

    stand.clock.at(0.5, silent)
    steps = "steps:\n  - set: {HEATER: 40 %}\n  - wait: 3 s\n  - set: {HEATER: 0 %}\n  - wait: 2 s\n"
    done = stand.run(steps.replace("HEATER", "heater_2"), rig)
    assert (done.result.exit_code, done.result.unconfirmed) == (1, "heater_2 40 %")
    stand = Stand("lines", Workshop(tmp_path / "again"), monkeypatch)
    done = stand.run(steps.replace("HEATER", "heater_1"), rig)
    assert (done.result.exit_code, done.result.unconfirmed) == (0, None), "it was never on"


def test_an_output_that_is_on_in_the_safe_state_and_that_nothing_confirms_is_warned_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A fan that the run never drives, or only to its safe value."""
    stand = Stand("lines", Workshop(tmp_path), monkeypatch)
    rig = stand.rig(
        ('heater_2: {send: "Q2 {value:.2f}", reply: "{value}"}', 'heater_2: {send: "Q2 {value:.2f}"}'),
        ('      - {send: R2, reply: "{heater_2}", every: 1 s}\n', ""),
        ("safe_state: {heater_1: 0 %, heater_2: 0 %}", "safe_state: {heater_1: 0 %, heater_2: 30 %}"),
    )

    def silent() -> None:
        assert stand.port is not None
        stand.port.sketch.always |= {"Q2 30.00": b"", "Q2 0.00": b""}

    stand.clock.at(0.0, silent)
    steps = "steps:\n  - set: {heater_2: 30 %}\n  - wait: 2 s\n"
    with view(stand.workshop.plan(steps, rig)) as display:
        done = stand.run(steps, rig, observer=display)
    assert (done.result.exit_code, done.result.unconfirmed) == (0, None)
    (warning,) = done.result.warnings
    assert warning.message == "nothing confirms the safe state of these outputs: heater_2 30 %; check them"
    assert warning.message in done.messages("note")
    assert capsys.readouterr().err.count(warning.message) == 1
    assert any(
        "to a value that is not safe ends as failed" in text for text in rig.warnings(date(2026, 10, 1))
    )
    stand = Stand("lines", Workshop(tmp_path / "driven"), monkeypatch)
    stand.clock.at(0.0, silent)
    done = stand.run("steps:\n  - set: {heater_2: 0 %}\n  - wait: 2 s\n", rig)
    assert (done.result.exit_code, done.result.unconfirmed) == (1, "heater_2 0 %")
    assert done.result.warnings == ()
