"""The equation that lacks a term is named, on data of the separate bench and of other benches."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.analysis.agreement.slot_disturbance import disturbance_columns, disturbed
from rigctl.analysis.agreement.slot_evidence import SlotEvidence, disturbance_normals, slot_evidence
from rigctl.analysis.linear.linearisation import linearise
from rigctl.dataset import open_run
from rigctl.dataset.importing.bring_in import import_file
from rigctl.engine.one_thread import one_thread
from rigctl.files.shipped import shipped
from rigctl.model import load_model
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.fit.problem import make_problem
from rigctl.model.measured import read_measurements
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.model.model import Model
from rigctl.noise import ChannelNoise, NoiseModel
from rigctl.rig import load_rig
from rigctl_validation.bench.campaign import Campaign
from rigctl_validation.hidden_effect import hide
from rigctl_validation.hidden_library import find_hidden
from rigctl_validation.in_memory import measure
from rigctl_validation.work import bench_model

SIGMA = {
    "oil_temperature": 0.1,
    "supply_pressure": 8e3,
    "position": 1e-4,
    "pressure_a": 1e4,
    "pressure_b": 1e4,
}
FLOWS = {"flow_p_to_a", "flow_p_to_b", "flow_a_to_tank", "flow_b_to_tank"}
WANTED = 5.0


def fitted(model: Model, measurements: Measurements, sigma: dict[str, float], spacing: float) -> FitResult:
    noise = NoiseModel(tuple(ChannelNoise(name, sigma[name]) for name in measurements.outputs), spacing)
    with one_thread():
        return fit(make_problem(model, measurements, noise, [record.here for record in measurements.records]))


def of_campaign(effect: str | None, share: float, chambers: bool, seed: int = 1) -> FitResult:
    """Six strokes of the separate bench, which hides a share of an effect's typical size."""
    campaign = Campaign(
        seed=seed,
        temperatures=(20.0, 50.0, 80.0),
        pressures=(20.0, 50.0),
        chamber_pressures=chambers,
    )
    if effect is not None:
        hidden = find_hidden(effect)
        campaign = hide(campaign, [(hidden, share * hidden.typical)], "other")
    model, rig = bench_model(chambers)
    return fitted(model, measure(campaign, model, rig), SIGMA, 0.01)


@pytest.fixture(scope="module")
def nothing() -> FitResult:
    return of_campaign(None, 0.0, chambers=False)


def names(found: tuple[SlotEvidence, ...]) -> list[str]:
    return [one.slot for one in found]


@pytest.mark.parametrize("seed", [1, 2])
def test_without_a_hidden_effect_no_term_is_needed(seed: int) -> None:
    found = slot_evidence(of_campaign(None, 0.0, chambers=False, seed=seed))
    assert found[0].log_evidence < WANTED
    assert not any(one.alike for one in found)
    assert [one.log_evidence for one in found] == sorted((one.log_evidence for one in found), reverse=True)


def test_a_leaking_valve_is_located_in_its_four_flows() -> None:
    first = slot_evidence(of_campaign("valve_leakage", 0.1, chambers=True))[0]
    assert set(first.slot.split(" + ")) == FLOWS
    assert first.log_evidence > WANTED
    assert first.share > 0.9
    assert first.meaning.startswith("from the supply into the cap side; ")


def test_friction_is_located_as_a_force_like_a_load() -> None:
    first = slot_evidence(of_campaign("coulomb_friction", 1.0, chambers=True))[0]
    assert first.slot == "friction"
    assert first.alike == ("load",)
    assert first.log_evidence > WANTED


@pytest.mark.parametrize(
    ("effect", "slot", "chambers"),
    [
        # without the chamber pressures, backlash and a late valve look alike
        ("position_backlash", "position_reading", True),
        ("pressure_gain", "supply_pressure_reading", False),
    ],
)
def test_an_error_of_a_sensor_is_located_in_its_reading(effect: str, slot: str, chambers: bool) -> None:
    found = slot_evidence(of_campaign(effect, 1.0, chambers=chambers))
    assert found[0].slot == slot
    assert found[0].log_evidence > WANTED
    assert found[0].log_evidence > found[1].log_evidence + WANTED


def test_a_thermal_drift_of_the_position_sensor_is_among_the_inseparable_leading_slots() -> None:
    """A position that reads short when warm looks like hot oil that flows more slowly."""
    found = slot_evidence(of_campaign("position_thermal_drift", 1.0, chambers=True))
    assert "position_reading" in {found[0].slot, *found[0].alike}
    assert "friction" not in found[0].alike


def test_slots_without_influence_on_the_readings_are_left_out(nothing: FitResult) -> None:
    shown = names(slot_evidence(nothing))
    assert "pressure_a_reading" not in shown  # not recorded
    assert "viscosity" not in shown  # no term of the textbook model contains it
    assert len(shown) == len(set(shown))


def test_disturbance_columns_add_up_to_the_derivative_of_the_engine(nothing: FitResult) -> None:
    """Tents at all knots are a constant: a disturbance of the load by 1 N is a load of 1 N."""
    problem = nothing.problem
    found = disturbance_columns(nothing, problem, disturbed(problem, 7))
    part = next(part for part in found.parts if part.slot.name == "load")
    names_ = problem.compiled.system.parameter_names
    base = problem.base.copy()
    for unknown, value in zip(problem.shared, nothing.values, strict=True):
        base[names_.index(unknown.name)] = value
    at = problem.with_shared((), base)
    slopes = at.simulate(np.empty(0), nothing.local, ["load_force"]).require().sensitivities
    for mine, theirs in zip(found.readings, slopes, strict=True):
        expected = np.take(theirs, problem.channels, axis=1)[:, :, 0]
        size = np.abs(expected).max(axis=0)
        apart = np.abs(mine[:, :, part.columns].sum(axis=2) - expected) / size
        assert apart.mean(axis=0).max() < 2e-3
        assert apart.max() < 0.2  # where a pressure jumps, the two take other steps
    reading = next(p for p in found.parts if p.slot.name == "position_reading" and p.view == "time")
    position = problem.measurements.outputs.index("position")
    assert found.readings[0][:, position, reading.columns].sum(axis=1) == pytest.approx(1.0)
    assert found.courses[0][:, reading.columns].sum(axis=1) == pytest.approx(1.0)


def test_without_a_fit_there_are_no_nuisance_parameters(nothing: FitResult) -> None:
    """As in the linearisation, a misfit that free parameters could absorb remains."""
    taken = replace(nothing, solution=None)
    columns = disturbance_columns(nothing, nothing.problem, disturbed(nothing.problem, 7))
    free, held = (disturbance_normals(fit, nothing.problem, columns) for fit in (nothing, taken))
    assert free.unknowns.matrix.shape[0] == len(linearise(nothing, nothing.problem, ()).nuisances) > 0
    assert held.unknowns.matrix.shape[0] == len(linearise(taken, nothing.problem, ()).nuisances) == 0
    assert held.cross.shape[2] == 0
    assert held.excess > free.excess - 2.0 * free.unknowns.matrix.shape[0]


def test_long_records_are_interpolated(nothing: FitResult, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = disturbance_columns(nothing, nothing.problem, disturbed(nothing.problem, 7))
    monkeypatch.setattr(sys.modules[disturbance_columns.__module__], "_SAMPLES", 180)
    some = disturbance_columns(nothing, nothing.problem, disturbed(nothing.problem, 7))
    for mine, theirs in zip(some.readings, whole.readings, strict=True):
        assert mine.shape == theirs.shape
        size = np.abs(theirs).max(axis=(0, 2))[None, :, None] + 1e-300
        assert np.mean(np.abs(mine - theirs) / size) < 2e-3


@pytest.fixture
def brought_in(tmp_path: Path) -> Callable[[str, str | None], Path]:
    def bring(name: str, rig: str | None) -> Path:
        bench = load_rig(shipped("rigs", rig)) if rig is not None else None
        return import_file(shipped("data", name), bench, tmp_path).path

    return bring


def test_the_missing_coupling_of_the_heaters_is_located_in_the_real_board(
    brought_in: Callable[[str, str | None], Path],
) -> None:
    """Real measurements: heater 1 was stepped, and heater 2, which was off, became warm."""
    run = open_run(str(brought_in("heater-board-steps.csv", "heater-board.yaml")))
    model = load_model(shipped("models", "heater-board.yaml"))
    measurements = read_measurements(model, [run]).only(range(0, 20, 5))
    result = fitted(model, measurements, {"temperature_1": 0.3, "temperature_2": 0.3}, 1.0)
    found = {one.slot: one for one in slot_evidence(result)}
    assert {"heat_1", "heat_2", "temperature_1_reading", "heat_1 + heat_2"} <= set(found)
    assert found["heat_2"].log_evidence > WANTED
    assert "heater_power_2" in found["heat_2"].alike
    assert all(0.0 <= one.share <= 1.0 for one in found.values())


def test_the_wrong_law_of_a_table_is_located(brought_in: Callable[[str, str | None], Path]) -> None:
    run = open_run(str(brought_in("hl32-viscosity.csv", None)))
    model = load_model(shipped("models", "hl32-oil.yaml"))
    measurements = read_measurements(model, [run])
    found = slot_evidence(fitted(model, measurements, {"kinematic_viscosity": 5e-8}, 1.0))
    assert {"viscosity", "temperature"} <= {found[0].slot, *found[0].alike}
    assert found[0].when == "row"


def tank_record(values: np.ndarray, times: np.ndarray, inflow: float) -> MeasuredRecord:
    return MeasuredRecord(
        run="made",
        index=0,
        label="made/1",
        times=times,
        switch_times=np.array([0.0, 300.0]),
        switch_half=np.zeros(2),
        inputs=np.array([[inflow, 0.0, 288.15, 293.15], [0.0, 0.0, 288.15, 293.15]]),
        values=values,
        condition={"inflow": inflow},
        group=0,
        phase=np.searchsorted([300.0], times, side="left").astype(np.intp),
        phases=("fill", "drain"),
    )


def test_a_heat_input_from_the_room_is_located_in_a_family_of_the_user(tmp_path: Path) -> None:
    path = tmp_path / "tank.yaml"
    family = shipped("models", "families", "water-tank.yaml")
    (tmp_path / "family.yaml").write_text(family.read_text(encoding="utf-8"), encoding="utf-8", newline="\n")
    text = "model: family.yaml\nparameters:\n  orifice_area: {value: 20 mm^2, fit: true}\n"
    path.write_text(text, encoding="utf-8", newline="\n")
    model = load_model(path)
    times, rng = np.arange(0.0, 600.0, 5.0), np.random.default_rng(4)
    start = np.column_stack([np.full(times.size, 0.2), np.full(times.size, 293.15)])
    blank = tuple(tank_record(start, times, flow / 60e3) for flow in (1.0, 2.0, 3.0))
    inputs = tuple(item.name for item in model.family.inputs)
    measurements = Measurements(("level", "temperature"), ("mm", "degC"), inputs, blank, None, ())
    sigma = {"level": 5e-4, "temperature": 0.02}
    noise = NoiseModel(tuple(ChannelNoise(name, size) for name, size in sigma.items()), 5.0)
    problem = make_problem(model, measurements, noise, [record.here for record in blank])
    warm = tuple(warmer(record, 15.0) for record in blank)
    values = np.array([unknown.start for unknown in problem.shared])
    local = [np.array([one.unknown.start for one in own]) for own in problem.local]
    warmed = replace(problem, measurements=replace(measurements, records=warm))
    truth = warmed.simulate(values, local).require().outputs
    scale = list(sigma.values())
    made = tuple(
        replace(record, values=output[:, problem.channels] + rng.normal(0.0, scale, start.shape))
        for record, output in zip(blank, truth, strict=True)
    )
    found = slot_evidence(fitted(model, replace(measurements, records=made), sigma, 5.0))
    assert found[0].slot == "heat"
    assert found[0].log_evidence > found[1].log_evidence + WANTED
    assert {one.slot for one in found} == {"leak", "orifice", "heat", "level_reading"}


def warmer(record: MeasuredRecord, kelvin: float) -> MeasuredRecord:
    """The record in a room warmer than noted while the tank was filled."""
    inputs = record.inputs.copy()
    inputs[0, 3] += kelvin
    return replace(record, inputs=inputs)
