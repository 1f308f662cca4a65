"""The bench of the page about one's own family of models: right by SciPy, and safe to open."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import rigctl
from commands import answer, refusal, told
from rigctl.cli.commands.init import create_project
from rigctl.dataset import open_run
from rigctl.files.shipped import shipped
from rigctl.physics.families import using_families
from rigctl.physics.user.program import run_family_file

Vector = NDArray[np.float64]
PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "write-a-model-family.md"
#: the files that the page shows, by their paths
FILES = dict(
    re.findall(
        r"^<!-- file: (\S+) -->\n```\w+\n(.*?)^```$",
        PAGE.read_text(encoding="utf-8"),
        re.MULTILINE | re.DOTALL,
    )
)


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with the files of the page; its commands are tested together with those of all pages."""
    folder = tmp_path_factory.mktemp("page") / "tank-bench"
    create_project(folder)
    for name, text in FILES.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    return folder


@pytest.fixture
def here(bench: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(bench)
    return bench


def test_the_page_shows_the_shipped_family_file() -> None:
    family = shipped("models", "families", "water-tank.yaml").read_text(encoding="utf-8")
    assert FILES["families/water-tank.yaml"] == family


def at_the_end(start: Vector, rest: float, flow: float, area: float, evaporation: float) -> Vector:
    """Level in m and temperature in degC after 4 min of filling and heating, and `rest` s of neither."""
    density, heat, base = 998.0, 4180.0, 0.05
    state = start
    for inflow, power, seconds in ((flow / 60e3, 1000.0, 240.0), (0.0, 0.0, rest)):

        def rates(t: float, y: Vector, inflow: float = inflow, power: float = power) -> list[float]:
            head = 0.5 * (y[0] + np.hypot(y[0], 1e-3))
            outflow = 0.61 * area * np.sqrt(2.0 * 9.80665 * head)
            balance = power - (3.0 + evaporation) * (y[1] - 20.0)
            balance += density * heat * inflow * (15.0 - y[1])
            return [(inflow - outflow) / base, balance / (density * heat * base * head)]

        state = solve_ivp(rates, (0.0, seconds), state, method="Radau", rtol=1e-9, atol=1e-10).y[:, -1]
    return state


@pytest.mark.parametrize(
    ("options", "area", "evaporation"),
    [
        ([], 20e-6, 0.0),
        (["--with", "effects/evaporation.yaml:conductance=20 W/K"], 20e-6, 20.0),
        (["--plant", "models/water-tank.yaml"], 30e-6, 8.0),
    ],
)
def test_the_simulated_tank_agrees_with_its_equations_solved_by_scipy(
    here: Path, options: list[str], area: float, evaporation: float
) -> None:
    done = answer("simulate", "procedures/fill-and-drain.yaml", "--no-noise", *options)
    run = open_run(done["path"])
    for record, flow in enumerate((2.0, 4.0)):
        time, level, kelvin = (run.signals(name, record) for name in ("time", "level", "temperature"))
        start = np.array([level[0], kelvin[0] - 273.15])
        expected = at_the_end(start, time[-1] - time[0] - 240.0, flow, area, evaporation)
        # both ends are known to within half a step of the converter
        assert level[-1] == pytest.approx(expected[0], abs=0.16e-3)
        assert kelvin[-1] - 273.15 == pytest.approx(expected[1], abs=0.04)


def test_python_files_named_in_other_files_are_not_executed(here: Path) -> None:
    trap = here / "families" / "trap.py"
    trap.write_text("from pathlib import Path\nPath('sprung').write_text('')\n", encoding="utf-8")
    rig = (here / "rigs" / "leaky-tank.yaml").read_text(encoding="utf-8")
    rig = rig.replace("model: leaky_tank", "model: families/trap.py")
    (here / "rigs" / "trap.yaml").write_text(rig, encoding="utf-8")
    (here / "effects" / "trap.yaml").write_text(
        (here / "effects" / "evaporation.yaml").read_text("utf-8").replace("water-tank.yaml", "trap.py"),
        encoding="utf-8",
    )
    (here / "models" / "trap.yaml").write_text("model: families/trap.py\n", encoding="utf-8")
    for arguments in (
        ["check", "procedures/fill.yaml", "--rig", "rigs/trap.yaml"],
        ["simulate", "procedures/fill.yaml", "--rig", "rigs/trap.yaml"],
        ["effects", "check", "effects/trap.yaml"],
        ["simulate", "procedures/fill-and-drain.yaml", "--plant", "models/trap.yaml"],
        ["simulate", "procedures/fill-and-drain.yaml", "--with", "effects/trap.yaml"],
    ):
        said = refusal(*arguments)
        assert "a Python file is not run because another file names it" in said
        assert "--family" in said
        assert "trap.yaml:" in said
    assert not (here / "sprung").exists()


def test_a_family_file_given_on_the_command_line_is_accepted_for_that_command_only(here: Path) -> None:
    rig = (here / "rigs" / "leaky-tank.yaml").read_text(encoding="utf-8")
    rig = rig.replace("model: leaky_tank", "model: ../families/leaky_tank.py")
    (here / "rigs" / "by-path.yaml").write_text(rig, encoding="utf-8")
    arguments = ("check", "procedures/fill.yaml", "--rig", "rigs/by-path.yaml")
    told(*arguments, "--family", "families/leaky_tank.py")
    assert "leaky_tank.py" in refusal(*arguments)  # the permission ends with its command


def test_the_constants_of_a_rig_are_checked_against_its_family(here: Path) -> None:
    rig = (here / "rigs" / "water-tank.yaml").read_text(encoding="utf-8")
    broken = rig.replace("orifice_area: 20 mm^2", "orifice_aera: 20 mm^2").replace("0.05 m^2", "0.05 m")
    (here / "rigs" / "broken.yaml").write_text(broken, encoding="utf-8")
    said = refusal("check", "procedures/fill-and-drain.yaml", "--rig", "rigs/broken.yaml")
    assert "broken.yaml:29:14: wrong dimension, got '0.05 m'" in said
    assert "broken.yaml:30:3: unknown constant of water_tank, got 'orifice_aera'" in said
    assert "did you mean 'orifice_area'?" in said


def test_a_family_is_known_by_its_name_within_using_families(here: Path) -> None:
    family = run_family_file(here / "families" / "leaky_tank.py")
    with using_families(family):
        run = rigctl.simulate("procedures/fill.yaml", noise=False).run
    time, level = run.signals("time", 0), run.signals("level", 0)
    assert level[0] == pytest.approx(
        0.1, abs=1e-3
    )  # the family's initial value, since the rig file gives none
    rising = 5e-5 / 0.02 * 300.0  # m, where it ends
    elapsed = time - time[0]
    expected = rising + (level[0] - rising) * np.exp(-elapsed / 300.0)
    assert level == pytest.approx(expected, abs=0.16e-3)


def test_a_report_compares_a_model_of_a_given_family(here: Path) -> None:
    family = ("--family", "families/leaky_tank.py")
    (here / "models" / "leaky.yaml").write_text(
        "model: leaky_tank\nrig: rigs/leaky-tank.yaml\nparameters:\n"
        "  drain_time: {value: 280 s, fit: true}\n",
        encoding="utf-8",
    )
    run = answer("simulate", "procedures/fill.yaml", "--seed", "1", *family)["run"]
    told("report", run, "--model", "models/leaky.yaml", *family, "-o", "leaky.html")
    page = Path("leaky.html").read_text(encoding="utf-8")
    assert "Model against measurement" in page
    assert "Measured and model: the worst record" in page
    assert "Leaky agrees with the measurements" in page  # each record begins with a command
