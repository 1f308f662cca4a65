"""Campaigns of the separate bench, integrated once, with new noise for every test."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.noise import NoiseRecord
from rigctl_validation.bench.campaign import Campaign, Scatter, simulate_campaign
from rigctl_validation.bench.sensing import TEN_BITS, Noise, coloured

NAMES = ("oil_temperature", "supply_pressure", "position", "pressure_a", "pressure_b")
SIGMA = np.array([Noise().sigma[name] for name in NAMES])
STEP = np.array([TEN_BITS[name] for name in NAMES])
OFFSET = np.array([273.15, 0.0, 0.0, 0.0, 0.0])
TO_SI = np.array([1.0, 1e5, 1e-3, 1e5, 1e5])


@dataclass(frozen=True)
class Truth:
    """A campaign without noise: per record the times, the channels (SI), the phase, and the condition."""

    records: list[NoiseRecord]

    def measured(self, seed: int, correlation: float, *, ten_bits: bool = False) -> list[NoiseRecord]:
        """One noisy recording of the campaign."""
        rng = np.random.default_rng(seed)
        return [
            NoiseRecord(
                each.times,
                self._channels(each.values, rng, correlation, ten_bits),
                each.condition,
                each.phase,
            )
            for each in self.records
        ]

    @staticmethod
    def _channels(
        truth: NDArray[np.float64], rng: np.random.Generator, correlation: float, ten_bits: bool
    ) -> NDArray[np.float64]:
        noise = [coloured(rng, truth.shape[0], sigma, correlation) for sigma in SIGMA]
        values = truth + np.stack(noise, axis=1)
        return np.round(values / STEP) * STEP if ten_bits else values


def _truth(scatter: Scatter) -> Truth:
    quiet = Noise(sigma=dict.fromkeys(NAMES, 1e-15))
    table = simulate_campaign(
        Campaign(noise=quiet, scatter=scatter, repeated=4, chamber_pressures=True, seed=7)
    )
    records, conditions = [], dict[tuple[float, float], int]()
    for _, part in table.groupby("record"):
        shown = [column for column in part.columns if str(column).split()[0] in NAMES]
        values = part[shown].to_numpy() * TO_SI + OFFSET
        key = (float(np.round(values[0, 0])), float(part["pressure_setpoint [bar]"].iloc[0]))
        phase = np.cumsum(np.concatenate([[0], np.diff(part["valve [1]"].to_numpy()) != 0]))
        number = conditions.setdefault(key, len(conditions))
        records.append(NoiseRecord(part["time [s]"].to_numpy(), values, number, phase.astype(np.intp)))
    return Truth(records)


@pytest.fixture(scope="session")
def bench_truth() -> Truth:
    """28 conditions, four of them repeated, with a little scatter between runs."""
    return _truth(Scatter(setting=0.002, oil=0.05, trapped=0.01, position_zero=5e-5))


@pytest.fixture
def plain_record() -> Callable[..., NoiseRecord]:
    """A record at 100 Hz from one channel's values."""

    def make(values: NDArray[np.float64], condition: int = 0) -> NoiseRecord:
        columns = values if values.ndim == 2 else values[:, None]
        size = columns.shape[0]
        return NoiseRecord(np.arange(size) * 0.01, columns, condition, np.zeros(size, np.intp))

    return make
