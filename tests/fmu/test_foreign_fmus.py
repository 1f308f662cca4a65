"""FMUs that rigctl did not export, simulated in a process of their own, against the closed form."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from foreign_fmus import lag_fmu
from rigctl.errors import RigctlError
from rigctl.fmu.description import read_description
from rigctl.fmu.process import FmuProcess
from systems import needs_compiler

pytestmark = needs_compiler

KINDS = [(version, kind) for version in ("2.0", "3.0") for kind in ("CoSimulation", "ModelExchange")][1:]


def simulated(
    path: Path,
    drives: list[float],
    starts: Mapping[str, float],
    step: float = 0.25,
    patience: float = 60.0,
) -> NDArray[np.float64]:
    about = read_description(path)
    points = step * np.arange(len(drives))
    ports = ([about.port(name) for name in names] for names in (["u"], ["y"], starts))
    with FmuProcess(about.path, about.kind, *ports, patience=patience) as process:
        twice = [
            process.simulate("record r", "simulation 1 of 1", points, np.array(drives)[:, None], starts)
            for _ in range(2)
        ]
    np.testing.assert_array_equal(twice[0], twice[1])  # nothing is left of the first
    return twice[0][:, 0]


@pytest.mark.parametrize(("version", "kind"), KINDS)
def test_a_foreign_lag_follows_its_closed_form(tmp_path: Path, version: str, kind: str) -> None:
    fmu = lag_fmu(tmp_path / "lag.fmu", version, kind)
    drives = [1.0] * 4 + [-2.0] * 4 + [0.5] * 4
    found = simulated(fmu, drives, {"y": 3.0, "T": 0.8})
    expected = [3.0]
    for drive in drives[:-1]:
        expected.append(drive + (expected[-1] - drive) * np.exp(-0.25 / 0.8))
    np.testing.assert_allclose(found, expected, rtol=2e-6)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_state_and_time_events_are_located(tmp_path: Path, version: str) -> None:
    """The drive is switched off where y reaches 0.8, and on at 3 s; neither is one of the points."""
    fmu = lag_fmu(tmp_path / "lag.fmu", version, "ModelExchange")
    found = simulated(fmu, [1.0] * 9, {"limit": 0.8}, step=0.4)
    off = np.log(5.0)
    times = 0.4 * np.arange(9)
    falling = 0.8 * np.exp(off - times)
    again = 1.0 + (0.8 * np.exp(off - 3.0) - 1.0) * np.exp(3.0 - times)
    expected = np.where(times < off, -np.expm1(-times), np.where(times < 3.0, falling, again))
    np.testing.assert_allclose(found, expected, atol=2e-6)


@pytest.mark.parametrize(("version", "kind"), KINDS)
@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("abort(), 0.0", r"lag\.fmu: the FMU has crashed \(exit code "),
        ("m->time > 0.4 ? NAN : 0.0", r"lag\.fmu: the FMU failed in record r at 0\.\d+ s: "),
        ("m->time > 0.4 ? loop() : 0.0", r"lag\.fmu: the FMU has not finished simulation 1 of 1 in 2 s"),
    ],
    ids=["crash", "nan", "hang"],
)
def test_a_faulty_fmu_is_one_message(tmp_path: Path, version: str, kind: str, fault: str, said: str) -> None:
    fmu = lag_fmu(tmp_path / "lag.fmu", version, kind, rate=fault)
    with pytest.raises(RigctlError, match=said):
        simulated(fmu, [1.0] * 5, {}, patience=2.0)


def test_a_unit_that_the_fmu_defines_is_converted(tmp_path: Path) -> None:
    defined = '<Unit name="%"/><Unit name="tick"><BaseUnit K="1" factor="0.01" offset="273.15"/></Unit>'
    fmu = lag_fmu(tmp_path / "lag.fmu", "3.0", "CoSimulation", units=("%", "tick"), defined=defined)
    found = simulated(fmu, [0.5] * 3, {"y": 273.65})  # 50 % and 50 ticks: at rest
    np.testing.assert_allclose(found, 273.65, rtol=1e-12)


def test_an_unknown_unit_is_refused(tmp_path: Path) -> None:
    fmu = lag_fmu(
        tmp_path / "lag.fmu", "2.0", "ModelExchange", units=("", "tick"), defined='<Unit name="tick"/>'
    )
    with pytest.raises(RigctlError, match=r"lag\.fmu: the FMU has an unknown unit for y.*got 'tick'"):
        simulated(fmu, [0.5], {})


@pytest.mark.parametrize(("version", "kind"), KINDS)
def test_a_program_for_another_computer_is_refused(tmp_path: Path, version: str, kind: str) -> None:
    fmu = lag_fmu(tmp_path / "lag.fmu", version, kind, platform="amiga68")
    with pytest.raises(RigctlError, match=r"no program for this computer, got 'amiga68'; expected"):
        read_description(fmu)
