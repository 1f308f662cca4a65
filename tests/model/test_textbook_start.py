"""From the shipped textbook model a fit finds the true opening of the simulated bench."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from rigctl.engine.compile import compile_system
from rigctl.engine.excitation import Excitation, Floats
from rigctl.engine.least_squares import Block, Unknown, least_squares
from rigctl.engine.simulate import simulate
from rigctl.files.shipped import shipped
from rigctl.model import load_model, parameter_values

#: noise of the channels of the published bench: K, Pa, m
NOISE = np.array([0.1, 8e3, 1e-4])


def stroke(celsius: float, bar: float, parameters: Floats, states: Sequence[str]) -> Excitation:
    start = {"oil_temperature": celsius + 273.15, "supply_pressure": bar * 1e5, "pressure_b": 0.9e5 * bar}
    return Excitation(
        times=np.arange(0.0, 3.25, 0.01),
        switch_times=np.array([0.0, 0.2, 1.25, 2.25]),
        inputs=np.array([[valve, 0.0, bar * 1e5, 295.15, 1.0] for valve in (0.0, 1.0, 0.0, -1.0)]),
        initial=np.array([start.get(name, 0.0) for name in states]),
        parameters=parameters,
    )


def test_the_fit_finds_the_flow_area_of_the_bench_from_the_textbook_value() -> None:
    textbook = load_model(shipped("models", "hl32-textbook.yaml"))
    system = textbook.system()
    compiled = compile_system(system)
    bench = parameter_values(textbook.family, textbook.rig)
    truth = np.array([bench[name] for name in system.parameter_names])
    places = [system.parameter_names.index(name) for name in textbook.fitted]
    conditions = [(celsius, bar) for celsius in (20.0, 60.0) for bar in (20.0, 30.0, 40.0, 50.0)]

    def records(parameters: Floats) -> list[Excitation]:
        return [stroke(celsius, bar, parameters, system.state_names) for celsius, bar in conditions]

    measured = simulate(compiled, records(truth)).require().outputs

    def evaluate(shared: Floats, _: Sequence[Floats], __: bool) -> list[Block]:
        parameters = truth.copy()
        parameters[places] = shared
        done = simulate(compiled, records(parameters), columns=textbook.fitted).require()
        return [
            Block(
                ((outputs - seen) / NOISE).ravel(),
                (slopes / NOISE[:, None]).reshape(-1, len(places)),
                np.zeros((outputs.size, 0)),
            )
            for outputs, slopes, seen in zip(done.outputs, done.sensitivities, measured, strict=True)
        ]

    unknowns = []
    for name in textbook.fitted:
        declared = textbook.family.parameter(name)
        unknowns.append(Unknown(name, textbook.values[name], declared.low, declared.high))
    found = least_squares(evaluate, unknowns, [()] * len(conditions))
    values = dict(zip(textbook.fitted, found.values, strict=True))
    assert textbook.values["flow_area"] == pytest.approx(4.05e-6)
    assert values["flow_area"] == pytest.approx(3.3e-6, rel=1e-3)
    assert values["spool_time"] == pytest.approx(25e-3, rel=1e-2)
    assert found.cost < 1.0
