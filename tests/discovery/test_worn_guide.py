"""From a log to a held-out error within the noise, with a law that no library has."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commands import answer, refusal, told
from discovery.guided_mass import LEVELS, MASS, nothing, rubbing_spot, worn_spot, write_bench
from rigctl.answers.discovery import discovery_answer, discovery_evidence
from rigctl.cli.blocks import show_answer
from rigctl.dataset import open_run
from rigctl.discovery.discover import discover
from rigctl.discovery.result import Discovery
from rigctl.discovery.written_effects import write_files
from rigctl.effects.user import load_effect
from rigctl.method_version import DISCOVERY_VERSION, METHOD_VERSION
from rigctl.model.load import load_model
from rigctl.report.analysis import discovery_sections

#: the designs are small, and the fits of a diagnosis are those of the search before it
pytestmark = pytest.mark.usefixtures("shared_results", "small_search")


def imported(folder: Path, hidden: Any, **how: Any) -> Path:
    log = write_bench(folder, hidden, **how)
    with chdir(folder):
        told("import", log.name, "--rig", "rig.yaml")
    return folder


@pytest.fixture(scope="module")
def worn(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, dict[str, Any]]]:
    """A campaign on a guide with a worn spot, and the answer of `discover`."""
    folder = imported(tmp_path_factory.mktemp("worn"), worn_spot)
    with chdir(folder):
        yield folder, answer("discover", "latest", "--model", "model.yaml", "-o", "effects")


def test_the_location_and_the_variable_are_found(worn: tuple[Path, dict[str, Any]]) -> None:
    _, found = worn
    assert found["gate"]["open"]
    first = found["located"][0]
    assert first["slot"] == "velocity_rate"
    assert "force_input" in first["alike"]  # a force at the drive does the same
    assert "position" in first["over"]
    assert first["p_value"] < 1e-3
    assert 0.5 < first["share"] <= 1.0


def test_the_true_form_is_in_the_set_with_its_scales(worn: tuple[Path, dict[str, Any]]) -> None:
    _, found = worn
    best = found["formulas"][0]
    assert best["delta"] == 0.0
    assert "bump_of_position" in best["effect"]
    assert len(found["formulas"]) <= 3
    values = best["parameters"]
    for name, truth in (("size", -0.12 / 1.5), ("center", 0.04), ("width", 0.02)):
        assert abs(values[name]["value"] - truth) < 4.0 * values[name]["std"], name
        assert values[name]["std"] < 0.1 * abs(truth), name
    assert best["accepted"]
    assert best["heldout_after"] < 1.05 < best["heldout_before"]
    assert best["tier"] == "B"  # no group of a stiffness, a damping and a mass has a length
    assert best["passive"] == ""  # it depends on no speed


def test_the_band_of_the_curve_covers_the_truth(
    worn: tuple[Path, dict[str, Any]],
) -> None:
    _, found = worn
    curve = found["curves"][0]
    assert (curve["slot"], curve["over"], curve["times"]) == ("velocity_rate", "position", "")
    x = [point["x"] for point in curve["points"]]
    assert -0.16 < min(x) < max(x) < 0.16  # the range that the records cover
    deepest = min(curve["points"], key=lambda point: point["value"])
    assert abs(deepest["x"] - 0.04) < 0.005
    truth = [-worn_spot(point["x"], 0.0) / MASS for point in curve["points"]]
    inside = [point["low"] < y < point["high"] for point, y in zip(curve["points"], truth, strict=True)]
    assert sum(inside) >= 0.9 * len(inside)
    assert deepest["high"] < 0.0  # significantly different from 0


def test_no_record_is_designed_between_effects_that_do_not_explain_the_data(
    worn: tuple[Path, dict[str, Any]],
) -> None:
    """Both effects of the nearest pair are refuted; two that the user names are compared all the same."""
    said = refusal("design", "latest", "--model", "model.yaml")
    assert "no effect of the library explains these data" in said
    assert "rigctl discover" in said
    pair = ["dead_band_of_force", "hysteresis_of_position"]
    asked = answer(
        "design", "latest", "--model", "model.yaml", "--separate", ",".join(pair), "--records", "1"
    )
    assert {frozenset(one) for one in asked["separates"]} == {frozenset(pair)}
    for one in asked["rivals"]:
        assert len({*pair} & {*one["effects"]}) == 1


def test_the_effect_file_predicts_held_out_records(
    worn: tuple[Path, dict[str, Any]],
) -> None:
    folder, found = worn
    file = found["formulas"][0]["file"]
    text = (folder / file).read_text(encoding="utf-8")
    assert "valid:" in text
    assert 'tier: "B"' in text
    held = ["--hold-out", "record > 6"]
    answer("model", "add", "model.yaml", file, "latest", "--fit-shapes", *held)
    compared = answer("compare", "latest", "--model", "model.yaml", *held)
    channel = compared["channels"]["position"]
    assert compared["adequate"]
    assert channel["heldout_rmse"] < 1.1 * channel["noise"]
    assert not [note for note in compared["notes"] if "learned for" in note]  # within its range of validity


def test_no_search_without_a_misfit(tmp_path: Path) -> None:
    with chdir(imported(tmp_path, nothing, levels=LEVELS[:5])):
        found = answer("discover", "latest", "--model", "model.yaml")
        assert not found["gate"]["open"]
        assert found["gate"]["reason"] == "adequate"
        assert found["formulas"] == found["located"] == found["curves"] == []


def test_a_local_drag_is_found_over_two_variables_and_as_dissipative(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = imported(tmp_path, rubbing_spot, seed=1)
    (run,) = (folder / "runs").iterdir()
    found = discover([open_run(run)], load_model(folder / "model.yaml"))
    assert {driver.name for driver in found.located[0].over} == {"position", "velocity"}
    best = found.formulas[0]
    assert "bump_of_position" in best.name
    assert best.passive == "dissipates energy"
    # a force on the mass and a drag on it are equivalent here: neither is claimed
    said = (
        "A term is missing, its location uncertain (velocity_rate or force_input), over position and "
        "velocity; of "
    )
    assert found.statement.startswith(said)
    document = found.document()
    assert document["place"] == {"slots": ["velocity_rate", "force_input"], "sure": False}
    assert document["driver"] == {"variables": [["position", "velocity"]], "sure": True}
    _writes_beside_what_is_there(found, folder / "effects")
    _shows_it_on_the_page(found)
    _answers_in_a_few_lines(found, capsys)


def _answers_in_a_few_lines(found: Discovery, capsys: pytest.CaptureFixture[str]) -> None:
    show_answer(discovery_answer(found))
    short = capsys.readouterr().out
    assert len(short.splitlines()) <= 3 + len(found.formulas)
    assert re.search(r"% of it, [0-9.]+ times as strong as chance \(p [<=] [0-9.e-]+\)", short)
    assert found.formulas[0].term in short
    assert "-v shows" in short
    show_answer(discovery_answer(found), discovery_evidence(found))
    whole = capsys.readouterr().out
    assert "family-wise p" in whole
    assert "95 % band" in whole
    assert "not tested outside this range" in whole


def _writes_beside_what_is_there(found: Discovery, folder: Path) -> None:
    first = write_files(found, folder).formulas[0].file
    assert first is not None
    before = first.read_bytes()
    second = write_files(found, folder).formulas[0].file
    assert second is not None
    assert second != first
    assert first.read_bytes() == before
    one, other = load_effect(first), load_effect(second)
    assert other.name == f"{one.name}_2"
    assert one.provenance is not None
    assert one.provenance.tier == "B"
    assert (one.provenance.method, one.provenance.discovery) == (METHOD_VERSION, DISCOVERY_VERSION)
    assert {side.over for side in one.valid} == {"position", "velocity"}


def _shows_it_on_the_page(found: Discovery) -> None:
    (section,) = discovery_sections(found)
    body = str(section.body)
    assert "<svg" in body
    assert body.count("<rect") >= 2 * len(found.diagnosis.before.fit.problem.model.family.slots)
    assert found.formulas[0].term.replace("-", "") in body.replace("-", "")
    assert [plot.id for plot in section.plots] == [f"curve-{k + 1}" for k in range(len(found.curves))]
    assert "dissipates energy" in body
    drag = found.curves[0]  # over the position, times the velocity
    assert (drag.over, drag.times) == ("position", "velocity/(1 m/s)")
    assert abs(float(drag.x[np.argmin(drag.value)]) - 0.04) < 0.005


def test_wrong_options_are_refused_before_any_work(worn: tuple[Path, dict[str, Any]]) -> None:
    said = refusal("discover", "latest", "--model", "model.yaml", "--slot", "velocity_rat")
    assert "velocity_rate" in said
    said = refusal("discover", "latest", "--model", "model.yaml", "-o", "log.csv")
    assert "folder" in said
