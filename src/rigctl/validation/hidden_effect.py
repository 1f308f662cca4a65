"""An effect of the cylinder's library as the separate bench hides it.

An effect is hidden with an amplitude in the unit of the library's leading parameter (SI), so that what a
diagnosis finds can be held against it, and in one of three shapes:

- ``same``: the library's formula, as far as the separate bench can have it;
- ``other``: what a real machine is likely to do instead (LuGre friction, an eccentric gap that pressure
  widens, isentropic air, drifts that level off, delays with jitter);
- ``wrong``: deliberately far off (soft bristles, half-turbulent leaks, another viscosity law).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias

from rigctl.errors import RigctlError
from rigctl.validation.bench.campaign import Campaign
from rigctl.validation.bench.parameters import Bench, Sensors, Switching

Shape: TypeAlias = Literal["same", "other", "wrong"]
SHAPES: tuple[Shape, ...] = ("same", "other", "wrong")

#: in which part of a campaign a field stands
_PLACE = (
    dict.fromkeys(Bench._fields, "bench")
    | dict.fromkeys(Sensors._fields, "sensors")
    | dict.fromkeys(Switching._fields, "switching")
)


@dataclass(frozen=True)
class HiddenEffect:
    """How the separate bench hides one effect of the library.

    Attributes
    ----------
    effect: the library's name of it.
    parameter: the library's leading parameter, whose value (SI) the amplitude is.
    typical, largest: amplitudes, SI; beyond the largest the bench is no bench any more.
    amounts: amplitude in, what is added to fields of `Bench`, `Sensors` or `Switching` out.
    shapes: fields that form it in each shape; what is left out keeps its default.
    differs: how the other shapes differ from the library's, in words.
    signs: directions that physics allows, in the library's sense.
    comparable: True when ``same`` is the library's formula, so that the fitted value has a truth.
    absorbed_by: fitted quantities of the textbook model that can do the same to the data, mostly or wholly.
    cannot_act: why a campaign of strokes does not show it; empty where it does.
    base: True for base physics, where the amplitude is the share of it that is missing.
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
    absorbed_by: tuple[str, ...] = ()
    cannot_act: str = ""
    base: bool = False

    @property
    def shaped(self) -> bool:
        """True when its shapes differ from one another."""
        return len({tuple(sorted(self.shapes.get(shape, {}).items())) for shape in SHAPES}) > 1


def hide(campaign: Campaign, hidden: Sequence[tuple[HiddenEffect, float]], shape: Shape) -> Campaign:
    """The campaign on a bench that hides each effect with its amplitude; amounts of several add up.

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
