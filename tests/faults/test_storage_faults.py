"""A runs folder deleted during a real-time run is reported at once, and samples are kept elsewhere."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

from rigctl.dataset import open_run, verify
from systems import needs_posix, own_state


@needs_posix("open files that can be deleted")
def test_a_runs_folder_that_is_deleted_ends_the_run_and_names_where_the_samples_are(tmp_path: Path) -> None:
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    text = (
        "procedure: p\nrig: rigs/heater-board.yaml\nsteps:\n  - set: {heater_1: 60 %}\n"
        "  - record: {name: r, rate: 100 Hz}\n    do: [wait: 1 h]\n"
    )
    (tmp_path / "p.yaml").write_text(text, encoding="utf-8")
    home = str(tmp_path / "home")
    with subprocess.Popen(
        [sys.executable, "-m", "rigctl", "simulate", "p.yaml", "--speed", "1x", "--json"],
        cwd=tmp_path,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **own_state(tmp_path / "home")},
    ) as run:
        try:
            journals = (tmp_path / "runs").glob
            while not any(path.stat().st_size > 20_000 for path in journals("2*/samples.journal")):  # some s
                time.sleep(0.02)
                assert run.poll() is None, run.communicate()
            (tmp_path / "runs").rename(tmp_path / "gone")  # in one step: the run writes files all the time
            shutil.rmtree(tmp_path / "gone", ignore_errors=True)
            out, err = run.communicate(timeout=600)
        finally:
            run.kill()
    answer = json.loads(out)
    assert (answer["exit_code"], answer["status"], answer["unconfirmed"]) == (1, "failed", None), err
    assert "the run's folder is gone; samples are kept in" in answer["reason"]
    kept = Path(answer["path"])
    assert home in str(kept)
    assert verify(kept).good
    samples = open_run(kept).samples(record=0)
    assert float(samples["time"].iloc[-1] - samples["time"].iloc[0]) > 0.5
