"""Selection of records by a condition, and the variables that distinguish records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.model.measured.groups import group_numbers
from rigctl.model.measured.hold_out import chosen, held_out
from rigctl.model.measured.phases import phases_of
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.physics.families import find_family
from rigctl.rig import load_rig

UNITS = {"oil_temperature": "degC", "relief_valve": "bar"}
CONDITIONS = [(t, p) for t in (20.0, 40.0, 60.02) for p in (20.0, 50.0)]


def measurements() -> Measurements:
    records = [record(k, t + 273.15, p * 1e5) for k, (t, p) in enumerate(CONDITIONS)]
    return Measurements(("position",), ("mm",), ("valve",), tuple(records), None, ("run",))


def record(index: int, oil: float, supply: float) -> MeasuredRecord:
    times = np.arange(20) * 0.01
    return MeasuredRecord(
        run="run",
        index=index,
        label=f"run/{index + 1}",
        times=times,
        switch_times=np.array([0.0, 0.1]),
        switch_half=np.zeros(2),
        inputs=np.array([[0.0], [1.0]]),
        values=np.linspace(0.0, 1.0, 20)[:, None],
        condition={"oil_temperature": oil, "relief_valve": supply},
        group=0,
        phase=(times > 0.1).astype(np.intp),
        phases=("wait", "extend"),
    )


def test_equality_of_temperatures_holds_within_a_kelvin() -> None:
    assert held_out(measurements(), "oil_temperature == 60 degC", UNITS) == (4, 5)


@pytest.mark.parametrize("name", ["oil", "temperature", "oil_temperature"])
def test_a_condition_accepts_the_usual_names_of_a_variable(name: str) -> None:
    assert held_out(measurements(), f"{name} > 50 degC and supply == 20 bar", UNITS) == (4,)


def test_records_are_chosen_by_a_command_that_is_no_condition_of_theirs() -> None:
    """Where a temperature is measured, it alone distinguishes imported records: "unknown name 'valve'"."""
    every = measurements()
    records = tuple(
        replace(one, inputs=np.array([[0.0], [0.5 + 0.1 * k]])) for k, one in enumerate(every.records)
    )
    driven = replace(every, records=records, rig=load_rig(shipped("rigs", "hl32-bench.yaml")))
    assert held_out(driven, "valve > 0.75", UNITS) == (3, 4, 5)
    assert chosen(driven, "valve == 0.5 and oil < 30 degC", UNITS) == (0,)
    unrecorded = replace(driven, records=tuple(replace(one, unrecorded=("valve",)) for one in records))
    with pytest.raises(RigctlError, match="unknown name"):
        held_out(unrecorded, "valve > 0.75", UNITS)


def test_records_are_counted_from_one() -> None:
    assert held_out(measurements(), "record == 1 or record == 6", UNITS) == (0, 5)


def test_without_a_condition_no_record_is_held_out_and_all_are_selected() -> None:
    assert held_out(measurements(), None, UNITS) == ()
    assert chosen(measurements(), None, UNITS) == tuple(range(6))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("oil_temperature == 90 degC", "no record is held out"),
        ("oil_temperature > 0 degC", "every record out"),
        ("oil_temperature + 1 K", "records are chosen by a condition, got 'oil_temperature + 1 K'"),
        ("oil_temprature > 50 degC", "did you mean 'oil_temperature'"),
        ("oil_temperature > 50 bar", "cannot compare a temperature and a pressure"),
    ],
)
def test_an_invalid_condition_is_refused_with_its_reason(text: str, said: str) -> None:
    with pytest.raises(RigctlError) as caught:
        held_out(measurements(), text, UNITS)
    assert said in str(caught.value)


def test_replicates_share_condition_commands_and_start() -> None:
    records = list(measurements().records)
    assert group_numbers([*records, records[2]]) == [0, 1, 2, 3, 4, 5, 2]


def test_phases_are_named_after_the_motion_that_the_valve_commands() -> None:
    family = find_family("hydraulic_cylinder")
    names = [item.name for item in family.inputs]
    row = np.zeros(len(names))
    rows = []
    for valve in (0.0, 1.0, 0.0, -1.0):
        row = row.copy()
        row[names.index("valve")] = valve
        rows.append(row)
    times = np.linspace(0.0, 4.0, 41)
    phase, found = phases_of(times, np.array([0.0, 1.0, 2.0, 3.0]), np.array(rows), family, [""] * len(names))
    assert found == ("wait", "extend", "hold", "retract")
    assert phase[0] == 0
    assert phase[10] == 0, "a sample at a switch shows what was before it"
    assert phase[11] == 1
    assert phase[-1] == 3


def test_a_record_without_switches_is_divided_into_early_middle_and_late() -> None:
    family = find_family("heater_board")
    times = np.arange(90.0)
    phase, found = phases_of(times, np.zeros(1), np.ones((1, 3)), family, ["%", "%", "K"])
    assert found == ("early", "middle", "late")
    assert np.bincount(phase).tolist() == [10, 20, 60]


def test_a_command_at_every_sample_of_a_long_record_begins_a_period_each() -> None:
    family = find_family("heater_board")
    count = 60_000
    times = np.arange(float(count))
    rows = np.zeros((count, 3))
    rows[:, 0] = np.arange(count) % 2  # percent, with which most commands repeat an earlier one
    phase, found = phases_of(times, times - 0.5, rows, family, ["%", "%", "K"])
    assert np.array_equal(phase, np.arange(count))
    assert len(set(found)) == count, "each has a name of its own"
    assert found[0] == "start"
    assert found[-1].endswith(f" {count // 2}")


@given(phase=st.lists(st.integers(0, 6), min_size=1, max_size=40))
def test_the_samples_of_each_period_are_those_with_its_number(phase: list[int]) -> None:
    record = replace(measurements().records[0], phase=np.array(phase, dtype=np.intp), phases=tuple("abcdefg"))
    for number, samples in enumerate(record.samples_of_phases):
        assert samples.tolist() == np.flatnonzero(record.phase == number).tolist()
