"""A journal that something else damages during a run: reported at its end, and not with exit code 0."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from bench_stand import Stand
from rigctl.dataset.recording import writer
from rigctl.dataset.recording.journal import JournalWriter
from run_workshop import Workshop
from systems import needs_posix

STEPS = "steps:\n  - record: {name: stroke, rate: 100 Hz}\n    do:\n      - wait: 6 s\n  - wait: 2 s\n"


@needs_posix("open files that another program can truncate")
@pytest.mark.parametrize(
    ("moment", "told"),
    [(3.0, "samples, of record 0 are lost"), (7.9, "5 samples are lost")],
)
def test_a_truncated_journal_is_reported_and_fails_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: float, told: str
) -> None:
    stand = Stand("simulated", Workshop(tmp_path), monkeypatch)
    monkeypatch.setattr(writer, "monotonic", stand.clock.now)

    def truncate() -> None:
        (journal,) = tmp_path.rglob("samples.journal")
        os.truncate(journal, journal.stat().st_size - 100 if moment > 7.0 else 100)

    stand.clock.at(moment, truncate)
    result = stand.run(STEPS).result
    assert (result.status, result.exit_code) == ("finished", 1)
    assert told in str(result.reason)
    info = json.loads((Path(str(result.folder)) / "run.json").read_text(encoding="utf-8"))
    assert info["reason"] == result.reason
    assert info["lost_rows"] > 0


@needs_posix("open files that another program can truncate")
def test_a_journal_that_is_truncated_after_its_last_sample_is_noticed(tmp_path: Path) -> None:
    written = JournalWriter(tmp_path / "samples.journal", ["time", "record"], {})
    written.append((0.0, -1.0))
    written.flush()
    assert not written.shortened
    os.truncate(written.path, written.path.stat().st_size - 1)
    assert written.shortened
    written.close()


def test_an_undamaged_run_has_no_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    result = Stand("simulated", Workshop(tmp_path), monkeypatch).run(STEPS).result
    assert (result.status, result.exit_code, result.reason) == ("finished", 0, None)
