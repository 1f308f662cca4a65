"""A slider for every parameter, a switch for every effect.

In: a model. Out: the controls that a page shows, with their ends, scale and unit. A slider's ends are the
bounds of a fit, or five standard deviations around the prior's mean, so that what can be set by hand is what
a fit could find; a typed value may go beyond the slider, within the bounds. It is logarithmic if the ends
span decades, as those of most conductances and compliances do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

from rigctl.effects.declaration import Effect, EffectParameter, qualified
from rigctl.effects.registry import library
from rigctl.model.fit.unknowns import parameter_unknown
from rigctl.model.model import Model
from rigctl.units import interval_unit, parse_unit

#: ratio of the ends above which a slider is logarithmic
_DECADES = 30.0
#: standard deviations around a prior's mean
_AROUND = 5.0
#: the smallest size of an effect on its slider, as a share of the typical one: below it the switch is off
_LEAST = 1e-3
#: the upper end if neither bounds nor a value give one, in the unit of the parameter's declaration
_WIDE = 20.0


@dataclass(frozen=True)
class Slider:
    """One parameter; everything SI but `unit`, in which it is shown: ``shown = (si − offset)/factor``.

    Attributes
    ----------
    name: as in the model's values.
    label: without the effect's name.
    low, high: the slider's ends; typed values may lie beyond them, within the bounds of a fit.
    scale: log if the ends span decades.
    null: the value that switches an effect off; None for other parameters.
    shape: whether it only shapes an effect that another parameter switches on.
    fit: whether a fit may change it.
    fixed: a dimension, which is a number of the compiled equations.
    """

    name: str
    label: str
    value: float
    unit: str
    factor: float
    offset: float
    low: float
    high: float
    scale: Literal["linear", "log"]
    meaning: str
    null: float | None = None
    shape: bool = False
    fit: bool = False

    def document(self) -> dict[str, Any]:
        """For the page."""
        return {
            "name": self.name,
            "label": self.label,
            "value": self.value,
            "unit": self.unit,
            "factor": self.factor,
            "offset": self.offset,
            "low": self.low,
            "high": self.high,
            "scale": self.scale,
            "meaning": self.meaning,
            "null": self.null,
            "shape": self.shape,
            "fit": self.fit,
        }


@dataclass(frozen=True)
class Switch:
    """One effect, with its sliders.

    Attributes
    ----------
    base: base physics, which is switched off by its parameters' null values and has no sliders of its own.
    on: whether the model has it.
    instead_of: effects that exclude it.
    """

    name: str
    summary: str
    equation: str
    looks_like: str
    on: bool
    base: bool
    sliders: tuple[Slider, ...]
    instead_of: tuple[str, ...] = ()

    def document(self) -> dict[str, Any]:
        """For the page."""
        return {
            "name": self.name,
            "summary": self.summary,
            "equation": self.equation,
            "looks_like": self.looks_like,
            "on": self.on,
            "base": self.base,
            "sliders": [slider.document() for slider in self.sliders],
            "instead_of": list(self.instead_of),
        }


def sliders(model: Model) -> tuple[Slider, ...]:
    """A slider for each parameter of the model's family except dimensions."""
    return tuple(_of_family(model, one.name) for one in model.family.parameters if not one.fixed)


def switches(model: Model) -> tuple[Switch, ...]:
    """A switch for each effect that the model has or could have: the library's, and the user's own."""
    known = {effect.name: effect for effect in (*library(model.family).values(), *model.own_effects)}
    switches = []
    for effect in known.values():
        present = _present(model, effect)
        switches.append(
            Switch(
                effect.name,
                effect.summary,
                effect.equation,
                effect.looks_like,
                present,
                bool(effect.base),
                tuple(_of_effect(model, effect, one) for one in effect.parameters),
                effect.instead_of,
            )
        )
    return tuple(switches)


def _present(model: Model, effect: Effect) -> bool:
    if effect.base:
        return any(model.values[name] != nothing for name, nothing in effect.base.items())
    return effect.name in model.effects


def _of_family(model: Model, name: str) -> Slider:
    declared, value = model.family.parameter(name), model.values[name]
    setting = model.parameters.get(name)
    unknown = parameter_unknown(model, name)
    low, high = unknown.lower, unknown.upper
    # A slider needs two ends; where the bounds leave one open, it is a multiple of the family's usual value.
    # A prior then narrows them, but never past the present value, which must stay on the slider.
    if not math.isfinite(high):
        high = max(_WIDE * abs(declared.value), value) or 1.0
    if not math.isfinite(low):
        low = min(-_WIDE * abs(declared.value), value)
    if setting is not None and setting.prior is not None:
        spread = _AROUND * setting.prior.std
        low = max(low, min(setting.prior.mean - spread, value))
        high = min(high, max(setting.prior.mean + spread, value))
    unit = (setting.unit if setting is not None else "") or declared.unit
    return _slider(
        Slider(name, name, value, unit, 1.0, 0.0, low, high, "linear", declared.meaning),
        fit=setting is not None and setting.fit,
    )


def _of_effect(model: Model, effect: Effect, declared: EffectParameter) -> Slider:
    name = qualified(effect.name, declared.name)
    setting = model.effects.get(effect.name, {}).get(declared.name)
    value = declared.start if setting is None else setting.si
    low, high = declared.bounds_around(value)
    if (
        declared.null == low == 0.0
    ):  # a size of one sign: as many decades below the typical one as are visible
        low = min(_LEAST * declared.start, value or math.inf)
    slider = Slider(
        name,
        declared.name,
        value,
        (setting.unit if setting is not None else "") or declared.unit,
        1.0,
        0.0,
        low,
        high,
        "linear",
        declared.meaning,
        declared.null,
        declared.shape,
    )
    return _slider(slider, fit=bool(setting and setting.fit), difference=declared.difference)


def _slider(slider: Slider, *, fit: bool, difference: bool = False) -> Slider:
    shown = interval_unit(slider.unit) if difference else slider.unit
    unit = parse_unit(shown)
    spans = slider.low > 0.0 and slider.high / slider.low > _DECADES
    return replace(
        slider,
        unit=shown,
        factor=unit.factor,
        offset=unit.offset,
        scale="log" if spans else "linear",
        fit=fit,
    )
