"""What the tests of the dataset measure: strokes of a small bench."""

from __future__ import annotations

from datetime import UTC, datetime

from rigctl.dataset import RunWriter
from rigctl.plan.measured import MeasuredValue
from rigctl.rig import Layout

LAYOUT = Layout(
    channels=("oil_temperature", "supply_pressure", "position"),
    commands=("heater", "valve"),
    units=("s", "1", "degC", "bar", "mm", "1", "1"),
)
STARTED = datetime(2026, 11, 21, 9, 30, 0, tzinfo=UTC)


def sample(time: float, record: int = -1, position: float = 0.1) -> tuple[float, ...]:
    """One row of SI values."""
    return (time, record, 313.15, 30e5, position, 1.0, 0.0)


def measure_strokes(writer: RunWriter, records: int = 3, rows: int = 20) -> None:
    """Records of `rows` samples at 100 Hz, a second apart, each with a sweep, a switch and a measure."""
    for number in range(records):
        start = float(number)
        writer.append(sample(start))
        sweep = {"oil": (293.15 + 10 * number, "degC"), "supply": (30e5, "bar")}
        index = writer.open_record(start + 0.1, "stroke", sweep, f"{number}/record", 100.0)
        writer.event(start + 0.1, "command", actuator="valve", value=1.0, uncertainty=0.001)
        for row in range(rows):
            writer.append(sample(start + 0.1 + row / 100, index, 0.001 * row))
        writer.measure(MeasuredValue("stroke", 0.001 * rows, "mm", 0.01, 0.3))
        writer.close_record(start + 0.5, "complete")
