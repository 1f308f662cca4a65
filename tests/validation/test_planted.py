"""The tier ``discovery``: planted terms act, are not in the library, and are counted correctly."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from rigctl.discovery.grammar import argument, factors, forms
from rigctl.effects.drivers import Driver
from rigctl.effects.registry import library
from rigctl.errors import RigctlError
from rigctl.physics.families import find_family
from rigctl_validation.bench.campaign import Campaign, clean_outputs
from rigctl_validation.hidden_effect import hide
from rigctl_validation.outcome import Searched, TrialOutcome
from rigctl_validation.planted.rates import planted_rates
from rigctl_validation.planted.terms import PLANTED, PlantedTerm, find_planted
from rigctl_validation.planted.trial import PlantedTrial, planted_trials

FAMILY = find_family("hydraulic_cylinder")
PLAIN = Campaign(temperatures=(30.0,), pressures=(40.0,), chamber_pressures=True)


def test_planted_terms_have_distinct_names_that_no_library_effect_has() -> None:
    assert len(PLANTED) >= 20
    assert len({one.name for one in PLANTED}) == len(PLANTED)
    assert not {one.name for one in PLANTED} & set(library(FAMILY))
    with pytest.raises(RigctlError, match="groove"):
        find_planted("grove")


@pytest.mark.parametrize("term", PLANTED, ids=lambda term: term.name)
def test_a_planted_term_changes_the_outputs_of_the_bench(term: PlantedTerm) -> None:
    with_it = hide(PLAIN, [(term.hidden, 20.0 * term.typical)], "other")
    ((_, plain),), ((_, changed),) = clean_outputs(PLAIN), clean_outputs(with_it)
    shown = {name for name in plain if not np.array_equal(plain[name], changed[name])}
    assert shown
    if term.slots[0].endswith("_reading"):  # a sensor error changes its own channel only
        assert shown == {term.slots[0].removesuffix("_reading")}


@pytest.mark.parametrize("term", PLANTED, ids=lambda term: term.name)
def test_the_grammar_can_express_the_planted_terms(term: PlantedTerm) -> None:
    assert all(FAMILY.slot(slot) for slot in term.slots)
    names = {state.name for state in FAMILY.states} | {"oil_temperature", "supply_pressure"}
    for form in term.forms:
        parts = [part.split(" of ") for part in form.split(" times ")]
        for place, (kind, variable) in enumerate(parts):
            weights = tuple((name, 1.0) for name in variable.split(" - "))
            assert {name for name, _ in weights} <= names
            own = argument(Driver(weights, "Pa"), -1.0, 2.0, FAMILY)
            low, high = own.of(np.array([own.low, own.high])).tolist()
            kinds = forms(low, high) if place == 0 else factors(low, high)
            assert kind in {one.name for one in kinds}


def test_every_trial_occurs_once_and_samples_have_both_kinds() -> None:
    trials = planted_trials()
    assert len({trial.name for trial in trials}) == len(trials)
    assert {trial.term for trial in trials} == {"", *(one.name for one in PLANTED)}
    assert {bool(trial.term) for trial in trials[:12]} == {True, False}
    for trial in trials[:3]:
        assert PlantedTrial.read(json.loads(json.dumps(trial.document()))) == trial


def outcome(term: str, **found: object) -> TrialOutcome[PlantedTrial]:
    trial = PlantedTrial(term, 50.0 if term else 0.0)
    return TrialOutcome(trial, searched=Searched(**found))  # type: ignore[arg-type]


def test_rates_count_gates_locations_and_formulas_of_planted_terms() -> None:
    truth = "load: bump of position"
    made = [
        outcome("", gate="adequate"),
        outcome("", gate="outside_library", formulas=(truth,), heldout_after=1.0),
        outcome("groove", gate="outside_library", places=("load",), in_set=True, heldout_after=1.02),
        outcome("groove", gate="outside_library", places=("mass",), heldout_after=1.3),
        outcome("groove", gate="library"),
        TrialOutcome(PlantedTrial("groove", 50.0), untested="no amplitude has the size wanted"),
    ]
    found = {(rate.name, rate.of): (rate.count, rate.trials) for rate in planted_rates(made)}
    assert found["nothing planted", "a formula is given"] == (1, 2)
    assert found["planted", "the gate opens"] == (2, 3)
    every = "planted, the gate open"
    assert found[every, "the place is among the first two"] == (1, 2)
    assert found[every, "the truth is in the set"] == (1, 2)
    assert found[every, "held out within 10 % of the noise"] == (1, 2)


def test_an_outcome_is_read_back_from_its_file() -> None:
    made = outcome("groove", gate="outside_library", places=("load",), formulas=("a", "b"), in_set=True)
    text = json.dumps(made.document()).replace("NaN", "null")
    again = TrialOutcome.read(json.loads(text), PlantedTrial.read)
    assert again.searched is not None
    assert made.searched is not None
    assert again.searched.formulas == ("a", "b")
    assert math.isnan(again.searched.heldout_after)
    assert again.searched.places == made.searched.places
