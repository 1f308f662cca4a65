"""Runs to test with: the public bench of `rigctl.testing`, without physics, under the names of the tests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rigctl.files.shipped import shipped
from rigctl.testing import RunLog as Done
from rigctl.testing import ScriptedControl, VirtualBench

RIG = shipped("rigs", "hl32-bench.yaml")


@dataclass
class Workshop(VirtualBench):
    """A bench whose roles do what they say, exactly and at once."""

    options: Mapping[str, object] = field(
        default_factory=lambda: {"plant": "roles", "noise": "off", "quantised": "off"}
    )


__all__ = ["RIG", "Done", "ScriptedControl", "Workshop"]
