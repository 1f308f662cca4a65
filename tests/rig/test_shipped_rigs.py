"""The shipped rig files: the published bench, complete."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import pytest

from rigctl.files.shipped import shipped
from rigctl.physics.families import find_family
from rigctl.rig import Rig, load_rig
from rigctl.rig.constants import CONSTANTS, GEOMETRY
from rigctl.units import parse_unit

BENCH = load_rig(shipped("rigs", "hl32-bench.yaml"))
INSTRUMENTED = load_rig(shipped("rigs", "hl32-bench-instrumented.yaml"))


@pytest.mark.parametrize("path", sorted(shipped("rigs").glob("*.yaml")), ids=lambda path: path.stem)
def test_shipped_rigs_warn_only_of_devices_without_a_watchdog(path: Path) -> None:
    rig = load_rig(path)
    unguarded = path.stem in ("tclab-board", "oil-circuit-visa", "line-device")
    expected = ["the device has no watchdog of its own"] if unguarded else []
    if path.stem == "oil-circuit-devices":
        expected = ["meter: the device has no watchdog of its own"]
    warnings = rig.warnings(date(2026, 11, 21))
    assert [text.partition(" own:")[0] + " own" * (" own:" in text) for text in warnings] == expected
    assert rig.description


def test_the_bench_has_the_published_dimensions() -> None:
    geometry, constants = BENCH.geometry, BENCH.constants
    assert (geometry["bore"], geometry["rod"], geometry["stroke"]) == pytest.approx((0.05, 0.025, 0.25))
    assert geometry["throttle_area"] == pytest.approx(3.3e-6)
    assert geometry["edge_area"] == pytest.approx(28e-6)
    assert geometry["tank_fill"] == pytest.approx(0.08)
    assert constants["pump_flow"] == pytest.approx(2.333e-4, rel=1e-3)
    assert constants["relief_resistance"] * constants["pump_flow"] == pytest.approx(0.5e5, rel=0.1)
    assert BENCH.actuators["heater"].power == 2000.0
    assert BENCH.options == {"throttle": "meter_in"}


def test_position_and_temperature_have_the_published_resolution() -> None:
    assert BENCH.channels["position"].resolution == pytest.approx(0.29e-3, rel=0.02)
    assert BENCH.channels["oil_temperature"].resolution == pytest.approx(0.25)


def test_the_relief_valve_is_set_by_the_operator() -> None:
    relief = BENCH.actuators["relief_valve"]
    assert (relief.by, relief.kind) == ("operator", "level")
    assert relief.prompt
    assert BENCH.roles.set_pressure is not None
    assert BENCH.roles.set_pressure.channel == "supply_pressure"


def test_the_safe_state_is_heater_off_and_valve_neutral() -> None:
    assert BENCH.safe_state == {"heater": 0.0, "valve": 0.0}
    assert BENCH.monitor_rate == 10.0
    assert BENCH.backend.kind == "simulated"


#: ranges of the published campaign, with the strokes of its model
CAMPAIGN = {
    "oil_temperature": (293.15, 353.15),
    "supply_pressure": (0.0, 50.5e5),
    "position": (0.0, 0.130),
}
#: the fastest changes: heaters and pump, the pump's flow into the smaller chamber
FASTEST = {"oil_temperature": 0.03, "position": 0.16}


@pytest.mark.parametrize("name", sorted(BENCH.limits))
def test_the_published_campaign_trips_no_limit(name: str) -> None:
    limit = BENCH.limits[name]
    channel = BENCH.channels[limit.channel]
    error = 6 * (channel.noise or 0.0) + channel.resolution
    if limit.of_rate:
        fastest = FASTEST[limit.channel] + 2 * error / limit.over
        assert limit.threshold > fastest if limit.bound == "rate_above" else limit.threshold < -fastest
    else:
        low, high = CAMPAIGN[limit.channel]
        assert limit.threshold > high + error if limit.bound == "above" else limit.threshold < low - error


@pytest.mark.parametrize("rig", [BENCH, INSTRUMENTED], ids=lambda rig: rig.name)
def test_a_broken_wire_reads_an_impossible_value(rig: Rig) -> None:
    for name, channel in rig.channels.items():
        dead = channel.raw.high if name == "oil_temperature" else channel.raw.low
        assert not channel.possible(channel.value_from_raw(dead)), name


def test_the_instrumented_bench_is_the_same_with_two_channels_more() -> None:
    added = {"pressure_a", "pressure_b"}
    assert set(INSTRUMENTED.channels) - set(BENCH.channels) == added
    assert {name: each for name, each in INSTRUMENTED.channels.items() if name not in added} == BENCH.channels
    same = (
        "actuators",
        "roles",
        "geometry",
        "constants",
        "options",
        "safe_state",
        "simulation",
        "model",
        "oil",
    )
    for field in same:
        assert getattr(INSTRUMENTED, field) == getattr(BENCH, field), field
    assert BENCH.limits.items() <= INSTRUMENTED.limits.items()


def test_geometry_and_constants_of_the_bench_are_known_to_its_model() -> None:
    assert set(BENCH.geometry) == set(GEOMETRY["hydraulic_cylinder"])
    assert set(BENCH.constants) <= set(CONSTANTS["hydraulic_cylinder"])


@pytest.mark.parametrize("family", ["hydraulic_cylinder", "heater_board"])
def test_the_model_family_and_the_rig_file_use_the_same_names(family: str) -> None:
    declared = find_family(family)
    rig_names = {model: rig for rig, models in declared.rig_names.items() for model in models}
    known = {**GEOMETRY[family], **CONSTANTS[family]}
    for parameter in declared.parameters:
        for name in {parameter.name, rig_names.get(parameter.name, parameter.name)} & set(known):
            dimension = parse_unit(known[name].unit).dimension
            assert dimension == parse_unit(parameter.unit).dimension, parameter.name
        assert {parameter.name, rig_names.get(parameter.name)} & set(known), parameter.name
