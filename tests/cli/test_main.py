"""The command line as a whole: quick to answer, and one clear message for every mistake."""

from __future__ import annotations

import subprocess
import sys

import pytest
from typer.testing import CliRunner

from rigctl.cli.catalogue import ENTRIES
from rigctl.cli.main import app, load_command

HEAVY = ("numpy", "pandas", "pyarrow", "duckdb", "pint", "numba", "scipy", "plotly", "matplotlib", "pydantic",
         "ruamel", "statemachine", "sympy", "jinja2")  # fmt: skip


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys\n"
        "sys.argv = ['rigctl', '--help']\n"
        "from rigctl.cli.main import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        f"heavy = sorted({set(HEAVY)!r} & set(sys.modules))\n"
        "sys.exit(f'imported: {heavy}' if heavy else 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "simulate" in done.stdout


@pytest.mark.parametrize("name", [entry.name for entry in ENTRIES])
def test_every_command_loads_and_its_help_shows_an_example(name: str) -> None:
    command = load_command(name)
    assert command.name == name
    for words in [[name, nested] for nested in getattr(command, "commands", {})] or [[name]]:
        shown = CliRunner().invoke(app, [*words, "--help"])
        assert shown.exit_code == 0
        assert "Example" in shown.output
        assert f"rigctl {' '.join(words)}" in shown.output.replace("Usage: rigctl", "")


def test_a_misspelt_command_names_the_nearest() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rigctl", "simulat"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr == "rigctl: unknown command, got 'simulat'; did you mean 'simulate'?\n"


def test_python_dash_m_is_the_same_program() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rigctl", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("rigctl ")
