"""`import rigctl` is light, and what it offers is found."""

from __future__ import annotations

import subprocess
import sys

import pytest

import rigctl
import rigctl.dataset

HEAVY = ("numpy", "pandas", "pyarrow", "duckdb", "pint", "pydantic", "numba", "scipy", "sympy", "plotly")


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
