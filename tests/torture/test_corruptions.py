from __future__ import annotations

from pathlib import Path

from rigctl.dataset import verify
from torture.corruptions import make_unclosed, rows_by_byte, torture


def test_random_damage_loses_only_the_damaged_frames_and_is_always_reported(tmp_path: Path) -> None:
    tally = torture(tmp_path, 60, seed=1)
    assert tally.lost_outside == 0
    assert tally.lost_rows > 0
    assert tally.conditions["recovered"] > 30


def test_a_journal_truncated_between_frames_is_detected_by_the_log_and_kept(tmp_path: Path) -> None:
    run = make_unclosed(tmp_path)
    path = run / "samples.journal"
    begin, _, rows = rows_by_byte(path.read_bytes())[-1]
    left = path.read_bytes()[:begin]
    path.write_bytes(left)
    (told,) = [problem for problem in verify(run).problems if "lost" in problem]
    assert f"{len(rows)} samples" in told
    (kept,) = run.glob("samples.journal.damaged-*")
    assert kept.read_bytes() == left
    assert verify(run).good
