"""A campaign on the separate bench as a run: as if it had been carried out, or imported from a file."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rigctl.dataset import RunHeader, RunWriter, Source, calibrations_of, current_versions, source_of_rig
from rigctl.dataset.run_id import new_run_id
from rigctl.errors import RigctlError
from rigctl.rig import Layout, load_rig
from rigctl_validation.bench.campaign import (
    ZERO_CELSIUS,
    Campaign,
    Measured,
    operating_points,
    recorded_channels,
    simulate_records,
    write_csv,
)
from rigctl_validation.bench.devices import Device, simulate_on_devices

if TYPE_CHECKING:
    from rigctl.rig import Rig

_NAME = "separate bench"
#: time from the start of a record to the start of the next, s
_PERIOD = 60.0


def make_run(
    campaign: Campaign,
    rig_path: Path,
    runs: Path,
    *,
    imported: bool = False,
    started: datetime | None = None,
    devices: Sequence[Device] = (),
) -> Path:
    """Measure the campaign and keep it as a run in the folder `runs`; returns the run's own folder.

    Parameters
    ----------
    rig_path: the rig file, e.g. ``rigs/hl32-bench.yaml``; it must have every channel of the campaign.
    imported: through a CSV file and the import, so that switch times are known to within a sample only;
        otherwise as a board reports them, exactly.
    started: time of measurement, if not imported; now by default.
    devices: what reads the channels, each at its own times; without, all are read together. Not if imported.

    Raises
    ------
    RigctlError
        the rig has another bench's channels, or the folder cannot be written.
    """
    rig = load_rig(rig_path)
    if imported:
        return _imported(campaign, rig, runs)
    records = simulate_on_devices(campaign, devices) if devices else simulate_records(campaign)
    return _carried_out(campaign, records, rig, runs, started)


def _imported(campaign: Campaign, rig: Rig, runs: Path) -> Path:
    from tempfile import TemporaryDirectory

    from rigctl.dataset.importing.bring_in import import_file

    with TemporaryDirectory() as folder:
        path = Path(folder) / "campaign.csv"
        write_csv(campaign, path)
        return import_file(path, rig, runs).path


def _carried_out(
    campaign: Campaign, records: Sequence[Measured], rig: Rig, runs: Path, started: datetime | None
) -> Path:
    layout = _layout(campaign, rig)
    now = started or datetime.now(UTC)
    calibrations = calibrations_of(rig)
    header = RunHeader(
        id=new_run_id(_NAME, now, runs),
        procedure=Source(_NAME),
        rig=source_of_rig(rig),
        layout=layout,
        started=now,
        backend={"kind": _NAME},
        clock="virtual",
        seed=campaign.seed,
        versions=current_versions(),
        calibrations={name: calibrations[name] for name in layout.channels},
    )
    writer = RunWriter.create(runs, header)
    try:
        for number, (point, record) in enumerate(zip(operating_points(campaign), records, strict=True)):
            _write(writer, layout, record, point[0] + ZERO_CELSIUS, number * _PERIOD)
        return writer.close("finished")
    except BaseException:
        writer.discard()
        raise


def _layout(campaign: Campaign, rig: Rig) -> Layout:
    channels = recorded_channels(campaign)
    roles = rig.roles
    missing = [name for name in channels if name not in rig.channels]
    if missing or roles.set_pressure is None or roles.extend is None:
        raise RigctlError(
            "the rig is not the bench that was simulated",
            value=rig.name,
            expected=f"channels {', '.join(channels)} and roles for pressure and motion",
        )
    commands = (roles.extend.actuator, roles.set_pressure.actuator)
    units = [rig.channels[name].unit for name in channels]
    units += [rig.actuators[name].display_unit for name in commands]
    return Layout(channels=channels, commands=commands, units=("s", "1", *units))


def _write(writer: RunWriter, layout: Layout, record: Measured, oil: float, start: float) -> None:
    """One record; the valve is switched exactly at the samples that first show it."""
    valve, relief = layout.commands
    sweep = {"oil_temperature": (oil, "degC"), relief: (record.setting, "bar")}
    time = record.time + start
    index = writer.open_record(start, "stroke", sweep, f"record {start / _PERIOD + 1:g}", _rate(record))
    writer.event(start, "command", actuator=relief, value=record.setting, uncertainty=0.0)
    for sample in (np.flatnonzero(np.diff(record.command)) + 1).tolist():
        value = float(record.command[sample])
        writer.event(float(time[sample]), "command", actuator=valve, value=value, uncertainty=0.0)
    setting = np.full(time.size, record.setting)
    channels = [record.channels[name] for name in layout.channels]
    rows = [time, np.full(time.size, float(index)), *channels, record.command, setting]
    writer.append_block(np.column_stack(rows))
    writer.close_record(float(time[-1]), "complete")


def _rate(record: Measured) -> float:
    return round(1.0 / float(np.diff(record.time[np.isfinite(record.channels["position"])]).min()), 6)
