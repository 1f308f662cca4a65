"""Models whose Python functions take no symbols: the answers of those that do, from their edges alone."""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import rigctl
from rigctl.engine.compile import compile_system
from rigctl.engine.excitation import Excitation
from rigctl.engine.simulate import simulate
from rigctl.model.build import build_system
from rigctl.physics.family import ModelFamily
from rigctl.physics.python_functions import family_from_functions

RIG = """
name: motor
channels:
  speed: {unit: rad/s, quantity: angular_speed, noise: 0.3 rad/s}
actuators:
  voltage: {kind: level, unit: V, low: -24 V, high: 24 V}
safe_state: {voltage: 0 V}
"""
DECLARED: dict[str, Any] = {
    "states": {"speed": ("0 rad/s", "0.1 rad/s")},
    "inputs": {"voltage": "0 V"},
    "parameters": {
        "gain": ("15 rad/(V*s)", "1 rad/(V*s)", "100 rad/(V*s)"),
        "lag": ("0.15 s", "0.01 s", "2 s"),
        "poles": "2",
    },
    "outputs": {"speed": "rad/s"},
}
VOLTAGES = (3.0, 6.0, -9.0, 12.0)
#: a look-up table that happens to be a straight line
TABLE = CubicSpline([-24.0, -5.0, 8.0, 24.0], [-24.0, -5.0, 8.0, 24.0])


def in_symbols(t: Any, x: Any, u: Any, p: Any) -> Any:
    return {"speed": (p.gain * u.voltage * p.poles / 2.0 - x.speed) / p.lag}


def by_a_table(t: Any, x: Any, u: Any, p: Any) -> Any:
    loss = x.speed if x.speed >= 0.0 else -abs(x.speed)
    return [(p.gain * TABLE(u["voltage"]) * int(p.poles) / 2.0 - loss) / p.lag]


def readings(x: Any, u: Any, p: Any) -> Any:
    (speed,) = x
    return speed


def made(rates: Callable[..., Any], folder: Path, **changes: Any) -> rigctl.Model:
    (folder / "rig.yaml").write_text(RIG, encoding="utf-8")
    given = {**DECLARED, **changes}
    return rigctl.Model.from_function(rates, readings, rig=folder / "rig.yaml", name="motor", **given)


def measured(folder: Path, offset: float = 0.0) -> rigctl.Run:
    """The closed form of a motor with 20 rad/(V·s) and 0.1 s."""
    rng = np.random.default_rng(3)
    times = np.arange(40) * 0.01
    rows = ["time [s],record,voltage [V],speed [rad/s]"]
    for record, volts in enumerate(VOLTAGES, start=1):
        speed = 20.0 * volts * (1.0 - np.exp(-times / 0.1)) + offset + 0.3 * rng.standard_normal(times.size)
        rows += [f"{t:.2f},{record},{volts},{w:.6f}" for t, w in zip(times, speed, strict=True)]
    (folder / "rig.yaml").write_text(RIG, encoding="utf-8")
    (folder / "log.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return rigctl.open_run(
        rigctl.import_file(folder / "log.csv", rigctl.load_rig(folder / "rig.yaml"), folder / "runs").path
    )


def test_they_are_fitted_as_with_symbols(tmp_path: Path) -> None:
    run = measured(tmp_path)
    model = made(by_a_table, tmp_path)
    assert "called with numbers: they take no symbols (an equation may not branch" in repr(model)
    found, expected = (rigctl.compare([run], [one]).models[0] for one in (model, made(in_symbols, tmp_path)))
    assert found.adequate
    assert expected.adequate
    for name in ("gain", "lag"):
        std = expected.fit.std[name]
        assert found.fit.model.values[name] == pytest.approx(expected.fit.model.values[name], abs=0.1 * std)
        assert found.fit.std[name] == pytest.approx(std, rel=0.05)


def switched(folder: Path, voltages: Sequence[float] = VOLTAGES, samples: int = 60) -> rigctl.Run:
    """The same motor, whose command is switched at samples, as a log has it: each switch was up to one
    interval earlier."""
    rng = np.random.default_rng(5)
    rows = ["time [s],record,voltage [V],speed [rad/s]"]
    for record, volts in enumerate(voltages, start=1):
        command = [volts * (1 if (k // 12) % 2 == 0 else -0.5) for k in range(samples)]
        speed = 0.0
        for k, level in enumerate(command):
            rows.append(f"{k * 0.01:.2f},{record},{level},{speed + 0.3 * rng.standard_normal():.6f}")
            late = 0.004 if k + 1 < samples and command[k + 1] != level else 0.0  # the next level acts before
            for held, seconds in ((level, 0.01 - late), (command[min(k + 1, samples - 1)], late)):
                speed = 20.0 * held + (speed - 20.0 * held) * math.exp(-seconds / 0.1)
    (folder / "rig.yaml").write_text(RIG, encoding="utf-8")
    (folder / "log.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return rigctl.open_run(
        rigctl.import_file(folder / "log.csv", rigctl.load_rig(folder / "rig.yaml"), folder / "runs").path
    )


def test_switches_at_samples_are_fitted_as_with_symbols(tmp_path: Path) -> None:
    """A switch at a sample is a corner of the cost: its two sides have different derivatives."""
    run = switched(tmp_path)
    found, expected = (
        rigctl.compare([run], [made(rates, tmp_path)]).models[0] for rates in (by_a_table, in_symbols)
    )
    assert found.fit.chi2_reduced == pytest.approx(expected.fit.chi2_reduced, rel=1e-3)
    for name in ("gain", "lag"):
        std = expected.fit.std[name]
        assert found.fit.model.values[name] == pytest.approx(expected.fit.model.values[name], abs=0.1 * std)


def test_the_first_records_may_be_at_rest(tmp_path: Path) -> None:
    """Steps are chosen on the first records in which something is switched."""
    found = rigctl.compare([switched(tmp_path, (0.0, 0.0, 9.0), 20)], [made(by_a_table, tmp_path)]).models[0]
    for name, value in (("gain", 20.0), ("lag", 0.1)):
        assert found.fit.model.values[name] == pytest.approx(value, abs=4.0 * found.fit.std[name])
        assert found.fit.std[name] < 0.02 * value


def test_a_drift_of_a_parameter_in_time_is_found(tmp_path: Path) -> None:
    """The gain of 20 rad/(V·s) grows by a fifth in a record, between whose ends it is switched alike."""
    rng = np.random.default_rng(11)
    rows = ["time [s],record,voltage [V],speed [rad/s]"]
    for record, volts in enumerate(VOLTAGES, start=1):
        speed, steps = 0.0, 20
        for k in range(100):
            level = volts * (1 if (k // 20) % 2 == 0 else -0.5)
            rows.append(f"{k * 0.01:.2f},{record},{level},{speed + 0.3 * rng.standard_normal():.6f}")
            for step in range(steps):
                gain = 20.0 * (1.0 + 0.2 * (k + (step + 0.5) / steps) * 0.01)
                speed = gain * level + (speed - gain * level) * math.exp(-0.01 / steps / 0.1)
    (tmp_path / "rig.yaml").write_text(RIG, encoding="utf-8")
    (tmp_path / "log.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    rig = rigctl.load_rig(tmp_path / "rig.yaml")
    run = rigctl.open_run(rigctl.import_file(tmp_path / "log.csv", rig, tmp_path / "runs").path)
    found = rigctl.diagnose([run], made(by_a_table, tmp_path), most=1)
    assert (found.verdict, found.effects) == ("ambiguous", ("drift_of_gain_in_time",)), found.statement
    size = found.ranking[0].parameters["rate"]
    assert size.value == pytest.approx(4.0, abs=3.0 * size.std)


def test_an_effect_at_an_edge_is_found_and_the_answer_says_what_was_searched(tmp_path: Path) -> None:
    found = rigctl.diagnose([measured(tmp_path, offset=4.0)], made(by_a_table, tmp_path), most=1)
    # by the speed alone, an offset of the command with the same effect is as probable
    assert found.verdict == "ambiguous", found.statement
    assert "offset_of_speed" in found.statement
    assert set(found.effects) <= {"offset_of_speed", "offset_of_voltage"}
    edges = (
        "nly effects at inputs, outputs and parameters of motor were searched, because they take no symbols"
    )
    assert edges in found.statement
    assert "the cause may be something else inside the functions" in found.statement
    assert not any(one.place_sure for one in found.levels)


def stepped(t: Any, x: Any, u: Any, p: Any) -> Any:
    return {"speed": (20.0 * u.voltage * round(p.gain) / 15.0 - x.speed) / p.lag}


def test_a_parameter_without_a_derivative_is_named(tmp_path: Path) -> None:
    with pytest.raises(rigctl.RigctlError, match="no derivative by gain: small changes of it change nothing"):
        rigctl.compare([measured(tmp_path)], [made(stepped, tmp_path)])


_CALLS: list[float] = []


def remembering(t: Any, x: Any, u: Any, p: Any) -> Any:
    _CALLS.append(float(x.speed))
    return {"speed": len(_CALLS) - x.speed / p.lag}


def failing_later(t: Any, x: Any, u: Any, p: Any) -> Any:
    return {"speed": (15.0 * u.voltage + 0.0 * math.sqrt(40.0 - x.speed) - x.speed) / p.lag}


@pytest.mark.parametrize(
    ("rates", "message"),
    [
        (remembering, "two results for one simulation of .* by the functions"),
        (
            failing_later,
            r"motor failed at 0\.\d+ s: failing_later fails: ValueError: .*, in line \d+ of failing",
        ),
    ],
)
def test_what_shows_in_a_simulation_ends_it_with_one_message(
    tmp_path: Path, rates: Callable[..., Any], message: str
) -> None:
    with pytest.raises(rigctl.RigctlError, match=message):
        rigctl.compare([measured(tmp_path)], [made(rates, tmp_path)])


def family(rates: Callable[..., Any]) -> ModelFamily:
    return family_from_functions("motor", rates, readings, **DECLARED, time_limit=2.0)


def returning(value: object) -> Callable[..., Any]:
    """Rates that take no symbols, and return this at rest."""

    def rates(t: Any, x: Any, u: Any, p: Any) -> Any:
        return value if x.speed == 0.0 else {"speed": -x.speed}

    return rates


def endless(t: Any, x: Any, u: Any, p: Any) -> Any:
    while x.speed < 1.0:
        pass


def dividing(t: Any, x: Any, u: Any, p: Any) -> Any:
    return {"speed": 1.0 / float(x.speed)}


def of_the_time(t: Any, x: Any, u: Any, p: Any) -> Any:
    return {"speed": math.sin(t) * float(x.speed)}


def misspelt(t: Any, x: Any, u: Any, p: Any) -> Any:
    return {"speed": -float(x.speed) / p.lagg}


@pytest.mark.parametrize(
    ("rates", "message"),
    [
        (returning(None), "rates does not return one rate for each of speed.*None"),
        (returning("fast"), "rates does not return one rate for each of speed.*fast"),
        (returning([1.0, 2.0]), "rates does not return one rate for each of speed"),
        (returning({"speed": "fast"}), "rates returns no number as the rate of speed.*fast"),
        (returning({"speed": 1j}), "rates returns no number as the rate of speed.*1j"),
        (returning(np.ones((1, 2))), "rates returns no number as the rate of speed"),
        (returning(math.nan), "0 s: rates returns nan as the rate of speed"),
        (dividing, r"0 s: dividing fails: ZeroDivisionError: .*, in line \d+ of dividing"),
        (endless, "the functions have not finished the simulation of the start .* in 2 s"),
        (of_the_time, "may not depend on the time itself"),
        (misspelt, "did you mean 'lag'"),
    ],
)
def test_functions_that_fail_with_numbers_too_are_refused_when_the_model_is_made(
    rates: Callable[..., Any], message: str
) -> None:
    with pytest.raises(rigctl.RigctlError, match=re.compile(message, re.DOTALL)):
        family(rates)


def test_functions_that_cannot_be_sent_to_another_process_are_refused() -> None:
    lock = threading.Lock()

    def rates(t: Any, x: Any, u: Any, p: Any) -> Any:
        with lock:
            return {"speed": -float(x.speed)}

    with pytest.raises(
        rigctl.RigctlError, match="cannot be sent to the process that calls them with numbers"
    ):
        family(rates)


def test_a_lag_of_a_command_has_the_derivative_of_the_equations_beside_a_large_input() -> None:
    """A step of the lag follows from the voltage alone, and not from the air's 293. With 5 s from sample to
    sample no node of the means is in the spike that is its derivative at 0."""

    columns = []
    for rates in (by_a_table, in_symbols):
        declared = {**DECLARED, "inputs": {"voltage": "0 V", "air": "293"}}
        declared["parameters"] = {**DECLARED["parameters"], "lag": ("15 s", "0.01 s", "200 s")}
        family = family_from_functions("motor", _warm(rates), readings, **declared)
        system = compile_system(build_system(family, {"lag_of_voltage": {"lag": 0.0}}))
        known = dict(zip(system.system.parameter_names, system.system.nominal, strict=True))
        excitation = Excitation(
            5.0 * np.arange(41),
            5.0 * np.array([0.0, 7.3, 15.6, 28.2]),
            np.array([[0.0, 293.0], [9.0, 293.0], [-6.0, 293.0], [3.0, 293.0]]),
            np.zeros(len(system.system.states)),
            np.array([known[name] for name in system.system.parameter_names]),
            "one",
        )
        found = simulate(system, [excitation], columns=["lag_of_voltage.lag"]).require()
        columns.append(found.sensitivities[0][:, 0, 0])
    through, exact = columns
    assert np.linalg.norm(through - exact) < 0.05 * np.linalg.norm(exact)


def _warm(rates: Callable[..., Any]) -> Callable[..., Any]:
    """The same rates, with a very small effect of the air's temperature."""

    def warm(t: Any, x: Any, u: Any, p: Any) -> Any:
        found = rates(t, x, u, p)
        (rate,) = found.values() if isinstance(found, dict) else found
        return {"speed": rate * (1.0 + 1e-9 * (u.air - 293.0))}

    return warm
