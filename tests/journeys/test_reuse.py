"""Consecutive commands on the same data reuse fits, without a change of any answer."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from commands import call, told
from rigctl.engine.result_cache import RESULTS_VARIABLE, TALLY

TANK, DATA = "models/tank.yaml", ("latest", "--model", "models/tank.yaml")


def write_log(path: Path) -> None:
    """A tank that leaks as the root of its level; read to a tenth of a millimetre."""

    def pump(t: float) -> float:
        return 6.0 if t < 100.0 else 2.0

    rng = np.random.default_rng(4)
    times = np.arange(0.0, 200.0, 1.0)
    flow = 4e-5 * 0.61 * np.sqrt(2.0 * 9.80665)
    course = solve_ivp(
        lambda t, h: (pump(t) / 60e3 - flow * np.sqrt(h)) / 0.015,
        (0.0, 200.0),
        [0.05],
        t_eval=times,
        max_step=1.0,
    )
    rows = [
        f"{t:.1f},{pump(t):.1f},{100.0 * h + rng.normal(0.0, 0.02):.3f}"
        for t, h in zip(times, course.y[0], strict=True)
    ]
    path.write_text("\n".join(["time [s],flow [l/min],level [cm]", *rows]) + "\n", encoding="utf-8")


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("tank")
    with chdir(folder), pytest.MonkeyPatch.context() as patch:
        patch.setenv(RESULTS_VARIABLE, str(folder / "results"))
        told("init", "--minimal")
        write_log(folder / "log.csv")
        told("family", "new", "tank", "--csv", "log.csv", "--template", "tank", "--no-fit")
        told("import", "log.csv", "--rig", "rigs/tank.yaml")
        yield folder


def counted(*arguments: str) -> tuple[str, int, int]:
    """What a command prints, and how many results it reused and made."""
    reused, made = TALLY.reused, TALLY.made
    said = told(*arguments)
    return said, TALLY.reused - reused, TALLY.made - made


def test_answers_are_identical_with_and_without_the_cache(project: Path) -> None:
    plain, reused, made = counted("diagnose", *DATA, "--json", "--no-cache")
    assert (reused, made) == (0, 0)
    first, _, made = counted("diagnose", *DATA, "--json")
    assert made > 0
    second, reused, made = counted("diagnose", *DATA, "--json")
    assert reused > 0
    assert made == 0
    assert plain == first == second
    assert json.loads(plain)["verdict"]
    assert counted("compare", *DATA, "--json")[0] == counted("compare", *DATA, "--json", "--no-cache")[0]


def fits() -> set[Path]:
    """The fits that are stored."""
    return set(Path("results").glob("fit-*"))


def test_commands_after_a_diagnosis_reuse_its_fits(project: Path) -> None:
    told("diagnose", *DATA)
    stored = fits()
    assert stored
    for command in (("compare", *DATA), ("report", *DATA, "--diagnose", "-o", "page.html")):
        _, reused, _ = counted(*command)
        assert reused > 0, command
        assert fits() == stored, command
    _, _, made = counted("model", "fit", TANK, "latest")
    assert made == 1, "its error before the fit, which no command has asked for yet"


def test_a_changed_model_or_changed_data_are_fitted_again(project: Path) -> None:
    told("compare", *DATA)
    text = Path(TANK).read_text("utf-8")
    assert ", fit: true" in text
    Path("models/other.yaml").write_text(text.replace(", fit: true", "", 1), encoding="utf-8")
    _, _, made = counted("compare", "latest", "--model", "models/other.yaml")
    assert made > 0
    lines = Path("log.csv").read_text("utf-8").splitlines()
    lines[50] = lines[50][:-1] + ("1" if lines[50][-1] != "1" else "2")
    Path("changed.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    told("import", "changed.csv", "--rig", "rigs/tank.yaml")
    _, _, made = counted("compare", *DATA)
    assert made > 0


def test_reuse_is_reported_on_request(project: Path) -> None:
    told("compare", *DATA)
    said = call("compare", *DATA, "-v").stderr
    assert "Results of earlier commands reused: " in said
    assert "; made and kept: 0, in " in said
    assert "reused" not in call("compare", *DATA).stderr
