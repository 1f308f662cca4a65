"""The reference page of the generic effects, written from those of an example family."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from rigctl.effects.declaration import Effect
from rigctl.effects.generic.offer import offers
from rigctl.effects.generic.slot_roles import Balance, Given, Late, Reading

#: one of everything: a speed with its position, a store beside its surroundings, a command, a reading
_EXAMPLE = """
family: example
states:
  position: {start: 0 m, scale: 1 mm, rate: speed}
  speed: {start: 0 m/s, scale: 1 mm/s, rate: command/(1 kg)}
  store: {start: 20 degC, scale: 0.1 K, rate: (ambient - store)/time}
inputs:
  command: {value: 0 N}
  ambient: {value: 20 degC}
parameters:
  time: {value: 100 s, bounds: [1 s, 1000 s]}
outputs:
  reading: {unit: degC, formula: store}
"""
_TABLE = """
family: table
inputs:
  setting: {value: "1"}
parameters:
  height: {value: 20 m, bounds: [1 m, 100 m]}
outputs:
  reading: {unit: m, formula: height*setting^2}
"""
_SECTIONS = (
    (
        "At the balance of a speed",
        """
A state that is the derivative of another one, or is measured in m/s or rad/s. `position` is the state that
it is the derivative of.
""",
    ),
    (
        "At the balance of what is stored",
        """
Any other state that is not the integral of one alone: a level, a temperature, a pressure, a current, a
charge. It counts from its surroundings where the family has a variable of its unit whose name says so
(`ambient`, `room`, `outside`, `environment`, `surroundings`, `atmosphere` or `reference` among its words),
else from 0, and a temperature or pressure from its start.
""",
    ),
    ("At an input", "What acts in the place of what is commanded. Surroundings have an offset alone."),
    ("At a reading", "What a sensor shows beside the truth."),
    (
        "At a reading of a table",
        "Where a family has no states, what is missing may depend on each setting.",
    ),
)

_INTRODUCTION = """\
# Generic effects

*Generated: `make docs`.*

What may be missing in any bench. A [family of your own](../../how-to/write-a-model-family.md) has these
effects without a line about them, wherever the dimension of a slot and the variables fit; `rigctl effects
list --family mine.yaml` says which act where, and why others do not. A family that declares no slots gets
them at the balance of every state, at every input and at every reading; one that declares slots, at those.
`generic_effects: false` in the family file does without.

Names say what and where: `coulomb_on_speed` acts on the balance of the state `speed`; at a slot `drag` that
the family declares itself it is `coulomb_on_drag`. `lag_of_level` is of the reading or the input `level`.
Below, the family has the states `position`, `speed` and `store`, the inputs `command` and `ambient`, and
`reading`; w is what is added there. Typical sizes and bounds follow from the family's own numbers, limits
and widths from the range of the data. Widths, limits, exponents and times are *shapes*: a diagnosis looks
at several, and fits them once the effect is in.

What only rounds or disturbs a reading, quantisation for one, is no effect: it belongs to the noise, which a
diagnosis learns from the readings ([why](../../decisions/0050-quantisation-is-read-off.md)). A share of an
absolute temperature counts from the input's usual value, `value:` in the family file.
"""


def generic_page() -> str:
    """Markdown: how a family gets generic effects, and each of them."""
    effects = list(_example_effects())
    parts = [_INTRODUCTION]
    for title, text in _SECTIONS:
        parts += [f"## {title}\n", f"{text.strip()}\n"]
        parts += [line for where, effect in effects if where == title for line in _of_effect(effect)]
    return "\n".join(parts)


def _example_effects() -> Iterable[tuple[str, Effect]]:
    from rigctl.physics.user import parse_family

    for offer in offers(parse_family(_EXAMPLE)):
        role = offer.role
        match role:
            case Balance(moves=True):
                title = _SECTIONS[0][0]
            case Balance():
                title = _SECTIONS[1][0]
            case Given(surroundings=False) | Late() if role.input.name == "command":
                title = _SECTIONS[2][0]
            case Reading():
                title = _SECTIONS[3][0]
            case _:
                continue
        yield from ((title, effect) for effect in offer.effects)
    for offer in offers(parse_family(_TABLE)):
        if isinstance(offer.role, Reading):
            yield from ((_SECTIONS[4][0], effect) for effect in offer.effects if "_with_" in effect.name)


def _of_effect(effect: Effect) -> Iterator[str]:
    yield f"### {effect.name}\n"
    yield f"{_plain(effect.summary)} *({effect.kind})*\n"
    yield f"`{_without_numbers(effect.equation)}`\n"
    for parameter in effect.parameters:
        how = "shape" if parameter.shape else "either sign" if not parameter.sign else "one sign"
        yield f"- `{parameter.name}` ({how}): {_plain(parameter.meaning)}"
    yield ""
    yield f"**Looks like:** {_plain(effect.looks_like)}\n"
    if effect.confused_with:
        yield f"**Confused with:** {', '.join(f'`{name}`' for name in effect.confused_with)}.\n"
    if effect.needs:
        yield f"**Needs:** {_plain(effect.needs)}.\n"
    yield f"**Source:** {_plain(effect.source)}.\n"


def _without_numbers(equation: str) -> str:
    """The example's own range is a letter."""
    return re.sub(r"/[\d.e+-]+( [\w/*^]+)?([)|])", r"/x₀\2", equation)


def _plain(text: str) -> str:
    return re.sub(r"([*|<])", r"\\\1", text)
