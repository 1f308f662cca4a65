"""Effects of the library with signatures similar to a given one's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigctl.effects.declaration import Effect, qualified
from rigctl.effects.registry import library
from rigctl.engine.compile import Progress, compile_system
from rigctl.engine.simulate import simulate
from rigctl.model.build import build_system, superset
from rigctl.model.signature import Floats, Signature
from rigctl.model.standard_record import standard_excitation
from rigctl.rig.rig import Rig

#: a change smaller than this share of the largest one is rounding
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Lookalike:
    """An effect of the library, and the cosine between the signatures: 1 identical, 0 nothing in common."""

    name: str
    likeness: float


def lookalikes(
    effect_signature: Signature, effect: Effect, rig: Rig | None = None, *, progress: Progress | None = None
) -> tuple[Lookalike, ...]:
    """The library's effects by decreasing similarity to `effect`.

    The similarity is the cosine of the smallest angle between the changes that either can make to the
    readings near its null, each reading in units of its noise (without a rig, of its range on the record).
    The model is not refitted: `rigctl diagnose` does that, on real data.

    Raises
    ------
    RigctlError
        the standard record cannot be simulated.
    """
    family = effect.model_family
    others = [other for other in library(family).values() if other.terms and other.name != effect.name]
    compiled = compile_system(build_system(family, superset(family), rig), progress=progress)
    system = compiled.system
    # one integration has the derivatives by all other effects at their nulls
    effect_starts = {qualified(o.name, s.name): s.start for o in library(family).values() for s in o.states}
    columns = [qualified(o.name, p.name) for o in others for p in o.parameters if not p.shape]
    record = standard_excitation(family, system, system.nominal, effect_starts)
    simulated = simulate(compiled, [record], columns=columns).require()
    scale = _scales(effect_signature, rig)
    mine = _directions(effect_signature.slopes / scale[:, None])
    result = []
    for other in others:
        indices = [columns.index(qualified(other.name, p.name)) for p in other.parameters if not p.shape]
        theirs = _directions(simulated.sensitivities[0][:, :, indices] / scale[:, None])
        result.append(Lookalike(other.name, _likeness(mine, theirs)))
    return tuple(sorted(result, key=lambda each: -each.likeness))


def _scales(effect_signature: Signature, rig: Rig | None) -> Floats:
    """The scale of each reading."""
    noise = [
        rig.channels[name].noise_level if rig is not None else 0.0 for name in effect_signature.output_names
    ]
    spread = np.ptp(effect_signature.without, axis=0)
    return np.array([n or float(s) or 1.0 for n, s in zip(noise, spread, strict=True)], dtype=float)


def _directions(changes: Floats) -> Floats:
    """An orthonormal basis of the possible changes (samples, outputs, parameters)."""
    flat = changes.reshape(-1, changes.shape[2])
    # each column of length 1 before the factorisation: their sizes are units, not importance
    lengths = np.linalg.norm(flat, axis=0)
    visible = flat[:, lengths > _ROUNDING * max(lengths.max(initial=0.0), 1e-300)]
    basis: Floats = (
        np.linalg.qr(visible / np.linalg.norm(visible, axis=0))[0] if visible.size else flat[:, :0]
    )
    return basis


def _likeness(mine: Floats, theirs: Floats) -> float:
    if mine.shape[1] == 0 or theirs.shape[1] == 0:
        return 0.0
    # the largest singular value of Q₁ᵀQ₂ is the cosine of the smallest principal angle
    return float(min(np.linalg.svd(mine.T @ theirs, compute_uv=False)[0], 1.0))
