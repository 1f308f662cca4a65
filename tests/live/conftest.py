"""The shipped campaign as a plan, and a rig to read."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.procedure import expand, load_procedure
from rigctl.procedure.plan import Plan
from rigctl.rig import Rig, load_rig

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def rig() -> Rig:
    return load_rig(ROOT / "rigs" / "hl32-bench.yaml")


@pytest.fixture(scope="session")
def plan(rig: Rig) -> Plan:
    return expand(load_procedure(ROOT / "procedures" / "campaign.yaml"), rig)


@pytest.fixture(scope="session")
def looping(rig: Rig, tmp_path_factory: pytest.TempPathFactory) -> Plan:
    """Three rounds of two waits, with something to do afterwards."""
    path = tmp_path_factory.mktemp("looping") / "looping.yaml"
    path.write_text(
        f"procedure: looping\nrig: {(ROOT / 'rigs' / 'hl32-bench.yaml').as_posix()}\nsteps:\n"
        "  - repeat: 3\n    do: [{wait: 1 s}, {wait: 2 s}]\n"
        "finally:\n  - wait: 4 s\n",
        encoding="utf-8",
        newline="\n",
    )
    return expand(load_procedure(path), rig)
