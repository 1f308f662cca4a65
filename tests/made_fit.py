"""A synthetic fit: records whose noise and misfit a test chooses."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.noise import ChannelNoise, NoiseModel, whiten

Floats = NDArray[np.float64]

CHANNELS = ("position", "pressure")
PHASES = ("extend", "hold", "retract")
#: samples of a phase, one a second
SIZE = 60
RECORDS = 12
#: all of SI units' size: a position in mm and a pressure in Pa
UNITS = ("mm", "Pa")


def made_noise(correlation: float = 0.0, degrees: int = 0, sigma: float = 0.1) -> NoiseModel:
    """The same noise on both channels."""
    channels = (ChannelNoise(name, sigma, correlation, degrees=degrees) for name in CHANNELS)
    return NoiseModel(tuple(channels), 1.0)


def made_fit(
    noise: NoiseModel,
    seed: int,
    misfit: Callable[[int, Floats], Floats] | None = None,
    *,
    still: bool = False,
) -> FitResult:
    """A model of 12 records at 20 to 31 °C that is off by noise, and by what `misfit` makes.

    Parameters
    ----------
    misfit: of a record's place and its times, how far above the measured position the model is, SI.
    still: the modelled position does not move in the hold.
    """
    rng = np.random.default_rng(seed)
    times = np.arange(float(SIZE * len(PHASES)))
    course = np.column_stack([np.linspace(0.0, 1.0, times.size), np.cos(times)])
    if still:
        course[SIZE : 2 * SIZE, 0] = course[SIZE, 0]
    records = []
    for index in range(RECORDS):
        values = course + noise.draw(times, rng)
        if misfit is not None:
            values[:, 0] -= misfit(index, times)
        records.append(
            MeasuredRecord(
                run="r",
                index=index,
                label=f"r/{index + 1}",
                times=times,
                switch_times=np.array([0.0]),
                switch_half=np.zeros(1),
                inputs=np.zeros((1, 1)),
                values=values,
                condition={"oil": 293.15 + index},
                group=index,
                phase=np.repeat(np.arange(len(PHASES)), SIZE),
                phases=PHASES,
            )
        )
    ok = np.ones((times.size, 2), bool)
    problem: Any = SimpleNamespace(
        records=tuple(records),
        ok=(ok,) * RECORDS,
        sigma=tuple(noise.sigma_at(record.values) for record in records),
        noise=noise,
        whiteners=(whiten(noise, times, ok),) * RECORDS,
        measurements=Measurements(CHANNELS, UNITS, ("valve",), tuple(records), None, ("r",)),
    )
    own = (np.empty(0),) * RECORDS
    return FitResult(problem, tuple(range(RECORDS)), None, np.empty(0), own, (course,) * RECORDS)
