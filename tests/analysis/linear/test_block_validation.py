"""Readings left out of a fit: blocks of time, and the second half of a record."""

from __future__ import annotations

import pytest

from rigctl.analysis import improve as improving
from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.analysis.improve import NotImproved, refusal
from rigctl.analysis.linear.block_validation import BlockValidation, leave_blocks_out
from rigctl.noise.noise_model import ChannelNoise

#: the tests leave the same blocks out of the same fits
pytestmark = pytest.mark.usefixtures("shared_results")


def test_the_right_effect_predicts_the_second_half_from_the_first(cubic_swing: Diagnosis) -> None:
    found = cubic_swing
    blocks = leave_blocks_out(found.before.fit, found.best.fit, ahead=True)
    assert blocks is not None and blocks.ahead is not None
    assert len(blocks.before) == 3
    assert blocks.ahead[1] < 0.2 * blocks.ahead[0]
    assert blocks.falls
    worse = leave_blocks_out(found.best.fit, found.before.fit, ahead=True)
    assert worse is not None and not worse.falls
    near = leave_blocks_out(found.before.fit, found.best.fit)
    assert near is not None and near.ahead is None


@pytest.mark.parametrize("own", [True, False], ids=["only its floor known", "noise known"])
def test_a_single_record_is_tested_outside_the_fit_whatever_is_known_of_its_noise(
    cubic_swing: Diagnosis, monkeypatch: pytest.MonkeyPatch, own: bool
) -> None:
    """No condition of it can be left out, and effects were added that made other records worse."""
    found = cubic_swing
    effects = found.best.effects
    monkeypatch.setattr(ChannelNoise, "own_scale", own)
    assert refusal(found, found.best, effects) is None
    worse_ahead = BlockValidation((4.0, 4.0, 4.0), (1.0, 1.0, 1.0), (4.0, 20.0))
    monkeypatch.setattr(improving, "leave_blocks_out", lambda *_, **__: worse_ahead)
    refused = refusal(found, found.best, effects)
    assert refused == NotImproved(tuple(effects), "blocks")
