"""The data of the timings: campaigns of the separate bench with a worn spool."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from rigctl.dataset import Run, open_run
from rigctl_validation.bench import record as bench_record
from rigctl_validation.bench.campaign import Campaign, clean_outputs, operating_points
from rigctl_validation.bench.parameters import BenchParameters
from rigctl_validation.benches.bench import BenchCampaign, write_bench
from rigctl_validation.benches.register import find_bench
from rigctl_validation.campaign_run import make_run
from rigctl_validation.hidden_effect import hide
from rigctl_validation.hidden_library import find_hidden
from rigctl_validation.planted.terms import find_planted

ROOT = Path(__file__).parents[2]
RIG = ROOT / "rigs" / "hl32-bench.yaml"
CHAMBERS_RIG = ROOT / "rigs" / "hl32-bench-instrumented.yaml"
MODEL = ROOT / "models" / "hl32-textbook.yaml"
#: the published campaign, 28 records of 376 samples, with a leaking valve
STANDARD = Campaign(bench=BenchParameters(spool_leak=8e-15), seed=1)
#: hidden at once, each of its typical size
THREE = ("valve_leakage", "coulomb_friction", "flow_area_thermal_drift")
#: of long records: samples a second, so that one has ten thousand
FAST = 10_000 / 3.75
#: of a user's own bench
OWN_RECORDS, OWN_SAMPLES = 12, 600


def run_of(records: int, folder: Path) -> Run:
    """A run of standard records, at four pressures and as many temperatures as necessary."""
    hot = np.linspace(20.0, 80.0, records // 4)
    path = make_run(replace(STANDARD, temperatures=tuple(hot.tolist())), RIG, folder)
    return open_run(path)


def runs_of_sensors(folder: Path) -> dict[str, Path]:
    """The standard run with exact sensors, a stated uncertainty, and stated kinds of calibration."""
    text = RIG.read_text("utf-8")
    rigs = {
        "exact sensors": re.sub(r"\n *uncertainty: .*", "", text),
        "a stated uncertainty": text,
        "calibrations of a stated kind": re.sub(r"(\n *)(uncertainty: .*)", r"\1\2\1kind: line", text),
    }
    runs = {}
    for index, (name, rig) in enumerate(rigs.items()):
        path = folder / str(index) / "rig.yaml"
        path.parent.mkdir(parents=True)
        path.write_text(rig, "utf-8")
        runs[name] = make_run(STANDARD, path, path.parent / "runs")
    return runs


def run_of_three(folder: Path) -> Run:
    """The standard campaign on a bench with three hidden effects of the library, with its own shapes."""
    hidden = [(find_hidden(name), find_hidden(name).typical) for name in THREE]
    return open_run(make_run(hide(Campaign(seed=1), hidden, "other"), RIG, folder))


def run_of_chambers(folder: Path) -> Run:
    """32 strokes with a leaking valve and both chamber pressures recorded, four of them repeats."""
    campaign = replace(STANDARD, chamber_pressures=True, repeated=4)
    return open_run(make_run(campaign, CHAMBERS_RIG, folder))


def write_tight(folder: Path) -> Path:
    """The run of `docs/tutorial/nothing-fits.md`: 32 strokes of a rod that is tight at one position."""
    hidden = [(find_planted("tight").hidden, 80.0)]
    campaign = Campaign(chamber_pressures=True, repeated=4)
    return make_run(hide(campaign, hidden, "other"), CHAMBERS_RIG, folder)


def write_own_bench(folder: Path) -> Path:
    """Write a user's bench with three states and a hidden effect, and a log of 12 records of 600 samples
    (eight conditions, four of them repeated); return the log."""
    campaign = BenchCampaign(find_bench("chain"), 0.03, noise="none", seed=1)
    log = write_bench(campaign, folder)
    clean = pd.read_csv(log)
    records = [rows.iloc[:OWN_SAMPLES] for _, rows in clean.groupby("record", sort=False)]
    taken = [*records, *records[: OWN_RECORDS - len(records)]]
    rng = np.random.default_rng(1)
    noisy = [rows.assign(record=number) for number, rows in enumerate(taken, start=1)]
    for rows in noisy:
        for channel, sigma in campaign.bench.noise.items():
            column = f"{channel} [{campaign.bench.columns[channel]}]"
            rows[column] += sigma * rng.standard_normal(len(rows))
    pd.concat(noisy).to_csv(log, index=False)
    return log


def write_fast(path: Path, repeats: int) -> int:
    """The standard campaign from a fast logger, several times over, as Parquet; returns the rows."""
    bench_record.RATE = FAST
    clean = clean_outputs(STANDARD)
    rows = 0
    with pq.ParquetWriter(path, _SCHEMA) as file:
        for table in _tables(clean, repeats):
            file.write_table(table)
            rows += table.num_rows
    return rows


_UNITS = {
    "time": "s",
    "record": "",
    "valve": "1",
    "oil_temperature": "degC",
    "supply_pressure": "bar",
    "pressure_setpoint": "bar",
    "position": "mm",
}
_SCHEMA = pa.schema(
    [
        pa.field(name, pa.float64() if unit else pa.int32(), metadata={"unit": unit} if unit else {})
        for name, unit in _UNITS.items()
    ]
)


def _tables(clean: list[tuple[np.ndarray, dict[str, np.ndarray]]], repeats: int) -> Iterator[pa.Table]:
    rng = np.random.default_rng(1)
    edges = np.cumsum([duration for _, duration in bench_record.STANDARD])[:-1]
    commands = np.array([command for command, _ in bench_record.STANDARD])
    noise = STANDARD.noise.sigma
    for number in range(repeats * len(clean)):
        time, channels = clean[number % len(clean)]
        pressure = operating_points(STANDARD)[number % len(clean)][1]
        read = {
            name: values + noise[name] * rng.standard_normal(time.size) for name, values in channels.items()
        }
        columns = [
            time,
            np.full(time.size, number, dtype=np.int32),
            commands[np.searchsorted(edges, time + 1e-9, side="right")],
            read["oil_temperature"] - 273.15,
            read["supply_pressure"] / 1e5,
            np.full(time.size, pressure),
            read["position"] * 1e3,
        ]
        yield pa.table(columns, schema=_SCHEMA)
