"""The benches that must fulfil the contract."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from backends.contract.subjects import REAL, Subject, driven, served, unreal
from rigctl.clock import real_clock
from systems import needs_simavr


@pytest.fixture(params=["simulated", pytest.param("emulated", marks=needs_simavr), *REAL, "python"])
def subject(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Subject]:
    """Each kind of bench."""
    if request.param == "simulated":
        yield unreal("simulated", "hl32-bench")
    elif request.param == "emulated":
        yield unreal("emulated", "hl32-bench-uno")
    elif request.param == "python":
        yield from driven(tmp_path, real_clock())
    else:
        yield from served(request.param, real_clock())


@pytest.fixture(params=REAL)
def device(request: pytest.FixtureRequest) -> Iterator[Subject]:
    """Each kind of bench with a device on a port."""
    yield from served(request.param, real_clock())
