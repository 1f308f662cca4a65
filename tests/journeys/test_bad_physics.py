"""Mistakes in the physics of a model get clear messages from the commands."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from commands import call, create_strokes, refusal, textbook_copy
from rigctl.errors import ExitCode

pytestmark = pytest.mark.usefixtures("inside")

EFFECT = "effect: mine\nsummary: A test.\nslot: {slot}\nterm: '{term}'\nparameters: {parameters}\n"
PUSH = "{push: {null_value: 0 N, start: 1e9 N, bounds: [0 N, 1e12 N]}}"


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with four strokes at 20 degC."""
    return create_strokes(tmp_path_factory.mktemp("bad-physics"), "20 degC", seed=3)


def strokes() -> str:
    """The run of the fixture."""
    return max(Path("runs").glob("*stroke-campaign")).name


def effect_file(slot: str, term: str, parameters: str = PUSH) -> str:
    Path("mine.yaml").write_text(EFFECT.format(slot=slot, term=term, parameters=parameters), encoding="utf-8")
    return "mine.yaml"


def test_parameters_outside_their_bounds_are_refused() -> None:
    simulate = ("simulate", "procedures/quick-check.yaml", "--with")
    said = refusal(*simulate, "piston_leakage:clearance=9 mm")
    assert "piston_leakage: clearance: out of bounds, got '9 mm'; expected" in said
    model = textbook_copy("wide", ("4.05 mm^2", "4 m^2"))
    assert re.search(
        r"wide\.yaml:\d+:22: flow_area is out of bounds, got '4 m\^2'", refusal("model", "show", model)
    )


def test_contradictory_effects_are_refused() -> None:
    both = ("--with", "barus", "--with", "modulus_viscosity")
    said = refusal("simulate", "procedures/quick-check.yaml", *both)
    assert "barus and modulus_viscosity contradict one another" in said
    model = textbook_copy("both", ("effects: {}", "effects: {barus: {}, modulus_viscosity: {}}"))
    said = refusal("model", "show", model)
    assert re.search(r"both\.yaml:\d+:1: barus and modulus_viscosity contradict", said)


def test_an_unknown_slot_of_an_effect_is_reported_with_its_place() -> None:
    said = refusal("effects", "check", effect_file("frction", "push*velocity/(1 m/s)"))
    assert "mine.yaml:3:7: unknown slot of hydraulic_cylinder, got 'frction'" in said
    assert "friction" in said


def test_a_parameter_without_influence_is_reported_and_keeps_its_value() -> None:
    """The heaters are off in these records: their lag has no influence; other parameters are not affected."""
    lag = "effects: {heater_lag: {lag: {value: 30 s, fit: true}}}"
    model = textbook_copy("lagged", ("effects: {}", lag))
    done = call("compare", strokes(), "--model", model)
    assert done.exit_code == 0, done.output
    assert "heater_lag.lag affects none of these readings and keeps its value" in done.output


def test_a_diverging_simulation_is_reported_with_state_and_time() -> None:
    file = effect_file("friction", "-push*velocity^3/(1 m^3/s^3)")
    said = refusal("effects", "check", file, exit_code=ExitCode.FAILED)
    assert "could not be simulated: the derivative of velocity is not a finite number at t = " in said
    done = call("simulate", "procedures/quick-check.yaml", "--with", file)
    assert done.exit_code == ExitCode.FAILED
    assert (
        "the simulation broke down: the derivative of velocity is not a finite number at t = " in done.output
    )
    run = json.loads((max(Path("runs").iterdir()) / "run.json").read_text(encoding="utf-8"))
    assert run["status"] == "failed"
