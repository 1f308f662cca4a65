"""Campaigns of the separate bench, each diagnosed and compared with its expected verdict.

``expected_verdicts.json`` has one trial per line: the hidden effects (name, size in sigmas, direction;
amplitudes in SI), the noise, and the verdict with the classes of effects that it leaves undecided. Five
strokes are the fewest with this verdict, except where a line asks for the eight of a ``larger`` campaign,
which show a weak effect and that a third temperature is outside of what the library explains. Some of
the effects are easily overlooked: the gain of a sensor that the opening of the throttle almost absorbs, the
slip of a pump for which the relief valve compensates until it closes, and a spring and the backlash of a
sensor that together look like a delay. `rigctl validate` runs and counts many more trials.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from rigctl.engine.one_thread import one_thread
from rigctl_validation.outcome import Outcome
from rigctl_validation.scenario import NOISES, Scenario, Wanted
from rigctl_validation.work import diagnose_scenario


@dataclass(frozen=True)
class Expected:
    """A trial of the list: what is hidden, how large (SI), and the expected diagnosis.

    `first`, if given, must head the ranking although it must not be named: a similar effect.
    """

    scenario: Scenario
    amplitudes: tuple[float, ...]
    verdict: str
    classes: frozenset[frozenset[str]]
    first: str | None


def listed(line: dict[str, Any]) -> Expected:
    larger = line.get("larger", False)
    scenario = Scenario(
        line["kind"],
        tuple(Wanted(*hidden) for hidden in line["hidden"]),
        noise=line["noise"],
        chamber_pressures=line["chamber_pressures"],
        repeated=2 if larger else 1,
        seed=line["seed"],
        temperatures=(20.0, 50.0, 80.0) if larger else (20.0, 80.0),
        pressures=(20.0, 50.0),
    )
    classes = frozenset(frozenset(group) for group in line["classes"])
    return Expected(scenario, tuple(line["amplitudes"]), line["verdict"], classes, line.get("first"))


LIST = [
    listed(line) for line in json.loads(Path(__file__).with_name("expected_verdicts.json").read_text("utf-8"))
]


@pytest.mark.parametrize("expected", LIST, ids=lambda expected: expected.scenario.name)
def test_each_campaign_gets_the_expected_verdict_and_classes(expected: Expected) -> None:
    with one_thread():
        found = diagnose_scenario(expected.scenario, expected.amplitudes)
    classes = frozenset(frozenset(group) for group in found.classes)
    assert (found.verdict.value, classes) == (expected.verdict, expected.classes)
    assert expected.first in (None, *(one.effect for one in found.ranking[:1]))
    outcome = Outcome(expected.scenario, found.verdict.value, found.effects, found.classes)
    assert outcome.right == outcome.accepted, "what is named is hidden, or is undecided with it"


@pytest.mark.parametrize("expected", LIST, ids=lambda expected: expected.scenario.name)
def test_every_expected_verdict_is_true_of_the_bench_or_undecided(expected: Expected) -> None:
    """A wrong verdict must not become the expected one."""
    named, truth = frozenset().union(*expected.classes), set(expected.scenario.truth)
    match expected.scenario.kind:
        case "nothing":
            assert (expected.verdict, named) == ("adequate", frozenset())
        case "removed":
            assert (expected.verdict, named) == ("outside_library", frozenset())
        case _ if expected.verdict == "adequate":
            assert max(wanted.size for wanted in expected.scenario.hidden) <= 5.0, (
                "too large to be overlooked"
            )
        case _:
            assert all(group & truth for group in expected.classes)
            assert named >= truth


def test_the_list_covers_every_kind_noise_and_set_of_sensors() -> None:
    scenarios = [expected.scenario for expected in LIST]
    assert len({scenario.name for scenario in scenarios}) == len(scenarios) >= 20
    assert {scenario.kind for scenario in scenarios} == {"nothing", "one", "two", "removed"}
    for kind in ("nothing", "one"):
        assert {scenario.noise for scenario in scenarios if scenario.kind == kind} == set(NOISES)
    assert {scenario.chamber_pressures for scenario in scenarios} == {False, True}
