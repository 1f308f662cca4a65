"""Values of unrecorded inputs given by the user: ``heater=0``, ``ambient_temperature=21 degC``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from rigctl.dataset.assumptions import assumed_value, read_assumptions
from rigctl.dataset.run import Run
from rigctl.errors import unknown_name
from rigctl.model.inputs import commanded_unit
from rigctl.model.measured.note import Note
from rigctl.model.model import Model
from rigctl.rig.rig import Rig
from rigctl.units import show

#: key under which a run keeps them: {input or actuator: SI value}
KEY = "assumed"
#: key for the values given when a run was opened, besides its own
_WRITTEN = "assumed_when_opened"


def assumed_of(run: Run) -> Mapping[str, float]:
    """The given values of a run's inputs and actuators, SI."""
    return {str(name): float(value) for name, value in (run.info.get(KEY) or {}).items()}


def assuming(run: Run, model: Model, written: Sequence[str]) -> Run:
    """The run with given values of its inputs, ``name=value``, which override its own.

    Raises
    ------
    RigctlError
        the text is not a name and a value, there is no such input or actuator, or the value is invalid or
        lacks its unit.
    """
    if not written:
        return run
    assumptions = dict(assumed_of(run))
    for name, text in read_assumptions(written).items():
        assumptions[name] = _value(name, text, model)
    return replace(run, info=MappingProxyType({**run.info, KEY: assumptions, _WRITTEN: tuple(written)}))


def assumed_when_opened(runs: Sequence[Run]) -> tuple[str, ...]:
    """The values given when runs were opened, ``name=value``, which are not kept with them."""
    return tuple(dict.fromkeys(text for run in runs for text in run.info.get(_WRITTEN, ())))


def _value(name: str, text: str, model: Model) -> float:
    actuators = model.rig.actuators if model.rig is not None else {}
    inputs = {item.name: item for item in model.family.inputs}
    if name in actuators:
        return assumed_value(name, text, model.rig)
    if name not in inputs:
        raise unknown_name("input or actuator", name, {**inputs, **actuators})
    unit = input_unit(model, model.rig, name)
    return assumed_value(name, text, model.rig, unit, difference=inputs[name].difference)


def input_unit(model: Model, rig: Rig | None, name: str) -> str:
    """The display unit of an input: that of its channel or its actuator, or its SI one; a temperature in
    degC."""
    if rig is not None and name in rig.channels:
        return rig.channels[name].unit
    if rig is not None and (commanded := commanded_unit(model.family, rig, name)):
        return commanded
    item = {item.name: item for item in model.family.inputs}[name]
    return "degC" if item.unit == "K" and not item.difference else item.unit


def assumed_notes(model: Model, run: Run, rig: Rig | None) -> list[Note]:
    """A note that an input was not recorded, and its given value."""
    actuators = rig.actuators if rig is not None else {}
    shown = []
    for name, value in assumed_of(run).items():
        if name in actuators:
            shown.append(f"{name} {actuators[name].show(value)}")
        elif any(item.name == name for item in model.family.inputs):
            shown.append(f"{name} {show(value, input_unit(model, rig, name))}")
    return [Note(f"assumed of {run.id}, not recorded: {', '.join(shown)}", "taken")] if shown else []
