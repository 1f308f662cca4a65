"""The reference page of a family's effects, written from their declarations."""

from __future__ import annotations

import re
from collections.abc import Iterator

from rigctl.effects.declaration import Effect, EffectParameter
from rigctl.effects.equations import latex_of, terms_in_symbols
from rigctl.effects.registry import shipped_effects
from rigctl.physics.family import ModelFamily
from rigctl.units import show


def effects_page(family: ModelFamily) -> str:
    """Markdown with the equations in LaTeX: every effect of the library, then the slots and the variables."""
    effects = shipped_effects(family.name)
    parts = [
        f"# Effects: {family.name}\n",
        "*Generated: `make docs`.*\n",
        f"{family.title}. Base equations: {family.source}.\n",
        "An effect adds a term at a *slot* of the equations, or multiplies there by a factor. At the null "
        "value of its parameters it is exactly off. `rigctl effects show NAME` plots its signature; "
        "[your own effect](../../how-to/write-an-effect.md) is a file of a few lines. Bounds in brackets "
        "give the usual range, the others the physical one: a diagnosis also tries values beyond the first, "
        "but never beyond the second.\n",
        *(part for effect in effects if effect.terms for part in _of_effect(effect, family)),
    ]
    base = [effect for effect in effects if effect.base]
    if base:
        parts.append("## Base physics\n")
        parts.append("In every model; removing one shows its share.\n")
        parts += [part for effect in base for part in _of_base(effect)]
    parts += [*_slots(family), *_variables(family)]
    return "\n".join(parts)


def _of_effect(effect: Effect, family: ModelFamily) -> Iterator[str]:
    yield f"## {effect.name}\n"
    yield f"{_plain(effect.summary)} *({effect.kind})*\n"
    yield f"`{effect.equation}`\n"
    for slot, term in terms_in_symbols(effect, family).items():
        how = "factor" if family.slot(slot).combine == "product" else "term"
        yield f"{how.capitalize()} at `{slot}`:\n\n$$\n{latex_of(term, effect)}\n$$\n"
    yield "| parameter | null | start | bounds | meaning |\n|---|---|---|---|---|"
    for parameter in effect.parameters:
        yield _row(parameter)
    for way in effect.other_ways:
        yield f"| `{way.name}` | | | in {way.unit} | sets `{way.parameter}`: {_plain(way.meaning)} |"
    yield ""
    for state in effect.states:
        yield f"State `{state.name}` [{state.unit}]: {_plain(state.meaning)}.\n"
    yield from _remarks(effect)


def _row(parameter: EffectParameter) -> str:
    def shown(si: float) -> str:
        return show(si, parameter.unit, difference=parameter.difference)

    null = "shape" if parameter.null is None else shown(parameter.null)
    bounds = " to ".join(
        f"({shown(end)})" if usual else shown(end)
        for end, usual in zip((parameter.low, parameter.high), parameter.usual, strict=True)
    )
    order = "" if parameter.at_least is None else f"; at least `{parameter.at_least}`"
    meaning = _plain(parameter.meaning) + order
    return f"| `{parameter.name}` | {null} | {shown(parameter.start)} | {bounds} | {meaning} |"


def _of_base(effect: Effect) -> Iterator[str]:
    yield f"### {effect.name}\n"
    yield f"{_plain(effect.summary)} `{effect.equation}`\n"
    taken = ", ".join(f"`{name}` = {value:g}" for name, value in effect.base.items())
    yield f"Taken away by {taken} (SI).\n"
    yield from _remarks(effect)


def _remarks(effect: Effect) -> Iterator[str]:
    if effect.looks_like:
        yield f"**Looks like:** {_plain(effect.looks_like)}\n"
    if effect.confused_with:
        yield f"**Confused with:** {_names(effect.confused_with)}.\n"
    if effect.instead_of:
        yield f"**Instead of:** {_names(effect.instead_of)}; a model has one or the other.\n"
    if effect.needs:
        yield f"**Needs:** {_plain(effect.needs)}.\n"
    if effect.valid:
        yield f"**Valid over:** {_plain('; '.join(map(str, effect.valid)))}.\n"
    if effect.provenance is not None:
        yield f"**Provenance:** {_plain(str(effect.provenance))}.\n"
    yield f"**Source:** {_plain(effect.source)}.\n"


def _plain(text: str) -> str:
    """Text escaped so that Markdown shows it verbatim, also in a table."""
    return re.sub(r"([*|<])", r"\\\1", text)


def _names(names: tuple[str, ...]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _slots(family: ModelFamily) -> Iterator[str]:
    yield "## Slots\n"
    yield "| slot | unit | | meaning | its own variables |\n|---|---|---|---|---|"
    for slot in family.slots:
        local = ", ".join(f"`{name}` [{unit}]" for name, unit in slot.local)
        yield f"| `{slot.name}` | {slot.shown_unit} | {slot.combine} | {_plain(slot.meaning)} | {local} |"
    yield ""


def _variables(family: ModelFamily) -> Iterator[str]:
    yield "## Variables\n"
    yield "What a term may name, besides the effect's own parameters and `pi`.\n"
    for title, items in (
        ("state", family.states),
        ("input", family.inputs),
        ("definition", family.definitions),
        ("parameter", family.parameters),
    ):
        if items:
            yield f"| {title} | unit | meaning |\n|---|---|---|"
            yield from (f"| `{item.name}` | {item.unit} | {_plain(item.meaning)} |" for item in items)
            yield ""
