"""A drafted family and its model, before they are written as text."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rigctl.units import parse_unit

#: unit, kind and meaning
Slot = tuple[str, str, str]


@dataclass(frozen=True)
class State:
    """A state of the draft; everything as written in the file."""

    start: str
    scale: str
    rate: str
    meaning: str = ""


@dataclass(frozen=True)
class Input:
    """An input of the draft; `delay` is the slot at which its switches may be late, "" for none, and `hold`
    "linear" for a command that changes from sample to sample."""

    value: str
    meaning: str
    delay: str = ""
    hold: str = ""


@dataclass(frozen=True)
class Parameter:
    """A parameter of the draft, its numbers in `unit`; `fit` says whether a fit may change it, `digits` how
    many of its value are written."""

    value: float
    unit: str
    low: float
    high: float
    meaning: str = ""
    fit: bool = True
    digits: int = 4


@dataclass(frozen=True)
class Formula:
    """A definition or an output."""

    unit: str
    formula: str
    meaning: str = ""


@dataclass(frozen=True)
class Draft:
    """The draft that a template makes from the columns.

    Attributes
    ----------
    equations: for the file's head, one line each.
    constants: value with its unit, by name.
    slots: unit, kind and meaning by name.
    """

    title: str
    equations: tuple[str, ...]
    inputs: Mapping[str, Input]
    outputs: Mapping[str, Formula]
    states: Mapping[str, State] = field(default_factory=dict)
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    constants: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    definitions: Mapping[str, Formula] = field(default_factory=dict)
    slots: Mapping[str, Slot] = field(default_factory=dict)

    @property
    def static(self) -> bool:
        """Whether the outputs follow the inputs at once."""
        return not self.states


def amount(value: float, unit: str, *, difference: bool = False) -> str:
    """An SI value as written in a file: four digits and the unit."""
    shown = parse_unit(unit).from_si(value, difference=difference)
    text = f"{shown:.4g}" if abs(shown) > 1e-300 else "0"
    return f"{text} {unit}" if unit not in ("", "1") else text


def ratio(above: str, below: str) -> str:
    """The unit of a quotient."""
    if below in ("", "1"):
        return above
    return f"{above}/({below})" if any(sign in below for sign in "*/^ ") else f"{above}/{below}"


def times(first: str, second: str) -> str:
    """The unit of a product."""
    if first in ("", "1"):
        return second
    return first if second in ("", "1") else f"{first}*{second}"


def positive(value: float, unit: str, meaning: str, *, fit: bool = True, room: float = 1000.0) -> Parameter:
    """A parameter above zero, SI, with bounds a factor `room` to either side."""
    shown = value / parse_unit(unit).factor
    return Parameter(shown, unit, shown / room, shown * room, meaning, fit)


def either(value: float, unit: str, span: float, meaning: str) -> Parameter:
    """A parameter of either sign, SI, with bounds `span` to either side of zero."""
    factor = parse_unit(unit).factor
    most = max(abs(span), 2.0 * abs(value)) / factor
    return Parameter(value / factor, unit, -most, most, meaning)
