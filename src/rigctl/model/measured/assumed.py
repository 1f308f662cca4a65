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
    return replace(run, info=MappingProxyType({**run.info, KEY: said}))


def _value(name: str, text: str, model: Model) -> float:
    actuators = model.rig.actuators if model.rig is not None else {}
    inputs = {item.name: item for item in model.family.inputs}
    if name in actuators:
        return assumed_value(name, text, model.rig)
    if name not in inputs:
        raise unknown_name("input or actuator", name, {**inputs, **actuators})
    return assumed_value(name, text, model.rig, inputs[name].unit, difference=inputs[name].difference)


def assumed_notes(model: Model, run: Run, rig: Rig | None) -> list[str]:
    """That an input was not recorded, and what was said of it."""
    units = {item.name: item.unit for item in model.family.inputs}
    actuators = rig.actuators if rig is not None else {}
    shown = [
        f"{name} {actuators[name].show(value) if name in actuators else show(value, units[name])}"
        for name, value in assumed_of(run).items()
        if name in actuators or name in units
    ]
    return [f"assumed of {run.id}, not recorded: {', '.join(shown)}"] if shown else []
