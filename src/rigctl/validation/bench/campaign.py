"""A campaign on the separate bench: conditions, repeats, run-to-run scatter; a table or a CSV file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rigctl.validation.bench.parameters import Bench, Sensors, Switching
from rigctl.validation.bench.record import Condition, simulate_record
from rigctl.validation.bench.sensing import Noise, measure

if TYPE_CHECKING:
    import pandas as pd

ZERO_CELSIUS = 273.15

#: the published campaign's operating points: degC and bar
TEMPERATURES = (20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)
PRESSURES = (20.0, 30.0, 40.0, 50.0)


@dataclass(frozen=True)
class Scatter:
    """What differs from run to run although nobody meant it: standard deviations."""

    setting: float = 0.0  # share of the pressure setting
    oil: float = 0.0  # K
    trapped: float = 0.0  # share of the trapped pressure
    position_zero: float = 0.0  # m


@dataclass(frozen=True)
class Campaign:
    """Everything that makes the data of one campaign; the same seed gives the same bytes."""

    bench: Bench = field(default_factory=Bench)
    sensors: Sensors = field(default_factory=Sensors)
    switching: Switching = field(default_factory=Switching)
    noise: Noise = field(default_factory=Noise)
    scatter: Scatter = field(default_factory=Scatter)
    temperatures: Sequence[float] = TEMPERATURES  # degC
    pressures: Sequence[float] = PRESSURES  # bar
    repeated: int = 0  # how many of the conditions are measured a second time
    chamber_pressures: bool = False
    seed: int = 0


def simulate_campaign(campaign: Campaign) -> pd.DataFrame:
    """All records as one table, columns named with their units as in a file to import."""
    import pandas as pd

    rng = np.random.Generator(np.random.PCG64(campaign.seed))
    points = [(t, p) for t in campaign.temperatures for p in campaign.pressures]
    again = rng.choice(len(points), size=campaign.repeated, replace=False) if campaign.repeated else ()
    points += [points[int(i)] for i in sorted(again)]
    return pd.concat(
        [_record(campaign, f"{i + 1:03d}", t, p, rng) for i, (t, p) in enumerate(points)], ignore_index=True
    )


def _record(
    campaign: Campaign, name: str, oil: float, pressure: float, rng: np.random.Generator
) -> pd.DataFrame:
    import pandas as pd

    scatter = campaign.scatter
    draw = rng.standard_normal(4)
    condition = Condition(
        oil=oil + ZERO_CELSIUS + scatter.oil * draw[0],
        setting=pressure * 1e5 * (1.0 + scatter.setting * draw[1]),
        trapped=0.9 * (1.0 + scatter.trapped * draw[2]),
    )
    trace = simulate_record(campaign.bench, condition, switching=campaign.switching, rng=rng)
    sensors = campaign.sensors._replace(
        position_offset=campaign.sensors.position_offset + scatter.position_zero * draw[3]
    )
    channels = measure(trace, sensors, campaign.noise, rng)
    table = {
        "time [s]": trace.time,
        "record": name,
        "valve [1]": trace.command,
        "oil_temperature [degC]": channels["oil_temperature"] - ZERO_CELSIUS,
        "supply_pressure [bar]": channels["supply_pressure"] / 1e5,
        "pressure_setpoint [bar]": np.full(trace.time.size, pressure),
        "position [mm]": channels["position"] * 1e3,
    }
    if campaign.chamber_pressures:
        table["pressure_a [bar]"] = channels["pressure_a"] / 1e5
        table["pressure_b [bar]"] = channels["pressure_b"] / 1e5
    return pd.DataFrame(table)


def write_csv(campaign: Campaign, path: Path) -> None:
    """The campaign as a self-describing CSV file that `rigctl import` takes."""
    simulate_campaign(campaign).to_csv(path, index=False, float_format="%.9g", lineterminator="\n")
