"""Compiled systems for the engine's tests."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from engine_systems import lag_builder
from rigctl.engine.compile import CompiledSystem, compile_system


@pytest.fixture(scope="session")
def cylinder() -> ModuleType:
    """The benchmark's model: `build()` and `campaign()`."""
    path = Path(__file__).parents[2] / "benchmarks" / "engine" / "cylinder.py"
    specification = importlib.util.spec_from_file_location("benchmark_cylinder", path)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def cylinder_compiled(cylinder: ModuleType) -> CompiledSystem:
    return compile_system(cylinder.build())


@pytest.fixture(scope="session")
def lag() -> CompiledSystem:
    return compile_system(lag_builder()[0].build())
