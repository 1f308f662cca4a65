"""How a family of models is declared: variables, parameters, equations, and the slots that effects use.

A family is data. Its equations are small functions of a `Scope`, which hands out variables by name; an
effect adds a term to one of the family's slots and touches nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

from rigctl.engine.symbols import Scalar
from rigctl.errors import unknown_name
from rigctl.notebook import one_line
from rigctl.physics.standard_record import StandardRecord

if TYPE_CHECKING:
    from rigctl.physics.interpolation import Curve
    from rigctl.physics.scope import Scope

#: an equation: variables of a scope in, a value out
Formula: TypeAlias = "Callable[[Scope], Scalar]"


@dataclass(frozen=True)
class StateVariable:
    """A quantity with a derivative.

    Attributes
    ----------
    unit: in SI.
    scale: a change of it that matters, for the solver's absolute tolerance.
    rate: its derivative.
    start: its value at the start of a record when nothing else is known.
    difference: a temperature that is an interval.
    start_std: how far records begin from `start`, one standard deviation; 0 where they all begin there.
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

    `hold` says what it does between two of its values: ``previous`` keeps the last one, ``linear`` is a
    straight line; None leaves it to where the values come from: commands hold, measured channels are lines.
    `value` is what it has when nobody says (SI); with `implied` it goes without saying, as that a pump runs.
    With `delay`, its switches act later: a formula of the scope and of the commanded values before and after,
    in s. `role` is the rig's role whose actuator commands it. `shown` is the unit that its author writes.
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
    unit: what it is shown in, e.g. mm^2; `value`, `low` and `high` are SI.
    fixed: never fitted, a number of the compiled equations (a bore, say).
    """

    name: str
    unit: str
    value: float
    meaning: str
    low: float = 0.0
    high: float = float("inf")
    fixed: bool = False


@dataclass(frozen=True)
class Definition:
    """An algebraic variable: a formula with a name and a unit (SI).

    `difference`: a temperature that is an interval.
    """

    name: str
    unit: str
    formula: Formula
    meaning: str
    difference: bool = False


@dataclass(frozen=True)
class Slot:
    """A named place of the equations where effects add terms, or factors.

    Attributes
    ----------
    unit: of a term, in SI; a factor has "1".
    combine: "sum" adds the terms to the base, "product" multiplies it.
    kind: of the process, of a sensor, or of the time at which a command acts.
    local: names that a term at this slot may use besides the family's variables.
    shown: the unit that the author of the family writes; that of an interval, so never degC.
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
    """An output: `formula` of a sensor's reading with its unit (SI); `shown` as of an input."""

    name: str
    unit: str
    formula: Formula
    meaning: str
    shown: str = ""


@dataclass(frozen=True)
class ModelFamily:
    """States, inputs, parameters, equations and slots of one kind of bench.

    Attributes
    ----------
    options: the variants of the equations, each with its choices; the first is the default.
    rig_names: the parameters that a name of a rig file stands for, where it is not their own.
    standard_record: what effects are tried and drawn on.
    tables: look-up tables, for `Scope.table`.
    generic: effects that may be missing in any bench are offered at its slots; the shipped families have
        effects of their own instead.
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
    tables: Mapping[str, Curve] = field(default_factory=dict)
    generic: bool = True

    def __repr__(self) -> str:
        """One-line representation."""
        return one_line(self, f"{self.name}: {self.title}")

    def slot(self, name: str) -> Slot:
        """The slot called `name`.

        Raises
        ------
        RigctlError
            there is none; it says the nearest.
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
            there is none; it says the nearest.
        """
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise unknown_name(f"parameter of {self.name}", name, [p.name for p in self.parameters])

    def units(self) -> dict[str, str]:
        """The SI unit of every variable that a formula may use, by name."""
        from rigctl.physics.units import si_unit

        named: tuple[StateVariable | InputVariable | Definition, ...]
        named = (*self.states, *self.inputs, *self.definitions)
        return {item.name: item.unit for item in named} | {p.name: si_unit(p.unit) for p in self.parameters}
