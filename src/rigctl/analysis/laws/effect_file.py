"""The law that the data support as an effect file, which is a candidate like any other."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from rigctl.analysis.laws.answer import LawAnswer
from rigctl.analysis.laws.power_law import driver_text
from rigctl.dataset.outputs import require_folder
from rigctl.effects.declaration import Effect
from rigctl.effects.drivers import Driver
from rigctl.effects.registry import library
from rigctl.effects.user import parse_effect
from rigctl.effects.user.file_text import effect_file_text, provenance_lines
from rigctl.effects.user.names import term_types
from rigctl.effects.user.quantity import read_quantity
from rigctl.effects.validity import Provenance, ValidRange
from rigctl.files.write import write_text
from rigctl.method_version import METHOD_VERSION
from rigctl.model.family_reference import family_reference
from rigctl.model.model import Model
from rigctl.physics.family import ModelFamily
from rigctl.units import parse_unit


def write_law(
    answer: LawAnswer, folder: Path, runs: Sequence[str], model: str, now: datetime | None = None
) -> LawAnswer:
    """Write the effect of a fitted law into `folder`; an answer without a law is returned unchanged.

    Nothing is overwritten: if the name is taken, a number is appended.

    Raises
    ------
    RigctlError
        as `require_folder`, or the folder cannot be written to.
    """
    if not answer.offered:
        return answer
    require_folder(folder)
    path = _free(folder, f"{answer.effect}_{answer.offered}")
    provenance = Provenance(
        runs=tuple(runs),
        model=model,
        method=METHOD_VERSION,
        date=f"{now or datetime.now(UTC):%Y-%m-%d}",
        tier="law" if answer.offered == "power" else "curve",
        statement=answer.statement,
    )
    writer = _power_text if answer.offered == "power" else _curve_text
    text = writer(answer, folder, path.stem, provenance)
    folder.mkdir(parents=True, exist_ok=True)
    parse_effect(text, path)  # a file that is offered must be valid
    write_text(path, text)
    return replace(answer, file=path)


def _power_text(answer: LawAnswer, folder: Path, name: str, provenance: Provenance) -> str:
    """The effect file of the fitted power."""
    power = answer.power
    assert power is not None  # noqa: S101 - it is offered
    model = power.fit.problem.model
    known = library(model.family)
    effect = replace(
        _fitted(power.effect, power.fit.model),
        instead_of=tuple(one for one in power.effect.instead_of if one in known),
        valid=tuple(_range(answer, driver, ends, model.family) for driver, ends in _ranges(answer)),
        provenance=provenance,
    )
    return effect_file_text(effect, power.terms, family_reference(model, folder), name)


#: every n-th point of a law is a point of its curve
_EVERY = 2


def _curve_text(answer: LawAnswer, folder: Path, name: str, provenance: Provenance) -> str:
    """The effect file of the curve itself, with its band."""
    law, model = answer.law, answer.model
    family = model.family
    types = term_types(family, family.slot(law.slot), ())
    points = {one for one, kind in types.items() if kind.temperature == "point"}
    over = driver_text(law.driver, points)
    nothing = law.term.nothing
    x, y, low, high = (
        [float(f"{value:.6g}") for value in (values + more)[::_EVERY].tolist()]
        for values, more in ((answer.x, 0.0), (law.asked, nothing), (law.low, nothing), (law.high, nothing))
    )
    instead = [answer.effect] if answer.effect in library(family) else []
    lines = [
        f"effect: {name}",
        f"family: {json.dumps(family_reference(model, folder))}",
        f"summary: The law of {answer.effect} over {law.driver.name} as estimated from data.",
        f"slot: {law.slot}",
        "curve:",
        f"  of: {json.dumps(over)}",
        f"  over: {json.dumps(answer.unit)}",
        f"  unit: {json.dumps(answer.value_unit)}",
        f"  points: {json.dumps([list(pair) for pair in zip(x, y, strict=True)])}",
        f"  band: {json.dumps([list(pair) for pair in zip(low, high, strict=True)])}",
        *([f"instead_of: [{', '.join(instead)}]"] if instead else []),
        *provenance_lines(provenance),
    ]
    return "\n".join(lines) + "\n"


def _free(folder: Path, name: str) -> Path:
    path, number = folder / f"{name}.yaml", 2
    while path.exists():
        path, number = folder / f"{name}_{number}.yaml", number + 1
    return path


def _fitted(effect: Effect, model: Model) -> Effect:
    """The effect with its parameters starting at their fitted values."""
    values = {name: value.si for name, value in model.effects[effect.name].items()}
    return replace(
        effect, parameters=tuple(replace(one, start=values[one.name]) for one in effect.parameters)
    )


def _ranges(answer: LawAnswer) -> list[tuple[Driver, tuple[float, float]]]:
    law = answer.law
    return [(law.driver, law.visited), *((driver, (low, high)) for driver, low, high in law.others)]


def _range(answer: LawAnswer, driver: Driver, ends: tuple[float, float], family: ModelFamily) -> ValidRange:
    slot = family.slot(answer.law.slot)
    types = term_types(family, slot, ())
    points = {name for name, one in types.items() if one.temperature == "point"}
    quantity = read_quantity(driver_text(driver, points), types)
    unit = answer.unit if driver == answer.law.driver else driver.unit
    if parse_unit(unit).absolute_temperature and quantity.type.temperature != "point":
        unit = "K"
    return ValidRange(quantity.text, unit, *_widened(ends), quantity, quantity.difference)


def _widened(ends: tuple[float, float]) -> tuple[float, float]:
    """Rounded outwards in the fourth digit."""
    low, high = ends
    digit = 10.0 ** (np.floor(np.log10(max(abs(low), abs(high), 1e-300))) - 3)
    return float(np.floor(low / digit) * digit), float(np.ceil(high / digit) * digit)
