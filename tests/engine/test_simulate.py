"""Simulated records compared with independent solvers, and failures of integration."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from itertools import pairwise
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from engine_systems import lag_record, plain_function
from rigctl.engine.compile import CompiledSystem, compile_system
from rigctl.engine.excitation import Excitation
from rigctl.engine.failure import Cause
from rigctl.engine.simulate import simulate
from rigctl.engine.symbols import exp, log, to_text
from rigctl.engine.system import SystemBuilder
from rigctl.engine.tolerance import TIGHT
from rigctl.errors import RigctlError
from systems import needs_package

Floats = NDArray[np.float64]


def lag_exact(t: Floats, gain: float = 2.0, lag: float = 0.3) -> Floats:
    """The analytical solution of `lag_record`."""
    up = gain * (1.0 - np.exp(-np.clip(t - 0.5, 0.0, 0.75) / lag))
    return np.where(t <= 1.25, up, up * np.exp(-(t - 1.25) / lag))


def test_a_first_order_lag_and_its_sensitivities_agree_with_the_exact_solution(lag: CompiledSystem) -> None:
    result = simulate(lag, [lag_record()], columns=["lag", "gain"], initial_columns=["x"], tolerance=TIGHT)
    t = result.times[0]
    assert result.output("x")[0] == pytest.approx(lag_exact(t), abs=1e-6)
    assert result.columns == ("lag", "gain", "x")
    step = 1e-5
    by_lag = (lag_exact(t, lag=0.3 + step) - lag_exact(t, lag=0.3 - step)) / (2 * step)
    assert result.sensitivity("x", "lag")[0] == pytest.approx(by_lag, abs=2e-5)
    assert result.sensitivity("x", "gain")[0] == pytest.approx(lag_exact(t) / 2.0, abs=1e-6)
    # steps are chosen for the state, which rests at first while its sensitivity decays
    assert result.sensitivity("x", "x")[0] == pytest.approx(np.exp(-t / 0.3), abs=1e-4)


def test_switches_between_irregular_samples_act_at_their_exact_time(lag: CompiledSystem) -> None:
    times = np.array([0.0, 0.013, 0.5, 0.5, 0.5001, 0.9, 1.2499, 1.2500001, 2.9])
    result = simulate(lag, [lag_record(times=times)], tolerance=TIGHT)
    assert result.outputs[0][:, 0] == pytest.approx(lag_exact(times), abs=1e-6)


def test_a_record_need_not_sample_at_its_start_nor_after_its_last_switch(lag: CompiledSystem) -> None:
    result = simulate(lag, [lag_record(times=[0.7, 0.8])], tolerance=TIGHT)
    assert result.outputs[0][:, 0] == pytest.approx(lag_exact(np.array([0.7, 0.8])), abs=1e-6)
    nothing = simulate(lag, [lag_record(times=np.empty(0))])
    assert nothing.ok
    assert nothing.outputs[0].shape == (0, 1)


def test_the_cylinder_agrees_with_radau(cylinder: ModuleType, cylinder_compiled: CompiledSystem) -> None:
    """Outputs within 3e-5 of their peak of a fully independent solution at 1e-9."""
    system = cylinder_compiled.system
    record = cylinder.campaign()[11]
    function = plain_function(system)
    scales = np.array([state.scale for state in system.states])
    y, pieces = record.initial.copy(), [record.initial[None]]
    edges = [*record.switch_times, record.times[-1]]
    for k, (start, end) in enumerate(pairwise(edges)):
        inside = record.times[(record.times > start) & (record.times <= end)]
        solution = solve_ivp(
            lambda t, y, u: function(y, u, record.parameters),
            (start, end),
            y,
            method="Radau",
            rtol=1e-9,
            atol=1e-6 * scales,
            t_eval=inside,
            args=(record.inputs[k],),
        )
        assert solution.success
        pieces.append(solution.y.T)
        y = solution.y[:, -1]
    exact = np.concatenate(pieces)
    ours = simulate(cylinder_compiled, [record]).states[0]
    error = np.abs(ours - exact).max(axis=0) / np.abs(exact).max(axis=0)
    shown = [system.state_names.index(name) for name in ("temperature", "supply", "position", "pressure_cap")]
    assert error[shown].max() < 3e-5
    tight = simulate(cylinder_compiled, [record], tolerance=TIGHT).states[0]
    assert (np.abs(tight - exact).max(axis=0) / np.abs(exact).max(axis=0))[shown].max() < 2e-6


@needs_package("casadi")
def test_the_sensitivities_of_the_cylinder_agree_with_cvodes(
    cylinder: ModuleType, cylinder_compiled: CompiledSystem
) -> None:
    """Within 1 % of an independent formula, differentiation and integrator; within 2e-4 in the median."""
    system = cylinder_compiled.system
    names = [
        *list(cylinder.NUISANCES)[:7],
        "piston_leakage",
        "stribeck_force",
        "air",
        "overlap",
        "spring_load",
    ]
    record = cylinder.campaign()[7]
    exact = cvodes_sensitivities(cylinder_compiled, record, names)
    ours = simulate(cylinder_compiled, [record], columns=names)
    outputs = [system.state_names.index(name) for name in system.output_names]
    found = ours.sensitivities[0]
    errors = []
    for place, state in enumerate(outputs):
        for column in range(len(names)):
            size = np.linalg.norm(exact[:, state, column])
            errors.append(np.linalg.norm(found[:, place, column] - exact[:, state, column]) / size)
    assert max(errors) < 1e-2
    assert np.median(errors) < 2e-4


def cvodes_sensitivities(compiled: CompiledSystem, record: Excitation, names: list[str]) -> Floats:
    """∂y/∂q (samples, states, columns): the variational equations, by CasADi's derivatives and CVODES."""
    import casadi

    system = compiled.system
    known = {name: casadi.SX.sym(name) for name in (*system.state_names, *system.input_names)}
    known |= dict(zip(system.parameter_names, map(casadi.SX, record.parameters), strict=True))
    scale = {
        name: value or 1.0 for name, value in zip(names, (typical(compiled, n) for n in names), strict=True)
    }
    free = casadi.SX.sym("free", len(names))
    for place, name in enumerate(names):
        known[name] = known[name] + scale[name] * free[place]
    functions = {"exp": casadi.exp, "log": casadi.log, "sqrt": casadi.sqrt, "tanh": casadi.tanh}
    rhs = casadi.vertcat(*(eval(to_text(expr), {**functions, **known}) for expr in system.rhs))
    sizes = np.array([state.scale for state in system.states]) * 1e2
    y = casadi.vertcat(*(known[name] for name in system.state_names))
    s = casadi.SX.sym("s", len(system.states), len(names))
    at_null = casadi.substitute(
        casadi.jtimes(rhs, y, casadi.mtimes(casadi.diag(sizes), s)) + casadi.jacobian(rhs, free),
        free,
        0 * free,
    )
    unit = casadi.SX.sym("unit", len(system.states))
    slope = casadi.substitute(casadi.substitute(rhs, free, 0 * free) / sizes, y, sizes * unit)
    variation = casadi.substitute(at_null / casadi.repmat(casadi.DM(sizes), 1, len(names)), y, sizes * unit)
    u = casadi.vertcat(*(known[name] for name in system.input_names))
    problem = {
        "x": casadi.vertcat(unit, casadi.vec(s)),
        "p": u,
        "ode": casadi.vertcat(slope, casadi.vec(variation)),
    }
    state = np.concatenate([record.initial / sizes, np.zeros(s.numel())])
    pieces = [state[:, None]]
    edges = [*record.switch_times, record.times[-1]]
    for k, (start, end) in enumerate(pairwise(edges)):
        grid = record.times[(record.times > start) & (record.times <= end)]
        options = {"abstol": 1e-9, "reltol": 1e-8, "max_num_steps": 200_000}
        solver = casadi.integrator("solver", "cvodes", problem, start, list(grid), options)
        pieces.append(np.array(solver(x0=state, p=record.inputs[k])["xf"]))
        state = pieces[-1][:, -1]
    flat = np.concatenate(pieces, axis=1)[len(system.states) :]
    scaled = flat.reshape(len(names), len(system.states), -1).transpose(2, 1, 0)
    return scaled * sizes[:, None] / np.array([scale[name] for name in names])


def typical(compiled: CompiledSystem, name: str) -> float:
    """A size of the parameter that makes its column comparable with the states."""
    value = dict(zip(compiled.system.parameter_names, compiled.system.nominal, strict=True))[name]
    guesses = {
        "piston_leakage": 2e-15,
        "stribeck_force": 60.0,
        "air": 1e-4,
        "overlap": 0.05,
        "spring_load": 300.0,
    }
    return value or guesses[name]


def test_the_result_does_not_depend_on_the_threads_or_the_columns(
    cylinder: ModuleType, cylinder_compiled: CompiledSystem
) -> None:
    records = cylinder.campaign()[:5]
    one = simulate(cylinder_compiled, records, columns=["air", "barus"], workers=1)
    four = simulate(cylinder_compiled, records, columns=["air", "barus"], workers=4)
    alone = simulate(cylinder_compiled, records)
    for a, b, c in zip(one.outputs, four.outputs, alone.outputs, strict=True):
        assert np.array_equal(a, b)
        assert np.array_equal(a, c)
    for a, b in zip(one.sensitivities, four.sensitivities, strict=True):
        assert np.array_equal(a, b)
    assert alone.sensitivities[0].shape == (701, 4, 0)


def test_columns_have_the_order_requested(cylinder: ModuleType, cylinder_compiled: CompiledSystem) -> None:
    records = cylinder.campaign()[:1]
    first = simulate(cylinder_compiled, records, columns=["air", "valve_area"], initial_columns=["position"])
    second = simulate(cylinder_compiled, records, columns=["valve_area"], initial_columns=["position"])
    assert first.sensitivity("supply", "valve_area")[0] == pytest.approx(
        second.sensitivity("supply", "valve_area")[0], rel=1e-9, abs=1.0
    )
    assert first.columns == ("air", "valve_area", "position")


def test_record_level_parameters_may_differ_between_records(lag: CompiledSystem) -> None:
    records = [lag_record(), lag_record(parameters=[1.0, 0.3])]
    result = simulate(lag, records)
    assert result.outputs[0] == pytest.approx(2.0 * result.outputs[1], rel=1e-4, abs=1e-4)


def test_an_excitation_is_read_only_and_can_be_replaced_in_part(lag: CompiledSystem) -> None:
    record = lag_record()
    with pytest.raises(ValueError, match="read-only"):
        record.times[0] = 1.0
    varied = record.replace(parameters=[1.0, 0.3], initial=[0.5])
    assert varied.times is record.times
    assert simulate(lag, [varied]).states[0][0, 0] == 0.5


def test_a_compiled_system_can_be_pickled(lag: CompiledSystem) -> None:
    copy = pickle.loads(pickle.dumps(lag))
    assert copy.source.digest == lag.source.digest
    assert np.array_equal(simulate(copy, [lag_record()]).outputs[0], simulate(lag, [lag_record()]).outputs[0])


def test_the_summary_states_records_samples_and_columns(lag: CompiledSystem) -> None:
    good = simulate(lag, [lag_record()], columns=["gain"])
    assert good.ok
    assert good.require() is good
    assert good.summary().startswith("1 records, 61 samples of x; ")
    assert good.summary().endswith("sensitivities to gain")


@pytest.mark.parametrize(
    ("changes", "cause", "message"),
    [
        ({"parameters": [math.nan, 0.3]}, Cause.VALUE, "the parameter gain is nan at t = 0 s"),
        ({"initial": [math.inf]}, Cause.VALUE, "the initial state x is inf"),
        ({"inputs": [[0.0], [math.nan], [0.0]]}, Cause.VALUE, "the input u is nan"),
        ({"parameters": [2.0, 0.0]}, Cause.EQUATIONS, "the derivative of x is not a finite number"),
    ],
)
def test_an_invalid_value_is_a_failure_with_its_reason(
    lag: CompiledSystem, changes: dict[str, object], cause: Cause, message: str
) -> None:
    result = simulate(lag, [lag_record(), lag_record(**changes, name="bad")], columns=["gain"])
    assert result.failures[0] is None
    failure = result.failures[1]
    assert failure is not None
    assert failure.cause is cause
    assert message in str(failure)
    assert not result.ok
    assert result.outputs[0].shape == (61, 1)
    assert len(result.times[1]) == len(result.outputs[1]) == len(result.sensitivities[1]) < 2
    assert f"record bad failed: {failure}" in result.summary()
    with pytest.raises(RigctlError, match="record bad could not be simulated"):
        result.require()


@pytest.fixture(scope="module")
def explosive() -> CompiledSystem:
    """``dx/dt = x²`` has a pole at t = 1/x(0); the output is a logarithm."""
    builder = SystemBuilder()
    x = builder.state("x", "1", scale=1e-3)
    rate = builder.parameter("rate", "1/s", 1.0)
    builder.input("unused", "1")
    builder.equation("x", rate * x**2)
    builder.output("log_x", "1", log(x))
    return compile_system(builder.build())


def test_a_solution_with_a_pole_ends_at_the_time_of_the_pole(explosive: CompiledSystem) -> None:
    times = np.arange(30) * 0.095
    record = Excitation(times, np.zeros(1), np.zeros((1, 1)), np.ones(1), np.ones(1), "pole")
    result = simulate(explosive, [record], columns=["rate"])
    failure = result.failures[0]
    assert failure is not None
    assert failure.cause in (Cause.STEP, Cause.EQUATIONS)
    assert failure.quantity == "x"
    assert failure.time == pytest.approx(1.0, abs=5e-3)
    assert result.times[0][-1] == pytest.approx(0.95)
    assert np.isfinite(result.outputs[0]).all()
    assert np.isfinite(result.sensitivities[0]).all()
    assert result.outputs[0][:, 0] == pytest.approx(-np.log(1.0 - result.times[0]), abs=1e-2)


def test_an_output_that_is_not_finite_is_a_failure(explosive: CompiledSystem) -> None:
    record = Excitation(np.arange(5.0), np.zeros(1), np.zeros((1, 1)), -np.ones(1), np.ones(1))
    failure = simulate(explosive, [record]).failures[0]
    assert failure is not None
    assert failure.cause is Cause.OUTPUTS
    assert failure.reason == "the output log_x is not a finite number"


def test_a_stiff_start_far_from_equilibrium_is_integrated() -> None:
    builder = SystemBuilder()
    fast = builder.state("fast", "1", scale=1e-3)
    slow = builder.state("slow", "1", scale=1e-3)
    rate = builder.parameter("rate", "1/s", 1e7)
    builder.equation("fast", rate * (exp(-slow) - fast))
    builder.equation("slow", builder.constant(1.0, "1/s") * (fast - slow))
    builder.output("slow", "1", slow)
    record = Excitation(
        np.linspace(0.0, 10.0, 101), np.zeros(1), np.zeros((1, 0)), np.array([50.0, 0.0]), np.array([1e7])
    )
    result = simulate(compile_system(builder.build()), [record]).require()
    assert result.outputs[0][-1, 0] == pytest.approx(0.5671, abs=1e-4)
    assert result.stats[0].steps < 400


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"times": [0.0, math.nan]}, "a time is not finite"),
        ({"times": [1.0, 0.5]}, "time runs backwards"),
        ({"switch_times": [0.0, 0.9, 0.8]}, "time runs backwards"),
        ({"times": [-1.0, 0.5]}, "before the first command"),
        ({"inputs": [[0.0], [1.0]]}, "each switch time needs one row of inputs"),
        ({"switch_times": np.empty(0), "inputs": np.empty((0, 1))}, "no command"),
        ({"initial": [[0.0]]}, "one-dimensional"),
    ],
)
def test_an_invalid_record_is_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(RigctlError, match=f"record lag: .*{message}"):
        lag_record(**changes)


def test_mistakes_in_a_call_are_refused_with_the_wrong_name(lag: CompiledSystem) -> None:
    with pytest.raises(RigctlError, match=r"unknown parameter to differentiate by, got 'gian'.*'gain'"):
        simulate(lag, [lag_record()], columns=["gian"])
    with pytest.raises(RigctlError, match="unknown state to differentiate by"):
        simulate(lag, [lag_record()], initial_columns=["gain"])
    with pytest.raises(RigctlError, match="twice, got 'gain'"):
        simulate(lag, [lag_record()], columns=["gain", "gain"])
    with pytest.raises(RigctlError, match="record lag has 1 parameters; expected 2"):
        simulate(lag, [lag_record(parameters=[1.0])])
    with pytest.raises(RigctlError, match="unknown output"):
        simulate(lag, [lag_record()]).output("y")
    with pytest.raises(RigctlError, match="unknown column"):
        simulate(lag, [lag_record()]).sensitivity("x", "gain")


def test_trajectories_are_immutable(lag: CompiledSystem) -> None:
    result = simulate(lag, [lag_record()])
    with pytest.raises(AttributeError):
        result.columns = ()  # type: ignore[misc]
    assert replace(result, columns=("a",)).columns == ("a",)
