"""Readings of a sensor that was stuck: they are no values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from rigctl.dataset.standstill import find_standstills, standstill_remark
from rigctl.model.measured.record import MeasuredRecord
from rigctl.rig.rig import Rig
from rigctl.units import show


def without_stuck_readings(
    records: Sequence[MeasuredRecord], outputs: Sequence[str], units: Sequence[str], rig: Rig | None
) -> tuple[list[MeasuredRecord], list[str]]:
    """Return the records without what a stuck sensor repeated, and a remark on each such channel.

    The first of these readings is one like any other. The records of a run are looked at together; rows of a
    table have no order, and are returned as they are.
    """
    result, remarks = list(records), []
    for run in dict.fromkeys(record.run for record in records if not record.row):
        of_run = [at for at, record in enumerate(records) if record.run == run and not record.row]
        for column, (name, unit) in enumerate(zip(outputs, units, strict=True)):
            found = find_standstills((records[at].times, records[at].values[:, column]) for at in of_run)
            if not found:
                continue
            shown = partial(show, unit=unit, difference=rig is not None and name in rig.layout.differences)
            labels = [records[at].label for at in of_run]
            remark = standstill_remark(name, found, shown, [f" in {label}" for label in labels])
            remarks.append(f"{remark}: the sensor was stuck, and these readings are left out")
            for one in found:
                record = result[of_run[one.record]]
                stuck = (record.times > one.begin) & (record.times <= one.end)
                values = record.values.copy()
                values[stuck, column] = np.nan
                result[of_run[one.record]] = replace(record, values=values)
    return result, remarks
