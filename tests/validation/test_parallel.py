"""Work in several processes: none is left behind."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

PARENT = """
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from rigctl.tasks.pools import begin_worker

if __name__ == "__main__":
    pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=begin_worker)
    pool.submit(print, "working", flush=True).result()
    pool.submit(time.sleep, 600.0)
    time.sleep(600.0)
"""


def test_worker_processes_end_when_their_parent_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(PARENT, "utf-8")
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == "working\n"
        parent.kill()
        # the worker holds the pipe too: end of file means that both are gone
        assert parent.communicate(timeout=600)[0] == ""


def test_ctrl_c_ends_a_worker_at_once_and_silently() -> None:
    """In a process of its own, as the terminal sends the signal to every process."""
    code = (
        "import signal, time; from rigctl.tasks.pools import begin_worker; "
        "begin_worker(); signal.raise_signal(signal.SIGINT); time.sleep(600.0)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], check=False, capture_output=True, text=True, timeout=600
    )
    assert (done.returncode, done.stdout, done.stderr) == (1, "", "")
