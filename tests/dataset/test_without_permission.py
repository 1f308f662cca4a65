"""Unreadable folders among the runs on a shared disk."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from dataset.strokes import LAYOUT, STARTED, measure_strokes
from rigctl.dataset import RunHeader, RunWriter, Source
from systems import needs_posix

#: prints the id and status of each run in a folder; uses an index from the given number of runs
LIST = """
import json, sys
from pathlib import Path
from rigctl.dataset import list_runs
from rigctl.dataset.index import file
file.INDEX_FROM = int(sys.argv[2])
print(json.dumps([(run.id, run.status) for run in list_runs(Path(sys.argv[1]))]))
"""


def _without_privileges() -> list[str]:
    """The start of a command that drops privileges, since an administrator may read every folder."""
    return ["setpriv", "--inh-caps=-all", "--bounding-set=-all"] if os.geteuid() == 0 else []


@needs_posix("permissions of POSIX")
@pytest.mark.parametrize("index_from", [1, 1000], ids=["indexed", "not indexed"])
def test_an_unreadable_folder_does_not_hide_the_other_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, index_from: int
) -> None:
    """A run folder at the root of a disk has an unreadable 'lost+found', and no run used to be listed."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    runs = tmp_path / "runs"
    names = ["20261121-093000-stroke", "20261122-093000-stroke"]
    for name in names:
        writer = RunWriter.create(runs, RunHeader(name, Source("stroke"), Source("bench"), LAYOUT, STARTED))
        measure_strokes(writer, 1, 20)
        writer.close("finished")
    closed = [runs / names[0], runs / "lost+found"]
    closed[1].mkdir()
    command = [*_without_privileges(), sys.executable, "-c", LIST, str(runs), str(index_from)]
    try:
        for folder in closed:
            folder.chmod(0)
        done = subprocess.run(command, capture_output=True, text=True, timeout=300.0, check=False)
    finally:
        for folder in closed:
            folder.chmod(0o700)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == [[names[0], "damaged"], [names[1], "finished"]]
