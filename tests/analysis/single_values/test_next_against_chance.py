"""Suggested readings: repeats that suffice to detect an effect, and points beyond the table."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import nct, t

from rigctl.analysis.comparison import judge
from rigctl.analysis.decision_levels import ALPHA
from rigctl.analysis.fitting import fit_model
from rigctl.analysis.linear.power import significant_size
from rigctl.analysis.single_values import next_values as module
from rigctl.analysis.single_values.next_values import FurtherPoint, Repeats, next_against_chance
from rigctl.answers.findings.tables import next_steps
from rigctl.dataset import open_run
from rigctl.dataset.importing import import_file
from rigctl.files.shipped import shipped
from rigctl.model import load_model
from rigctl.model.measured.noise import DataNoise, noise_of
from rigctl.model.measured.read import read_measurements
from rigctl.noise import ChannelNoise


def score(z: float, kappa: float = 0.5) -> Any:
    return SimpleNamespace(effect="leak", candidate=0, z=z, kappa=kappa)


def before(one: Any, rows: int, degrees: int, tests: int = 3) -> Any:
    """Rows with their own unknowns, so that no point beyond their ends is searched."""
    problem = SimpleNamespace(
        records=(None,) * rows,
        local=((object(),),) * rows,
        noise=SimpleNamespace(channels=(ChannelNoise("stroke", 1e-3, degrees=degrees),)),
        measurements=SimpleNamespace(variables=("oil",)),
        model=SimpleNamespace(family=SimpleNamespace(standard_record=object())),
    )
    return SimpleNamespace(
        fit=SimpleNamespace(problem=problem),
        screening=SimpleNamespace(scores=(one,)),
        adequacy=SimpleNamespace(tests=dict.fromkeys(range(tests))),
    )


@pytest.mark.parametrize("z", [2.6, 3.0, 3.4])
@pytest.mark.parametrize(("rows", "degrees"), [(8, 4), (13, 10)])
def test_the_suggested_repeats_have_a_power_of_90_percent(z: float, rows: int, degrees: int) -> None:
    (step,) = next_against_chance(before(score(z), rows, degrees))
    assert isinstance(step, Repeats)
    repeats = step.readings
    assert step.size == pytest.approx(z * np.sqrt(repeats))
    (said,) = next_steps([step])
    assert said.startswith(f"read each condition {repeats} times: leak, if it is as large as it seems, would")

    def shown(count: int) -> float:
        """Power of Student's test, one of three at 1 %, with the noise estimated from the repeats as well."""
        known = degrees + rows * (count - 1)
        return float(nct.sf(t.isf(0.005 / 3, known), known, z * np.sqrt(count)))

    assert shown(repeats) > 0.88
    assert repeats == 2 or shown(repeats - 1) < 0.92


@pytest.mark.parametrize(
    ("one", "degrees"), [(score(2.4), 10), (score(3.0, kappa=0.04), 10), (score(3.0), 0)]
)
def test_no_repeats_are_suggested_for_undetectable_effects(one: Any, degrees: int) -> None:
    assert next_against_chance(before(one, 10, degrees)) == []


def test_no_refit_is_made_without_a_point_beyond_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: Any, **__: Any) -> None:
        raise AssertionError("a fit that nobody needs")

    monkeypatch.setattr(module, "alone", never)
    assert len(next_against_chance(before(score(3.0), 10, 10))) == 1


def test_the_predicted_change_beyond_a_table_matches_a_fit_with_the_effect(tmp_path: Path) -> None:
    """Compared with a model file that has the effect, and the point as a held-out row."""
    table = shipped("data", "hl32-viscosity.csv").read_text(encoding="utf-8")
    table += "100,6,6,0.0049094,0.0049094\n"
    (tmp_path / "more.csv").write_text(table, encoding="utf-8", newline="\n")
    law = shipped("models", "hl32-oil.yaml").read_text(encoding="utf-8")
    path = tmp_path / "capillary.yaml"
    effect = "effects: {capillary_end_correction: {correction: {value: 1 cSt^2, fit: true}}}"
    path.write_text(law.replace("effects: {}", effect), encoding="utf-8", newline="\n")
    plain, more = load_model(shipped("models", "hl32-oil.yaml")), load_model(path)
    done = import_file(tmp_path / "more.csv", None, tmp_path)
    every = read_measurements(plain, [open_run(str(done.path))])
    table_alone = every.only(range(13))
    noise = noise_of(table_alone)
    steps = next_against_chance(judge(fit_model(plain, table_alone, noise), "oil"))
    (hot,) = [one for one in steps if isinstance(one, FurtherPoint) and one.condition == "100 degC"]
    assert hot.effect == "capillary_end_correction"
    assert " at 100 degC too: capillary_end_correction changes it there by " in next_steps([hot])[0]
    known = DataNoise(noise.model, (*noise.ok, noise.ok[0]))
    with_it, without = (
        float(fit_model(model, every, known, (13,)).outputs[13][-1, 0]) for model in (more, plain)
    )
    assert hot.change == pytest.approx(with_it / without - 1.0, abs=0.01)
    sigma = float(noise.model.channels[0].sigma_at(np.array([without]))[0])
    assert hot.times == pytest.approx(abs(with_it - without) / sigma, rel=0.1)


@pytest.mark.parametrize(("effects", "degrees"), [(1, 4), (6, 4), (6, 10)])
def test_the_largest_of_several_effects_exceeds_the_stated_size_by_chance_in_one_percent(
    effects: int, degrees: int
) -> None:
    """At most, of all models that are right: the smallest p-value of three tests counts three times."""
    rng = np.random.default_rng(8)
    sizes = rng.standard_normal((200_000, effects)) / np.sqrt(rng.chisquare(degrees, (200_000, 1)) / degrees)
    exceeded = np.mean(np.abs(sizes).max(axis=1) > significant_size(degrees, effects, 3))
    assert 0.4 * ALPHA / 3 < exceeded < 1.1 * ALPHA / 3
