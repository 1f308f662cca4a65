"""What the rows of a table lack: operating points in between, and repeats."""

from __future__ import annotations

from rigctl.compare.localise import variable_units
from rigctl.compare.result import ModelComparison
from rigctl.units import show


def next_rows(before: ModelComparison) -> list[str]:
    """Sentences on rows that would say more of any effect."""
    measurements = before.fit.problem.measurements
    units = variable_units(measurements)
    found = []
    conditions = [record.condition for record in measurements.records]
    for name in dict.fromkeys(name for condition in conditions for name in condition):
        points = sorted({condition[name] for condition in conditions if name in condition})
        if len(points) == 1:
            found.append(f"vary {name}: every row is at {show(points[0], units[name], digits=3)}")
        if len(points) == 2:
            low, high = (show(point, units[name], digits=3) for point in points)
            found.append(
                f"take more values of {name} than {low} and {high}: with two, any course in between fits"
            )
    if any(channel.guessed for channel in before.fit.problem.noise.channels):
        found.append("repeat each condition three times: so far the noise is only guessed")
    return found
