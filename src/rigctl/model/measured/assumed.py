"""What a user says of inputs that nobody recorded: ``heater=0``, ``ambient_temperature=21 degC``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from rigctl.dataset.run import Run
from rigctl.errors import RigctlError, unknown_name
from rigctl.model.model import Model
from rigctl.rig.rig import Rig
from rigctl.units import read_si, show

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
        it is no name and value, there is no such input or actuator, or the value is none of it.
    """
    if not written:
        return run
    said = dict(assumed_of(run))
    for text in written:
        name, value = read_assumption(text, model)
        said[name] = value
    return replace(run, info=MappingProxyType({**run.info, KEY: said}))


def read_assumption(text: str, model: Model) -> tuple[str, float]:
    """The name and the SI value of ``name=value``.

    Raises
    ------
    RigctlError
        as `assuming`.
    """
    name, equals, value = (part.strip() for part in text.partition("="))
    if not equals or not name or not value:
        raise RigctlError("an assumption is a name and a value", value=text, expected="e.g. 'heater=0'")
    actuators = model.rig.actuators if model.rig is not None else {}
    inputs = {item.name: item for item in model.family.inputs}
    if name in actuators:
        unit = actuators[name].display_unit
        number = f"{value} {unit}" if _bare(value) and actuators[name].kind == "level" else value
        return name, actuators[name].read(number)
    if name not in inputs:
        raise unknown_name("input or actuator", name, {**inputs, **actuators})
    return name, read_si(f"{value} {inputs[name].unit}" if _bare(value) else value, inputs[name].unit)


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


def _bare(value: str) -> bool:
    try:
        float(value)
    except ValueError:
        return False
    return True
