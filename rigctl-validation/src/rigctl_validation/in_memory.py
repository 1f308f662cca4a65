"""A campaign on the separate bench as measurements for a model, without files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rigctl.model.inputs import InputSource, input_sources
from rigctl.model.measured.groups import group_numbers
from rigctl.model.measured.phases import phases_of
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.model.model import Model
from rigctl.rig.rig import Rig
from rigctl_validation.bench.campaign import (
    ZERO_CELSIUS,
    Campaign,
    Measured,
    operating_points,
    recorded_channels,
    simulate_records,
)

_NAME = "separate bench"


def measure(campaign: Campaign, model: Model, rig: Rig) -> Measurements:
    """The measurements that `read_measurements` returns for the run that `make_run` makes of the campaign.

    Parameters
    ----------
    rig: with every channel of the campaign.
    """
    channels = recorded_channels(campaign)
    outputs = tuple(output.name for output in model.family.outputs if output.name in channels)
    sources = input_sources(model.family, rig)
    pairs = zip(operating_points(campaign), simulate_records(campaign), strict=True)
    records = [
        _record(index, oil + ZERO_CELSIUS, record, outputs, sources, model, rig)
        for index, ((oil, _), record) in enumerate(pairs)
    ]
    groups = group_numbers(records)
    return Measurements(
        outputs=outputs,
        units=tuple(rig.channels[name].unit for name in outputs),
        inputs=tuple(item.name for item in model.family.inputs),
        records=tuple(replace(record, group=group) for record, group in zip(records, groups, strict=True)),
        rig=rig,
        runs=(_NAME,),
    )


def _record(
    index: int,
    oil: float,
    record: Measured,
    outputs: Sequence[str],
    sources: Sequence[InputSource],
    model: Model,
    rig: Rig,
) -> MeasuredRecord:
    assert rig.roles.extend is not None and rig.roles.set_pressure is not None  # noqa: S101 - it is the bench
    valve, relief = rig.roles.extend.actuator, rig.roles.set_pressure.actuator
    switches = np.concatenate([[0], np.flatnonzero(np.diff(record.command)) + 1])
    times = record.time[switches] - record.time[0]
    idle = dict.fromkeys(rig.actuators, 0.0)
    commands = [idle | {valve: float(record.command[k]), relief: record.setting} for k in switches]
    inputs = np.array([[source.of(row) for source in sources] for row in commands])
    units = [_unit(source, rig) for source in sources]
    phase, names = phases_of(record.time, times, inputs, model.family, units)
    return MeasuredRecord(
        run=_NAME,
        index=index,
        label=f"{_NAME}/{index + 1}",
        times=record.time - record.time[0],
        switch_times=times,
        switch_half=np.zeros(times.size),
        inputs=inputs,
        values=np.column_stack([record.channels[name] for name in outputs]),
        condition={"oil_temperature": oil, relief: record.setting},
        group=0,
        phase=phase,
        phases=names,
    )


def _unit(source: InputSource, rig: Rig) -> str:
    names = [name for name, _ in source.actuators]
    return rig.actuators[names[0]].display_unit if len(names) == 1 else ""
