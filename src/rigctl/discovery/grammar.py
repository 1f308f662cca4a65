"""Formulas that a term may be, over one variable or a product over two, with all that is needed to write
them.

    u = z − z_0, z_0 where z has no zero of its own in the data (a temperature);   R a round size of u

    sign(u)·|u/R|^a, a ∈ {½, 1, 3/2, 2, 3};   |u/R|^a, a ∈ {½, 1, 2};   tanh(u/s);   (u/s)/(1 + |u|/s)
    exp(u/s);   exp(−u/s);   tanh(4u/s)·exp(−(u/s)²);   ((u − s)/R)₊;   ((s − u)/R)₊;   exp(−((u − s)/w)²)

A product has one of these over one variable, and over the other |v/R|^b, b ∈ {½, 1, 2}, v/R, tanh(v/s) or
the sign of v, as tanh(100·v/R): a dry force has no scale of its own.
Every argument of a function is a pure number, and the one size in front has the unit of the slot.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.effects.drivers import Driver
from rigctl.physics.family import InputVariable, ModelFamily, StateVariable
from rigctl.units import parse_unit

Floats = NDArray[np.float64]

#: a variable whose smallest magnitude exceeds this share of its largest does not pass through zero in the
#: data
_AWAY = 0.5
#: corners are rounded over this share of the reference
WIDTH = 1e-3
_ZERO_CELSIUS = 273.15
#: the sign of a variable changes over this share of the reference
_STEP = 0.01
#: scales that are distances; the others are values of the variable
DISTANCES = frozenset(("scale", "width"))


@dataclass(frozen=True)
class Argument:
    """The argument of a function.

    Attributes
    ----------
    zero, reference: ``u = z − zero``, ``x = u/reference``, SI; the reference is a round number.
    low, high: range of z in the data, SI.
    text, reference_text: u and R as written in an effect file.
    point: z is a temperature, not a temperature difference.
    """

    driver: Driver
    zero: float
    reference: float
    low: float
    high: float
    text: str
    reference_text: str
    point: bool

    def of(self, z: Floats) -> Floats:
        """(n) x at the values z of the variable."""
        return np.asarray((z - self.zero) / self.reference)

    @property
    def length(self) -> float:
        """The length of the range of x."""
        return (self.high - self.low) / self.reference

    @property
    def ratio(self) -> str:
        """x as written in an effect file."""
        return f"{self.text}/{self.reference_text}"

    def scale_si(self, name: str, x: float) -> float:
        """A scale of x in the variable's unit: a distance, or a value of z."""
        return x * self.reference + (0.0 if name in DISTANCES else self.zero)

    def amount(self, name: str, si: float) -> str:
        """A scale as written in an effect file."""
        if name not in DISTANCES and self.point:
            return amount(si - _ZERO_CELSIUS, "degC")
        return amount(si, self.driver.unit)

    @property
    def step_text(self) -> str:
        """The width of the sign of u as written in an effect file."""
        return _bracketed(amount(_STEP * self.reference, self.driver.unit))

    @property
    def driver_text(self) -> str:
        """z as written in an effect file."""
        return self.driver.name if len(self.driver.weights) == 1 else f"({self.driver.name})"


def argument(driver: Driver, low: float, high: float, family: ModelFamily) -> Argument:
    """A variable with range `low` to `high`, measured from its own zero, or from the lower end."""
    # A variable far from its zero, and any absolute temperature, is counted from a round value at the lower
    # end of its range: a power of 293 K … 353 K would be a straight line.
    size = max(abs(low), abs(high))
    point = _is_point(driver, family)
    zero = 0.0
    if point or (min(abs(low), abs(high)) > _AWAY * size and low * high > 0.0):
        shift = _ZERO_CELSIUS if point else 0.0
        zero = round_to(low - shift, high - low) + shift
        size = max(high - zero, zero - low)
    reference = round_to(size, size)
    name = driver.name if len(driver.weights) == 1 else f"({driver.name})"
    text = name
    if zero:
        text = f"({name} - {amount(zero - _ZERO_CELSIUS, 'degC') if point else amount(zero, driver.unit)})"
    return Argument(
        driver, zero, reference, low, high, text, _bracketed(amount(reference, driver.unit)), point
    )


def _is_point(driver: Driver, family: ModelFamily) -> bool:
    """Whether it is an absolute temperature, according to the family."""
    if len(driver.weights) > 1 or parse_unit(driver.unit).text != "K":
        return False
    named: tuple[StateVariable | InputVariable, ...] = (*family.states, *family.inputs)
    return not any(item.difference for item in named if item.name in driver.variables)


def amount(value: float, unit: str) -> str:
    """A value as written in a file."""
    return f"{value:.6g}" if unit == "1" else f"{value:.6g} {unit}"


def _bracketed(amount: str) -> str:
    return f"({amount})" if " " in amount else amount


def round_to(value: float, size: float) -> float:
    """A value rounded to one significant figure of `size`."""
    if value == 0.0 or size == 0.0:
        return 0.0
    step = 10.0 ** math.floor(math.log10(abs(size)))
    return float(f"{round(value / step) * step:.6g}") if round(value / step) else 0.0


@dataclass(frozen=True)
class Form:
    """A function of x with scales.

    Attributes
    ----------
    name: unique among the forms.
    text: makes the text in an effect file from its argument and the names of its scales.
    of: its values from the values of x and its scales.
    scales: the names of its scales: ``scale`` and ``width`` are distances, ``center`` and ``limit`` values.
    starts: initial values of its scales, in x; all are tried.
    complexity: operations and constants, for the description length.
    """

    name: str
    text: Callable[[Argument, Sequence[str]], str]
    of: Callable[..., Floats]
    scales: tuple[str, ...] = ()
    starts: tuple[tuple[float, ...], ...] = ((),)
    complexity: int = 1


def odd_powers() -> Iterator[Form]:
    """``sign(u)·|u/R|^a``."""
    yield Form("linear", lambda a, _: a.ratio, lambda x: x)
    yield from (_odd(power) for power in (0.5, 1.5, 2.0, 3.0))


def _odd(power: float) -> Form:
    return Form(
        f"power_{_word(power)}",
        lambda a, _: f"spow({a.ratio}, {power:g}, {WIDTH:g})",
        lambda x: np.sign(x) * np.abs(x) ** power,
        complexity=2,
    )


def even_powers() -> Iterator[Form]:
    """``|u/R|^a``."""
    yield from (_even(power) for power in (0.5, 1.0, 2.0))


def _even(power: float) -> Form:
    return Form(
        f"even_{_word(power)}",
        lambda a, _: f"absolute({a.ratio}, {WIDTH:g})^{power:g}",
        lambda x: np.abs(x) ** power,
        complexity=2,
    )


def _tanh(largest: float) -> Form:
    return Form(
        "tanh",
        lambda a, s: f"tanh({a.text}/{s[0]})",
        lambda x, s: np.tanh(x / s),
        ("scale",),
        tuple((share * largest,) for share in (0.01, 0.03, 0.1, 0.3)),
        3,
    )


def forms(low: float, high: float) -> Iterator[Form]:
    """The forms of one argument with x from `low` to `high`."""
    largest, length = max(abs(low), abs(high)), high - low
    # Powers of x = u/R need no scale; saturating, growing and local forms have one or two, each started at
    # several values, since a search for the best one stays near its start.
    yield from odd_powers()
    if _changes_sign(low, high):  # else they equal the odd ones
        yield from even_powers()
    yield _tanh(largest)
    shares = tuple((share * largest,) for share in (0.03, 0.1, 0.3, 1.0))
    yield Form(
        "saturation",
        lambda a, s: f"({a.text}/{s[0]})/(1 + absolute({a.text}/{s[0]}, {WIDTH:g}))",
        lambda x, s: (x / s) / (1.0 + np.abs(x / s)),
        ("scale",),
        shares,
        4,
    )
    slow = tuple((share * largest,) for share in (0.1, 0.2, 0.4, 0.8))
    yield Form(
        "growth", lambda a, s: f"exp({a.text}/{s[0]})", lambda x, s: np.exp(x / s), ("scale",), slow, 3
    )
    yield Form(
        "decay", lambda a, s: f"exp(-{a.text}/{s[0]})", lambda x, s: np.exp(-x / s), ("scale",), slow, 3
    )
    yield Form(
        "stribeck",
        lambda a, s: f"tanh(4*{a.text}/{s[0]})*exp(-({a.text}/{s[0]})^2)",
        lambda x, s: np.tanh(4.0 * x / s) * np.exp(-np.square(x / s)),
        ("scale",),
        shares,
        6,
    )
    inner = tuple((low + share * length,) for share in (0.1, 0.25, 0.4, 0.55, 0.7, 0.85))
    yield Form(
        "above",
        lambda a, s: f"positive_part(({a.driver_text} - {s[0]})/{a.reference_text}, {WIDTH:g})",
        lambda x, s: np.maximum(x - s, 0.0),
        ("limit",),
        inner,
        3,
    )
    yield Form(
        "below",
        lambda a, s: f"positive_part(({s[0]} - {a.driver_text})/{a.reference_text}, {WIDTH:g})",
        lambda x, s: np.maximum(s - x, 0.0),
        ("limit",),
        inner,
        3,
    )
    yield _bump(low, length)


def _bump(low: float, length: float) -> Form:
    return Form(
        "bump",
        lambda a, s: f"exp(-(({a.driver_text} - {s[0]})/{s[1]})^2)",
        lambda x, s, w: np.exp(-np.square((x - s) / w)),
        ("center", "width"),
        tuple(
            (low + share * length, width * length)
            for share in np.linspace(0.05, 0.95, 13).tolist()
            for width in (0.04, 0.08, 0.16, 0.32)
        ),
        5,
    )


def factors(low: float, high: float) -> Iterator[Form]:
    """Forms that may multiply a form of another variable."""
    yield from even_powers()
    if low < 0.0 < high:
        yield Form("linear", lambda a, _: a.ratio, lambda x: x)
        yield _tanh(max(abs(low), abs(high)))
    if _changes_sign(low, high):
        yield Form(
            "sign", lambda a, _: f"tanh({a.text}/{a.step_text})", lambda x: np.tanh(x / _STEP), complexity=2
        )


def _changes_sign(low: float, high: float) -> bool:
    """Whether x has values of both signs, not only by its scatter about an end of the range."""
    least = 0.05 * (high - low)
    return low < -least and high > least


def _word(power: float) -> str:
    return {0.5: "half", 1.0: "one", 1.5: "three_halves", 2.0: "two", 3.0: "three"}[power]
