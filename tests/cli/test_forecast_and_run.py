"""The duration forecast by `check` agrees with that of `simulate`."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from rigctl.cli.main import main


def call(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str
) -> dict[str, float]:
    """The JSON document that a command prints."""
    monkeypatch.setattr(sys, "argv", ["rigctl", *arguments, "--json"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code in (0, None)
    document: dict[str, float] = json.loads(capsys.readouterr().out)
    return document


@pytest.mark.parametrize(
    ("procedure", "arguments", "tolerance"),
    [
        ("quick-check", [], 0.05),
        ("viscometer", [], 0.05),
        ("calibrate-pressure", [], 0.05),
        ("calibrate-thermocouple", ["--arg", "points=25 degC, 60 degC"], 0.01),
        ("heater-board-steps", ["--arg", "dwell=2 min"], 0.01),
        ("campaign", ["--arg", "temperatures=20 degC, 30 degC, 50 degC"], 0.01),
    ],
)
def test_check_forecasts_the_records_and_the_duration_of_simulate(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    procedure: str,
    arguments: list[str],
    tolerance: float,
) -> None:
    monkeypatch.chdir(tmp_path)
    path = f"procedures/{procedure}.yaml"
    expected = call(monkeypatch, capsys, "check", path, *arguments)
    found = call(monkeypatch, capsys, "simulate", path, *arguments)
    assert found["records"] == expected["records"]
    assert found["duration"] == pytest.approx(expected["duration"], rel=tolerance)
