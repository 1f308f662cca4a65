"""The library of effects: one short declaration each, looked up by name."""

from rigctl.effects.declaration import Effect, EffectParameter, qualified
from rigctl.effects.registry import find_effect, library

__all__ = [
    "Effect",
    "EffectParameter",
    "find_effect",
    "library",
    "qualified",
]
