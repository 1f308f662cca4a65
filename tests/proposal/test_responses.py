"""First values of drafts, from systems whose parameters are known (simulated by SciPy alone)."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lsim

from rigctl.proposal.choice import suggest
from rigctl.proposal.columns import Column, Table
from rigctl.proposal.propose import propose
from rigctl.proposal.responses import (
    driven_mass_response,
    first_order_response,
    second_order_response,
    tells_no_directions,
)

Floats = NDArray[np.float64]


def column(name: str, unit: str, values: Floats, *, drives: bool = False, held: bool = False) -> Column:
    role = "input" if drives else "output"
    return Column(
        name, name, unit, values, role=role, stepped=held, origin="commanded" if drives else "measured"
    )


def table(times: Floats, *columns: Column) -> Table:
    return Table(None, columns, times, np.zeros(times.size, dtype=np.int64))


def prbs(count: int, hold: int, seed: int) -> Floats:
    levels = np.random.default_rng(seed).integers(0, 2, count // hold + 1)
    return np.repeat(2.0 * levels - 1.0, hold)[:count]


def held(above: list[float], below: list[float], u: Floats, times: Floats) -> Floats:
    """The exact response to an input that holds between samples."""
    return np.asarray(lsim((above, below), u, times, interp=False)[1])


def test_a_lag_is_found_from_random_switches() -> None:
    times = np.arange(800) * 0.05
    u = prbs(800, 7, 1)
    y = 3.0 + held([2.0], [0.8, 1.0], u, times) + np.random.default_rng(2).normal(0.0, 0.05, 800)
    log = table(times, column("u", "V", u, drives=True, held=True), column("y", "V", y))
    found = first_order_response(log, log.columns[1], log.columns[:1])
    assert found is not None
    assert 1.0 / found.rates[0] == pytest.approx(0.8, rel=0.05)
    assert found.gains[0] == pytest.approx(2.0, rel=0.02)
    assert found.rest == pytest.approx(3.0, rel=0.02)
    assert suggest(log).template == "first-order"


def test_a_resonance_is_found_under_a_multisine_of_times_that_were_rounded() -> None:
    """A tenth of a microsecond in the median step is a whole sample after ten thousand of them."""
    count, rate = 4000, 610.35
    times = np.arange(count) / rate
    phases = np.random.default_rng(3).uniform(0.0, 2.0 * np.pi, 900)
    lines = np.arange(1, 901) * (200.0 / 900.0)
    u = np.cos(2.0 * np.pi * lines[:, None] * times + phases[:, None]).sum(axis=0) / 30.0
    omega, zeta = 430.0, 0.04
    y = lsim(([1.1 * omega**2], [1.0, 2.0 * zeta * omega, omega**2]), u, times)[1]
    log = table(
        np.round(times, 6), column("force", "V", u, drives=True), column("position", "V", np.asarray(y))
    )
    found = second_order_response(log, log.columns[1], log.columns[:1])
    assert found is not None
    assert found.rates == (pytest.approx(omega, rel=0.02), pytest.approx(zeta, rel=0.2))
    assert found.unexplained < 0.05
    assert suggest(log).template == "second-order"


def test_a_light_mass_on_a_spring_is_drafted_with_bounds_around_it() -> None:
    """5.3 g on 1 kN/m, released; the draft had 85 kg."""
    times = np.arange(2000) * 1e-4
    omega, zeta = np.sqrt(1000.0 / 5.3e-3), 0.01
    force = prbs(2000, 40, 4)
    x = 1e3 * held([omega**2 / 1000.0], [1.0, 2.0 * zeta * omega, omega**2], force, times)
    x += np.random.default_rng(5).normal(0.0, 0.01, 2000)
    log = table(
        times,
        column("force", "N", force, drives=True, held=True),
        Column("x", "x", "mm", 1e-3 * x, role="output"),
    )
    parameters = propose("spring", log, "mass-spring-damper").draft.parameters
    assert parameters["mass"].value == pytest.approx(5.3e-3, rel=0.1)
    assert parameters["stiffness"].value == pytest.approx(1000.0, rel=0.1)
    assert parameters["mass"].low <= 5.3e-5 < 0.53 <= parameters["mass"].high


def test_a_driven_mass_is_found_from_its_position() -> None:
    times = np.arange(1500) * 0.01
    volts = 3.0 * prbs(1500, 60, 6) * np.linspace(0.5, 1.0, 1500)
    x = held([0.3], [1.0, 3.6, 0.0], volts, times)
    log = table(
        times, column("voltage", "V", volts, drives=True, held=True), Column("x", "x", "m", x, role="output")
    )
    found = driven_mass_response(log, log.columns[1], log.columns[:1])
    assert found is not None
    assert (found.rates[0], found.gains[0]) == (pytest.approx(3.6, rel=0.05), pytest.approx(0.3, rel=0.05))
    assert suggest(log).template == "driven-mass"
    draft = propose("axis", log, None).draft
    assert draft.parameters["mass"].value == pytest.approx(1.0 / 0.3, rel=0.05)
    assert not draft.parameters["force_gain"].fit  # no data tell it from the mass


def test_a_sensor_without_directions_is_noticed() -> None:
    times = np.arange(1500) * 0.02
    u = prbs(1500, 20, 7)
    z = held([2.0 * 169.0], [1.0, 2.0 * 0.7 * 13.0, 169.0], u, times)
    log = table(times, column("u", "V", u, drives=True, held=True), column("y", "V", np.abs(z)))
    found = tells_no_directions(log, log.columns[1], log.columns[:1])
    assert found is not None
    assert found.rates == (pytest.approx(13.0, rel=0.05), pytest.approx(0.7, rel=0.1))
    draft = propose("drive", log, None).draft
    assert "absolute(y_with_sign, corner)" in draft.outputs["y"].formula
    signed = table(times, log.columns[0], column("y", "V", z))
    assert tells_no_directions(signed, signed.columns[1], signed.columns[:1]) is None


def test_missing_blocks_of_an_input_and_of_an_output_are_bridged() -> None:
    times = np.arange(800) * 0.05
    u = prbs(800, 7, 1)
    y = held([2.0], [0.8, 1.0], u, times)
    u[200:204], y[400:450] = np.nan, np.nan
    log = table(times, column("u", "V", u, drives=True, held=True), column("y", "V", y))
    found = first_order_response(log, log.columns[1], log.columns[:1])
    assert found is not None
    assert 1.0 / found.rates[0] == pytest.approx(0.8, rel=0.1)
