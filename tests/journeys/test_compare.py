"""From a run to the agreement of a model with it, with commands only."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from commands import MODEL, answer, call, create_strokes, refusal, textbook_copy

pytestmark = pytest.mark.usefixtures("inside")


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with a small campaign on a bench that obeys the model."""
    return create_strokes(tmp_path_factory.mktemp("compare"), "20 degC, 60 degC", seed=4)


def test_a_model_agrees_once_it_is_fitted() -> None:
    other = textbook_copy("other")
    fitted = answer("model", "fit", other, "latest", "--hold-out", "supply == 30 bar")
    assert (fitted["version"], fitted["effect"]) == (2, None)
    assert fitted["after"]["rmse"]["position"] < 0.2 * fitted["before"]["rmse"]["position"]
    assert fitted["after"]["heldout_rmse"]["position"] < 1.3 * fitted["after"]["noise"]["position"]

    two = ["--model", f"{other}@1", "--model", other, "--no-fit"]
    compared = answer("compare", "latest", *two, "-v")
    first, second = compared["models"]
    assert (first["model"], first["adequate"]) == ("other@1", False)
    assert (second["model"], second["adequate"]) == ("other", True)
    assert set(second["tests"]) == {"score", "plane", "chi2"}
    assert first["where"][0]["share_of_error"] > 0.3
    assert first["slots"][0]["log_evidence"] >= first["slots"][-1]["log_evidence"]
    assert set(first["slots"][0]) == {"slot", "meaning", "log_evidence", "share_of_error", "when", "alike"}
    assert set(second["channels"]) == {"oil_temperature", "supply_pressure", "position"}
    told = call("compare", "latest", *two, "-v").stdout
    for words in ("other@1 does not agree", "other agrees", "p of plane test", "adequate"):
        assert words in told
    # its page showed the second model alone, fitted again
    assert f"rigctl compare latest --model {other}@1 --model {other} --no-fit -o page.html" in told


def test_a_comparison_reports_noise_held_out_records_and_places_of_misfit() -> None:
    told = call("compare", "latest", "--model", MODEL, "--no-fit", "--hold-out", "oil == 60 degC", "-v")
    assert told.exit_code == 0
    for words in (
        "does not agree",
        "RMSE/noise",
        "quiet",
        "held out: 4 records",
        "where it fails",
        "by phase",
    ):
        assert words in told.stdout
    assert "Reading the records" in told.stderr
    assert "Reading the records" not in told.stdout


@pytest.mark.parametrize(
    ("written", "says"),
    [
        ("oil == 20 degC and oil == 60 degC", "no record is held out"),
        ("record > 0", "nothing is left to fit on"),
        ("oyl == 20 degC", "did you mean 'oil'"),
        ("supply == 20 degC", "cannot compare"),
    ],
)
def test_a_contradictory_choice_of_records_is_refused(written: str, says: str) -> None:
    assert says in refusal("compare", "latest", "--model", MODEL, "--hold-out", written)


def test_a_model_of_another_bench_is_refused() -> None:
    told = refusal("compare", "latest", "--model", "models/heater-board.yaml")
    assert "was recorded on 'HL32 bench'" in told


def test_too_few_values_are_reported_with_the_parameters_to_fit(tmp_path: Path) -> None:
    table = tmp_path / "two.csv"
    table.write_text("oil_temperature [degC],kinematic_viscosity [cSt]\n20,85.19\n", "utf-8")
    run = answer("import", str(table))["run"]
    told = refusal("compare", run, "--model", "models/hl32-oil.yaml")
    shutil.rmtree(Path("runs", run))
    assert "vogel_a, vogel_b, vogel_c" in told


def test_a_model_without_free_parameters_is_refused() -> None:
    fixed = textbook_copy("fixed", ("fit: true", "fit: false"))
    assert "no free parameters" in refusal("diagnose", "latest", "--model", fixed)
    assert "no free parameters" in refusal("model", "fit", fixed, "latest")
