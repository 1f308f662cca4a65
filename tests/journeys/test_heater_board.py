"""Measured heating of a real board: missing effects are found, added, and tested on other records."""

from __future__ import annotations

from contextlib import chdir
from pathlib import Path
from typing import Any

import pytest

from commands import answer, told
from rigctl.cli.commands.init import create_project

MODEL = "models/heater-board.yaml"
EVERY_SECOND = " or ".join(f"heater_1 == {level} %" for level in (20, 40, 60, 80, 100))


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The answer of `diagnose --apply` for heating only, with every second level held out."""
    folder = tmp_path_factory.mktemp("board")
    create_project(folder)
    with chdir(folder):
        told("import", "data/heater-board-steps.csv", "--rig", "rigs/heater-board.yaml")
        chosen = ("--only", "heater_1 > 0 %", "--hold-out", EVERY_SECOND)
        done = answer("diagnose", "latest", "--model", MODEL, *chosen, "--apply", "-o", "page.html")
        page = Path("page.html").read_text("utf-8")
        return done | {"history": answer("model", "history", MODEL), "page": page}


def test_coupling_a_lag_and_radiation_or_convection_are_added_step_by_step(found: dict[str, Any]) -> None:
    added = {name for step in found["steps"] for name in step["effects"]}
    assert "heater_coupling" in added
    assert added & {"heater_lag", "sensor_lag"}, "which of the two cannot be told while it only warms up"
    assert added & {"radiation", "power_law_convection"}
    assert [version["version"] for version in found["history"]["versions"]] == list(
        range(1, len(found["steps"]) + 2)
    )


def test_the_error_on_held_out_levels_falls_below_0_8_k_and_by_half(found: dict[str, Any]) -> None:
    before, after = found["steps"][0]["before"], found["steps"][-1]["after"]
    assert before["heldout_rmse"]["temperature_1"] > 1.0
    assert after["heldout_rmse"]["temperature_1"] < 0.8
    assert after["heldout_rmse"]["temperature_2"] < 0.5 * before["heldout_rmse"]["temperature_2"]


def test_masked_spikes_are_noted(found: dict[str, Any]) -> None:
    assert any("spikes of temperature_1 were masked" in note for note in found["notes"])


def test_the_model_fitted_to_heating_predicts_held_out_and_cooling_records(found: dict[str, Any]) -> None:
    held_out, cooling = found["unseen"]
    assert (held_out["why"], len(held_out["records"])) == ("hold_out", 5)
    names = {"why", "condition", "where", "records", "as_good", "channels", "remedies", "slot", "statement"}
    assert set(held_out) == set(cooling) == names
    assert (cooling["why"], cooling["condition"], len(cooling["records"])) == ("only", "heater_1 > 0 %", 10)
    assert cooling["where"].startswith("heater_1 0 %")
    for channel in ("temperature_1", "temperature_2"):
        seen = cooling["channels"][channel]
        # most spikes come while a heater is on: with them masked, the error is smaller there
        assert seen["rmse"] < 1.4 * seen["fitted_rmse"]
    assert "10 records with heater_1 0 %" in cooling["statement"]


def test_the_last_answer_includes_the_remaining_misfit(found: dict[str, Any]) -> None:
    last = found["after"]
    assert last["verdict"] == "outside_library"
    left = last["remainder"]
    assert left["share"] > 0.5  # of the remaining misfit: no single library effect explains nearly all of it
    assert left["p_value"] < 0.01 < left["size"]
    assert left["slot"]
    assert left["statement"].startswith(f"{100 * left['share']:.0f} % of the misfit is left")
    _, now = found["page"].split("The model as it is now</h2>", 1)
    assert f"{100 * left['share']:.0f} % of the misfit is left" in now.partition("<h2")[0]
