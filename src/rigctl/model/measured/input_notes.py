"""Notes on a record's inputs: which were measured, with what noise, and which were not recorded."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from rigctl.model.inputs import input_sources
from rigctl.model.measured.assumed import input_unit
from rigctl.model.measured.excitation import Acting
from rigctl.model.measured.input_floor import measured_noise
from rigctl.model.measured.record import MeasuredRecord
from rigctl.model.measured.smoothing import smoothed, window_of
from rigctl.model.model import Model
from rigctl.rig.rig import Rig
from rigctl.units import show


@dataclass(frozen=True)
class SmoothedInputs:
    """The records, with their measured inputs smoothed where possible.

    Attributes
    ----------
    noise: by input, the standard deviation of a reading, SI, if it is stated or the data determine it.
    notes: on it.
    """

    records: tuple[MeasuredRecord, ...]
    noise: dict[str, float]
    notes: tuple[str, ...]


def steady_inputs(model: Model, rig: Rig | None, records: Sequence[MeasuredRecord]) -> SmoothedInputs:
    """Remove as much of the noise of measured inputs as their readings allow; commands have none."""
    smooth, noise, notes = list(records), dict[str, float](), []
    # all records of an input together: the noise is the sensor's, and the window has to suit the fastest of
    # them
    for name in _measured_inputs(model, rig, records):
        index = [item.name for item in model.family.inputs].index(name)
        columns = [(k, record.along.index(index)) for k, record in enumerate(smooth) if index in record.along]
        lines = [smooth[k].lines[:, column] for k, column in columns]
        channel = rig.channels.get(name) if rig is not None else None
        stated = channel.noise_level if channel is not None and channel.noise_level else None
        knots = [smooth[k].knots for k, _ in columns]
        sigma = stated if stated is not None else measured_noise(knots, lines)
        if sigma is None:
            continue
        noise[name] = sigma
        source = "as the rig file says" if stated is not None else "by its differences"
        text = f"a reading of the input {name} has noise of "
        text += f"{show(sigma, input_unit(model, rig, name), difference=True, digits=2)}, {source}"
        window = window_of(knots, lines, sigma)
        if window > 1:
            text += (
                f": it is smoothed over {window} readings. If it is a command, and so known exactly, make it "
                "an actuator of the rig file"
            )
            for (k, column), line in zip(columns, lines, strict=True):
                changed = smooth[k].lines.copy()
                changed[:, column] = smoothed(smooth[k].knots, line, window)
                smooth[k] = replace(smooth[k], lines=changed)
        notes.append(text)
    return SmoothedInputs(tuple(smooth), noise, tuple(notes))


def _measured_inputs(model: Model, rig: Rig | None, records: Sequence[MeasuredRecord]) -> Iterator[str]:
    """The inputs with readings between which they change; what an actuator commands is known exactly."""
    given = input_sources(model.family, rig) if rig is not None else ()
    commanded = {source.input for source in given if source.actuators}
    for index in sorted({index for record in records for index in record.along}):
        name = model.family.inputs[index].name
        if name not in commanded:
            yield name


def acting_notes(
    model: Model, rig: Rig | None, records: Sequence[MeasuredRecord], acts: Sequence[Acting]
) -> Iterator[str]:
    """Notes that measured inputs are used as measured, and that unrecorded ones are unknown."""
    names = [item.name for item in model.family.inputs]
    along = dict.fromkeys(names[index] for record in records for index in record.along)
    for name in along:
        yield f"{name} acts as it was measured: straight lines between its readings"
        bridged, spikes = (
            sum(one.get(name, 0) for one in counts)
            for counts in ([act.bridged for act in acts], [act.spikes for act in acts])
        )
        if bridged:
            yield f"{bridged} readings of {name} are missing: it is taken as a straight line across them"
        if spikes:
            yield f"{spikes} readings of {name} are spikes: it is taken as a straight line across them"
    for name in dict.fromkeys(name for record in records for name in record.unrecorded):
        ranges = [record.unrecorded[name] for record in records if name in record.unrecorded]
        low, high = ranges[0]
        unit = input_unit(model, rig, name)
        rows = all(record.row for record in records)
        unknown = (
            "it is one unknown of all rows"
            if rows
            else f"in {len(ranges)} of {len(records)} records; it is an unknown of each of them, the same "
            "all through it"
        )
        yield (
            f"not recorded: {name}, {unknown}, between {show(low, unit)} and {show(high, unit)}. If it is "
            f"known, '--assume {_written(name, acts)}=…' says so"
        )
    taken = {name: value for act in acts for name, value in act.taken.items()}
    for name, value in taken.items():
        count = sum(name in act.taken for act in acts)
        where = "" if count == len(acts) else f" in {count} of {len(acts)} records"
        yield from taken_notes(model, rig, {name: value}, where)


def taken_notes(model: Model, rig: Rig | None, taken: Mapping[str, float], where: str = "") -> Iterator[str]:
    """Notes on the values used for unrecorded inputs without a known range."""
    for name, value in taken.items():
        shown = show(value, input_unit(model, rig, name))
        yield f"not recorded: {name}{where}; taken as {shown}, '--assume {name}=…' says otherwise"


def _written(name: str, acts: Sequence[Acting]) -> str:
    """The name of an unrecorded input on the rig: that of its actuator, if it has one."""
    absent = next((act.absent[name] for act in acts if name in act.absent), ())
    return absent[0] if len(absent) == 1 else name
