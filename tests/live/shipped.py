"""The shipped campaign as a plan; handed out by a function, for its text is too long for a test's report."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from rigctl.plan import Plan
from rigctl.procedure import expand, load_procedure
from rigctl.rig import Rig, load_rig

ROOT = Path(__file__).parents[2]
RIG_FILE = ROOT / "rigs" / "hl32-bench.yaml"


@cache
def bench() -> Rig:
    return load_rig(RIG_FILE)


@cache
def campaign() -> Plan:
    return expand(load_procedure(ROOT / "procedures" / "campaign.yaml"), bench())
