"""A test bench: the shipped rig file on the simple plant, where every number has a closed form."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from rigctl.backends.registry import create_backend
from rigctl.backends.simulated.bench import SimulatedBench
from rigctl.clock import Clock, VirtualClock
from rigctl.rig import Rig, load_rig

RIG = Path(__file__).parents[2] / "rigs" / "hl32-bench.yaml"


@pytest.fixture(scope="session")
def rig() -> Rig:
    return load_rig(RIG)


@pytest.fixture
def make_bench(rig: Rig) -> Callable[..., SimulatedBench]:
    """An open bench; keyword arguments are the backend's options."""

    def make(clock: Clock | None = None, *, on: Rig = rig, **options: object) -> SimulatedBench:
        chosen = {"plant": "roles", "noise": "off", "quantised": "off", **options}
        bench = create_backend(on, "simulated", clock or VirtualClock(), chosen)
        assert isinstance(bench, SimulatedBench)
        bench.open()
        return bench

    return make
