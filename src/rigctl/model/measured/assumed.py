"""What a user says of inputs that nobody recorded: ``heater=0``, ``ambient_temperature=21 degC``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from rigctl.dataset.assumptions import assumed_value, read_assumptions
from rigctl.dataset.run import Run
from rigctl.errors import unknown_name
from rigctl.model.model import Model
from rigctl.rig.rig import Rig
from rigctl.units import show

#: where a run keeps it: {input or actuator: SI value}
KEY = "assumed"
#: where a run that was opened keeps what was written of it then, beside what it says itself
_WRITTEN = "assumed_when_opened"


def assumed_of(run: Run) -> Mapping[str, float]:
    """What is said of a run's inputs and actuators, SI."""
    return {str(name): float(value) for name, value in (run.info.get(KEY) or {}).items()}


def assuming(run: Run, model: Model, written: Sequence[str]) -> Run:
    """The run with what is written of its inputs, ``name=value``, in the place of what it says itself.

    Raises
    ------
    RigctlError
        it is no name and value, there is no such input or actuator, or the value is none of it or lacks
        its unit.
    """
    if not written:
        return run
    said = dict(assumed_of(run))
    for name, text in read_assumptions(written).items():
        said[name] = _value(name, text, model)
    return replace(run, info=MappingProxyType({**run.info, KEY: said, _WRITTEN: tuple(written)}))


def assumed_when_opened(runs: Sequence[Run]) -> tuple[str, ...]:
    """What was written of runs when they were opened, ``name=value``, and is not kept with them."""
    return tuple(dict.fromkeys(text for run in runs for text in run.info.get(_WRITTEN, ())))


def _value(name: str, text: str, model: Model) -> float:
    actuators = model.rig.actuators if model.rig is not None else {}
    inputs = {item.name: item for item in model.family.inputs}
    if name in actuators:
        return assumed_value(name, text, model.rig)
    if name not in inputs:
        raise unknown_name("input or actuator", name, {**inputs, **actuators})
    return assumed_value(name, text, model.rig, inputs[name].unit, difference=inputs[name].difference)


def input_unit(model: Model, rig: Rig | None, name: str) -> str:
    """What an input is shown in: its channel's unit, or its SI one; a temperature in degC."""
    if rig is not None and name in rig.channels:
        return rig.channels[name].unit
    item = {item.name: item for item in model.family.inputs}[name]
    return "degC" if item.unit == "K" and not item.difference else item.unit


def assumed_notes(model: Model, run: Run, rig: Rig | None) -> list[str]:
    """That an input was not recorded, and what was said of it."""
    actuators = rig.actuators if rig is not None else {}
    shown = []
    for name, value in assumed_of(run).items():
        if name in actuators:
            shown.append(f"{name} {actuators[name].show(value)}")
        elif any(item.name == name for item in model.family.inputs):
            shown.append(f"{name} {show(value, input_unit(model, rig, name))}")
    return [f"assumed of {run.id}, not recorded: {', '.join(shown)}"] if shown else []
