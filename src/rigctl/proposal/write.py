"""The text of the files: a family, a rig, a procedure and a model, commented, to be edited.

In: a table and a `Draft`. Out: YAML as a person would write it, a comment beside whatever was guessed.
Nothing about safety is: limits are a comment, and no backend is named, so that no command moves a bench by
default.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from decimal import ROUND_CEILING, ROUND_FLOOR, Context

import numpy as np

from rigctl.files.scalars import quoted
from rigctl.noise import even_pieces, white_floor
from rigctl.proposal.columns import Column, Table
from rigctl.proposal.draft import Draft, amount
from rigctl.proposal.from_columns import duration
from rigctl.rig.channel import QUANTITIES
from rigctl.units import parse_unit

#: text that needs no quotes
_PLAIN = frozenset("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789 _-+*/^().=|")


def plain_or_quoted(text: str) -> str:
    """A text as YAML, in quotes where it needs them."""
    return text if text and set(text) <= _PLAIN and text[0].isalpha() else quoted(text)


#: beside a unit that nobody knows
NO_UNIT = "the log states no unit: a plain number until '--unit' of 'rigctl family new' gives it"
#: most samples of the record on which effects are tried
_MOST_SAMPLES = 1000


def family_text(name: str, draft: Draft, source: str, table: Table) -> str:
    """The family file."""
    return "\n".join([*_family(name, draft, source), *_standard_record(table, draft)]) + "\n"


def _standard_record(table: Table, draft: Draft) -> Iterator[str]:
    """The record on which effects are tried: the inputs within the range of the log, up and down."""
    given = [c for c in table.columns if c.name in draft.inputs and c.values.size]
    if table.times is None or not given:
        return
    longest = duration(table)
    rate = min(_rate(table), 1e6)
    length = min(longest, _MOST_SAMPLES / rate)
    yield ""
    yield "# What effects are tried on; it also says how large the inputs are, and that there is a time axis."
    yield "standard_record:"
    yield f"  duration: {length:.4g} s"
    yield f"  rate: {rate:.4g} Hz"
    yield "  switches:"
    for at, pick in ((0.0, 0.5), (0.1, 1.0), (0.4, 0.0), (0.7, 0.8)):
        values = ", ".join(f"{c.name}: {amount(_within(c, pick), c.unit)}" for c in given)
        yield f"    - {{at: {at * length:.4g} s, set: {{{values}}}}}"


def _within(column: Column, share: float) -> float:
    """A value of a column: `share` of the way from the smallest to the largest."""
    low, high = np.nanmin(column.values), np.nanmax(column.values)
    return float(low + share * (high - low))


def _family(name: str, draft: Draft, source: str) -> Iterator[str]:
    yield f"# {draft.title}: a first family, to be edited. 'rigctl check' says what is wrong with it;"
    yield "# every formula is checked for its unit."
    yield "#"
    yield from (f"#   {equation}" for equation in draft.equations)
    yield ""
    yield f"family: {name}"
    yield f"title: {plain_or_quoted(draft.title)}"
    yield f"source: {plain_or_quoted(source)}"
    yield from part(
        "states",
        "What changes with time. `rate` has the state's unit per second.",
        {
            key: {
                "start": s.start,
                "scale": s.scale,
                "rate": plain_or_quoted(s.rate),
                "meaning": plain_or_quoted(s.meaning),
            }
            for key, s in draft.states.items()
        },
    )
    yield from part(
        "inputs",
        "What is commanded, or measured and given from outside: a channel or an actuator of the same name.",
        {
            key: {
                "value": one.value,
                "hold": one.hold,
                "delay": one.delay,
                "meaning": plain_or_quoted(one.meaning),
            }
            for key, one in draft.inputs.items()
        },
    )
    yield from part(
        "parameters",
        "What a fit may change, and within which bounds. An assumed number is a guess: measure it.",
        {
            key: {
                "value": amount_of(p.value, p.unit),
                "bounds": f"[{amount_of(p.low, p.unit)}, {amount_of(p.high, p.unit)}]",
                "standing": "" if p.fit else "assumed",
                "meaning": plain_or_quoted(p.meaning),
            }
            for key, p in draft.parameters.items()
        },
    )
    yield from part(
        "constants",
        "Numbers that no fit changes.",
        {
            key: {"value": value, "standing": _guessed(meaning), "meaning": plain_or_quoted(meaning)}
            for key, (value, meaning) in draft.constants.items()
        },
    )
    yield from part(
        "definitions",
        "What several formulas use.",
        {
            key: {
                "unit": plain_or_quoted(f.unit),
                "formula": plain_or_quoted(f.formula),
                "meaning": plain_or_quoted(f.meaning),
            }
            for key, f in draft.definitions.items()
        },
    )
    yield from part(
        "slots",
        "Where effects may act: 0 without any.",
        {
            key: {"unit": plain_or_quoted(unit), "kind": kind, "meaning": plain_or_quoted(meaning)}
            for key, (unit, kind, meaning) in draft.slots.items()
        },
    )
    yield from part(
        "outputs",
        "What sensors read, by the names of the rig's channels.",
        {
            key: {
                "unit": plain_or_quoted(f.unit),
                "formula": plain_or_quoted(f.formula),
                "meaning": plain_or_quoted(f.meaning),
            }
            for key, f in draft.outputs.items()
        },
    )


def _guessed(meaning: str) -> str:
    """The standing of a constant: a guess where its meaning asks for a measurement."""
    return "assumed" if meaning.endswith("measure it") else ""


def amount_of(value: float, unit: str, digits: int = 4) -> str:
    """A number in its unit."""
    text = f"{value:.{digits}g}" if abs(value) > 1e-300 else "0"
    return f"{text} {unit}" if unit not in ("", "1") else text


def part(name: str, comment: str, items: Mapping[str, Mapping[str, str]]) -> Iterator[str]:
    """A part of a family file: a comment, and the fields of each name that are not empty."""
    if not items:
        return
    yield ""
    yield f"# {comment}"
    yield f"{name}:"
    for key, fields in items.items():
        yield f"  {key}:"
        yield from (f"    {field}: {text}" for field, text in fields.items() if text not in ("", '""'))


def rig_text(name: str, table: Table, draft: Draft, family: str, log_format: str | None) -> str:
    """The rig file: every output and measured input a channel, every command an actuator."""
    return "\n".join(_rig(name, table, draft, family, log_format)) + "\n"


def actuated(table: Table) -> list[Column]:
    """The inputs that are commands."""
    return [c for c in table.columns if c.role == "input" and c.origin == "commanded"]


def _rig(name: str, table: Table, draft: Draft, family: str, log_format: str | None) -> Iterator[str]:
    commands = actuated(table)
    channels = [c for c in table.columns if c.role != "left out" and c not in commands]
    yield "# A first rig file, to be edited: what is measured, what is commanded, and what must not happen."
    yield f"name: {name.replace('_', ' ')}"
    yield f"model: {family}"
    if log_format is not None:
        yield f"log_format: {log_format}    # the columns of its logs, for 'rigctl import'"
    yield "# backend: {kind: serial, port: /dev/ttyACM0}   # how the bench is reached; an import needs none"
    yield ""
    yield "channels:"
    for column in channels:
        known = column.name in draft.outputs or column.name in draft.inputs
        yield f"  {column.name}:" + ("" if known else "    # the family says nothing of it")
        if column.origin == "unclear":
            yield "    # An input: measured, as here, or commanded? The log does not tell. A command is known"
            yield "    # exactly, has no noise and is never smoothed: it belongs under 'actuators', as"
            yield f"    # 'rigctl family new … --commanded {column.name}' writes it."
        yield f"    unit: {plain_or_quoted(column.unit)}" + ("" if column.known else f"    # {NO_UNIT}")
        yield f"    quantity: {quantity_of(column.unit)}"
        scatter = _scatter(column, table)
        if scatter > 0.0:
            size = amount(scatter, column.interval, difference=True)
            yield f"    # noise: {size}      # its white part. A number stated here counts in verdicts;"
            yield "    # the simulated bench adds it. Slow noise: {white: …, slow: …, over: …}"
    yield ""
    if not commands:
        yield "actuators: {}    # nothing is commanded; what comes from outside is measured"
        yield "safe_state: {}"
    else:
        yield "actuators:"
        for column in commands:
            low, high = _reach(column)
            ends = (
                f"low: {_end(low, column.unit, ROUND_FLOOR)}, high: {_end(high, column.unit, ROUND_CEILING)}"
            )
            unknown = "" if column.known else f"    # {NO_UNIT}"
            yield f"  {column.name}: {{kind: level, unit: {plain_or_quoted(column.unit)}, {ends}}}{unknown}"
        yield ""
        yield "# where every actuator goes when anything is wrong"
        yield "safe_state:"
        yield from (f"  {column.name}: {amount(_safe(column), column.unit)}" for column in commands)
    yield ""
    yield "# limits:      # interlocks: what stops a run"
    first = channels[0] if channels else commands[0]
    most = amount(_reach(first)[1], first.unit)
    yield f"#   too_much: {{channel: {first.name}, above: {most}, action: stop}}"
    starts = {c.name: c for c in channels if c.values.size and np.isfinite(c.values).any()}
    if starts:
        yield ""
        yield "simulation:"
        yield "  initial:"
        for column in starts.values():
            initial = float(column.values[np.isfinite(column.values)][0])
            yield f"    {column.name}: {amount(initial, column.unit)}"


def quantity_of(unit: str) -> str:
    """The rig file's quantity of a channel in this unit."""
    dimension = parse_unit(unit).dimension
    fitting = [
        quantity
        for quantity, known in QUANTITIES.items()
        if known is not None and parse_unit(known).dimension == dimension and not dimension.dimensionless
    ]
    if "frequency" in fitting:  # a radian is a plain number
        return "frequency" if "Hz" in unit or unit.startswith("1/") else "angular_speed"
    return fitting[0] if fitting else "other"


def _scatter(column: Column, table: Table) -> float:
    """The white part of a reading's noise, SI; 0 where the readings do not measure it."""
    if table.times is None or not column.values.size:
        return 0.0
    spacing = 1.0 / _rate(table)
    pieces = [p for r in table.pieces for p in even_pieces(table.times[r], column.values[r], spacing)]
    found = white_floor(pieces)
    return found.sigma if found is not None and found.measured else 0.0


def _reach(column: Column) -> tuple[float, float]:
    """Range of a command: that of the data, extended to zero."""
    present = column.values[np.isfinite(column.values)]
    zero = column.display.to_si(0.0)
    if not present.size:
        return zero, zero + column.display.factor
    low, high = float(present.min()), float(present.max())
    return (
        (min(low, zero), max(high, zero))
        if low < high or low != zero
        else (zero, zero + column.display.factor)
    )


def _end(value: float, unit: str, rounding: str) -> str:
    """An end of a range, SI, of four digits and rounded outwards, so that the range holds its own data.

    The six digits before that keep a conversion to SI and back from adding a step: 70.000000001 is 70.
    """
    shown = f"{parse_unit(unit).from_si(value):.6g}"
    return amount_of(float(Context(prec=4, rounding=rounding).create_decimal(shown)), unit)


def _safe(column: Column) -> float:
    low, high = _reach(column)
    return min(max(column.display.to_si(0.0), low), high)


def procedure_text(name: str, table: Table, rig: str, duration: float) -> str:
    """A procedure to begin with: every command up and down again, or only a record."""
    commands = actuated(table)
    rate = _rate(table)
    half = max(0.5 * duration, 4.0 / rate)
    lines = [f"procedure: {name.replace('_', ' ')} steps", f"rig: {rig}", "steps:"]
    lines.append(f"  - record: {{name: step, rate: {rate:.4g} Hz}}")
    lines.append("    do:")
    if commands:
        up = ", ".join(f"{c.name}: {amount(_reach(c)[1], c.unit)}" for c in commands)
        down = ", ".join(f"{c.name}: {amount(_safe(c), c.unit)}" for c in commands)
        lines += [f"      - set: {{{up}}}", f"      - wait: {half:.4g} s", f"      - set: {{{down}}}"]
    lines.append(f"      - wait: {half:.4g} s")
    return "\n".join(lines) + "\n"


def _rate(table: Table) -> float:
    if table.times is None or table.times.size < 2:
        return 10.0
    steps = np.diff(table.times)
    steps = steps[steps > 0.0]
    return float(1.0 / np.median(steps)) if steps.size else 10.0


def model_text(draft: Draft, family: str, rig: str) -> str:
    """The model file: the parameters with `fit` are what a fit may change."""
    lines = [
        "# A first model, to be edited: 'fit: true' lets a fit change a parameter.",
        f"model: {family}",
        f"rig: {rig}",
        "parameters:",
    ]
    for name, p in draft.parameters.items():
        value = _quoted_amount(amount_of(p.value, p.unit, p.digits))
        lines.append(f"  {name}: {{value: {value}, fit: {'true' if p.fit else 'false'}}}")
    return "\n".join(lines) + "\n"


def _quoted_amount(text: str) -> str:
    return text if set(text) <= _PLAIN else f'"{text}"'
