"""A campaign on the separate bench: conditions, repeats, run-to-run scatter; a table or a CSV file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigctl_validation.bench.parameters import BenchParameters, Sensors, Switching
from rigctl_validation.bench.record import RATE, Condition, Trace, simulate_record
from rigctl_validation.bench.sensing import CHANNELS, Noise, measure, true_channels

if TYPE_CHECKING:
    import pandas as pd

ZERO_CELSIUS = 273.15

#: the published campaign's operating points: degC and bar
TEMPERATURES = (20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)
PRESSURES = (20.0, 30.0, 40.0, 50.0)
#: traces that are kept in memory, about 36 kB each
_KEPT = 2048


@dataclass(frozen=True)
class Scatter:
    """Unintended scatter between runs: standard deviations."""

    setting: float = 0.0  # share of the pressure setting
    oil: float = 0.0  # K
    trapped: float = 0.0  # share of the trapped pressure
    position_zero: float = 0.0  # m


@dataclass(frozen=True)
class Campaign:
    """All settings of one campaign; equal seeds give identical data."""

    bench: BenchParameters = field(default_factory=BenchParameters)
    sensors: Sensors = field(default_factory=Sensors)
    switching: Switching = field(default_factory=Switching)
    noise: Noise = field(default_factory=Noise)
    scatter: Scatter = field(default_factory=Scatter)
    temperatures: Sequence[float] = TEMPERATURES  # degC
    pressures: Sequence[float] = PRESSURES  # bar
    repeated: int = 0  # number of conditions that are measured twice
    chamber_pressures: bool = False
    seed: int = 0


@dataclass(frozen=True)
class Measured:
    """One record as logged: SI, one value per sample; `setting` [Pa] is the nominal pressure setting."""

    time: NDArray[np.float64]
    command: NDArray[np.float64]
    setting: float
    channels: dict[str, NDArray[np.float64]]


def recorded_channels(campaign: Campaign) -> tuple[str, ...]:
    """The channels that the campaign's sensors show, in the order of `CHANNELS`."""
    return tuple(name for name in CHANNELS if campaign.chamber_pressures or not name.startswith("pressure_"))


def operating_points(campaign: Campaign) -> list[tuple[float, float]]:
    """Oil temperature [degC] and pressure setting [bar] of every record.

    The repeated ones come last: spread evenly over the conditions, the same for every seed.
    """
    points = [(t, p) for t in campaign.temperatures for p in campaign.pressures]
    every = len(points) / max(campaign.repeated, 1)
    return points + [points[int((k + 0.5) * every)] for k in range(campaign.repeated)]


def clean_outputs(campaign: Campaign) -> list[tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]]:
    """Time [s] and channels [SI] of every record without noise, scatter, converter and jitter."""
    steady = campaign.switching._replace(jitter=0.0, jitter_share=0.0)
    shown = []
    for oil, pressure in operating_points(campaign):
        trace = _trace(campaign.bench, Condition(oil + ZERO_CELSIUS, pressure * 1e5), steady)
        channels = true_channels(trace, campaign.sensors)
        shown.append((trace.time, {name: channels[name] for name in recorded_channels(campaign)}))
    return shown


def simulate_records(campaign: Campaign) -> list[Measured]:
    """Every record as logged; each has an independent random stream."""
    points = operating_points(campaign)
    return [
        _measured(campaign, oil, pressure, generator(campaign.seed, 1 + i))
        for i, (oil, pressure) in enumerate(points)
    ]


def generator(seed: int, stream: int) -> np.random.Generator:
    """An independent random stream of a campaign: 1 + i is that of record i."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(stream,))))


@lru_cache(maxsize=_KEPT)
def _trace(bench: BenchParameters, condition: Condition, switching: Switching) -> Trace:
    """Noise-free outputs, simulated once; the arrays are read-only."""
    trace = simulate_record(bench, condition, switching=switching)
    for array in (trace.time, trace.command, trace.states):
        array.flags.writeable = False
    return trace


def _measured(campaign: Campaign, oil: float, pressure: float, rng: np.random.Generator) -> Measured:
    trace, sensors = scattered_trace(campaign, oil, pressure, rng)
    channels = measure(trace, sensors, campaign.noise, rng)
    recorded = {name: channels[name] for name in recorded_channels(campaign)}
    return Measured(trace.time, trace.command, pressure * 1e5, recorded)


def scattered_trace(
    campaign: Campaign, oil: float, pressure: float, rng: np.random.Generator, rate: float = RATE
) -> tuple[Trace, Sensors]:
    """The outputs of one record [degC, bar] with its scatter but without noise, and the sensors during it."""
    scatter, switching = campaign.scatter, campaign.switching
    draw = rng.standard_normal(4)
    condition = Condition(
        oil=oil + ZERO_CELSIUS + scatter.oil * float(draw[0]),
        setting=pressure * 1e5 * (1.0 + scatter.setting * float(draw[1])),
        trapped=0.9 * (1.0 + scatter.trapped * float(draw[2])),
    )
    if scatter.oil or scatter.setting or scatter.trapped or switching.random or rate != RATE:
        trace = simulate_record(campaign.bench, condition, switching=switching, rng=rng, rate=rate)
    else:
        trace = _trace(campaign.bench, condition, switching)
    zero = campaign.sensors.position_offset + scatter.position_zero * float(draw[3])
    return trace, campaign.sensors._replace(position_offset=zero)


def simulate_campaign(campaign: Campaign) -> pd.DataFrame:
    """All records as one table; column names have units, as in a file for import."""
    import pandas as pd

    records = simulate_records(campaign)
    return pd.concat([_table(f"{i + 1:03d}", record) for i, record in enumerate(records)], ignore_index=True)


def _table(name: str, record: Measured) -> pd.DataFrame:
    import pandas as pd

    channels = dict(record.channels)
    table = {
        "time [s]": record.time,
        "record": name,
        "valve [1]": record.command,
        "oil_temperature [degC]": channels.pop("oil_temperature") - ZERO_CELSIUS,
        "supply_pressure [bar]": channels.pop("supply_pressure") / 1e5,
        "pressure_setpoint [bar]": np.full(record.time.size, record.setting / 1e5),
        "position [mm]": channels.pop("position") * 1e3,
    }
    return pd.DataFrame(table | {f"{name} [bar]": values / 1e5 for name, values in channels.items()})


def write_csv(campaign: Campaign, path: Path, digits: int = 9) -> None:
    """Write the campaign as a CSV file for `rigctl import`, with this number of significant digits."""
    table = simulate_campaign(campaign)
    table.to_csv(path, index=False, float_format=f"%.{digits}g", lineterminator="\n")
