"""The noise of measurements: what was left out is counted in the records chosen, and no value has none."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from rigctl.model.measured.noise import noise_of
from rigctl.model.measured.record import MeasuredRecord, Measurements


def record(
    index: int, values: np.ndarray, *, row: bool = False, switched: float | None = None
) -> MeasuredRecord:
    """One a second; its input goes to 1 at the time `switched`."""
    times = np.zeros(1) if switched is None else np.array([0.0, switched])
    return MeasuredRecord(
        run="r",
        index=index,
        label=f"r/{index + 1}",
        times=np.arange(float(values.size)),
        switch_times=times,
        switch_half=np.zeros(times.size),
        inputs=np.arange(float(times.size))[:, None],
        values=values[:, None],
        condition={"oil": 300.0 + index},
        group=index,
        phase=np.zeros(values.size, dtype=np.int64),
        phases=("hold",),
        row=row,
    )


def measured(records: Sequence[MeasuredRecord]) -> Measurements:
    return Measurements(("position",), ("mm",), ("valve",), tuple(records), None, ("r",))


def test_spikes_and_edges_are_counted_in_the_records_that_were_chosen() -> None:
    rng = np.random.default_rng(1)
    values = [1e-4 * rng.standard_normal(400) for _ in range(3)]
    for place in (50, 150, 250):
        values[0][place] += 0.02
    values[1][200] += 0.02
    values[2][200:] += 0.05  # an edge within one sample
    switched = (None, None, 200.0)
    noise = noise_of(
        measured(
            [record(k, one, switched=at) for k, (one, at) in enumerate(zip(values, switched, strict=True))]
        )
    )
    channel = noise.model.channels[0]
    assert (channel.masked, channel.statement.endswith("; 4 spikes masked")) == (4, True)
    assert channel.edges > 0
    one = noise.only([1])
    assert (one.model.channels[0].masked, one.model.channels[0].edges) == (1, 0)
    assert one.model.statement == noise.model.statement.replace("4 spikes", "1 spike")
    assert one.model.sigma == pytest.approx(noise.model.sigma, rel=0.0)
    none = noise.only([1, 2]).only([1])
    assert (none.model.channels[0].masked, none.model.channels[0].edges) == (0, channel.edges)
    assert "masked" not in none.model.statement + none.model.channels[0].statement


@pytest.mark.parametrize(
    ("values", "sigma"), [([0.0, 0.0, 4.0], 0.02), ([0.0, 0.0, 0.0], 0.005), ([2.0, 2.0, 4.0], 0.01)]
)
def test_a_short_column_of_zeros_is_not_without_noise(values: list[float], sigma: float) -> None:
    """Half a per cent of a typical value, of the largest where that is 0, of 1 where all are."""
    rows = [record(k, np.array([value]), row=True) for k, value in enumerate(values)]
    (channel,) = noise_of(measured(rows)).model.channels
    assert channel.guessed
    assert channel.sigma == pytest.approx(sigma)
