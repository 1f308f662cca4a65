"""Every value of a model: its unit, its uncertainty, whether a fit may change it, and its origin.

In: a `Model`. Out: a `StatedValue` for each parameter of the family and of every effect, in SI and as
shown. A value that stands in no model file comes from the rig, the oil, the family or the effect; which
of them it was is kept, and shown where the file names no source.

Displayed numbers have twelve digits, by which only the rounding of a conversion is lost: 3.9 mm² was
written, and is shown.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

from rigctl.effects.declaration import qualified
from rigctl.engine.least_squares.unknown import Prior
from rigctl.model.model import Model, Value
from rigctl.model.values import parameter_origins
from rigctl.physics.standing import Standing
from rigctl.units import interval_unit, parse_unit

Origin: TypeAlias = Literal["model", "rig", "oil", "family", "effect"]
#: what gives a value whose source the model file does not state
_STATED_IN: dict[Origin, str] = {
    "model": "model file",
    "rig": "rig file",
    "oil": "oil",
    "family": "typical",
    "effect": "typical",
}


@dataclass(frozen=True)
class StatedValue:
    """A parameter's value, SI, and its uncertainty.

    Attributes
    ----------
    name: as in `Model.values`.
    unit: in which it is shown: that in the model file, or the declared one.
    std: its standard deviation, SI.
    fit: whether a fit may change it.
    fixed: it is a dimension, which no fit changes.
    origin: of the value: the model file, the rig file, the oil, the family or the effect.
    source: the origin stated in the model file, in words.
    prior: prior knowledge, SI.
    undetermined: the data to which it was fitted determine only combinations of it with others.
    standing: how well it is known, as far as a file says it; `range` is that of an assumed one, SI.
    """

    name: str
    si: float
    unit: str
    std: float | None
    fit: bool
    fixed: bool
    origin: Origin
    source: str
    meaning: str
    difference: bool = False
    prior: Prior | None = None
    undetermined: bool = False
    standing: Standing = ""
    range: tuple[float, float] | None = None

    @property
    def value(self) -> float:
        """The value in `unit`, without rounding errors of the conversion."""
        return rounded(parse_unit(self.unit).from_si(self.si, difference=self.difference))

    @property
    def std_unit(self) -> str:
        """The unit of the standard deviation; for a temperature scale the kelvin."""
        return interval_unit(self.unit)

    @property
    def std_value(self) -> float | None:
        """The standard deviation in `std_unit`."""
        if self.std is None:
            return None
        return rounded(parse_unit(self.std_unit).from_si(self.std, difference=True))

    @property
    def prior_values(self) -> tuple[float, float] | None:
        """The prior's value in `unit` and its standard deviation in `std_unit`."""
        if self.prior is None:
            return None
        mean = parse_unit(self.unit).from_si(self.prior.mean, difference=self.difference)
        return rounded(mean), rounded(parse_unit(self.std_unit).from_si(self.prior.std, difference=True))

    @property
    def range_values(self) -> tuple[float, float] | None:
        """The range of an assumed value, in `unit`."""
        if self.range is None:
            return None
        unit = parse_unit(self.unit)
        low, high = (rounded(unit.from_si(end)) for end in self.range)
        return low, high

    @property
    def stated_in(self) -> str:
        """Where the value is from: the source that the model file states, or what gives the value."""
        return self.source or _STATED_IN[self.origin]


def rounded(value: float) -> float:
    """Twelve digits, which hide only the rounding of a conversion."""
    return float(f"{value:.12g}")


def stated_values(model: Model) -> tuple[StatedValue, ...]:
    """The family's parameters in its order, then each effect's."""
    return (*_of_family(model), *_of_effects(model))


def _of_family(model: Model) -> Iterator[StatedValue]:
    origins = parameter_origins(model.family, model.rig, model.parameters, model.oil)
    for declared in model.family.parameters:
        given = model.parameters.get(declared.name, Value(model.values[declared.name]))
        yield StatedValue(
            name=declared.name,
            si=given.si,
            unit=given.unit or declared.unit,
            std=given.std,
            fit=given.fit,
            fixed=declared.fixed,
            origin=origins[declared.name],
            source=given.source,
            meaning=declared.meaning,
            prior=given.prior,
            undetermined=given.undetermined,
            standing=_standing(model, declared.name, given),
            range=model.assumed.get(declared.name, given.range),
        )


def _standing(model: Model, name: str, given: Value) -> Standing:
    """That of the model file, or of the family's own value."""
    declared = model.family.parameter(name)
    return given.standing or (declared.standing if given.si == declared.value else "")


def _of_effects(model: Model) -> Iterator[StatedValue]:
    for name, values in model.effects.items():
        effect = model.effect(name)
        for declared in effect.parameters:
            given = values[declared.name]
            typical = not given.unit and given == Value(declared.start)
            yield StatedValue(
                name=qualified(name, declared.name),
                si=given.si,
                unit=given.unit or declared.unit,
                std=given.std,
                fit=given.fit,
                fixed=False,
                origin="effect" if typical else "model",
                source=given.source,
                meaning=declared.meaning,
                difference=declared.difference,
                undetermined=given.undetermined,
            )
