"""What an effect changes in the readings, in the units in which they are shown."""

from __future__ import annotations

from typing import Any

import numpy as np

from rigctl.effects.document import effect_document
from rigctl.model.effect_preview import SAME, Trial
from rigctl.model.signature import Floats, Signature
from rigctl.rig.rig import Rig
from rigctl.units import interval_unit, parse_unit

#: share of a reading below which a change is rounding of the integration
_ROUNDING = 1e-8
#: units of readings without a rig file
_SHOWN = {"Pa": "bar", "m": "mm", "m^2/s": "cSt"}


def shown_unit(output: str, unit: str, rig: Rig | None) -> str:
    """The unit in which a change of an output is shown; temperatures change by kelvins."""
    wanted = rig.channels[output].unit if rig is not None else _SHOWN.get(unit, unit)
    return interval_unit(wanted)


def shown_change(signature: Signature, index: int, rig: Rig | None) -> tuple[Floats, str]:
    """(samples) the change of an output, and its unit."""
    unit = shown_unit(signature.output_names[index], signature.output_units[index], rig)
    return signature.difference[:, index] / parse_unit(unit).factor, unit


def changes(signature: Signature, index: int) -> bool:
    """Whether an output changes by more than the integration rounds."""
    size = float(np.abs(signature.without[:, index]).max()) or 1.0
    return bool(np.abs(signature.difference[:, index]).max() > _ROUNDING * size)


def signature_document(signature: Signature, rig: Rig | None) -> dict[str, Any]:
    """The changes of the readings by an effect as data, in display units."""
    outputs = {}
    for index, name in enumerate(signature.output_names):
        change, unit = shown_change(signature, index, rig)
        outputs[name] = {
            "unit": unit,
            "max": float(np.abs(change).max()),
            "changes": changes(signature, index),
            "difference": change,
        }
    return {
        "record": signature.record.description,
        "time": signature.times,
        "silent": signature.silent,
        "flat_at_null": signature.flat_at_null,
        "outputs": outputs,
    }


def trial_document(trial: Trial, rig: Rig | None) -> dict[str, Any]:
    """The verdict of a check as data."""
    signature = signature_document(trial.seen, rig)
    for output in signature["outputs"].values():
        del output["difference"]
    del signature["time"]
    return {
        **effect_document(trial.effect),
        "sound": True,
        "signature": signature,
        "alike": [{"effect": each.name, "likeness": each.likeness} for each in trial.alike],
        "indistinguishable": [each.name for each in trial.alike if each.likeness > SAME],
        "warnings": list(trial.warnings),
    }
