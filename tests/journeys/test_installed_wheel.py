"""rigctl from a wheel, in an empty folder, without a checkout."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from systems import needs_package

REPOSITORY = Path(__file__).resolve().parents[2]

pytestmark = needs_package("build")


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of a process that sees both wheels' packages instead of the checkout's."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder)]
    for source in (REPOSITORY, REPOSITORY / "rigctl-validation"):
        subprocess.run([*build, str(source)], check=True, capture_output=True)
    wheels = sorted(map(str, folder.glob("*.whl")))
    assert len(wheels) == 2
    place = folder / "site"
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(place)]
    subprocess.run([*install, *wheels], check=True, capture_output=True)
    return {**os.environ, "PYTHONPATH": str(place), "EXPECTED": str(place)}


def rigctl(arguments: list[str], folder: Path, environment: dict[str, str], module: str = "rigctl") -> str:
    """Run the installed command; returns its stdout."""
    done = subprocess.run(
        [sys.executable, "-m", module, *arguments],
        cwd=folder, env=environment, capture_output=True, text=True, encoding="utf-8", check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_first_commands_work_from_an_installed_wheel(installed: dict[str, str], tmp_path: Path) -> None:
    code = (
        "import os, rigctl, rigctl_validation as other\n"
        "print(all(one.__file__.startswith(os.environ['EXPECTED']) for one in (rigctl, other)))"
    )
    seen = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=installed, capture_output=True, text=True, check=True
    )
    assert seen.stdout.strip() == "True", "the checkout was imported instead of the wheel"
    assert (Path(installed["PYTHONPATH"]) / "rigctl/shipped/site/tutorial/hidden-effect.html").is_file()

    made = json.loads(rigctl(["init", "bench", "--json"], tmp_path, installed))
    assert len(made["files"]) > 8
    bench = tmp_path / "bench"
    table = json.loads(rigctl(["import", "data/hl32-viscosity.csv", "--json"], bench, installed))
    assert table["records"] == 13
    rigctl(["check", "procedures/campaign.yaml", "--json"], bench, installed)
    run = json.loads(rigctl(["simulate", "procedures/quick-check.yaml", "--json"], bench, installed))
    assert run["records"] == 2
    rigctl(["runs", "verify", run["run"]], bench, installed)
    rigctl(["report", "latest", "-o", "page.html"], bench, installed)
    assert "Plotly" in (bench / "page.html").read_text(encoding="utf-8")
    oil = json.loads(rigctl(["oil", "--json"], tmp_path, installed))
    assert oil


def test_the_separate_benches_work_from_their_own_wheel(installed: dict[str, str], tmp_path: Path) -> None:
    assert "--tier" in rigctl(["validate", "--help"], tmp_path, installed)
    made = rigctl(["motor", "-o", "mine"], tmp_path, installed, module="rigctl_validation.benches")
    assert "lambda" in made
    assert {"rig.yaml", "model.yaml"} <= {file.name for file in (tmp_path / "mine").iterdir()}
    (described,) = Path(installed["PYTHONPATH"]).glob("rigctl_validation-*.dist-info")
    assert (described / "licenses" / "LICENSE").is_file()


def test_a_shipped_procedure_runs_without_a_project(installed: dict[str, str], tmp_path: Path) -> None:
    shown = rigctl(["check", "procedures/quick-check.yaml"], tmp_path, installed)
    assert "2 records" in shown
    assert list(tmp_path.iterdir()) == []
