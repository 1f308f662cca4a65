"""A formula as a user's effect file: term, parameters, range of validity and origin.

In: a formula with its fitted scales. Out: the text of its file, and the same effect in memory for a refit:
what is fitted is read from the text that is written, so that the file says what was judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rigctl.discovery.formulas import Factor, Formula
from rigctl.discovery.grammar import DISTANCES, amount
from rigctl.effects.declaration import Effect
from rigctl.effects.user import parse_effect
from rigctl.effects.user.file_text import provenance_lines
from rigctl.effects.user.names import taken_names
from rigctl.effects.validity import Provenance
from rigctl.model.family_reference import family_reference
from rigctl.model.model import Model
from rigctl.physics.families import FAMILIES, using_families
from rigctl.physics.family import ModelFamily

#: bounds: of a size, times the fitted one; of a distance, times its start; of a position, in ranges beyond
#: the data
_FAR, _SCALE, _BEYOND = 100.0, 10.0, 0.5
#: largest argument of a function: exp(40) is 2e17
_LARGEST = 40.0


@dataclass(frozen=True)
class ScaleParameter:
    """A scale of a formula as a parameter of its effect: SI, and as written in the file."""

    name: str
    factor: Factor
    kind: str
    value: float
    low: float
    high: float

    def text(self) -> str:
        """Its line in the file."""
        argument = self.factor.argument
        start, low, high = (argument.amount(self.kind, one) for one in (self.value, self.low, self.high))
        return f"{{start: {start}, bounds: [{low}, {high}], meaning: {_MEANINGS[self.kind]}}}"


_MEANINGS = {
    "scale": "scale over which the term changes",
    "width": "width of the bump",
    "center": "centre of the bump",
    "limit": "threshold of the term",
}


def scale_parameters(formula: Formula, family: ModelFamily) -> tuple[ScaleParameter, ...]:
    """The parameters besides the size, with names not otherwise used in the model."""
    taken = {*taken_names(family), "size"}
    parameters = []
    for factor in formula.factors:
        argument = factor.argument
        for kind, x in zip(factor.form.scales, factor.scales, strict=True):
            name, number = kind, 2
            while name in taken:
                name, number = f"{kind}_{number}", number + 1
            taken.add(name)
            value = argument.scale_si(kind, x)
            if kind in DISTANCES:
                least = max(abs(argument.low - argument.zero), abs(argument.high - argument.zero)) / _LARGEST
                steep = factor.form.name in ("growth", "decay")
                low, high = max(value / _SCALE, least if steep else 0.0), value * _SCALE
            else:
                beyond = _BEYOND * (argument.high - argument.low)
                low, high = argument.low - beyond, argument.high + beyond
            value = min(max(value, low), high)
            parameters.append(ScaleParameter(name, factor, kind, value, low, high))
    return tuple(parameters)


def factor_text(factor: Factor) -> str:
    """One factor with its scales as numbers: ``tanh(velocity/(0.002 m/s))``."""
    argument = factor.argument
    scales = [
        f"({argument.amount(kind, argument.scale_si(kind, x))})"
        for kind, x in zip(factor.form.scales, factor.scales, strict=True)
    ]
    return factor.form.text(argument, scales)


def term_of(formula: Formula, scales: Sequence[ScaleParameter]) -> str:
    """The term as written in an effect file."""
    text = "size"
    for factor in formula.factors:
        names = [one.name for one in scales if one.factor is factor]
        text += f"*{factor.form.text(factor.argument, names)}"
    return f"1 + {text}" if formula.slot.combine == "product" else text


def effect_of(formula: Formula, family: ModelFamily) -> Effect:
    """The effect; its scales are fitted once it is in the model."""
    text = "\n".join([f"effect: {formula.name}", f"family: {family.name}", *_body(formula, family)])
    if family.name in FAMILIES:
        effect = parse_effect(text)
    else:
        with using_families(family):
            effect = parse_effect(text)
    return replace(
        effect,
        own_family=None if family.name in FAMILIES else family,
        parameters=tuple(replace(one, refined=one.shape) for one in effect.parameters),
    )


def _body(formula: Formula, family: ModelFamily) -> list[str]:
    scales = scale_parameters(formula, family)
    unit = formula.slot.unit
    start = formula.size or 1.0
    far = _FAR * abs(start)
    return [
        f"summary: {_summary(formula)}",
        f"slot: {formula.slot.name}",
        f"term: {term_of(formula, scales)}",
        "parameters:",
        f"  size: {{null_value: {amount(0.0, unit)}, start: {amount(start, unit)}, "
        f"bounds: [{amount(-far, unit)}, {amount(far, unit)}], physical: none, "
        "meaning: coefficient of the term}",
        *(f"  {one.name}: {one.text()}" for one in scales),
    ]


def _summary(formula: Formula) -> str:
    over = " and ".join(one.argument.driver.name for one in formula.factors)
    return f"A term at {formula.slot.name} over {over}, found in measurements by 'rigctl discover'."


def file_text(
    formula: Formula,
    name: str,
    valid: Sequence[tuple[str, float, float, str]],
    model: Model,
    folder: Path,
    origin: Provenance,
) -> str:
    """The effect file of a formula with fitted size and scales.

    Parameters
    ----------
    name: of the effect.
    valid: (variable, lowest, highest, unit) of each factor, SI.
    folder: where it will be: a user's family is named relative to it.
    """
    lines = [f"effect: {name}", f"family: {family_reference(model, folder)}"]
    lines += _body(formula, model.family)
    lines.append("valid:")
    for factor, (over, *ends, _) in zip(formula.factors, valid, strict=True):
        low, high = (factor.argument.amount("center", end) for end in ends)
        lines.append(f"  {over}: [{low}, {high}]")
    return "\n".join([*lines, *provenance_lines(origin)]) + "\n"
