"""The standard record of a family as an excitation of its system."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rigctl.engine.excitation import Excitation
from rigctl.engine.system import System
from rigctl.errors import RigctlError
from rigctl.physics.family import ModelFamily
from rigctl.physics.standard_record import StandardRecord


def standard_record(family: ModelFamily) -> StandardRecord:
    """The standard record of a model family.

    Raises
    ------
    RigctlError
        the family has none.
    """
    if family.standard_record is None:
        raise RigctlError(
            f"the family {family.name} has no record to try effects on",
            hint="Add 'standard_record' to it, with the commands and their times",
        )
    return family.standard_record


def standard_excitation(
    family: ModelFamily, system: System, parameters: Sequence[float], effect_starts: Mapping[str, float]
) -> Excitation:
    """The standard record for a system of `family`; `effect_starts` are the starts of its effects' states.

    Raises
    ------
    RigctlError
        the family has none.
    """
    record = standard_record(family)
    start = {state.name: state.start for state in family.states} | dict(effect_starts) | dict(record.initial)
    given = {item.name: item.value for item in family.inputs}
    rows = []
    for _, changed in record.switches:
        given |= changed
        rows.append([given[name] for name in system.input_names])
    return Excitation(
        times=np.array(record.times),
        switch_times=np.array([time for time, _ in record.switches]),
        inputs=np.array(rows),
        initial=np.array([start[name] for name in system.state_names]),
        parameters=np.array(parameters),
        name="standard record",
    )
