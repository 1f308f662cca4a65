"""What every test shares: a state folder of its own, and no guard of a device left behind."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import settings

# The examples of `make test` are the same each time and have no deadline; `make explore` looks for new ones,
# and what it finds becomes an `@example`.
settings.register_profile("suite", derandomize=True, deadline=None)
settings.register_profile("explore", max_examples=2_000, deadline=None)
settings.load_profile("suite")


@pytest.fixture(scope="session", autouse=True)
def state_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Locks and notices of guards lie here; a guard whose notice is taken away ends."""
    folder = tmp_path_factory.mktemp("state")
    before = os.environ.get("XDG_STATE_HOME")
    os.environ["XDG_STATE_HOME"] = str(folder)
    yield folder
    end_guards(folder)
    wait_for_guards()
    if before is None:
        del os.environ["XDG_STATE_HOME"]
    else:
        os.environ["XDG_STATE_HOME"] = before


def end_guards(folder: Path) -> None:
    """Take away the notices of guards that still try to reach a board that a test has closed."""
    for _ in range(20):  # one that gives way may have to be told twice
        for notice in (folder / "rigctl" / "guards").glob("*.json"):
            with suppress(OSError):
                notice.unlink()
        time.sleep(0.01)


def wait_for_guards() -> None:
    """Let no guard that a test in this process has left to itself outlive the tests."""
    guard_port = sys.modules.get("rigctl.backends.lines.guard_port")
    for process in guard_port._GOING_ON if guard_port else ():
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:  # its notice lies elsewhere
            process.kill()
            process.wait()
