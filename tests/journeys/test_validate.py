"""A small sample of the benchmark: the diagnosis is right on campaigns that the engine did not make."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from rigctl.validation.outcome import Outcome
from rigctl.validation.parallel import run_scenarios
from rigctl.validation.scenario import Kind, NoiseVariant, Scenario, Wanted
from rigctl.validation.store import ResultStore
from rigctl.validation.work import carry_out

pytestmark = pytest.mark.timeout(900)  # a minute of computing, more where the computer is shared

NOTHING: tuple[NoiseVariant, ...] = ("white", "coloured")
EFFECTS = ("piston_leakage", "valve_leakage")


def sample() -> Iterator[Scenario]:
    """Nothing hidden in two kinds of noise, and two effects of 30 sigmas in shapes of their own."""
    for noise in NOTHING:
        yield small("nothing", noise=noise)
    for effect in EFFECTS:
        yield small("one", effect)


def small(kind: Kind, effect: str = "", noise: NoiseVariant = "white") -> Scenario:
    hidden = (Wanted(effect, 30.0),) if effect else ()
    return Scenario(
        kind, hidden, noise=noise, repeated=2, seed=7, temperatures=(20.0, 50.0, 80.0), pressures=(20.0, 50.0)
    )


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> tuple[Outcome, ...]:
    store = ResultStore(tmp_path_factory.mktemp("validate") / "results.jsonl", "test")
    return run_scenarios(tuple(sample()), carry_out, store, workers=1)


def test_no_false_alarm_in_any_noise(outcomes: tuple[Outcome, ...]) -> None:
    nothing = [outcome for outcome in outcomes if not outcome.scenario.hidden]
    assert {outcome.scenario.noise: outcome.verdict for outcome in nothing} == dict.fromkeys(
        NOTHING, "adequate"
    )


def test_every_effect_is_found_and_none_is_accepted_wrongly(outcomes: tuple[Outcome, ...]) -> None:
    hidden = [outcome for outcome in outcomes if outcome.scenario.hidden]
    assert [outcome.failure for outcome in hidden] == [""] * len(EFFECTS)
    assert [outcome.first for outcome in hidden] == list(EFFECTS)
    assert all(outcome.right for outcome in hidden if outcome.accepted)
