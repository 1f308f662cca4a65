"""What the measurements say of their own noise, without any model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.model.measured.record import Measurements
from rigctl.noise import ChannelNoise, NoiseModel, NoiseRecord, estimate_noise, find_spikes_in_records


@dataclass(frozen=True)
class DataNoise:
    """The noise of some measurements, and which of their values count.

    Attributes
    ----------
    model: of all channels.
    ok: (n, outputs) of each record: read, and no spike.
    """

    model: NoiseModel
    ok: tuple[NDArray[np.bool_], ...]

    def only(self, places: Sequence[int]) -> DataNoise:
        """Of these records alone."""
        return replace(self, ok=tuple(self.ok[place] for place in places))


def noise_of(measurements: Measurements) -> DataNoise:
    """Estimate the noise of `measurements`; spikes are masked and counted, never dropped silently."""
    moving = [record for record in measurements.records if record.times.size > 1 and _timed(measurements)]
    if not moving:
        return _assumed(measurements)
    records = [
        NoiseRecord(
            record.times,
            np.where(record.here, record.values, np.nan),
            record.group,
            record.phase.astype(np.intp),
        )
        for record in measurements.records
    ]
    spikes = find_spikes_in_records(records)
    ok = tuple(record.here & ~mask for record, mask in zip(measurements.records, spikes, strict=True))
    return DataNoise(
        estimate_noise(records, measurements.outputs, known=_known(measurements), spikes=spikes), ok
    )


def _timed(measurements: Measurements) -> bool:
    """Samples over time, not the rows of a table."""
    return measurements.rig is not None and any(record.times.size > 4 for record in measurements.records)


def _known(measurements: Measurements) -> dict[str, float]:
    rig = measurements.rig
    if rig is None:
        return {}
    channels = {name: rig.channels[name] for name in measurements.outputs if name in rig.channels}
    return {name: float(channel.noise) for name, channel in channels.items() if channel.noise}


def _assumed(measurements: Measurements) -> DataNoise:
    """A table, one value for each condition: its noise can only be guessed."""
    known = _known(measurements)
    channels = []
    for c, name in enumerate(measurements.outputs):
        values = np.concatenate([record.values[record.here[:, c], c] for record in measurements.records])
        size, source = _digits(values), "assumed"
        if name in known:
            size, source = max(size, known[name]), "rig"
        channels.append(
            ChannelNoise(
                name,
                size,
                source="rig" if source == "rig" else "assumed",
                guessed=True,
                statement=f"the noise of {name} is a guess: the table has one value for each condition",
            )
        )
    statement = "noise guessed: a table of single values has no repeats to tell it from"
    ok = tuple(record.here for record in measurements.records)
    return DataNoise(NoiseModel(tuple(channels), 1.0, statement), ok)


#: of a table without any word of its accuracy: half a per cent of what was read
_SHARE = 0.005


def _digits(values: NDArray[np.float64]) -> float:
    typical = float(np.median(np.abs(values))) if values.size else 1.0
    return _SHARE * typical or 1e-12
