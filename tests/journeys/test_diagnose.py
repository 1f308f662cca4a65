"""A hidden effect, from the run to the model that has it, with commands only."""

from __future__ import annotations

from contextlib import chdir
from pathlib import Path

import pytest

from commands import MODEL, answer, refusal, textbook_copy, told
from rigctl.cli.commands.init import create_project

pytestmark = pytest.mark.usefixtures("inside")

#: records at 20 and 80 degC, and one at 60, of the shipped campaign that an independent program made with a
#: leaking valve; the same as in web/test_workbench.py, which reuses these fits
RECORDS = {"001", "019", "025", "028"}


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with four records of the campaign."""
    folder = tmp_path_factory.mktemp("diagnose")
    create_project(folder)
    with chdir(folder):
        lines = Path("data/unknown-bench.csv").read_text("utf-8").splitlines(keepends=True)
        kept = [line for line in lines[1:] if line.split(",")[1] in RECORDS]
        Path("few.csv").write_text("".join([lines[0], *kept]), "utf-8")
        told("import", "few.csv", "--rig", "rigs/hl32-bench.yaml", "--assume", "heater=off")
    return folder


def test_the_hidden_effect_is_found_and_reduces_the_error() -> None:
    model = textbook_copy("found")
    done = answer("diagnose", "latest", "--model", model, "--apply", "--hold-out", "oil == 60 degC")
    assert done["verdict"] in ("missing_effect", "ambiguous")
    assert "valve_leakage" in {name for names in done["classes"] for name in names}
    (step,) = done["steps"]
    assert (step["effects"], step["version"]) == (["valve_leakage"], 2)
    assert step["after"]["heldout_rmse"]["position"] < step["before"]["heldout_rmse"]["position"]
    assert step["after"]["rmse"]["position"] < 1.1 * step["after"]["noise"]["position"]
    assert (done["ended"], done["after"]["verdict"]) == ("adequate", "adequate")

    values = {one["name"]: one for one in answer("model", "show", model)["parameters"]}
    found = values["valve_leakage.conductance"]
    assert 0.0 < found["std"] < 0.3 * found["value"]  # with sensors as uncertain as the rig file says
    assert found["from"].startswith("fitted")
    history = answer("model", "history", model)
    assert [version["kind"] for version in history["versions"]] == ["start", "add"]
    assert [error["version"] for error in history["errors"]] == [1, 2]
    assert "noise" in told("model", "history", model)

    told("report", "latest", "--model", model, "-o", "found.html")
    page = Path("found.html").read_text("utf-8")
    for words in (
        "Stroke, measured and predicted by every version",
        "version 1: position: ",
        "version 2: position: ",
    ):
        assert words in page
    told("report", "latest", "--model", f"{model}@1", "-o", "first.html")
    assert "of every version" not in Path("first.html").read_text("utf-8")  # one was selected by its number


def test_the_ranking_shows_evidence_against_each_effect() -> None:
    shown = told("diagnose", "latest", "--model", MODEL, "--max-effects", "1", "-v")
    for words in (
        "valve_leakage",
        "probability",
        "ΔmBIC",
        "+ for valve_leakage",
        "100.0 %",
        "not testable with these data",
    ):
        assert words in shown
    assert not Path("models/.history/hl32-textbook").exists()  # without --apply nothing is written


def test_the_answer_takes_at_most_seven_lines() -> None:
    shown = told("diagnose", "latest", "--model", MODEL, "--max-effects", "1")
    answered, _, suggested = shown.partition("\n\nNext:")
    lines = answered.splitlines()
    assert "valve_leakage" in lines[0]
    assert len(lines) <= 7
    heads = [line.split("  ")[1] for line in lines[1:]]
    assert {"how sure", "error", "left", "-v shows"} <= set(heads)
    assert "l/min at 50 bar, 80 degC" in shown
    assert "position from" in shown
    assert (
        f"rigctl diagnose latest --model {MODEL} --max-effects 1 --" in suggested
    )  # it would add up to four
    for only_when_asked in ("ΔmBIC", "Noise:", "not testable"):
        assert only_when_asked not in shown


def test_adding_and_removing_show_the_error_before_and_after() -> None:
    model = textbook_copy("by-hand")
    added = answer("model", "add", model, "valve_leakage:conductance=1e-15 m^3", "--fit", "latest")
    assert (added["version"], added["effect"], added["before"]["heldout_rmse"]) == (2, "valve_leakage", {})
    assert added["after"]["chi2_reduced"] < added["before"]["chi2_reduced"]
    gone = answer("model", "remove", model, "valve_leakage", "--fit", "latest")
    assert gone["version"] == 3
    assert gone["before"]["chi2_reduced"] == pytest.approx(added["after"]["chi2_reduced"], rel=1e-3)
    assert gone["after"]["chi2_reduced"] == pytest.approx(added["before"]["chi2_reduced"], rel=1e-3)


def test_without_runs_there_is_nothing_to_fit_to() -> None:
    assert "Name a RUN, or use --no-fit" in refusal("model", "add", MODEL, "valve_leakage")
    model = textbook_copy("unfitted")
    assert answer("model", "add", model, "valve_leakage", "--no-fit")["after"] is None
    assert "conductance" in Path(model).read_text("utf-8")
