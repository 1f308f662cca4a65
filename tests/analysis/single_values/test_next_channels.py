"""Suggested channels: those in which rivals differ by far more than the noise, and no others."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rigctl.analysis.agreement.trends import Trend
from rigctl.analysis.single_values import next_values as module
from rigctl.analysis.single_values.next_values import next_channels
from rigctl.answers.findings.tables import next_steps

TREND = Trend("stroke", "oil", 293.15, 353.15, 0.1, 0.0, 9.0, "degC")
CHANNELS = {"position": ("mm", 1e-4), "pressure_a": ("bar", 1e4)}


def before(*, standard: bool = True) -> Any:
    """A bench with both channels, and a table of the position only."""
    family = SimpleNamespace(
        standard_record=object() if standard else None,
        outputs=tuple(SimpleNamespace(name=name, unit=unit) for name, (unit, _) in CHANNELS.items()),
    )
    channels = {
        name: SimpleNamespace(unit=unit, noise_level=noise) for name, (unit, noise) in CHANNELS.items()
    }
    problem = SimpleNamespace(
        model=SimpleNamespace(family=family),
        measurements=SimpleNamespace(outputs=("position",), rig=SimpleNamespace(channels=channels)),
        compiled=SimpleNamespace(system=SimpleNamespace(output_names=tuple(CHANNELS), state_names=())),
    )
    return SimpleNamespace(fit=SimpleNamespace(problem=problem))


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch):
    """The sentences, given each rival's largest change of position (m) and pressure (Pa)."""

    def sentences(**changes: tuple[float, float]) -> list[str]:
        here = before()
        fits = {name: SimpleNamespace(problem=here.fit.problem, change=one) for name, one in changes.items()}
        course = np.linspace(0.0, 1.0, 5)[:, None]
        monkeypatch.setattr(
            module, "_changes", lambda fit, trend, channels: np.array([course * np.array(fit.change)])
        )
        return next_steps(next_channels(here, TREND, cast("Any", fits)))

    return sentences


def test_a_channel_in_which_all_rivals_differ_separates_them_all(said: Any) -> None:
    (text,) = said(leak=(1e-3, 1e5), friction=(1e-3, 6e5), air=(1e-3, -4e5))
    assert text == "record pressure_a over time: it distinguishes all of them, by up to 10 bar"


def test_a_channel_may_separate_one_rival_from_two_inseparable_ones(said: Any) -> None:
    text, never = said(leak=(1e-3, 1e5), friction=(1e-3, 1.5e5), air=(5e-3, 1e5))
    assert text == (
        "record position over time instead of one number: it distinguishes air from the others, by up to 4 mm"
    )
    assert never == (
        "measure the stroke a second time, independently of the bench's sensor: leak and friction cannot "
        "be distinguished by any channel of the bench"
    )


def test_each_channel_may_separate_a_different_pair(said: Any) -> None:
    found = said(leak=(1e-3, 1e5), friction=(1e-3, 9e5), air=(5e-3, 1e5))
    assert [text.partition(" over")[0] for text in found] == ["record position", "record pressure_a"]
    assert "distinguishes air from the others" in found[0]
    assert "distinguishes friction from the others" in found[1]


def test_differences_below_ten_times_the_noise_do_not_separate(said: Any) -> None:
    (never,) = said(leak=(1e-3, 1e5), friction=(1.9e-3, 1.9e5))
    assert never.endswith("leak and friction cannot be distinguished by any channel of the bench")


def test_no_channel_is_suggested_without_rivals_a_trend_or_a_standard_record() -> None:
    two = cast("Any", {"leak": None, "friction": None})
    assert next_channels(before(), TREND, cast("Any", {"leak": None})) == []
    assert next_channels(before(), None, two) == []
    assert next_channels(before(standard=False), TREND, two) == []
