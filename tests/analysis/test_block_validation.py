"""Readings left out of a fit: blocks of time, and the second half of a record."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.analysis import improve as improving
from rigctl.analysis.block_validation import BlockValidation, leave_blocks_out
from rigctl.analysis.comparison import compare
from rigctl.analysis.comparison_result import Comparison
from rigctl.analysis.diagnosis import diagnose_comparison
from rigctl.analysis.improve import ImprovementEnd, improve
from rigctl.dataset import open_run
from rigctl.dataset.importing.bring_in import import_file
from rigctl.model.load import load_model
from rigctl.rig.load import load_rig
from swing import project, white


def compared(folder: Path, stated: str = "") -> Comparison:
    project(folder, white, cubic=0.6, stated=stated)
    imported = import_file(folder / "log.csv", load_rig(folder / "rigs/swing.yaml"), folder / "runs")
    return compare([open_run(imported.path)], [load_model(folder / "models/swing.yaml")])


def test_the_right_effect_predicts_the_second_half_from_the_first(tmp_path: Path) -> None:
    both = compared(tmp_path)
    found = diagnose_comparison(both.models[0], both.runs, both.held_out, both.notes)
    blocks = leave_blocks_out(found.before.fit, found.best.fit, ahead=True)
    assert blocks is not None and blocks.ahead is not None
    assert len(blocks.before) == 3
    assert blocks.ahead[1] < 0.2 * blocks.ahead[0]
    assert blocks.falls
    worse = leave_blocks_out(found.best.fit, found.before.fit, ahead=True)
    assert worse is not None and not worse.falls
    near = leave_blocks_out(found.before.fit, found.best.fit)
    assert near is not None and near.ahead is None


def test_a_single_record_whose_noise_is_known_is_tested_outside_the_fit_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No condition of it can be left out, and effects were added that made other records worse."""
    both = compared(tmp_path, stated="5 mm")
    assert not any(one.own_scale for one in both.models[0].fit.problem.noise.channels)
    worse_ahead = BlockValidation((4.0, 4.0, 4.0), (1.0, 1.0, 1.0), (4.0, 20.0))
    monkeypatch.setattr(improving, "leave_blocks_out", lambda *_, **__: worse_ahead)
    model = tmp_path / "models/swing.yaml"
    found = improve(both, model)
    assert found.ended is ImprovementEnd.NOT_PREDICTED
    assert "blocks of time left out of the fit" in found.statement
    assert not load_model(model).effects
