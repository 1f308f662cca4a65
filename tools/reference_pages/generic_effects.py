"""The reference page of the generic effects, written from those of an example family."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from rigctl.effects.declaration import Effect
from rigctl.effects.generic.offer import offers
from rigctl.effects.generic.slot_roles import Balance, Given, Late, OfProgram, Reading
from rigctl.physics.derived_slots import around
from rigctl.physics.family import ModelFamily

#: one of each kind: a speed with its position, a store in its surroundings, a command, a reading
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
#: of which a program computes the state
_PROGRAM = """
family: program
states:
  reading: {start: 0 m, scale: 1 mm, rate: (temperature - 20 degC)*(1 m/s/K) - stiffness*reading/(1 N*s/m)}
inputs:
  temperature: {value: 20 degC}
parameters:
  stiffness: {value: 100 N/m, bounds: [1 N/m, 1000 N/m]}
outputs:
  reading: {unit: m, formula: reading}
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
        "At the balance of a stored quantity",
        """
Any other state that is not the integral of one alone: a level, a temperature, a pressure, a current, a
charge. It is relative to its surroundings if the family has a variable with its unit and a matching name
(containing `ambient`, `room`, `outside`, `environment`, `surroundings`, `atmosphere` or `reference`),
otherwise to 0, and a temperature or pressure to its initial value.
""",
    ),
    ("At an input", "The actual input instead of the command. Surroundings have only an offset."),
    ("At a reading", "The error of a sensor."),
    (
        "At a reading of a table",
        "In a family without states, a missing term may depend on each setting.",
    ),
    (
        "At a parameter of an FMU or of functions",
        """
Where a program computes the states there are no balances to act on. Effects act at its inputs and outputs,
and on each of its parameters that a fit may change: a drift with every input and condition, and in time if
the parameter can change during a simulation (`variability="tunable"` of an FMU; functions always). To a
parameter that cannot, the mean of w over the record is added. `origin` is the middle of the data.
""",
    ),
)

_INTRODUCTION = """\
# Generic effects

*Generated: `make docs`.*

Effects that may be missing in any bench. A [family of your own](../../how-to/write-a-model-family.md) has
these effects without declaring them, wherever the dimension of a slot and the variables match; `rigctl
effects list --family mine.yaml` shows which act where, and why others do not. In a family without slots they
act on the balance of every state, on every input and on every reading; in one with slots, only at those.
`generic_effects: false` in the family file disables them.

Names give the kind and the location: `coulomb_on_speed` acts on the balance of the state `speed`; at a slot
`drag` declared by the family it is called `coulomb_on_drag`. `lag_of_level` acts on the reading or the input
`level`. The family below has the states `position`, `speed` and `store`, the inputs `command` and `ambient`,
and `reading`; w is the term that is added. Typical sizes and bounds follow from the family's numbers, limits
and widths from the range of the data. Widths, limits, exponents and times are *shape parameters*: a diagnosis
tries several values, and fits them once the effect is in the model.

Rounding and disturbances of a reading, such as quantisation, are not effects: they belong to the noise, which
a diagnosis estimates from the readings
([why](../../decisions/0050-converter-resolution-detected-from-readings.md)). A share of an absolute
temperature is relative to the input's usual value, `value:` in the family file.
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
    for offer in offers(_of_program()):
        if isinstance(offer.role, OfProgram):
            yield from ((_SECTIONS[5][0], effect) for effect in offer.effects)


def _of_program() -> ModelFamily:
    from rigctl.foreign.functions import FunctionProgram
    from rigctl.physics.user import parse_family

    names = {"inputs": ("temperature",), "outputs": ("reading",), "parameters": ("stiffness",)}
    rest = {"token": "", "code": b"", "why": "", "states": {}, "settable": (), "constants": {}}
    program = FunctionProgram(name="program", sizes={"stiffness": 100.0}, **names, **rest)
    return around(program, parse_family(_PROGRAM))


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
    """The equation with the example's range replaced by a letter."""
    return re.sub(r"/[\d.e+-]+( [\w/*^]+)?([)|])", r"/x₀\2", equation)


def _plain(text: str) -> str:
    return re.sub(r"([*|<])", r"\\\1", text)
