"""The shipped model files are complete and agree with their comments."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.engine.compile import compile_system
from rigctl.engine.excitation import Excitation
from rigctl.engine.simulate import simulate
from rigctl.files.shipped import shipped
from rigctl.model import load_model

MODELS = sorted(shipped("models").glob("*.yaml"))

#: temperature in degC, kinematic viscosity in cSt and dynamic viscosity in Pa*s, as printed for Vogel's law
PRINTED = (
    (20.0, 85.19009, 0.073855979),
    (40.0, 33.81235, 0.028901952),
    (60.0, 16.42916, 0.013843125),
    (80.0, 9.213226, 0.007650801),
)


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_every_shipped_model_has_a_description_and_free_parameters(path: object) -> None:
    model = load_model(path)  # type: ignore[arg-type]
    assert model.description
    assert model.fitted
    assert not model.effects
    assert model.system().outputs


def test_the_heat_capacity_of_the_board_is_fixed_and_the_rest_is_free() -> None:
    model = load_model(shipped("models", "heater-board.yaml"))
    assert model.fitted == ("heater_gain_1", "heater_gain_2", "convection")
    assert model.values["heat_capacity"] == 2.0
    assert model.rig is not None
    assert model.system().output_names == tuple(model.rig.channels)


def test_the_oil_model_reproduces_the_printed_table_row_by_row() -> None:
    model = load_model(shipped("models", "hl32-oil.yaml"))
    compiled = compile_system(model.system())
    rows = np.arange(float(len(PRINTED)))
    table = Excitation(
        times=rows + 1.0,  # a sample at a switch still shows the row before it
        switch_times=rows,
        inputs=np.array([[celsius + 273.15, 0.0] for celsius, _, _ in PRINTED]),
        initial=np.zeros(0),
        parameters=np.array(model.system().nominal),
    )
    found = simulate(compiled, [table]).outputs[0]
    assert compiled.system.output_names == ("kinematic_viscosity", "dynamic_viscosity", "density")
    assert found[:, 0] / 1e-6 == pytest.approx([nu for _, nu, _ in PRINTED], rel=1e-6)
    assert found[:, 1] == pytest.approx([mu for _, _, mu in PRINTED], rel=1e-6)
    assert found[:, 2] == pytest.approx([870.0 * (1.0 - 7e-4 * (t - 15.0)) for t, _, _ in PRINTED])
