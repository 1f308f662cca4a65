"""Previews of procedures written in the test."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from textwrap import dedent

import pytest

from rigctl.planning import Preview, preview
from rigctl.procedure import expand, parse_procedure
from rigctl.rig import Rig, load_rig, parse_rig

RIG = Path(__file__).parents[2] / "rigs" / "hl32-bench.yaml"


@pytest.fixture(scope="session")
def rig() -> Rig:
    return load_rig(RIG)


@pytest.fixture(scope="session")
def serial_rig() -> Rig:
    """The same bench behind a port, with a real operator."""
    text = RIG.read_text(encoding="utf-8")
    return parse_rig(text.replace("kind: simulated", "kind: serial", 1), RIG)


@pytest.fixture
def previewed(rig: Rig) -> Callable[..., Preview]:
    """Preview the text of a procedure without its name; keywords are arguments."""

    def see(text: str, on: Rig | None = None, **arguments: str) -> Preview:
        procedure = parse_procedure(f"procedure: test\n{dedent(text)}", Path("test.yaml"))
        return preview(expand(procedure, on or rig, arguments))

    return see
