"""Possible sensors: the pairs of rivals that they would separate, and their cost."""

from __future__ import annotations

from contextlib import chdir
from pathlib import Path
from typing import Any

import pytest

from commands import MODEL, answer, told
from rigctl.cli.commands.init import create_project
from rigctl.errors import RigctlError
from rigctl.rig.load import parse_rig

pytestmark = pytest.mark.usefixtures("inside")

CAMPAIGN = (
    "procedures/campaign.yaml",
    "-a",
    "temperatures=20 degC, 60 degC",
    "-a",
    "pressures=30 bar, 50 bar",
)


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A position sensor that drifts with the temperature, as the throttle's opening might."""
    folder = tmp_path_factory.mktemp("sensors")
    create_project(folder)
    with chdir(folder):
        told("simulate", *CAMPAIGN, "--with", "position_thermal_drift", "--seed", "4")
    return folder


@pytest.fixture(scope="module")
def designed(bench: Path) -> dict[str, Any]:
    with chdir(bench):
        return answer("design", "latest", "--model", MODEL, "--records", "1", "--page", "next.html")


def test_the_sensor_that_would_separate_inseparable_effects_is_named(
    designed: dict[str, Any],
) -> None:
    """Both change the reading in proportion to the stroke; a second sensor of the motion, or of the chamber
    pressures, shows where the piston really is."""
    pair = {"position_thermal_drift", "flow_area_thermal_drift"}  # which of them comes first is chance
    assert [set(one) for one in designed["separates"]] == [pair]
    assert designed["probability"] < 0.5
    said = designed[
        "statement"
    ].lower()  # a record either does not do it reliably, or none that can be made does
    assert "not reliably distinguished" in said or "no record that this bench can make distinguishes" in said
    best = designed["sensor"]
    assert best["probability"] > 0.5
    assert set(best["channels"]) <= {"velocity", "pressure_a", "pressure_b"}
    assert [set(one) for one in best["splits"]] == [pair]
    assert " and ".join(best["channels"]) in designed["statement"]


def test_every_set_of_up_to_two_sensors_has_its_price(designed: dict[str, Any]) -> None:
    sets = {tuple(one["channels"]): one for one in designed["sensors"]}
    assert len(sets) == 5 + 10
    assert sets["pressure_a", "pressure_b"]["price"] == 360.0
    assert {one["currency"] for one in designed["sensors"]} == {"EUR"}
    prices = [one["price"] for one in designed["sensors"]]
    assert prices == sorted(prices)
    for (first, second), both in ((k, v) for k, v in sets.items() if len(k) == 2):
        assert both["expected_separation"] >= 0.99 * sets[(first,)]["expected_separation"]
        assert both["told"] >= sets[(second,)]["told"]


def test_the_page_has_the_table_and_chart_of_sensors(designed: dict[str, Any]) -> None:
    page = Path("next.html").read_text("utf-8")
    assert "Sensors that the bench could have" in page
    assert "best value for money" in page


RIG = """\
name: small
backend: {kind: simulated}
channels: {level: {unit: m, quantity: position}}
could_have:
  weight: {unit: N, quantity: force, noise: 0.1 N, price: 180 EUR}
"""


def test_a_price_is_an_amount_with_a_currency() -> None:
    possible = parse_rig(RIG).could_have["weight"]
    assert possible.price is not None
    assert (possible.price.amount, possible.price.currency, str(possible.price)) == (180.0, "EUR", "180 EUR")
    assert possible.channel.noise == 0.1
    assert parse_rig(RIG.replace("180 EUR", "95")).could_have["weight"].price is not None


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("180 EUR", "cheap", "no price"),
        ("180 EUR", "-3 EUR", "no price"),
        ("0.1 N", "0.1 mm", "noise"),
        ("0.1 N", "0 N", "a sensor without any tells everything"),
        ("noise: 0.1 N, ", "", "noise"),
        ("weight:", "level:", "the bench has this name already"),
        ("force", "forse", "did you mean 'force'"),
        ("unit: N", "unit: bar", "unit"),
    ],
)
def test_an_invalid_sensor_is_refused_with_its_reason(old: str, new: str, words: str) -> None:
    assert old in RIG
    with pytest.raises(RigctlError) as caught:
        parse_rig(RIG.replace(old, new, 1))
    assert words in str(caught.value)
