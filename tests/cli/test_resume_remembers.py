"""`rigctl resume` restores port, speed, seed and the hidden effects of a simulated bench."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rigctl.cli.commands.resume import _speed_before
from rigctl.cli.main import app
from rigctl.dataset.run_json import read_info

STEPS = """\
procedure: p
rig: rigs/heater-board.yaml
steps:
  - record: {name: first, rate: 2 Hz}
    do: [wait: 1 s]
  - record: {name: second, rate: 2 Hz}
    do: [wait: {until: temperature_1 > 90 degC, timeout: 1 s}]
"""


def told(*arguments: str) -> dict[str, Any]:
    done = CliRunner().invoke(app, [*arguments, "--json"])
    assert done.stdout, done.exception
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def test_a_resumed_simulation_keeps_its_bench_seed_and_speed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    (tmp_path / "p.yaml").write_text(STEPS, encoding="utf-8")
    began = told("simulate", "p.yaml", "--with", "radiation:area=40 cm^2", "--seed", "7", "--speed", "50x")
    assert (began["status"], began["records"]) == ("failed", 1), began
    before = read_info(Path(began["path"]))
    again = told("resume", "latest")
    assert (again["status"], again["records"]) == ("failed", 1), again
    after = read_info(Path(began["path"]))
    first, second = after["sessions"]
    assert first["backend"] == second["backend"] == before["backend"]
    assert "radiation" in second["backend"]["plant"]
    assert (first["seed"], second["seed"], first["clock"], second["clock"]) == (7, 7, "50x", "50x")


@pytest.mark.parametrize(("clock", "speed"), [("virtual", "max"), ("real", "1x"), ("10x", "10x")])
def test_the_speed_of_a_run_follows_from_its_recorded_clock(clock: str, speed: str) -> None:
    assert _speed_before(clock) == speed
