from __future__ import annotations

from pathlib import Path

from torture.corruptions import torture


def test_random_damage_costs_its_own_frames_alone_and_is_never_silent(tmp_path: Path) -> None:
    tally = torture(tmp_path, 60, seed=1)
    assert tally.lost_outside == 0
    assert tally.lost_rows > 0
    assert tally.conditions["recovered"] > 30
