"""An effect as the text of an effect file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from rigctl.effects.declaration import Effect, EffectParameter
from rigctl.effects.validity import Provenance, ValidRange
from rigctl.units import parse_unit


def effect_file_text(effect: Effect, terms: Mapping[str, str], family: str, name: str = "") -> str:
    """YAML that `rigctl.effects.user.load_effect` reads as `effect`, with its validity box and provenance.

    Parameters
    ----------
    terms: the text of each term, by slot.
    family: as referred to in the file.
    name: a new name of the effect, if any.
    """
    lines = [
        f"effect: {name or effect.name}",
        f"family: {_text(family)}",
        f"summary: {_text(effect.summary)}",
    ]
    if len(terms) == 1:
        ((slot, term),) = terms.items()
        lines += [f"slot: {slot}", f"term: {_text(term)}"]
    else:
        lines += ["terms:", *(f"  {slot}: {_text(term)}" for slot, term in terms.items())]
    lines += ["parameters:"]
    for parameter in effect.parameters:
        lines += [f"  {parameter.name}:", *(f"    {line}" for line in _parameter(parameter))]
    for field in ("source", "looks_like", "needs"):
        if getattr(effect, field):
            lines.append(f"{field}: {_text(getattr(effect, field))}")
    for field in ("confused_with", "instead_of"):
        if getattr(effect, field):
            lines.append(f"{field}: [{', '.join(getattr(effect, field))}]")
    lines += _box(effect.valid)
    lines += [] if effect.provenance is None else provenance_lines(effect.provenance)
    return "\n".join(lines) + "\n"


def _text(written: str) -> str:
    """A scalar that YAML reads as this text and nothing else."""
    return json.dumps(written, ensure_ascii=False)


def _quantity(value: float, unit: str, *, difference: bool = False) -> str:
    number = f"{parse_unit(unit).from_si(value, difference=difference):.12g}"
    return number if unit == "1" else f"{number} {unit}"


def _parameter(parameter: EffectParameter) -> list[str]:
    def shown(value: float) -> str:
        return _quantity(value, parameter.unit, difference=parameter.difference)

    low_usual, high_usual = parameter.usual
    ends: dict[tuple[bool, bool], str] = {
        (True, True): "none",
        (True, False): "high",
        (False, True): "low",
        (False, False): "both",
    }
    lines = [] if parameter.null is None else [f"null_value: {shown(parameter.null)}"]
    lines += [
        f"start: {shown(parameter.start)}",
        f"bounds: [{shown(parameter.low)}, {shown(parameter.high)}]",
        f"physical: {ends[low_usual, high_usual]}",
    ]
    return lines + ([f"meaning: {_text(parameter.meaning)}"] if parameter.meaning else [])


def _box(ranges: tuple[ValidRange, ...]) -> list[str]:
    lines = ["valid:"] if ranges else []
    for one in ranges:
        low, high = (_quantity(end, one.unit, difference=one.difference) for end in (one.low, one.high))
        lines.append(f"  {_text(one.over)}: [{low}, {high}]")
    return lines


def provenance_lines(provenance: Provenance) -> list[str]:
    """The lines for an effect's origin."""
    document: dict[str, Any] = {key: value for key, value in provenance.document().items() if value}
    lines = ["provenance:"]
    for key, value in document.items():
        lines.append(f"  {key}: {json.dumps(value, ensure_ascii=False)}")
    return lines
