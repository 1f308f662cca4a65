"""Learning with commands only: declined without confirmation, resumed, and reported."""

from __future__ import annotations

from contextlib import chdir
from pathlib import Path

import pytest

from commands import answer, call, refusal, textbook_copy, told
from rigctl.cli.commands.init import create_project

pytestmark = pytest.mark.usefixtures("small_search", "inside")

#: a small leak, which the campaign leaves ambiguous
CAMPAIGN = (
    *("procedures/campaign.yaml", "-a", "temperatures=20 degC, 60 degC, 80 degC"),
    *("-a", "pressures=50 bar", "--seed", "1", "--hold-out", "oil == 60 degC"),
)
LEAK = "valve_leakage:conductance=4e-16 m^3"


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("learn")
    create_project(folder)
    with chdir(folder):
        textbook_copy("own")
    return folder


def test_an_ambiguous_campaign_is_resolved_after_confirmation_of_its_next_records() -> None:
    """The campaign leaves a leak and a sensor drift; the designed records distinguish them."""
    declined = answer("learn", *CAMPAIGN, "--model", "models/own.yaml", "--with", LEAK)
    first, proposal = declined["rounds"]
    assert declined["ended"] == "declined"  # no one can confirm at the terminal, and --yes was not given
    assert first["verdict"] == "ambiguous"
    assert "valve_leakage" in first["classes"][0]
    assert len(first["classes"][0]) > 1
    assert (proposal["answer"], proposal["run"]) == ("no", None)
    assert proposal["promised"]["probability"] > 0.5
    assert "record" in told("check", proposal["procedure"])

    learned = answer("learn", "--resume", "--yes")
    assert learned["ended"] == "adequate"
    assert learned["added"] == ["valve_leakage"]
    values = {one["name"]: one for one in answer("model", "show", "models/own.yaml")["parameters"]}
    assert values["valve_leakage.conductance"]["value"] == pytest.approx(4e-16, rel=0.35)
    assert learned["rounds"][0] == first
    out = learned["rounds"][-1]["came_out"]
    assert (out["winner"], out["told_apart"], out["kept"]) == ("valve_leakage", True, True)
    runs = {one["id"] for one in answer("runs", "list")["runs"]}
    assert runs == {one["run"] for one in learned["rounds"]}
    page = Path(learned["page"]).read_text(encoding="utf-8")
    assert "What was learnt" in page
    assert "predicted: valve leakage over" in page
    assert "this learning session has ended: adequate" in refusal("learn", "--resume")


def test_a_refused_command_leaves_no_files() -> None:
    before = set(Path().rglob("*"))
    assert "a procedure is missing" in refusal("learn", "--model", "models/own.yaml")
    assert "--model is missing" in refusal("learn", "procedures/campaign.yaml")
    assert "no time" in refusal("learn", *CAMPAIGN, "--model", "models/own.yaml", "--budget", "much")
    known = ("learn", *CAMPAIGN, "--model", "models/own.yaml")
    assert "valve_leakage" in refusal(*known, "--with", "valve_leakge")
    for share in ("much", "0 %", "200 %", "3 mm"):
        assert "--precision: not a percentage" in refusal(*known, "--precision", share)
    assert "only a simulated bench hides" in refusal(*known, "--backend", "emulated", "--with", LEAK)
    again = refusal("learn", "--resume", "procedures/campaign.yaml", "--seed", "0", "--port", "COM3")
    assert "those of the session, got 'procedure, --port, --seed'" in again
    away = ("--backend", "serial", "--port", "/dev/no-such-port")
    assert "takes no --seed" in refusal(*known, *away)
    assert "10 bits" in str(call("learn", *CAMPAIGN[:5], "--model", "models/own.yaml", *away).exception)
    assert set(Path().rglob("*")) == before


def test_a_budget_below_the_first_round_is_refused_before_anything_moves() -> None:
    before = set(Path().rglob("*"))
    said = refusal("learn", *CAMPAIGN, "--model", "models/own.yaml", "--budget", "5m")
    assert set(Path().rglob("*")) == before
    assert "the budget is too small for the first round" in said
