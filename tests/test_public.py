"""`import rigctl` is light, and what it offers is found."""

from __future__ import annotations

import inspect
import subprocess
import sys
from importlib import import_module

import pytest

import rigctl
import rigctl.dataset

HEAVY = ("numpy", "pandas", "pyarrow", "duckdb", "pint", "pydantic", "numba", "scipy", "plotly")


def test_importing_it_imports_nothing_heavy() -> None:
    program = f"import rigctl, sys; print([name for name in {HEAVY} if name in sys.modules])"
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "[]"


def test_its_names_are_those_of_the_packages() -> None:
    assert rigctl.open_run is rigctl.dataset.open_run
    assert set(rigctl.__all__) <= set(dir(rigctl))


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="open_rum"):
        _ = rigctl.open_rum


@pytest.mark.parametrize("name", ["compare", "diagnose"])
def test_a_package_of_the_same_name_is_called_like_its_function(name: str) -> None:
    before = getattr(rigctl, name)
    function = getattr(import_module(f"rigctl.{name}.{name}"), name)
    assert getattr(rigctl, name) is before  # importing the package did not replace it
    assert inspect.signature(before) == inspect.signature(function)
    with pytest.raises(TypeError, match="missing"):
        before()
