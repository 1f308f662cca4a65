"""Formulas are tried at every location that the data allow, and at few if one location is clearly best."""

from __future__ import annotations

from rigctl.discovery.locate import Located, Map
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
