"""Plans to show, and a rig to read."""

from __future__ import annotations

import pytest

from live.shipped import RIG_FILE, bench, campaign
from rigctl.plan import Plan
from rigctl.procedure import expand, load_procedure
from rigctl.rig import Rig


@pytest.fixture
def rig() -> Rig:
    return bench()


@pytest.fixture
def plan() -> Plan:
    return campaign()


@pytest.fixture(scope="session")
def looping(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    """Three rounds of two waits, with something to do afterwards."""
    path = tmp_path_factory.mktemp("looping") / "looping.yaml"
    path.write_text(
        f"procedure: looping\nrig: {RIG_FILE.as_posix()}\nsteps:\n"
        "  - repeat: 3\n    do: [{wait: 1 s}, {wait: 2 s}]\n"
        "finally:\n  - wait: 4 s\n",
        encoding="utf-8",
        newline="\n",
    )
    return expand(load_procedure(path), bench())
