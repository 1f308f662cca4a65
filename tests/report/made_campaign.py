"""Synthetic runs of the published bench: similar to real ones, and quick to make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.dataset import RunHeader, RunWriter, Source, calibrations_of, source_of_rig
from rigctl.plan.measured import MeasuredValue
from rigctl.rig import Rig, load_rig

RIG_FILE = Path(__file__).parents[2] / "rigs" / "hl32-bench.yaml"
TEMPERATURES = (20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)  # degC
PRESSURES = (20.0, 30.0, 40.0, 50.0)  # bar
BAR, ZERO = 1e5, 273.15
#: the published strokes in mm at 20 degC, and their loss at 60 degC
STROKES = {20.0: (77.0, 3.7), 30.0: (97.0, 5.8), 40.0: (100.0, 6.5), 50.0: (125.0, 6.0)}
OPENS, CLOSES, RETRACTS, ENDS = 0.2, 1.25, 2.25, 3.75  # s of a record
STARTED = datetime(2026, 11, 21, 9, 30, tzinfo=UTC)


@dataclass(frozen=True)
class Campaign:
    """What is made: a sweep of temperatures and pressures, watched at 10 Hz between the records."""

    temperatures: Sequence[float] = TEMPERATURES
    pressures: Sequence[float] = PRESSURES
    rate: float = 100.0  # Hz
    idle_rows: int = 100  # before each record
    name: str = "stroke campaign"
    record: str = "stroke"
    run_id: str = "20261121-093000-stroke-campaign"
    operator: str = "Ada"
    repeats: int = 1
    seed: int = 1
    measure: bool = True
    facts: dict[str, object] = field(default_factory=dict)  # of the header


def published_stroke(temperature: float, pressure: float) -> float:
    """mm; falls to 60 degC, and rises a little after it."""
    full, drop = STROKES[pressure]
    return full - drop * (1.0 - ((temperature - 60.0) / 40.0) ** 2)


def make_campaign(runs: Path, campaign: Campaign | None = None, rig: Rig | None = None) -> Path:
    """Record the campaign under `runs`; returns the run's folder."""
    campaign, rig = campaign or Campaign(), rig or load_rig(RIG_FILE)
    header = {
        "procedure": Source(campaign.name, "procedure: stroke campaign\nsteps: []\n", path="campaign.yaml"),
        "rig": source_of_rig(rig),
        "layout": rig.layout,
        "started": STARTED,
        "backend": {"kind": "serial", "firmware": "rigfw 1.2", "serial_number": "A-17"},
        "operator": campaign.operator,
        "clock": "real",
        "seed": campaign.seed,
        "versions": {"rigctl": "0.1.0", "python": "3.11"},
        "calibrations": calibrations_of(rig),
        **campaign.facts,
    }
    writer = RunWriter.create(runs, RunHeader(id=campaign.run_id, **header))  # type: ignore[arg-type]
    random = np.random.default_rng(campaign.seed)
    writer.event(0.0, "state", message="idle → arming → running")
    time = 0.0
    for temperature in campaign.temperatures:
        for pressure in campaign.pressures:
            for _ in range(campaign.repeats):
                time = _idle(writer, campaign, time, temperature, pressure, random)
                time = _record(writer, campaign, time, temperature, pressure, random)
    return writer.close("finished")


def _idle(
    writer: RunWriter,
    campaign: Campaign,
    time: float,
    temperature: float,
    pressure: float,
    random: np.random.Generator,
) -> float:
    times = time + 0.1 * np.arange(1, campaign.idle_rows + 1)
    rows = _rows(times, -1, temperature, pressure, np.zeros_like(times), np.zeros_like(times), random)
    rows[:, 5] = np.arange(len(times)) % 40 < 20  # the heater
    writer.append_block(rows)
    return float(times[-1]) if len(times) else time


def _record(
    writer: RunWriter,
    campaign: Campaign,
    start: float,
    temperature: float,
    pressure: float,
    random: np.random.Generator,
) -> float:
    local = np.arange(0.0, ENDS, 1.0 / campaign.rate)
    stroke = published_stroke(temperature, pressure)
    sweep = {"oil": (temperature + ZERO, "degC"), "supply": (pressure * BAR, "bar")}
    index = writer.open_record(start, campaign.record, sweep, f"1/for/{campaign.record}", campaign.rate)
    out = np.clip((local - OPENS) / (CLOSES - OPENS), 0.0, 1.0)
    back = np.clip((local - RETRACTS) / (ENDS - 0.2 - RETRACTS), 0.0, 1.0)
    position = stroke * (out - back)
    valve = np.where(local < OPENS, 0.0, np.where(local < CLOSES, 1.0, np.where(local < RETRACTS, 0.0, -1.0)))
    writer.append_block(_rows(start + local, index, temperature, pressure, position, valve, random))
    writer.event(start + OPENS, "command", actuator="valve", value=1.0, uncertainty=0.0)
    writer.event(start + CLOSES, "command", actuator="valve", value=0.0, uncertainty=0.0)
    if campaign.measure:
        writer.measure(MeasuredValue("travel", stroke * 1e-3, "mm", 0.07, 0.13, 70.0 <= stroke <= 130.0))
    writer.close_record(start + ENDS, "complete")
    return start + ENDS


def _rows(
    times: NDArray[np.float64],
    record: int,
    temperature: float,
    pressure: float,
    position: NDArray[np.float64],
    valve: NDArray[np.float64],
    random: np.random.Generator,
) -> NDArray[np.float64]:
    """Columns of the published bench: time, record, three channels, heater, valve, relief valve; SI."""
    rows = np.empty((len(times), 8))
    rows[:, 0], rows[:, 1] = times, record
    rows[:, 2] = temperature + ZERO + 0.25 * np.round(random.normal(0.0, 0.4, len(times)))
    rows[:, 3] = (pressure - 1.5 * (valve != 0.0) + random.normal(0.0, 0.08, len(times))) * BAR
    rows[:, 4] = position * 1e-3 + 1e-4 * random.normal(0.0, 1.0, len(times))
    rows[:, 5], rows[:, 6], rows[:, 7] = 0.0, valve, pressure * BAR
    return rows
