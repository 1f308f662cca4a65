"""Derivatives through an FMU, which are differences made as few times as possible, beside the exact ones of
the same motor in equations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fmu.motor_bench import EQUATIONS, FAMILY, MODEL, RIG
from foreign_fmus import motor_fmu
from rigctl.effects import Effect
from rigctl.effects.user import parse_effect
from rigctl.engine import cascade
from rigctl.engine.compile import CompiledSystem, compile_system
from rigctl.engine.differences import Step
from rigctl.engine.excitation import Excitation
from rigctl.engine.simulate import simulate
from rigctl.engine.system import Delay, after
from rigctl.engine.trajectories import Trajectories
from rigctl.fmu.archive import digest
from rigctl.fmu.program import allow
from rigctl.foreign.pool import Pool, pool_of
from rigctl.model import load_model
from rigctl.model.build import build_system
from rigctl.units import parse_unit
from systems import needs_compiler

pytestmark = needs_compiler

Floats = NDArray[np.float64]

PERIOD = 10e-3
#: switches to a larger value, to a smaller one and to 0, each between two samples
SWITCHES = np.array([0.0, 0.1234, 0.2561, 0.3817, 0.4978])
VOLTAGES = np.array([0.0, 9.0, -6.0, 6.0, 0.0])
#: what moves them: delays of the three kinds, and all of them together
SHIFTS = np.array([[0.0, 0.0, 0.0, 0.0], [0.01, 0, 0, 1], [0, 0.01, 0, 1], [0.01, 0, 0, 1], [0, 0, 0.01, 1]])
MOVED = ("up", "down", "off", "all")
PARAMETERS = ("resistance", "kt", "damping")
INITIAL = ("current", "speed")
LATE = {"dead_time_of_voltage": {"time": 0.0}, "lag_of_voltage": {"lag": 0.0}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    place = tmp_path_factory.mktemp("motor")
    motor_fmu(place / "motor.fmu")
    files = {"family": FAMILY, "equations": EQUATIONS, "rig": RIG}
    files |= {"model": f"model: family.yaml\n{MODEL}", "written": f"model: equations.yaml\n{MODEL}"}
    for name, text in files.items():
        (place / f"{name}.yaml").write_text(text, encoding="utf-8")
    allow(digest(place / "motor.fmu"))
    yield place


def compiled(folder: Path, name: str, effects: dict[str, dict[str, float]], *own: Effect) -> CompiledSystem:
    model = load_model(folder / f"{name}.yaml")
    return compile_system(build_system(model.family, effects, model.rig, own_effects=own))


def record(system: CompiledSystem, *, shifts: Floats | None = SHIFTS, **changed: float) -> Excitation:
    """The record for one of the two systems, whose states and parameters are in orders of their own."""
    known = dict(zip(system.system.parameter_names, system.system.nominal, strict=True)) | changed
    initial = np.array([0.0 for _ in system.system.states])
    return Excitation(
        PERIOD * np.arange(61),
        SWITCHES,
        VOLTAGES[:, None],
        initial,
        np.array([known[name] for name in system.system.parameter_names]),
        "one",
        shifts,
    )


def at_rest(one: Excitation, name: str) -> Excitation:
    """A record of the same samples in which nothing is switched."""
    shifts = None if one.shifts is None else one.shifts[:1]
    return replace(one, switch_times=SWITCHES[:1], inputs=VOLTAGES[:1, None], shifts=shifts, name=name)


def simulated(
    system: CompiledSystem, excitation: Excitation, *parameters: str, before: Sequence[Excitation] = ()
) -> Trajectories:
    moving = () if excitation.shifts is None else MOVED[: excitation.shifts.shape[1]]
    return simulate(
        system,
        [*before, excitation],
        columns=parameters,
        initial_columns=list(INITIAL),
        shift_columns=moving,
    ).require()


def apart(one: Floats, other: Floats) -> float:
    """By how much two columns differ, as a share of the second."""
    return float(np.linalg.norm(one - other) / np.linalg.norm(other))


def in_order(found: Trajectories, record: int = -1) -> Floats:
    """(samples, outputs, columns) with the outputs by their names."""
    order = [found.output_names.index(name) for name in ("current", "speed")]
    return np.asarray(found.sensitivities[record][:, order])


@pytest.mark.parametrize(
    "shifts",
    [SHIFTS, np.hstack([np.zeros((5, 1)), np.diag([0.0, 1.0, 0.7, 1.0, 1.3])[:, 1:3]])],
    ids=["fewer groups than columns", "each by itself"],
)
def test_every_column_is_that_of_the_equations(folder: Path, shifts: Floats) -> None:
    through, exact = (compiled(folder, name, {}) for name in ("model", "written"))
    found = in_order(simulated(through, record(through, shifts=shifts), *PARAMETERS))
    right = in_order(simulated(exact, record(exact, shifts=shifts), *PARAMETERS))
    assert found.shape == right.shape
    for column in range(right.shape[2]):
        for output in range(2):
            if np.any(right[:, output, column]):
                assert apart(found[:, output, column], right[:, output, column]) < 0.01
            else:
                assert not found[:, output, column].any()


def test_a_delay_and_a_short_lag_of_a_command_are_what_its_switches_do_together(folder: Path) -> None:
    through = compiled(folder, "model", LATE)
    found = in_order(simulated(through, record(through), *(f"{e}.{p}" for e, ps in LATE.items() for p in ps)))
    dead, lag, *_, every = (found[:, :, k] for k in range(found.shape[2]))
    np.testing.assert_allclose(dead, every, rtol=1e-12, atol=1e-12 * np.abs(every).max())
    assert apart(lag, every) < 0.02


@pytest.mark.parametrize("shifts", [SHIFTS, None], ids=["switches that move", "switches that are known"])
def test_steps_are_chosen_on_records_that_show_a_column(folder: Path, shifts: Floats | None) -> None:
    """The first two records are at rest, where neither a switch nor a parameter has a derivative."""
    through, exact = (compiled(folder, name, {}) for name in ("model", "written"))
    found, right = (
        in_order(simulated(one, last, *PARAMETERS, before=[at_rest(last, name) for name in ("a", "b")]))
        for one in (through, exact)
        for last in [record(one, shifts=shifts)]
    )
    assert through.cascade is not None
    assert {through.cascade.steps[name] for name in PARAMETERS} == {Step(1.0)}
    for column in range(right.shape[2]):
        for output in range(2):
            assert apart(found[:, output, column], right[:, output, column]) < 0.01


#: a direct share of the voltage in a reading, as crosstalk of its cable
CROSSTALK = """
effect: crosstalk
summary: The reading of the speed has a share of the voltage.
slot: speed_reading
term: share*voltage
parameters: {share: {null_value: 0 rad/(V*s), start: 2 rad/(V*s), bounds: [-9 rad/(V*s), 9 rad/(V*s)]}}
"""


@pytest.mark.parametrize("late", [0.0, 4e-3])
def test_a_dead_time_delays_what_a_reading_has_of_the_command(folder: Path, late: float) -> None:
    """By 4 ms, one command acts after the sample that it precedes, another shortly after one."""
    effects = {"crosstalk": {"share": 2.0}, "dead_time_of_voltage": {"time": late}}
    found, right = (
        simulated(system, record(system, shifts=None), "dead_time_of_voltage.time", "crosstalk.share")
        for name, family in (("model", "family"), ("written", "equations"))
        for own in [parse_effect(CROSSTALK + f"family: {family}.yaml\n", folder / "crosstalk.yaml")]
        for system in [compiled(folder, name, effects, own)]
    )
    speeds = [one.outputs[0][:, one.output_names.index("speed")] for one in (found, right)]
    np.testing.assert_allclose(*speeds, atol=1e-3)
    for column, outputs in ((0, (0, 1)), (1, (1,))):
        for output in outputs:
            slopes = [in_order(one)[:, output, column] for one in (found, right)]
            assert apart(*slopes) < 0.01


def test_a_command_that_acts_earlier_than_those_before_it_takes_their_place(folder: Path) -> None:
    """A voltage takes 2 ms for each volt below 12 V: negative ones never act, and no reading sees them."""
    speeds = []
    for name, family in (("model", "family"), ("written", "equations")):
        own = parse_effect(CROSSTALK + f"family: {family}.yaml\n", folder / "crosstalk.yaml")
        system = compiled(folder, name, {"crosstalk": {"share": 2.0}}, own).system
        graph = system.graph
        to = graph.variable(after("voltage"), parse_unit("V").dimension)
        highest, slope = (
            graph.constant(n, parse_unit(unit).dimension) for n, unit in ((12.0, "V"), (2e-3, "s/V"))
        )
        later = compile_system(replace(system, delays=(Delay("voltage", slope * (highest - to)),)))
        close = replace(
            record(later, shifts=None),
            switch_times=np.array([0.0, 0.1234, 0.2561, 0.3017, 0.3057, 0.3117]),
            inputs=np.array([0.0, 9.0, 6.0, -6.0, -8.0, 9.0])[:, None],
        )
        found = simulated(later, close)
        speeds.append(found.outputs[0][:, found.output_names.index("speed")])
    np.testing.assert_allclose(*speeds, atol=1e-3)


def test_a_dead_time_is_moved_within_the_samples_between_which_commands_act(folder: Path) -> None:
    """The commands lie at a sample and far before one, and act shortly before and shortly after one."""
    column = "dead_time_of_voltage.time"
    found, right = (
        in_order(simulated(system, late, column))[:, :, 0]
        for name in ("model", "written")
        for system in [compiled(folder, name, {"dead_time_of_voltage": {"time": 0.0995}})]
        for late in [
            replace(
                record(system, shifts=None),
                times=0.1 * np.arange(11),
                switch_times=np.array([0.0, 0.3, 0.62]),
                inputs=VOLTAGES[:3, None],
            )
        ]
    )
    for output in range(2):
        assert apart(found[:, output], right[:, output]) < 0.02


@pytest.fixture
def jobs(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many simulations each call of a pool makes."""
    made: list[int] = []
    run: Callable[..., Any] = Pool.run

    def counted(self: Pool, asked: Any) -> Any:
        made.append(len(asked))
        return run(self, asked)

    monkeypatch.setattr(Pool, "run", counted)
    return made


def test_derivatives_that_are_not_used_take_no_simulation(folder: Path, jobs: list[int]) -> None:
    """But for those of a system's first records, on which the steps are chosen."""
    through = compiled(folder, "model", {})
    simulated(through, record(through), *PARAMETERS)
    jobs.clear()
    found = simulated(through, record(through, resistance=2.5), *PARAMETERS)
    assert sum(jobs) == 1
    assert found.sensitivities[0].shape == (61, 2, 9)
    assert sum(jobs) > 1


def test_a_record_that_hardly_moves_keeps_its_derivatives(folder: Path, jobs: list[int]) -> None:
    through, exact = (compiled(folder, name, {}) for name in ("model", "written"))
    in_order(simulated(through, record(through), *PARAMETERS))
    jobs.clear()
    near = {"resistance": 1.8 * 1.004, "kt": 0.045 * 0.997}
    found = in_order(simulated(through, record(through, **near), *PARAMETERS))
    assert sum(jobs) == 1
    right = in_order(simulated(exact, record(exact, **near), *PARAMETERS))
    for column in range(right.shape[2]):
        assert apart(found[:, :, column], right[:, :, column]) < 0.03


def test_kept_derivatives_are_one_set_of_columns_of_each_record_and_not_too_large(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    through = compiled(folder, "model", {})
    assert through.cascade is not None
    kept, one = through.cascade.kept, record(through, shifts=None)
    for names in (PARAMETERS, PARAMETERS[:1], PARAMETERS):
        in_order(simulated(through, one, *names))
        assert [(record, each.columns) for record, each in kept.items()] == [("one", (*names, *INITIAL))]
    # 61 samples, 2 outputs: two times 5 columns, and the outputs
    numbers = 61 * 2 * (2 * 5 + 1)
    monkeypatch.setattr(cascade, "_MOST_NUMBERS", 2 * numbers)
    others = [replace(one, name=name) for name in ("a", "b", "c", "d")]
    in_order(simulated(through, one, *PARAMETERS, before=others))
    assert len(kept) == 2
    assert sum(each.numbers for each in kept.values()) == 2 * numbers


@pytest.mark.parametrize(
    "moved",
    [
        lambda one: replace(one, parameters=one.parameters * 1.05),
        lambda one: replace(one, switch_times=one.switch_times + 1e-3 * SHIFTS[:, 3]),
        lambda one: replace(one, initial=one.initial + 1.0),
        lambda one: replace(one, inputs=one.inputs * 1.001),
        lambda one: replace(one, times=one.times[:-1]),
    ],
    ids=["parameters", "switches", "start", "commands", "samples"],
)
def test_a_record_that_moves_does_not(
    folder: Path, jobs: list[int], moved: Callable[[Excitation], Excitation]
) -> None:
    through = compiled(folder, "model", {})
    one = record(through)
    in_order(simulated(through, one, *PARAMETERS))
    jobs.clear()
    found = in_order(simulated(through, moved(one), *PARAMETERS))
    assert sum(jobs) > 1
    again = in_order(simulated(compiled(folder, "model", {}), moved(one), *PARAMETERS))
    for column in range(again.shape[2]):
        assert apart(found[:, :, column], again[:, :, column]) < 0.005


def test_the_mean_of_a_drive_is_what_the_program_is_given(folder: Path) -> None:
    """A lag shorter than every interval takes from each switch its time constant times the jump."""
    system = compiled(folder, "model", LATE)
    lag = 2e-5
    given: list[Floats] = []
    pool = pool_of(system.system.foreign.program)  # type: ignore[union-attr]
    run: Callable[..., Any] = pool.run

    def seen(asked: Any) -> Any:
        given.extend((each.points, each.drives[:, 0]) for each in asked)
        return run(asked)

    pool.run = seen  # type: ignore[method-assign]
    try:
        for value in (0.0, lag):
            simulate(system, [record(system, shifts=None, **{"lag_of_voltage.lag": value})]).require()
    finally:
        del pool.run  # type: ignore[method-assign]
    (points, before), (_, after) = given
    missing = (after - before) * np.diff(points)
    for at, jump in zip(SWITCHES[1:], np.diff(VOLTAGES), strict=True):
        near = (points[:-1] > at - 1e-6) & (points[:-1] < at + 0.02)
        assert missing[near].sum() == pytest.approx(-lag * jump, rel=0.01)


#: the drift of the resistance of the FMU with the voltage, as a term of the equations
HEATING = """
effect: heating
family: equations.yaml
summary: The resistance changes with the voltage.
slot: current_rate
term: -slope*voltage*current/(20 mH)
parameters: {slope: {null_value: 0 ohm/V, start: 0.01 ohm/V, bounds: [-1 ohm/V, 1 ohm/V]}}
"""
DRIFT = "drift_of_resistance_with_voltage"


@pytest.mark.parametrize("slope", [0.0, 0.05])
def test_a_parameter_that_can_change_follows_the_command_that_acts(tmp_path: Path, slope: float) -> None:
    motor_fmu(tmp_path / "motor.fmu", variability="tunable")
    for name, text in {"family": FAMILY, "equations": EQUATIONS, "rig": RIG}.items():
        (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
    for name, family in (("model", "family"), ("written", "equations")):
        (tmp_path / f"{name}.yaml").write_text(f"model: {family}.yaml\n{MODEL}", encoding="utf-8")
    allow(digest(tmp_path / "motor.fmu"))
    own = parse_effect(HEATING, tmp_path / "heating.yaml")
    through = compiled(tmp_path, "model", {DRIFT: {"slope": slope}})
    exact = compiled(tmp_path, "written", {"heating": {"slope": slope}}, own)
    found = simulated(through, record(through), *PARAMETERS, f"{DRIFT}.slope")
    right = simulated(exact, record(exact), *PARAMETERS, "heating.slope")
    outputs = [
        one.outputs[0][:, [one.output_names.index(name) for name in ("current", "speed")]]
        for one in (found, right)
    ]
    np.testing.assert_allclose(*outputs, rtol=1e-4, atol=1e-3)
    slopes, expected = in_order(found), in_order(right)
    for column in range(expected.shape[2]):
        for output in range(2):
            assert apart(slopes[:, output, column], expected[:, output, column]) < 0.01


def test_a_parameter_that_cannot_change_has_the_mean_over_the_record(folder: Path) -> None:
    system = compiled(folder, "model", {DRIFT: {"slope": 0.05}})
    found = simulated(system, record(system, shifts=None), "resistance", f"{DRIFT}.slope")
    times = np.append(SWITCHES, 60 * PERIOD)
    mean = float(np.average(VOLTAGES, weights=np.diff(times)))
    plain = compiled(folder, "model", {})
    right = simulated(plain, record(plain, shifts=None, resistance=1.8 + 0.05 * mean), "resistance")
    np.testing.assert_allclose(found.outputs[0], right.outputs[0], rtol=1e-9, atol=1e-9)
    slopes = in_order(found)
    for output in range(2):
        assert apart(slopes[:, output, 0], in_order(right)[:, output, 0]) < 0.01
        assert apart(slopes[:, output, 1], mean * slopes[:, output, 0]) < 0.01


#: the accuracy of a solver with a coarse tolerance: the outputs tremble by 0.01 % as parameters change
COARSE = "(m->k * current * (1.0 + 1e-4 * sin(1e7 * (m->R + m->k + m->b))) - m->b * speed) / m->J"


def test_of_a_program_with_a_coarse_tolerance_larger_steps_are_chosen(tmp_path: Path) -> None:
    motor_fmu(tmp_path / "motor.fmu", acceleration=COARSE)
    for name, text in {"family": FAMILY, "equations": EQUATIONS, "rig": RIG}.items():
        (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
    for name, family in (("model", "family"), ("written", "equations")):
        (tmp_path / f"{name}.yaml").write_text(f"model: {family}.yaml\n{MODEL}", encoding="utf-8")
    allow(digest(tmp_path / "motor.fmu"))
    through, exact = (compiled(tmp_path, name, {}) for name in ("model", "written"))
    found, right = (
        in_order(simulated(one, record(one, shifts=None), *PARAMETERS)) for one in (through, exact)
    )
    for column in range(len(PARAMETERS)):
        for output in range(2):
            assert apart(found[:, output, column], right[:, output, column]) < 0.05
    assert through.cascade is not None
    assert all(step.share > 1.0 for name, step in through.cascade.steps.items() if name in PARAMETERS)
    # the derivatives are known to this, and what they leave is known no better
    assert 1e-3 < through.accuracy(PARAMETERS) < 0.2
    assert exact.accuracy(PARAMETERS) == 0.0
