"""openhtf: phases, and one dimensioned measurement written to JSON when the test ends."""

from __future__ import annotations

from pathlib import Path

import openhtf as htf
from openhtf.output.callbacks import json_factory
from workload import answer, row, seconds


@htf.PhaseOptions(name="nothing")
def nothing(test):
    del test


@htf.measures(htf.Measurement("m").in_range(0, 2))
def measured(test):
    test.measurements.m = 1.0


def steps(count: int) -> dict[str, float]:
    return {
        name: seconds(lambda phase=phase: htf.Test(*([phase] * count)).execute(lambda: "unit")) / count
        for name, phase in (("phase", nothing), ("phase with a limit", measured))
    }


def rows(count: int, folder: Path) -> float:
    @htf.measures(htf.Measurement("record").with_dimensions("t"))
    def record(test):
        channel = test.measurements.record
        for i in range(count):
            channel[float(i)] = row(i)

    test = htf.Test(record)
    test.add_output_callbacks(json_factory.OutputToJSON(str(folder / "rows.json"), indent=None))
    return seconds(lambda: test.execute(lambda: "unit"))


answer(steps, rows)
