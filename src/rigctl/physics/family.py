"""The declaration of a family of models: variables, parameters, equations, and slots for effects.

A family is data, wherever it comes from: a shipped Python module, a family file, two functions of a user's,
or an FMU. Its equations are small functions of a `Scope`, which provides the variables by name, as symbols
(compiled and differentiated by the engine) or as numbers; an effect adds terms at the family's slots and
changes nothing else. That is why one model with an effect and one without it differ in that effect alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

from rigctl.engine.symbols import Scalar
from rigctl.errors import unknown_name
from rigctl.notebook import one_line
from rigctl.physics.standard_record import StandardRecord
from rigctl.physics.standing import Standing

if TYPE_CHECKING:
    from rigctl.foreign.program import Program
    from rigctl.physics.interpolation import Curve
    from rigctl.physics.scope import Scope

#: how far beyond the limits of the usual range a parameter may be, as a factor
_BEYOND = 10.0

#: an equation: a function of the variables of a scope
Formula: TypeAlias = "Callable[[Scope], Scalar]"


@dataclass(frozen=True)
class StateVariable:
    """A quantity with a derivative.

    Attributes
    ----------
    unit: in SI.
    scale: a relevant change of it, SI, for the solver's absolute tolerance.
    rate: its time derivative.
    start: its value, SI, at the start of a record if nothing else is known.
    difference: it is a temperature difference.
    start_std: standard deviation of the records' initial values about `start`, SI; 0 if all start there.
    """

    name: str
    unit: str
    scale: float
    rate: Formula
    start: float
    meaning: str
    difference: bool = False
    start_std: float = 0.0


@dataclass(frozen=True)
class InputVariable:
    """A quantity that is commanded or given from outside.

    Attributes
    ----------
    unit: in SI.
    value: its default, SI.
    delay: time in s from a switch until it acts: a formula of the scope and of the commanded values before
        and after.
    role: the rig's role whose actuator commands it.
    difference: it is a temperature difference.
    hold: its behaviour between two of its values: ``previous`` keeps the last one, ``linear`` interpolates;
        None depends on their origin: commands are held, measured channels are interpolated.
    implied: the default counts as given, for example that a pump is running.
    shown: the unit used by the author of the family.
    """

    name: str
    unit: str
    value: float
    meaning: str
    delay: Callable[[Scope, Scalar, Scalar], Scalar] | None = None
    role: Literal["move", "heat", "set_pressure"] | None = None
    difference: bool = False
    hold: Literal["previous", "linear"] | None = None
    implied: bool = False
    shown: str = ""


@dataclass(frozen=True)
class ParameterDeclaration:
    """A constant of the equations.

    Attributes
    ----------
    unit: in which it is shown, e.g. mm^2; `value`, `low` and `high` are SI.
    fixed: never fitted, but a number in the compiled equations (a bore, for example).
    usual: whether the lower and the upper bound are only limits of the usual range, which a fit may leave.
        Those that a user wrote are not.
    standing: how well `value` is known, where the family says it.
    range: of an assumed value, SI; where no fit changes the parameter, every fit lets it be anywhere in it.
    """

    name: str
    unit: str
    value: float
    meaning: str
    low: float = 0.0
    high: float = float("inf")
    fixed: bool = False
    usual: tuple[bool, bool] = (False, False)
    standing: Standing = ""
    range: tuple[float, float] | None = None

    @property
    def widest(self) -> tuple[float, float]:
        """The bounds, with limits of the usual range ten times as far out; zero stays a bound."""
        low_usual, high_usual = self.usual
        low = self.low / _BEYOND if self.low > 0.0 else _BEYOND * self.low
        high = self.high / _BEYOND if self.high < 0.0 else _BEYOND * self.high
        return (low if low_usual else self.low, high if high_usual else self.high)


@dataclass(frozen=True)
class Definition:
    """An algebraic variable: a formula with a name and a unit (SI).

    `difference`: it is a temperature difference.
    """

    name: str
    unit: str
    formula: Formula
    meaning: str
    difference: bool = False


@dataclass(frozen=True)
class Slot:
    """A named location in the equations where effects add terms or multiply by factors.

    Attributes
    ----------
    unit: of a term, in SI; "1" for a factor.
    combine: "sum" adds the terms to the equation of the family, "product" multiplies it by them.
    kind: effects there change the process, a sensor, or the time at which a command acts.
    local: (name, unit) of the variables that a term at this slot may use besides the family's.
    shown: the unit used by the author of the family; that of a difference, so never degC.
    """

    name: str
    unit: str
    meaning: str
    combine: Literal["sum", "product"] = "sum"
    kind: Literal["process", "sensor", "command"] = "process"
    local: tuple[tuple[str, str], ...] = ()
    shown: str = ""

    @property
    def shown_unit(self) -> str:
        """The unit of a term in lists of slots."""
        return self.shown or self.unit


@dataclass(frozen=True)
class OutputVariable:
    """A sensor's reading: its `formula` and its unit (SI); `shown` as for an input."""

    name: str
    unit: str
    formula: Formula
    meaning: str
    shown: str = ""


@dataclass(frozen=True)
class ModelFamily:
    """The equations of one kind of bench, ``dy/dt = f(y, u, q)``, ``z = g(y, u, q)``, with slots for effects.

    Attributes
    ----------
    source: reference of the equations.
    states, inputs, parameters: y, u and q.
    definitions: algebraic variables, for use in several equations.
    slots: at which effects act.
    outputs: z, the readings of the sensors.
    options: the variants of the equations, each with its choices; the first is the default.
    rig_names: parameters by their names in a rig file, where these differ.
    standard_record: on which effects are tried and plotted.
    single_values: the columns of a table of single values that are read from a moving record: the output,
        and the time in the standard record at which it is read, s.
    tables: look-up tables, for `Scope.table`.
    program: computes its states, which are then the program's outputs: an FMU, or a user's functions.
    generic: whether generic effects are offered at its slots; the shipped families have a library instead.
    """

    name: str
    title: str
    source: str
    states: tuple[StateVariable, ...]
    inputs: tuple[InputVariable, ...]
    parameters: tuple[ParameterDeclaration, ...]
    definitions: tuple[Definition, ...]
    slots: tuple[Slot, ...]
    outputs: tuple[OutputVariable, ...]
    options: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    rig_names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    standard_record: StandardRecord | None = None
    single_values: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    tables: Mapping[str, Curve] = field(default_factory=dict)
    generic: bool = True
    program: Program | None = None

    def __repr__(self) -> str:
        """One-line representation."""
        return one_line(self, f"{self.name}: {self.title}")

    @property
    def in_time(self) -> bool:
        """Whether its records have a time axis: it has states, or outputs that follow its inputs at once in a
        standard record. Only then can something lag, or depend on what was before."""
        return bool(self.states) or self.standard_record is not None

    def slot(self, name: str) -> Slot:
        """The slot called `name`.

        Raises
        ------
        RigctlError
            there is none; the message gives the nearest name.
        """
        for slot in self.slots:
            if slot.name == name:
                return slot
        raise unknown_name(f"slot of {self.name}", name, [slot.name for slot in self.slots])

    def parameter(self, name: str) -> ParameterDeclaration:
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

    def units(self) -> dict[str, str]:
        """The SI unit of every variable that a formula may use, by name."""
        from rigctl.physics.si_unit import si_unit

        named: tuple[StateVariable | InputVariable | Definition, ...]
        named = (*self.states, *self.inputs, *self.definitions)
        return {item.name: item.unit for item in named} | {p.name: si_unit(p.unit) for p in self.parameters}
