"""Suggested rows: intermediate points, more values of a variable, and repeats."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from rigctl.analysis.single_values.next_values import next_rows
from rigctl.answers.findings.tables import next_steps
from rigctl.model.measured.record import Measurements
from rigctl.noise import ChannelNoise


def before(conditions: Sequence[dict[str, float]], guessed: bool = False) -> Any:
    records: Any = tuple(SimpleNamespace(condition=one, values=np.zeros((1, 1))) for one in conditions)
    measurements = Measurements(("stroke",), ("mm",), (), records, None, ("r",), columns={"load": "N"})
    noise = SimpleNamespace(channels=(ChannelNoise("stroke", 1e-3, guessed=guessed),))
    return SimpleNamespace(
        fit=SimpleNamespace(problem=SimpleNamespace(measurements=measurements, noise=noise))
    )


def test_constant_and_two_valued_variables_need_more_values() -> None:
    conditions = [{"oil": 293.15, "load": load} for load in (10.0, 10.0, 40.0)]
    assert next_steps(next_rows(before(conditions))) == [
        "vary oil: every row is at 20 degC",
        "take more values of load than 10 N and 40 N: any curve passes through two",
    ]


def test_no_rows_are_suggested_for_a_variable_with_three_values() -> None:
    assert next_rows(before([{"load": load} for load in (10.0, 20.0, 40.0)])) == []


def test_guessed_noise_requires_repeats() -> None:
    conditions = [{"load": load} for load in (10.0, 20.0, 40.0)]
    (said,) = next_steps(next_rows(before(conditions, guessed=True)))
    assert said == "repeat each condition three times: so far the noise is only guessed"
