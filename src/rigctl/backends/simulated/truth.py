"""The true model of the simulated bench: the rig's family or a model file, with hidden effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rigctl.effects.option import read_effect_option
from rigctl.errors import RigctlError
from rigctl.model import Model, family_of, load_model
from rigctl.printable import shown_path
from rigctl.rig import Rig


def read_truth(rig: Rig, model_file: Path | None, effects: Sequence[str]) -> Model:
    """Read the true model of the bench.

    Parameters
    ----------
    rig: the simulated bench; the model's outputs are its channels.
    model_file: the file with its parameters and effects; by default the rig's family without effects.
    effects: further effects, e.g. ``piston_leakage:clearance=30 um`` or ``my-effect.yaml``; parameters
        without a value have their typical ones.

    Raises
    ------
    RigctlError
        the file or an effect is wrong, or the family of the file's model is not that of the rig.
    """
    family = family_of(rig)
    model = Model(family, rig) if model_file is None else replace(load_model(model_file), rig=rig)
    if model.family.name != family.name:
        raise RigctlError(
            "this model is of another kind than the bench",
            value=f"{shown_path(model_file)}: {model.family.name}",
            expected=f"a model of the family {family.name}, as rig '{rig.name}' says",
        )
    for text in effects:
        effect, values = read_effect_option(text, model.family, model.values)
        model = model.with_effect(effect, values, fit=False)
    return model


def describe(model: Model) -> str:
    """Return a brief description of the model: its origin, and its effects with their SI values."""
    origin = model.path.as_posix() if model.path is not None else model.family.name
    effects = [
        f"{name} ({', '.join(f'{key}={value.si:.6g}' for key, value in values.items())})"
        for name, values in model.effects.items()
    ]
    return f"{origin} with {', '.join(effects)}" if effects else origin
