"""Quantities with units: converted to SI when they are read.

`30 bar` becomes 3e6, `40 degC` becomes 313.15, and a tolerance of `0.5 degC` becomes 0.5 because a
temperature difference has no offset. pint provides the units; it is imported only if an uncommon one is read.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

from rigctl.errors import RigctlError, nearest_name

if TYPE_CHECKING:
    import pint

BASE = ("length", "mass", "time", "current", "temperature", "substance", "luminosity")
_BASE_UNITS = ("m", "kg", "s", "A", "K", "mol", "cd")


@dataclass(frozen=True)
class Dimension:
    """Exponents of the seven SI base dimensions, in the order of `BASE`."""

    exponents: tuple[Fraction, ...]

    def __hash__(self) -> int:
        """Computed once, since the hash of a fraction requires a modular inverse of its denominator."""
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash(self.exponents)

    def __mul__(self, other: Dimension) -> Dimension:
        return Dimension(tuple(a + b for a, b in zip(self.exponents, other.exponents, strict=True)))

    def __truediv__(self, other: Dimension) -> Dimension:
        return Dimension(tuple(a - b for a, b in zip(self.exponents, other.exponents, strict=True)))

    def __pow__(self, power: float | Fraction) -> Dimension:
        exact = Fraction(power).limit_denominator(64)
        return Dimension(tuple(a * exact for a in self.exponents))

    @property
    def dimensionless(self) -> bool:
        """True when every exponent is zero."""
        return not any(self.exponents)

    def __str__(self) -> str:
        """The dimension as a product of SI base units, e.g. ``kg m^-1 s^-2``."""
        factors = [
            unit if power == 1 else f"{unit}^{power}"
            for unit, power in zip(_BASE_UNITS, self.exponents, strict=True)
            if power
        ]
        return " ".join(factors) or "1"


DIMENSIONLESS = Dimension((Fraction(0),) * len(BASE))

#: the name of a dimension in messages, with an example
_NAMED = {
    "1": "a plain number",
    "s": "a time, e.g. '2 s'",
    "K": "a temperature, e.g. '40 degC'",
    "Pa": "a pressure, e.g. '30 bar'",
    "m": "a length, e.g. '100 mm'",
    "m/s": "a speed, e.g. '0.1 m/s'",
    "Hz": "a rate, e.g. '100 Hz'",
    "m^3/s": "a flow, e.g. '14 l/min'",
    "V": "a voltage, e.g. '5 V'",
    "W": "a power, e.g. '1000 W'",
    "N": "a force, e.g. '100 N'",
    "A": "a current, e.g. '2 A'",
    "ohm": "a resistance, e.g. '1.2 ohm'",
    "H": "an inductance, e.g. '1 mH'",
    "kg": "a mass, e.g. '2 kg'",
    "N*m": "a torque or an energy, e.g. '0.5 N*m' or '2 kJ'",
}

#: units by quantity, as listed in the documentation; multiples (mV, kN) and products work as well
UNITS_OF: Mapping[str, tuple[str, ...]] = {
    "plain number": ("1", "%", "count"),
    "time": ("s", "ms", "min", "h", "day"),
    "length": ("m", "mm", "cm", "um", "km", "inch"),
    "area": ("m^2", "mm^2", "cm^2"),
    "volume": ("m^3", "l", "ml", "cm^3"),
    "angle": ("rad", "mrad", "deg"),
    "speed": ("m/s", "mm/s", "km/h"),
    "acceleration": ("m/s^2", "mm/s^2"),
    "speed of rotation": ("rad/s", "rpm", "deg/s"),
    "frequency": ("Hz", "kHz", "1/s"),
    "mass": ("kg", "g", "t"),
    "moment of inertia": ("kg*m^2", "g*cm^2"),
    "force": ("N", "kN", "mN"),
    "torque": ("N*m", "mN*m"),
    "stiffness": ("N/m", "N/mm"),
    "torsional stiffness": ("N*m/rad",),
    "damping": ("N*s/m",),
    "friction of rotation": ("N*m*s/rad",),
    "pressure": ("Pa", "bar", "mbar", "kPa", "MPa", "psi"),
    "flow": ("m^3/s", "l/min", "ml/min", "m^3/h"),
    "flow of mass": ("kg/s", "g/s", "kg/h"),
    "density": ("kg/m^3", "g/cm^3"),
    "dynamic viscosity": ("Pa*s", "mPa*s"),
    "kinematic viscosity": ("m^2/s", "cSt"),
    "temperature": ("K", "degC", "degF"),
    "power": ("W", "kW", "mW"),
    "energy": ("J", "kJ", "kWh", "Wh"),
    "heat capacity": ("J/K", "kJ/K"),
    "specific heat": ("J/(kg*K)", "kJ/(kg*K)"),
    "heat conductance": ("W/K",),
    "heat transfer coefficient": ("W/(m^2*K)",),
    "voltage": ("V", "mV", "kV"),
    "current": ("A", "mA"),
    "resistance": ("ohm", "mohm", "kohm"),
    "inductance": ("H", "mH", "uH"),
    "capacitance": ("F", "uF", "nF"),
    "charge": ("C", "A*h", "mA*h"),
    "motor constant": ("N*m/A", "V*s/rad"),
}

#: other spellings of single names, and their standard names
SPELLINGS: Mapping[str, str] = {
    "Ohm": "ohm",
    "Ohms": "ohm",
    "Ω": "ohm",
    "kΩ": "kohm",
    "mΩ": "mohm",
    "kOhm": "kohm",
    "sec": "s",
    "secs": "s",
    "°": "deg",
    "RPM": "rpm",
    "Nm": "(N*m)",
    "mNm": "(mN*m)",
    "kNm": "(kN*m)",
    "Ah": "(A*h)",
    "mAh": "(mA*h)",
    "lpm": "(l/min)",
    "LPM": "(l/min)",
    "L": "l",
    "Volt": "V",
    "Volts": "V",
    "Amp": "A",
    "Amps": "A",
    "Watt": "W",
    "Watts": "W",
    "Newton": "N",
    "Kelvin": "K",
    "Celsius": "degC",
    "mL": "ml",
}

#: signs and their replacements
_SIGNS = str.maketrans({"·": "*", "⋅": "*", "×": "*", "µ": "u", "μ": "u", "−": "-", "Ω": "Ω"})
_RAISED = re.compile("[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+")
_LOWERED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
#: names of angles, and of angles per time; they are dimensionless
_ANGLES = frozenset(("rad", "mrad", "deg", "radian", "degree", "turn", "revolution", "rpm", "rps"))
#: units recognised only as a whole text: revolutions per minute, as in German data sheets
_WHOLE = {"U/min": "rpm", "u/min": "rpm", "rev/min": "rpm", "r/min": "rpm"}

_LONGEST = 80
_WORD = re.compile(r"([^\W\d]\w*|°(?![CF]))")
_TOKEN = re.compile(r"[^\W\d]\w*|°[CF]?|%|1(?!\d)|\*\*|[*/^()]|-?\d+")
_QUANTITY = re.compile(r"^\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*$")


@dataclass(frozen=True)
class Unit:
    """A unit known to pint: ``si = value * factor + offset``.

    `offset` is non-zero only for degC and degF; a temperature *difference* uses `factor` alone.
    """

    text: str
    dimension: Dimension
    factor: float
    offset: float

    @property
    def absolute_temperature(self) -> bool:
        """True for a scale with an offset: degC, degF."""
        return self.offset != 0.0

    def to_si(self, value: float, *, difference: bool = False) -> float:
        """The value in SI; with `difference`, an interval of temperatures."""
        return value * self.factor + (0.0 if difference else self.offset)

    def from_si(self, value: float, *, difference: bool = False) -> float:
        """The value in this unit."""
        return (value - (0.0 if difference else self.offset)) / self.factor


@lru_cache(maxsize=1)
def registry() -> pint.UnitRegistry[Any]:
    """pint's registry of units, created at the first use."""
    import pint

    units: pint.UnitRegistry[Any] = pint.UnitRegistry()
    units.define("cSt = 1e-6 m^2/s = centistokes")
    units.define("count = 1")
    return units


# units with a fixed SI form: a process that reads only these need not import pint
_COMMON: Mapping[str, tuple[tuple[int, ...], float, float]] = {
    "1": ((0, 0, 0, 0, 0, 0, 0), 1.0, 0.0),
    "count": ((0, 0, 0, 0, 0, 0, 0), 1.0, 0.0),
    "%": ((0, 0, 0, 0, 0, 0, 0), 0.01, 0.0),
    "s": ((0, 0, 1, 0, 0, 0, 0), 1.0, 0.0),
    "ms": ((0, 0, 1, 0, 0, 0, 0), 1e-3, 0.0),
    "min": ((0, 0, 1, 0, 0, 0, 0), 60.0, 0.0),
    "h": ((0, 0, 1, 0, 0, 0, 0), 3600.0, 0.0),
    "day": ((0, 0, 1, 0, 0, 0, 0), 86400.0, 0.0),
    "Hz": ((0, 0, -1, 0, 0, 0, 0), 1.0, 0.0),
    "K": ((0, 0, 0, 0, 1, 0, 0), 1.0, 0.0),
    "degC": ((0, 0, 0, 0, 1, 0, 0), 1.0, 273.15),
    "m": ((1, 0, 0, 0, 0, 0, 0), 1.0, 0.0),
    "mm": ((1, 0, 0, 0, 0, 0, 0), 1e-3, 0.0),
    "cm": ((1, 0, 0, 0, 0, 0, 0), 1e-2, 0.0),
    "um": ((1, 0, 0, 0, 0, 0, 0), 1e-6, 0.0),
    "l": ((3, 0, 0, 0, 0, 0, 0), 1e-3, 0.0),
    "Pa": ((-1, 1, -2, 0, 0, 0, 0), 1.0, 0.0),
    "bar": ((-1, 1, -2, 0, 0, 0, 0), 1e5, 0.0),
    "kPa": ((-1, 1, -2, 0, 0, 0, 0), 1e3, 0.0),
    "MPa": ((-1, 1, -2, 0, 0, 0, 0), 1e6, 0.0),
    "cSt": ((2, 0, -1, 0, 0, 0, 0), 1e-6, 0.0),
    "N": ((1, 1, -2, 0, 0, 0, 0), 1.0, 0.0),
    "V": ((2, 1, -3, -1, 0, 0, 0), 1.0, 0.0),
    "A": ((0, 0, 0, 1, 0, 0, 0), 1.0, 0.0),
    "W": ((2, 1, -3, 0, 0, 0, 0), 1.0, 0.0),
    "kW": ((2, 1, -3, 0, 0, 0, 0), 1e3, 0.0),
    "J": ((2, 1, -2, 0, 0, 0, 0), 1.0, 0.0),
    "kJ": ((2, 1, -2, 0, 0, 0, 0), 1e3, 0.0),
    "kg": ((0, 1, 0, 0, 0, 0, 0), 1.0, 0.0),
}
# likewise, for units in which dimensions are written; they are not suggested for misspelt names
_ELECTRICAL: Mapping[str, tuple[tuple[int, ...], float, float]] = {
    "ohm": ((2, 1, -3, -2, 0, 0, 0), 1.0, 0.0),
    "H": ((2, 1, -2, -2, 0, 0, 0), 1.0, 0.0),
    "F": ((-2, -1, 4, 2, 0, 0, 0), 1.0, 0.0),
    "C": ((0, 0, 1, 1, 0, 0, 0), 1.0, 0.0),
}


@lru_cache(maxsize=512)
def parse_unit(text: str) -> Unit:
    """The unit given by `text`: names, integer powers, ``*``, ``/`` and parentheses.

    Only single names are passed to pint; the grammar around them is parsed here, so that a unit in a file
    can never be anything but a unit.

    Raises
    ------
    RigctlError
        the text is not a unit; the nearest one is named.
    """
    if len(text) > _LONGEST:
        raise _unknown_unit(text)
    spelt = _plain_spelling(text)
    tokens = _TOKEN.findall(spelt)
    if "".join(tokens) != "".join(spelt.split()):
        raise _unknown_unit(text)
    if not tokens:
        return replace(_name_to_unit("1"), text="")
    if tokens[0] == "(" and tokens[-1] == ")" and len(tokens) == 3:
        tokens = tokens[1:-1]  # '(degC)' is a scale too
    factor, dimension, rest = _read_product(tokens, text)
    if rest:
        raise _unknown_unit(text)
    if len(tokens) == 1:
        return Unit(text, dimension, factor, _name_to_unit(tokens[0]).offset)
    if dimension == _name_to_unit("K").dimension and any(map(_on_scale, tokens)):
        raise _unknown_unit(text)  # '1*degC': a point on the scale, or an interval
    return Unit(text, dimension, factor, 0.0)


def interval_unit(unit: str) -> str:
    """The unit of a difference of two values in `unit`: ``K`` for ``degC``, otherwise the unit itself."""
    return "K" if parse_unit(unit).absolute_temperature else unit


def _on_scale(token: str) -> bool:
    """Whether a token names a temperature scale with an offset."""
    return _is_name(token) and _name_to_unit(token).offset != 0.0


def _plain_spelling(text: str) -> str:
    """The unit as spelt in the grammar: ``N·m²`` is ``N*m^2``, ``Nm`` is ``N*m``, ``U/min`` is ``rpm``."""
    text = _WHOLE.get(text.strip(), text)
    text = _RAISED.sub(lambda match: "^" + match.group().translate(_LOWERED), text.translate(_SIGNS))
    return "".join(SPELLINGS.get(part, part) for part in _WORD.split(text))


def _read_product(tokens: list[str], text: str) -> tuple[float, Dimension, list[str]]:
    """``power (('*' | '/') power)*``"""
    factor, dimension, rest = _read_power(tokens, text)
    while rest and rest[0] in "*/":
        other_factor, other_dimension, after = _read_power(rest[1:], text)
        if rest[0] == "*":
            factor, dimension = factor * other_factor, dimension * other_dimension
        else:
            factor, dimension = factor / other_factor, dimension / other_dimension
        rest = after
    return factor, dimension, rest


def _read_power(tokens: list[str], text: str) -> tuple[float, Dimension, list[str]]:
    """``(name | '(' product ')') [('^' | '**') integer]``"""
    if not tokens or tokens[0] in ("*", "/", "^", "**", ")"):
        raise _unknown_unit(text)
    if tokens[0] == "(":
        factor, dimension, rest = _read_product(tokens[1:], text)
        if not rest or rest[0] != ")":
            raise _unknown_unit(text)
        rest = rest[1:]
    else:
        unit = _name_to_unit(tokens[0])
        factor, dimension, rest = unit.factor, unit.dimension, tokens[1:]
    if rest and rest[0] in ("^", "**"):
        if len(rest) < 2 or not re.fullmatch(r"-?[1-9]", rest[1]):
            raise _unknown_unit(text)
        power = int(rest[1])
        factor, dimension, rest = factor**power, dimension**power, rest[2:]
    return factor, dimension, rest


@lru_cache(maxsize=512)
def _name_to_unit(name: str) -> Unit:
    common = _COMMON.get(name) or _ELECTRICAL.get(name)
    if common:
        exponents, factor, offset = common
        return Unit(name, Dimension(tuple(Fraction(e) for e in exponents)), factor, offset)
    import pint

    if not _is_name(name):
        raise _unknown_unit(name)
    units = registry()
    try:
        parsed = units.parse_units(name.replace("°", "deg"))
        zero = float(units.Quantity(0.0, parsed).to_base_units().magnitude)
        one = float(units.Quantity(1.0, parsed).to_base_units().magnitude)
    except (pint.errors.PintError, AttributeError, ValueError, TypeError) as problem:
        raise _unknown_unit(name) from problem
    return Unit(name, _dimension(dict(parsed.dimensionality)), one - zero, zero)


def _is_name(token: str) -> bool:
    return re.fullmatch(r"[^\W\d]\w*|%|°[CF]", token) is not None


def find_unit(text: str) -> Unit | None:
    """The unit given by `text`; None if it is not one."""
    try:
        return parse_unit(text)
    except RigctlError:
        return None


def is_speed_of_rotation(text: str) -> bool:
    """Whether a unit is an angle per time: rad/s, rpm or deg/s; 1/s is ambiguous.

    Raises
    ------
    RigctlError
        the unit is unknown.
    """
    per_time = parse_unit(text).dimension == parse_unit("Hz").dimension
    return per_time and not _ANGLES.isdisjoint(_TOKEN.findall(_plain_spelling(text)))


def is_angle(text: str) -> bool:
    """Whether a unit is one of an angle: rad or deg; a plain number, a share or a count is none.

    Raises
    ------
    RigctlError
        the unit is unknown.
    """
    plain = parse_unit(text).dimension.dimensionless
    return plain and not _ANGLES.isdisjoint(_TOKEN.findall(_plain_spelling(text)))


def _unknown_unit(text: str) -> RigctlError:
    listed = {unit for units in UNITS_OF.values() for unit in units}
    known = list(dict.fromkeys((*_COMMON, *listed, "percent")))
    usual = (*_COMMON, "m/s", "m^3/s", "l/min", "mm^2", "cm^3", "N*s/m", "degF", "rpm", "ohm")
    same = [name for name in known if name.casefold() == text.strip().casefold()]
    return RigctlError(
        "unknown unit",
        value=text,
        expected="a unit such as bar, degC, l/min or N*s/m",
        nearest=same[0] if same else nearest_name(text, usual) or nearest_name(text, known),
    )


def _dimension(powers: Mapping[str, Any]) -> Dimension:
    names = {f"[{name}]": index for index, name in enumerate(BASE)}
    exponents = [Fraction(0)] * len(BASE)
    for name, power in powers.items():
        exponents[names[str(name)]] = Fraction(power).limit_denominator(64)
    return Dimension(tuple(exponents))


@dataclass(frozen=True)
class Quantity:
    """A number as written by a user, with its unit."""

    value: float
    unit: Unit

    @property
    def si(self) -> float:
        """The value in SI; a temperature is absolute."""
        return self.unit.to_si(self.value)

    def __str__(self) -> str:
        return f"{self.value:g} {self.unit.text}".strip()


def parse_quantity(text: str | float) -> Quantity:
    """Read ``30 bar``, ``-0.5 K`` or a plain number.

    Raises
    ------
    RigctlError
        there is no number, it is not finite, or the unit is unknown.
    """
    match = _QUANTITY.match(str(text))
    if not match:
        raise RigctlError("not a quantity", value=str(text), expected="a number with its unit, e.g. '30 bar'")
    value = float(match.group(1))
    if not math.isfinite(value):
        raise RigctlError("not a finite number", value=str(text))
    return Quantity(value, parse_unit(match.group(2)))


def read_si(text: str | float | Quantity, unit: str, *, difference: bool = False) -> float:
    """The SI value of a quantity, or of its text, which must have the dimension of `unit`.

    With `difference`, a temperature is an interval: ``0.5 degC`` and ``0.5 K`` are both 0.5.

    Raises
    ------
    RigctlError
        the text is not a quantity, its unit is missing, or it has another dimension.
    """
    quantity = text if isinstance(text, Quantity) else parse_quantity(text)
    wanted = parse_unit(unit)
    if quantity.unit.dimension != wanted.dimension:
        missing = quantity.unit.text == ""
        raise RigctlError(
            "the unit is missing" if missing else "wrong dimension",
            value=str(text),
            expected=describe(unit, difference=difference),
        )
    return quantity.unit.to_si(quantity.value, difference=difference)


def onto_bound(value: float, low: float, high: float) -> float:
    """`value`, moved to the bound if it exceeds it only by the rounding of a conversion.

    ``0.06 l/min`` is 1e-6 m^3/s, but not in the last bit.
    """
    for bound in (low, high):
        if math.isclose(value, bound, rel_tol=1e-12):
            return bound
    return value


def describe(unit: str, *, difference: bool = False) -> str:
    """The name of a quantity of the dimension of `unit` in a message."""
    dimension = parse_unit(unit).dimension
    return describe_dimension(dimension, difference=difference, otherwise=f"a quantity in {unit}")


def describe_dimension(
    dimension: Dimension, *, difference: bool = False, otherwise: str | None = None
) -> str:
    """The name of a quantity of this dimension in a message; a product of base units if it has none."""
    if difference and str(dimension) == "K":
        return "a temperature difference, e.g. '0.5 K'"
    for unit, words in _NAMED.items():
        if parse_unit(unit).dimension == dimension:
            return words
    return otherwise or f"a quantity in {dimension}"


def convert(value: float, from_unit: str, to_unit: str, *, difference: bool = False) -> float:
    """Convert between two units of one dimension; an absolute temperature unless `difference`."""
    source, target = parse_unit(from_unit), parse_unit(to_unit)
    if source.dimension != target.dimension:
        raise RigctlError(f"cannot convert {from_unit} to {to_unit}", expected=f"a unit like {from_unit}")
    return target.from_si(source.to_si(value, difference=difference), difference=difference)


#: values of this order and beyond are written with a power of ten
_SMALL, _LARGE = -4, 6


def significant(value: float, digits: int = 4, *, sign: bool = False) -> str:
    """A value in significant digits: ``2090`` rather than ``2.09e+03``, with a power of ten only from 1e6
    upwards and below 1e-4; with `sign`, a positive value has a plus sign.
    """
    value += 0.0  # no negative zero
    text = f"{value:+.{digits}g}" if sign else f"{value:.{digits}g}"
    if "e+" not in text or abs(rounded := float(text)) >= 10.0**_LARGE:
        return text
    return f"{rounded:+.0f}" if sign else f"{rounded:.0f}"


def show(si: float, unit: str, *, difference: bool = False, digits: int = 4) -> str:
    """An SI value as text in a unit, e.g. ``show(3e6, 'bar')`` is ``30 bar``.

    An interval on a scale with an offset is shown in kelvin: ``0.5 degC`` would read as a point on it.
    """
    if difference:
        unit = interval_unit(unit)
    value = parse_unit(unit).from_si(si, difference=difference)
    text = significant(value, digits)
    return f"{text} {unit}" if unit != "1" else text


def known_digits(value: float, std: float) -> tuple[str, str]:
    """A value and its standard deviation in significant digits: ``("0.00463", "0.00017")``.

    The standard deviation has two digits, and the value ends at the same decimal place. Very small and large
    ones have a common power of ten: ``("1.032e-14", "0.014e-14")``. Without a finite, positive standard
    deviation the value has four digits, and "" is returned as its standard deviation.

    Source: JCGM 100 (GUM), 7.2.6.
    """
    if not (math.isfinite(value) and math.isfinite(std) and std > 0.0):
        return significant(value), ""
    last = math.floor(math.log10(float(f"{std:.1e}"))) - 1  # the power of ten of the last digit
    order = max(math.floor(math.log10(abs(value))) if value else last, last + 1)
    if _SMALL < order < _LARGE:
        return tuple(f"{round(one, -last):.{max(-last, 0)}f}" for one in (value, std))  # type: ignore[return-value]
    digits = order - last
    value_text, std_text = (f"{one / 10.0**order:.{digits}f}e{order:+03d}" for one in (value, std))
    return value_text, std_text


def with_uncertainty(value: float, std: float, unit: str = "1") -> str:
    """``0.00463 ± 0.00017 m``, ``(1.032 ± 0.014)e-14 m^3``; without a standard deviation the value alone."""
    shown, spread = known_digits(value, std)
    unit_text = "" if unit == "1" else f" {unit}"
    if not spread:
        return f"{shown}{unit_text}"
    head, mark, power = shown.partition("e")
    if mark:
        return f"({head} ± {spread.partition('e')[0]})e{power}{unit_text}"
    return f"{shown} ± {spread}{unit_text}"
