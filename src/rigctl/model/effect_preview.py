"""Try an effect on its family's standard record, and report in words what a user should know."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.effects.declaration import Effect
from rigctl.effects.examine import Fault, examine
from rigctl.engine.compile import Progress
from rigctl.model.record_points import record_points
from rigctl.model.signature import Signature, signature
from rigctl.model.similar_effects import Lookalike, lookalikes
from rigctl.rig.rig import Rig

#: cosine above which no reading of the record distinguishes two effects
SAME = 0.999


@dataclass(frozen=True)
class Trial:
    """The result of trying an effect.

    Attributes
    ----------
    seen: its signature in the readings.
    alike: the library's effects by decreasing cosine; none for an effect without a signature.
    warnings: what its user should know, a sentence each.
    """

    effect: Effect
    seen: Signature
    alike: tuple[Lookalike, ...]
    warnings: tuple[str, ...]


def faults_on_record(
    effect: Effect,
    rig: Rig | None = None,
    *,
    alongside: Sequence[tuple[Effect, Mapping[str, float]]] = (),
    progress: Progress | None = None,
) -> tuple[Fault, ...]:
    """What is wrong with an effect's terms along the standard record without it.

    Arguments and errors as for `try_effect`.
    """
    if not effect.terms:
        return ()
    family = effect.model_family
    points = record_points(family, rig, alongside=alongside, progress=progress)
    return examine(effect, family, points)


def try_effect(
    effect: Effect,
    rig: Rig | None = None,
    *,
    alongside: Sequence[tuple[Effect, Mapping[str, float]]] = (),
    progress: Progress | None = None,
) -> Trial:
    """Simulate the standard record without and with `effect`, and compare its signature with the library's.

    Parameters
    ----------
    rig: its channels and noise are used; by default everything that the family can read.
    alongside: effects present in both simulations, with their parameters (SI).

    Raises
    ------
    RigctlError
        the record cannot be simulated.
    """
    effect_signature = signature(effect, rig, alongside=alongside, progress=progress)
    shows = not effect_signature.silent and not effect_signature.flat_at_null and bool(effect.terms)
    alike = lookalikes(effect_signature, effect, rig, progress=progress) if shows else ()
    return Trial(effect, effect_signature, alike, tuple(_warnings(effect, effect_signature, alike, rig)))


def _warnings(
    effect: Effect, effect_signature: Signature, alike: Sequence[Lookalike], rig: Rig | None
) -> list[str]:
    if effect_signature.silent:
        where = f"rig '{rig.name}' reads" if rig is not None else f"a {effect.family} can read"
        return [
            f"by itself {effect.name} has no influence on anything that {where}"
            + (f"; it needs {effect.needs}" if effect.needs else "")
        ]
    warnings = []
    if effect_signature.flat_at_null:
        warnings.append(
            f"{effect.name} changes nothing to first order at its null value, so that a diagnosis cannot "
            "detect it: write it with a parameter in which it is linear"
        )
    if rig is not None and _below_noise(effect_signature, rig):
        warnings.append(
            f"at its typical size it changes every reading by less than the noise of '{rig.name}'"
        )
    declared = {*effect.instead_of, *effect.confused_with}
    same = [other.name for other in alike if other.likeness > SAME and other.name not in declared]
    if same:
        warnings.append(
            f"no reading of the standard record distinguishes it from {', '.join(same)}: say so in "
            "'confused_with' or in 'instead_of'"
        )
    return warnings


def _below_noise(effect_signature: Signature, rig: Rig) -> bool:
    largest = np.abs(effect_signature.difference).max(axis=0)
    noise = [rig.channels[name].noise_level for name in effect_signature.output_names]
    return all(size and change < size for change, size in zip(largest, noise, strict=True))
