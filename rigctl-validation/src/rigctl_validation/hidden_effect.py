"""Hiding an effect of the cylinder's library in the separate bench.

An effect is hidden with an amplitude in the unit of the library's leading parameter (SI), so that the result
of a diagnosis can be compared with it, and in one of three shapes:

- ``same``: the library's formula, as far as the separate bench can have it;
- ``other``: what a real machine is likely to do instead (LuGre friction, an eccentric gap widened by
  pressure, isentropic air, drifts that level off, delays with jitter);
- ``wrong``: deliberately far off (soft bristles, half-turbulent leaks, another viscosity law).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias

from rigctl.errors import RigctlError
from rigctl_validation.bench.campaign import Campaign
from rigctl_validation.bench.parameters import BenchParameters, Sensors, Switching

Shape: TypeAlias = Literal["same", "other", "wrong"]
SHAPES: tuple[Shape, ...] = ("same", "other", "wrong")

#: the part of a campaign to which a field belongs
_PLACE = (
    dict.fromkeys(BenchParameters._fields, "bench")
    | dict.fromkeys(Sensors._fields, "sensors")
    | dict.fromkeys(Switching._fields, "switching")
)


@dataclass(frozen=True)
class HiddenEffect:
    """An effect of the library as the separate bench hides it.

    Attributes
    ----------
    effect: its name in the library.
    parameter: the library's leading parameter, whose value (SI) is the amplitude.
    typical, largest: amplitudes, SI; beyond the largest the bench is no longer plausible.
    amounts: maps the amplitude to what is added to fields of `BenchParameters`, `Sensors` or `Switching`.
    shapes: fields that define each shape; others keep their defaults.
    differs: how the other shapes differ from the library's, in words.
    signs: physically possible directions, in the library's sense.
    comparable: True if ``same`` is the library's formula, so that the fitted value has a true value.
    depends_also: a variable on which its shape ``wrong`` depends, and the library's law does not; "" for
        none.
    absorbed_by: fitted quantities of the textbook model that have the same signature, mostly or wholly.
    cannot_act: why a campaign of strokes does not show it; empty if it does.
    base: True for base physics, where the amplitude is the missing share of it.
    """

    effect: str
    parameter: str
    typical: float
    largest: float
    amounts: Callable[[float], Mapping[str, float]]
    shapes: Mapping[Shape, Mapping[str, float]] = field(default_factory=dict)
    differs: str = "in nothing"
    signs: tuple[int, ...] = (1,)
    comparable: bool = True
    depends_also: str = ""
    absorbed_by: tuple[str, ...] = ()
    cannot_act: str = ""
    base: bool = False

    @property
    def shaped(self) -> bool:
        """True if its shapes differ from one another."""
        return len({tuple(sorted(self.shapes.get(shape, {}).items())) for shape in SHAPES}) > 1


def hide(campaign: Campaign, hidden: Sequence[tuple[HiddenEffect, float]], shape: Shape) -> Campaign:
    """The campaign on a bench that hides each effect with its amplitude; amounts of several effects add up.

    Raises
    ------
    RigctlError
        the bench cannot have the effect.
    """
    parts: dict[str, Any] = {
        "bench": campaign.bench,
        "sensors": campaign.sensors,
        "switching": campaign.switching,
    }
    for each, amplitude in hidden:
        added = each.amounts(amplitude)
        if not added:
            raise RigctlError(f"the separate bench cannot hide {each.effect}: {each.cannot_act}")
        for name, value in added.items():
            part = _PLACE[name]
            parts[part] = parts[part]._replace(**{name: getattr(parts[part], name) + value})
        for name, value in each.shapes.get(shape, {}).items():
            part = _PLACE[name]
            parts[part] = parts[part]._replace(**{name: value})
    return replace(campaign, **parts)
