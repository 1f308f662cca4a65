"""The command line as a whole: fast start, and one clear message for every mistake."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rigctl.cli.catalogue import ENTRIES
from rigctl.cli.main import app, load_command

HEAVY = ("numpy", "pandas", "pyarrow", "duckdb", "pint", "numba", "scipy", "plotly", "matplotlib", "pydantic",
         "ruamel", "jinja2", "typer", "rich", "click")  # fmt: skip


def test_help_imports_no_heavy_library() -> None:
    code = (
        "import sys\n"
        "sys.argv = ['rigctl', '--help']\n"
        "from rigctl.cli.entry import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        f"heavy = sorted({set(HEAVY)!r} & set(sys.modules))\n"
        "sys.exit(f'imported: {heavy}' if heavy else 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "simulate" in done.stdout


def test_the_fast_overview_equals_the_help_of_the_full_program() -> None:
    short = subprocess.run([sys.executable, "-m", "rigctl", "-h"], capture_output=True, text=True, check=True)
    assert CliRunner().invoke(app, ["--help"]).output == short.stdout
    assert all(len(line) <= 106 for line in short.stdout.splitlines())
    assert {entry.name for entry in ENTRIES} <= set(short.stdout.split())


@pytest.mark.parametrize("name", [entry.name for entry in ENTRIES])
def test_every_command_loads_and_its_help_shows_an_example(name: str) -> None:
    command = load_command(name)
    assert command.name == name
    for words in [[name, nested] for nested in getattr(command, "commands", {})] or [[name]]:
        shown = CliRunner().invoke(app, [*words, "--help"])
        assert shown.exit_code == 0
        assert "Example" in shown.output
        assert f"rigctl {' '.join(words)}" in shown.output.replace("Usage: rigctl", "")


def test_a_misspelt_command_is_reported_with_the_nearest_name() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rigctl", "simulat"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr == "rigctl: unknown command, got 'simulat'; did you mean 'simulate'?\n"


@pytest.mark.parametrize(
    ("words", "exit_code", "message"),
    [
        (["check", "nowhere.yaml"], 2, "there is no such file, got 'nowhere.yaml'"),
        (["check"], 2, "FILE is missing"),
        (["runs", "lst"], 2, "unknown command of 'rigctl runs', got 'lst'; did you mean 'list'?"),
        (["simulat"], 2, "unknown command, got 'simulat'; did you mean 'simulate'?"),
        (["pause"], 1, "no run is in progress"),
    ],
)
def test_a_mistake_is_reported_in_json(
    tmp_path: Path, words: list[str], exit_code: int, message: str
) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rigctl", *words, "--json"],
        capture_output=True, text=True, check=False, cwd=tmp_path, encoding="utf-8",
    )  # fmt: skip
    told = json.loads(done.stdout)
    assert done.returncode == told["exit_code"] == exit_code
    assert message in told["error"]["message"]
    assert done.stderr


def test_a_mistake_in_a_file_has_its_place_in_json(tmp_path: Path) -> None:
    (tmp_path / "p.yaml").write_text("procedure: x\nrigg: y\nsteps: [{wait: 1 s}]\n", encoding="utf-8")
    command = [sys.executable, "-m", "rigctl", "check", "p.yaml", "--json"]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=tmp_path, encoding="utf-8"
    )
    error = json.loads(done.stdout)["error"]
    assert (error["file"], error["line"], error["column"]) == ("p.yaml", 2, 1)
    assert (error["value"], error["nearest"]) == ("rigg", "rig")


def test_python_dash_m_runs_the_same_program() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rigctl", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("rigctl ")


def test_rarely_used_modules_of_numpy_are_loaded_on_first_use() -> None:
    program = (
        "import sys\n"
        "from rigctl.cli.late_modules import load_late\n"
        "load_late()\n"
        "import numpy, scipy.special\n"
        "assert 'numpy.testing._private' not in sys.modules\n"
        "assert 'numpy.f2py.crackfortran' not in sys.modules\n"
        "numpy.testing.assert_array_equal(scipy.special.ndtr([0.0]), [0.5])\n"
        "assert callable(numpy.f2py.run_main)\n"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", program], check=True)


@pytest.mark.parametrize(
    "call", ["report latest --output {}", "init {}", "check {}", "compare latest --model {}"]
)
def test_a_storage_address_is_refused_where_a_local_file_is_expected(call: str, tmp_path: Path) -> None:
    """`--output s3://lab/x.html` used to write a page to a new folder `s3:`."""
    address = "s3://lab/x.yaml"
    done = subprocess.run(
        [sys.executable, "-m", "rigctl", *call.format(address).split()],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert f"an address of storage is no local file, got '{address}'" in done.stderr
    assert list(tmp_path.iterdir()) == []
