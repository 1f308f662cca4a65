"""Channels of a stored run whose sensor was stuck, by their data alone."""

from __future__ import annotations

from functools import partial

from rigctl.dataset.run import Run
from rigctl.dataset.standstill import StandstillDetector, standstill_remark
from rigctl.units import show


def stuck_channels(run: Run) -> list[str]:
    """Return a sentence for each channel that repeats one value although it has noise; times are the run's.

    Only records count: between them a bench is sampled at another rate.
    """
    if not run.info["rows"] or not run.info["records"]:
        return []
    layout = run.layout
    detectors = {name: StandstillDetector() for name in layout.channels}
    for record in run.each(range(int(run.info["records"]))):
        for name, detector in detectors.items():
            detector.begin_record()
            detector.add(record.time, record.channels[name])
    where = [f" in record {index}" for index in range(int(run.info["records"]))]
    remarks = []
    for name, detector in detectors.items():
        if stretches := detector.found():
            shown = partial(show, unit=layout.unit(name), difference=name in layout.differences)
            remark = standstill_remark(name, stretches, shown, where)
            remarks.append(f"{remark}: was the sensor stuck?")
    return remarks
