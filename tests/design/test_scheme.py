"""The variables of a design, and the agreement of the written procedure with the simulation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.design.procedure_text import Called, Writer
from rigctl.design.recipe import Recipe, Stage
from rigctl.design.refusals import NothingToSet
from rigctl.design.rig_time import RigTime, forecast
from rigctl.design.scheme import schemes_of
from rigctl.files.shipped import shipped
from rigctl.model.inputs import InputSource, input_sources
from rigctl.model.measured.record import MeasuredRecord
from rigctl.plan import Leaf, RecordNode, walk
from rigctl.procedure.expand import expand
from rigctl.procedure.load import parse_procedure
from rigctl.rig import Rig, load_rig
from rigctl.rig.load import parse_rig
from rigctl.steps.heat import Heat
from rigctl.steps.move import Move
from rigctl.steps.set_pressure import SetLevel
from rigctl.steps.wait import Wait
from rigctl.steps.waveform.step import Waveform


def stroke(inputs: int, *, valve: int = 0) -> MeasuredRecord:
    """Wait, extend, hold closed, retract."""
    rows = np.zeros((4, inputs))
    rows[:, valve] = [0.0, 1.0, 0.0, -1.0]
    times = np.arange(0.0, 3.75, 0.01)
    return MeasuredRecord(
        run="r",
        index=0,
        label="r/1",
        times=times,
        switch_times=np.array([0.0, 0.2, 1.25, 2.25]),
        switch_half=np.zeros(4),
        inputs=rows,
        values=np.zeros((times.size, 3)),
        condition={},
        group=0,
        phase=np.zeros(times.size, dtype=np.intp),
        phases=("all",),
    )


@pytest.fixture(scope="module")
def stage() -> Stage:
    rig = load_rig(shipped() / "rigs" / "hl32-bench.yaml")
    sources = input_sources("hydraulic_cylinder", rig)
    readings = {"oil_temperature": 293.15, "supply_pressure": 30e5, "position": 0.0}
    return Stage(rig, sources, {"heater_power": 0.0, "ambient_temperature": 295.15, "pump": 1.0}, readings)


@settings(max_examples=20)
@given(which=st.integers(0, 2), seed=st.integers(0, 10**6))
def test_a_written_record_has_the_switches_and_the_operating_point_simulated(
    stage: Stage, which: int, seed: int
) -> None:
    """The procedure is parsed again: switching times of the valve, and operating point."""
    scheme = schemes_of(stage, [stroke(5)])[which]
    recipe = scheme.recipe(np.random.default_rng(seed).uniform(size=len(scheme.free)).tolist())
    course = stage.course(recipe)
    writer = Writer(stage.rig, called=Called("oil", "supply"))
    plan = expand(parse_procedure(writer.text([recipe])), stage.rig)
    (record,) = [node for node in walk(plan.root) if isinstance(node, RecordNode)]
    clock, switches = 0.0, []
    for node in walk(record.body):
        if isinstance(node, Leaf) and isinstance(node.action, Move | Wait):
            value = node.action.value if isinstance(node.action, Move) else 0.0
            if (switches[-1][1] if switches else 0.0) != value:
                switches.append((clock, value))
            clock += node.action.duration or 0.0
    assert clock == pytest.approx(course.length)
    simulated = list(zip(course.switch_times, course.inputs[:, 0], strict=True))
    simulated = simulated if simulated[0][1] else simulated[1:]
    assert switches == [(pytest.approx(time), value) for time, value in simulated]
    actions = [node.action for node in walk(plan.root) if isinstance(node, Leaf)]
    (pressure,) = [one.to for one in actions if isinstance(one, SetLevel)]
    (temperature,) = [one.to for one in actions if isinstance(one, Heat)]
    assert course.inputs[:, 2] == pytest.approx(pressure)
    assert course.readings["oil_temperature"] == pytest.approx(temperature)


def heated(seconds: float) -> MeasuredRecord:
    """A record of the heater board: one step of one heater."""
    times = np.arange(0.0, seconds)
    return MeasuredRecord(
        run="a",
        index=0,
        label="step",
        times=times,
        switch_times=np.array([0.0, 60.0]),
        switch_half=np.zeros(2),
        inputs=np.array([[0.0, 0.0, 295.15], [0.4, 0.0, 295.15]]),
        values=np.zeros((times.size, 2)),
        condition={},
        group=0,
        phase=np.zeros(times.size, dtype=np.intp),
        phases=("all",),
    )


@settings(max_examples=20)
@given(driven=st.sampled_from(["heater_1", "heater_2"]), seed=st.integers(0, 10**6))
def test_a_multisine_is_carried_out_as_it_was_simulated(driven: str, seed: int) -> None:
    """The procedure is parsed again, with the rig's checks of the waveform's range, rate and sampling."""
    rig = load_rig(shipped() / "rigs" / "heater-board.yaml")
    sources = input_sources("heater_board", rig)
    stage = Stage(rig, sources, {"ambient": 295.15}, {"temperature_1": 300.0, "temperature_2": 300.0})
    (scheme,) = [one for one in schemes_of(stage, [heated(600.0)]) if one.name == f"multisine of {driven}"]
    recipe = scheme.recipe(np.random.default_rng(seed).uniform(size=len(scheme.free)).tolist())
    plan = expand(parse_procedure(Writer(rig).text([recipe])), rig)
    (record,) = [node for node in walk(plan.root) if isinstance(node, RecordNode)]
    (waveform,) = [node.action for node in walk(record.body) if isinstance(node, Leaf)]
    assert isinstance(waveform, Waveform)
    given_then = [one for one in waveform.course(None) if one[0] < waveform.duration - 1e-9]
    course = stage.course(recipe)
    assert course.length == pytest.approx(waveform.duration)
    (column,) = [k for k, source in enumerate(sources) if [name for name, _ in source.actuators] == [driven]]
    factor = dict(sources[column].actuators)[driven]
    held = np.searchsorted(course.switch_times, [time + 1e-6 for time, _ in given_then], side="right") - 1
    expected = [factor * value for _, value in given_then]
    assert course.inputs[held, column] == pytest.approx(expected, rel=1e-6, abs=1e-9)
    assert len(course.switch_times) <= len(given_then)


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6))
def test_the_rig_time_of_recipes_agrees_with_the_preview(stage: Stage, seed: int) -> None:
    rng = np.random.default_rng(seed)
    schemes = schemes_of(stage, [stroke(5)])

    def drawn() -> list[Recipe]:
        return [one.recipe(rng.uniform(size=len(one.free)).tolist()) for one in schemes]

    writer = Writer(stage.rig)
    tried = ((one, forecast(writer, one)) for one in (drawn() for _ in range(50)))
    recipes, found = next(pair for pair in tried if pair[1] is not None)  # the rig refuses most
    assert found is not None
    assert sum(RigTime(stage.rig).in_order(recipes)) == pytest.approx(found.seconds, rel=1e-9)
    order = RigTime(stage.rig).quickest(recipes)
    assert order.seconds <= sum(RigTime(stage.rig).in_order(recipes)) + 1e-9


def test_a_rig_without_actuators_has_no_condition_to_set() -> None:
    rig: Rig = parse_rig("name: pump\nchannels: {pressure: {unit: bar, quantity: pressure}}\n")
    stage = Stage(rig, (InputSource("pressure", 150e5, channel="pressure"),), {}, {"pressure": 150e5})
    with pytest.raises(NothingToSet, match="no condition of the rig 'pump' can be set"):
        schemes_of(stage, [stroke(1)])
