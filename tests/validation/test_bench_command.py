"""The command that makes the shipped example, and its option to hide effects."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from rigctl.files.shipped import shipped
from rigctl_validation.bench.__main__ import main
from rigctl_validation.bench.recipes import RECIPES, with_hidden


def test_the_command_reproduces_the_shipped_example(tmp_path: Path) -> None:
    path = tmp_path / "again.csv"
    assert main(["unknown-bench", "-o", str(path)]) == 0
    made, kept = pd.read_csv(path), pd.read_csv(shipped("data", "unknown-bench.csv"))
    pd.testing.assert_frame_equal(made, kept, rtol=1e-4, atol=1e-5)


def test_parameters_of_bench_sensors_and_valve_can_be_hidden() -> None:
    made = with_hidden(RECIPES["textbook"], {"rod_leak": 1e-15, "position_gain": 1e-3, "open_delay": 0.02})
    assert made.bench.rod_leak == 1e-15
    assert made.sensors.position_gain == 1e-3
    assert made.switching.open_delay == 0.02
    assert RECIPES["textbook"].bench.rod_leak == 0.0


@pytest.mark.parametrize("written", ["rod_leek=1e-15", "rod_leak", "rod_leak=much"])
def test_invalid_hidden_parameters_are_refused_with_the_valid_names(
    written: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["textbook", "--hide", written])
    assert "rod_leak" in capsys.readouterr().err
