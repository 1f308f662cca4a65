"""Formulas are tried at every location that the data allow, and at few if one location is clearly best."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import pytest

from rigctl.discovery import locate
from rigctl.discovery.locate import Located, Map
from rigctl.discovery.open_slots import OpenSlots
from rigctl.effects.drivers import Driver
from rigctl.physics.families import find_family

FAMILY = find_family("hydraulic_cylinder")
SAMPLES = 15_000.0
SLOTS = [slot.name for slot in FAMILY.slots]


def located(slot: str, over: tuple[str, ...], statistic: float, dof: int, p_value: float = 1e-5) -> Located:
    drivers = tuple(Driver(((name, 1.0),), "SI") for name in over)
    return Located(FAMILY.slot(slot), drivers, statistic, dof, p_value, 0.9)


def wanted(*found: Located) -> list[str]:
    """Names of the locations at which formulas are tried."""
    ordered = tuple(sorted(found, key=lambda one: one.cost(SAMPLES)))
    return [one.name for one in Map(ordered, (), len(found), float(len(found)), 30.0).most_wanted]


def pairs(slot: str, statistics: list[float]) -> list[Located]:
    others = ("valve", "spool", "pressure_b", "velocity", "pressure_a", "supply_pressure")
    degrees = (14, 20, 22, 23, 23, 23)
    return [
        located(slot, ("position", other), statistic, dof)
        for other, statistic, dof in zip(others, statistics, degrees, strict=False)
    ]


def test_all_locations_as_good_as_the_best_are_tried() -> None:
    """A leak somewhere behind the piston: twelve slots explain it equally well."""
    equal = [located(slot, ("pressure_b",), 2500.0 - k, 8) for k, slot in enumerate(SLOTS[:12])]
    assert wanted(*equal) == [f"{slot} over pressure_b" for slot in SLOTS[:12]]


def test_few_locations_are_tried_if_one_is_clearly_best() -> None:
    worse = [located(slot, ("pressure_b",), 2000.0 - k, 8) for k, slot in enumerate(SLOTS[1:12])]
    singles = wanted(located(SLOTS[0], ("pressure_b",), 2500.0, 8), *worse)
    assert singles == [f"{slot} over pressure_b" for slot in SLOTS[:4]]
    both = wanted(*(pair for k in range(5) for pair in pairs(SLOTS[k], [3000.0 - 400.0 * k] * 6)))
    assert [sum(name.startswith(f"{slot} over") for name in both) for slot in SLOTS[:5]] == [5, 2, 1, 0, 0]


def test_pairs_of_variables_are_chosen_by_what_they_explain_and_not_by_their_splines() -> None:
    """A drag at one position: the valve command replaces the sign of the speed with fewer splines."""
    best = located("line_resistance", ("position", "pressure_setpoint"), 2612.0, 15)
    drag = pairs("friction", [2551.0, 2580.0, 2560.0, 2594.0, 976.0, 541.0])
    found = wanted(best, *drag)
    assert "friction over position and velocity" in found
    assert "friction over position and pressure_a" not in found


def test_locations_without_significance_are_not_tried() -> None:
    assert wanted(located(SLOTS[0], ("velocity",), 9.0, 8, p_value=0.4)) == []


def test_the_best_pairs_of_variables_are_tested_at_every_location(monkeypatch: pytest.MonkeyPatch) -> None:
    """A damper near the end of the stroke: position and speed explain it as a resistance of the lines, and
    neither alone shows anything at the friction, where the pressure is the best single variable."""
    names = ("position", "velocity", "pressure_a", "spool", "valve")
    drivers = tuple(Driver(((name, 1.0),), "SI") for name in names)
    truth = {"line_resistance": 2500.0, "friction": 2510.0}
    looked: list[tuple[str, frozenset[str]]] = []

    def pairs_at(_: object, place: Located, driver: Driver, others: Sequence[Driver]) -> Iterator[Located]:
        for other in others:
            if other is not driver:
                over = {driver.name, other.name}
                looked.append((place.slot.name, frozenset(over)))
                right = over == {"position", "velocity"}
                statistic = truth.get(place.slot.name, 90.0) if right else 80.0
                yield replace(place, over=(driver, other), statistic=statistic, dof=23)

    monkeypatch.setattr(locate, "_with_others", pairs_at)
    far = [slot for slot in SLOTS if slot not in truth]
    order = ["line_resistance", *far[: locate.PLACES], "friction", *far[locate.PLACES :]]
    best = {"friction": "pressure_a"}
    singles = [located(slot, (best.get(slot, "position"),), 1000.0 - k, 8) for k, slot in enumerate(order)]
    opened = SimpleNamespace(drivers=drivers)
    found = locate._pairs(cast("OpenSlots", opened), singles, SAMPLES)
    first = max(found, key=lambda one: one.statistic)
    assert (first.slot.name, {driver.name for driver in first.over}) == ("friction", {"position", "velocity"})
    assert len(looked) == len(set(looked)), "a pair was simulated twice"
    assert {slot for slot, over in looked if over == {"position", "velocity"}} == set(order)
