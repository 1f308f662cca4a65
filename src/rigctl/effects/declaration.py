"""The declaration of an effect: terms at slots of a model, and parameters whose null values switch it off.

An effect is data: it comes from a shipped library, from the generic laws, or from a user's file, and is
written into equations, listed and documented the same way. Its formulas take a scope `m` (the model's
variables) and `p` (the effect's own parameters and states) and return a term; at the null values every term
is exactly 0, or exactly 1 if the slot multiplies. A model without the effect is then the same equations at
that point, in whose neighbourhood a diagnosis linearises.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

from rigctl.effects.validity import Provenance, ValidRange
from rigctl.engine.symbols import Scalar
from rigctl.errors import unknown_name
from rigctl.notebook import one_line
from rigctl.physics.families import find_family
from rigctl.physics.family import Formula, ModelFamily
from rigctl.physics.scope import Addition, Scope

if TYPE_CHECKING:
    from rigctl.effects.measured_curve import MeasuredCurve


class Own:
    """An effect's parameters and states by attribute, ``p.conductance``, or by name, ``p["side_1"]``."""

    def __init__(self, scope: Scope, effect: str) -> None:
        self._scope = scope
        self._effect = effect

    def __getattr__(self, name: str) -> Scalar:
        return self[name]

    def __getitem__(self, name: str) -> Scalar:
        return self._scope[qualified(self._effect, name)]


#: which of a parameter's bounds are physical; the others are limits of the usual range
Ends: TypeAlias = Literal["none", "low", "high", "both"]

#: factor, relative to the null value, by which a search goes beyond a limit of the usual range
_BEYOND = 10.0

#: a term of an effect: a function of the model's variables, and of the effect's parameters and states
Term: TypeAlias = Callable[[Scope, Own], Scalar]


#: names under which unknowns that are no effects are declared: of records, calibrations and clocks
NOT_EFFECTS = ("record", "calibration", "clock")


def qualified(effect: str, name: str) -> str:
    """The name of an effect's parameter or state in a system: ``piston_leakage.conductance``."""
    return f"{effect}.{name}"


@dataclass(frozen=True)
class EffectParameter:
    """A parameter of an effect, SI; `unit` is the one in which it is shown.

    Attributes
    ----------
    null: the value that switches the effect off; None for a shape parameter (a width, for example), which has
        no effect alone.
    start: a typical size, at which a fit starts.
    low, high: bounds; if null is one of them, the effect can have only one sign.
    difference: a temperature difference.
    grid: values at which a diagnosis evaluates the effect, SI: for a shape, in addition to `start`; for
        a parameter with a threshold, instead of its null, at which the slope contains no information.
    within, shares: for a shape, the quantity of which it is a value, named as in
        `rigctl.analysis.linear.candidates`, and the shares of the range of that quantity at which a diagnosis
        tries it, instead of `grid`.
    refined: a shape that a diagnosis also fits, once the effect is in the model.
    physical: the bounds beyond which a value is physically impossible: a share above one, a negative mass.
        The others are limits of the usual range, and a diagnosis also searches beyond them. By default only
        the null value, if it is one of the bounds, is physical.
    at_least: another parameter of the effect that is a physical lower limit of this one.
    """

    name: str
    unit: str
    null: float | None
    start: float
    low: float
    high: float
    meaning: str
    difference: bool = False
    grid: tuple[float, ...] = ()
    within: str = ""
    shares: tuple[float, ...] = ()
    refined: bool = False
    physical: Ends | None = None
    at_least: str | None = None

    @property
    def usual(self) -> tuple[bool, bool]:
        """Whether the lower and the upper bound are only limits of the usual range."""
        if self.physical is None:
            return self.low != self.null, self.high != self.null
        return self.physical in ("none", "high"), self.physical in ("none", "low")

    @property
    def widest(self) -> tuple[float, float]:
        """The bounds, with limits of the usual range ten times as far from the null value.

        A lower bound above zero, of a width or a time constant, becomes a tenth of itself instead.
        """
        low_usual, high_usual = self.usual
        below = self.low / _BEYOND if self.low > 0.0 else self._further(self.low)
        return (below if low_usual else self.low, self._further(self.high) if high_usual else self.high)

    def _further(self, bound: float) -> float:
        return self.at_null + _BEYOND * (bound - self.at_null)

    def unusual(self, value: float) -> bool:
        """True if a value is outside the bounds."""
        return not self.low <= value <= self.high

    def bounds_around(self, value: float) -> tuple[float, float]:
        """The bounds, or the widest ones for a value outside."""
        return self.widest if self.unusual(value) else (self.low, self.high)

    @property
    def shape(self) -> bool:
        """True if it only affects the shape of a term that another parameter switches on."""
        return self.null is None

    @property
    def at_null(self) -> float:
        """Its value in a model in which the effect is off."""
        return self.start if self.null is None else self.null

    @property
    def sign(self) -> Literal[-1, 0, 1]:
        """1 or -1 if only one sign is physically possible, 0 if both are."""
        if self.null is None:
            return 0
        return 1 if self.null <= self.low else -1 if self.null >= self.high else 0


@dataclass(frozen=True)
class ParameterAlternative:
    """An alternative way to write a parameter, e.g. a leakage's gap instead of its conductance.

    `value_of` maps the SI value written and the family's parameters (SI) to that of `parameter`.
    """

    name: str
    unit: str
    parameter: str
    value_of: Callable[[float, Mapping[str, float]], float]
    meaning: str


@dataclass(frozen=True)
class EffectState:
    """A state added by an effect; SI, `scale` as for the family's."""

    name: str
    unit: str
    scale: float
    rate: Term
    meaning: str
    start: float = 0.0


@dataclass(frozen=True)
class Effect:
    """A piece of physics that a model may lack or have.

    Attributes
    ----------
    name: in snake case, unique within its family.
    family: the model family it belongs to.
    summary: one sentence.
    equation: in readable form.
    terms: slot and formula; most effects have one.
    kind: of the process, or of a sensor.
    looks_like: its appearance in the recorded data.
    confused_with: effects with nearly the same signature.
    instead_of: alternatives for the same physics: a model has at most one of them.
    needs: what the data must contain for the effect to be visible.
    becomes: for a law that contains another one as a limit, the parameter, its limiting value (or the
        parameter that it equals there), and the effect with that other law.
    base: for base physics: the family's parameters and the values that remove it; such an effect is in every
        model and has no terms of its own.
    own_family: the family itself if its name alone does not find it: a user's, from a file.
    valid: the ranges over which its law was learned; none for a law that holds everywhere.
    provenance: the data from which it was learned; None if it was not.
    curve: the measured curve that is its term; None for a formula.
    """

    name: str
    family: str
    summary: str
    equation: str
    source: str
    looks_like: str
    terms: tuple[tuple[str, Term], ...] = ()
    parameters: tuple[EffectParameter, ...] = ()
    states: tuple[EffectState, ...] = ()
    other_ways: tuple[ParameterAlternative, ...] = ()
    kind: Literal["process", "sensor"] = "process"
    confused_with: tuple[str, ...] = ()
    instead_of: tuple[str, ...] = ()
    needs: str | None = None
    becomes: tuple[tuple[str, float | str, str], ...] = ()
    base: Mapping[str, float] = field(default_factory=dict)
    own_family: ModelFamily | None = None
    valid: tuple[ValidRange, ...] = ()
    provenance: Provenance | None = None
    curve: MeasuredCurve | None = None

    def __repr__(self) -> str:
        """One-line representation."""
        return one_line(self, f"{self.name} of {self.family}: {self.summary}")

    @property
    def described(self) -> str:
        """The effect as a sentence of physics, with its name in brackets."""
        return f"{self.summary.rstrip('.')} ({self.name})"

    @property
    def model_family(self) -> ModelFamily:
        """The declaration of the family it belongs to.

        Raises
        ------
        RigctlError
            there is no such family.
        """
        return self.own_family or find_family(self.family)

    @property
    def slots(self) -> tuple[str, ...]:
        """The slots at which it acts, each once."""
        return tuple(dict.fromkeys(slot for slot, _ in self.terms))

    @property
    def null(self) -> dict[str, float]:
        """Its parameters where it is off, SI."""
        return {parameter.name: parameter.at_null for parameter in self.parameters}

    @property
    def start(self) -> dict[str, float]:
        """Its parameters at a typical size, SI."""
        return {parameter.name: parameter.start for parameter in self.parameters}

    def parameter(self, name: str) -> EffectParameter:
        """The parameter called `name`.

        Raises
        ------
        RigctlError
            there is none; the message gives the nearest name.
        """
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise unknown_name(f"parameter of {self.name}", name, [p.name for p in self.parameters])

    def additions(self) -> list[Addition]:
        """Its terms, for a scope that also holds its parameters and states under their `qualified` names."""
        return [Addition(slot, self.name, self.bind(term)) for slot, term in self.terms]

    def bind(self, term: Term) -> Formula:
        """A term, or a state's rate, as a formula of the scope alone."""
        return lambda m: term(m, Own(m, self.name))


def problems(effect: Effect, family: ModelFamily) -> list[str]:
    """What is wrong with a declaration, in words; empty if it is valid."""
    # First what refers to the family, then whether the effect can be switched off, then each parameter.
    faults = [f"unknown slot {slot!r}" for slot in effect.slots if slot not in {s.name for s in family.slots}]
    faults += [
        f"base parameter {name!r} is none of {family.name}"
        for name in effect.base
        if name not in {p.name for p in family.parameters}
    ]
    if bool(effect.terms) == bool(effect.base):
        faults.append("it must either add terms or be base physics")
    if effect.terms and all(parameter.shape for parameter in effect.parameters):
        faults.append("no parameter switches it off")
    for parameter in effect.parameters:
        if not (
            parameter.low <= parameter.start <= parameter.high
            and parameter.low <= parameter.at_null <= parameter.high
            and math.isfinite(parameter.low)
            and math.isfinite(parameter.high)
        ):
            faults.append(f"{parameter.name}: null and start must lie within finite bounds")
        if parameter.start == parameter.null:
            faults.append(f"{parameter.name}: start is the null value")
        if not all(parameter.low <= value <= parameter.high for value in parameter.grid):
            faults.append(f"{parameter.name}: its grid must lie within its bounds")
        if parameter.null in parameter.grid:
            faults.append(f"{parameter.name}: its grid holds the null value")
        if parameter.at_least is not None:
            faults += _wrong_order(effect, parameter)
    known = {parameter.name for parameter in effect.parameters}
    named = [name for one, at, _ in effect.becomes for name in (one, at) if isinstance(name, str)]
    faults += [f"becomes: unknown parameter {name!r}" for name in named if name not in known]
    return faults


def _wrong_order(effect: Effect, parameter: EffectParameter) -> list[str]:
    """What is wrong with the order of a parameter and its lower limit."""
    other = {one.name: one for one in effect.parameters if one is not parameter}.get(parameter.at_least or "")
    if other is None or other.shape or parameter.shape:
        return [f"{parameter.name}: at_least must name another parameter that switches the effect on"]
    if parameter.start < other.start or parameter.at_null < other.at_null:
        return [f"{parameter.name}: null and start must be at least those of {other.name}"]
    return []
