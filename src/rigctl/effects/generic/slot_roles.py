"""Where family-independent effects may act in a family, derived from its equations.

In: a family. Out: for each slot its role, which is what `balance`, `sensor`, `actuator` and `parameter` need
in order to write effects there: the rate of one state (with the direction and the gain of a term), a reading,
an input, the time of its switches, or a parameter of a program; or the reason why none can act. Each slot is
traced through the equations by a variable in its place, so that a family of a user's gets a library without
declaring what its slots mean.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias, cast

from rigctl.engine.symbols import Expr, Graph, Scalar, derivative, evaluate, variables_of
from rigctl.engine.system import after, before
from rigctl.errors import RigctlError
from rigctl.physics.derived_slots import input_slot, kinematics, parameter_slot, rate_slot
from rigctl.physics.family import (
    InputVariable,
    ModelFamily,
    OutputVariable,
    ParameterDeclaration,
    Slot,
    StateVariable,
)
from rigctl.physics.scope import Addition, Scope
from rigctl.physics.si_unit import si_unit
from rigctl.units import is_speed_of_rotation, parse_unit, show

#: parts of a name that mark a variable as the surroundings of others
_SURROUNDINGS = frozenset(
    ("ambient", "room", "environment", "surroundings", "outside", "atmosphere", "atmospheric", "reference")
)
#: quantities with zero far outside a bench's range: measured relative to their surroundings or start
_FAR_FROM_ZERO = ("K", "Pa")


@dataclass(frozen=True)
class Balance:
    """A slot that adds to the rate of one state.

    Attributes
    ----------
    label: used in the names of effects there: the state for a derived slot, else the slot.
    direction: 1 if a term raises the rate, -1 if it lowers it (a drag, an outflow).
    gain: change of the rate per unit of the term, SI, always positive.
    moves: the state is a speed.
    position: the state that is its integral, if there is one.
    surroundings: the variable from which the state is measured; None for `reference`.
    reference: the value from which it is measured, SI.
    """

    slot: Slot
    label: str
    state: StateVariable
    direction: float
    gain: float
    moves: bool
    position: str | None
    surroundings: str | None
    reference: float


@dataclass(frozen=True)
class Reading:
    """A slot that adds to a reading, or is subtracted from it.

    Attributes
    ----------
    label: used in the names of effects there: the output, or a slot that is not a sensor's.
    direction: 1 if a term raises the reading, -1 if it lowers it.
    slopes: of the reading, by the states that it reads.
    inputs: on which it may depend if it reads no state: for a bench without time.
    reference: the value from which it is measured, SI.
    """

    slot: Slot
    label: str
    output: OutputVariable
    direction: float
    slopes: Mapping[str, float]
    inputs: tuple[str, ...]
    reference: float

    def truth(self, m: Scope) -> Scalar:
        """The reading without effects at this slot."""
        return self.output.formula(cast("Scope", _Without(m, self.slot.name)))

    def rate(self, m: Scope) -> Scalar:
        """The derivative of the true value: ``Σ ∂z/∂s·ds/dt``; jumps of inputs are left out.

        Raises
        ------
        RigctlError
            `m` holds plain numbers.
        """
        value = self.truth(m)
        if not isinstance(value, Expr):
            raise RigctlError(f"the rate of {self.output.name} needs symbols, not numbers")
        total: Scalar = 0.0
        for state in self.slopes:
            variable = m[state]
            assert isinstance(variable, Expr)  # noqa: S101 - as the value is
            total = total + derivative(value, variable) * m.rate(state)
        return total


class _Without:
    """A scope in which nothing is added at one slot."""

    def __init__(self, scope: Scope, slot: str) -> None:
        self._scope = scope
        self._slot = slot

    def total(self, slot: str, **local: Scalar) -> Scalar:
        return 0.0 if slot == self._slot else self._scope.total(slot, **local)

    def __getitem__(self, name: str) -> Scalar:
        return self._scope[name]

    def __getattr__(self, name: str) -> object:
        return getattr(self._scope, name)


@dataclass(frozen=True)
class Given:
    """A derived slot that adds to an input; `surroundings` if it is the environment rather than a command."""

    slot: Slot
    input: InputVariable
    surroundings: bool


@dataclass(frozen=True)
class Late:
    """A slot that delays the switches of an input."""

    slot: Slot
    input: InputVariable


@dataclass(frozen=True)
class OfProgram:
    """A slot that adds to a parameter of the program that computes the family's states.

    Attributes
    ----------
    size: a change of the parameter that matters, SI.
    tunable: it can change during a simulation; one that cannot has its mean over each record.
    """

    slot: Slot
    parameter: ParameterDeclaration
    size: float
    tunable: bool


@dataclass(frozen=True)
class UnusableSlot:
    """A slot where no generic effect can act, and why."""

    slot: Slot
    why: str


Role: TypeAlias = Balance | Reading | Given | Late | OfProgram | UnusableSlot


def slot_roles(family: ModelFamily) -> tuple[Role, ...]:
    """The role of each slot of `family`, in the family's order.

    Raises
    ------
    RigctlError
        an equation has the wrong dimension.
    """
    probed = _Probed(family)
    return tuple(probed.role(slot) for slot in family.slots)


class _Probed:
    """The equations of a family with a variable at every slot."""

    def __init__(self, family: ModelFamily) -> None:
        self.family = family
        self.graph = Graph()
        known = self._variables()
        self.surroundings = {name: known[name] for name in known if _SURROUNDINGS & set(name.split("_"))}
        # Each slot adds a variable of its own, the probe. Wherever the finished equations contain that
        # variable, the slot acts; nobody has to declare it.
        scope = Scope(family, known, additions=[self._probe(slot) for slot in family.slots])
        self.rates = {state.name: self.graph.expression(scope.rate(state.name)) for state in family.states}
        self.readings = {
            output.name: self.graph.expression(output.formula(scope)) for output in family.outputs
        }
        self.delays = {
            item.name: self.graph.expression(item.delay(scope, *self._switch(item)))
            for item in family.inputs
            if item.delay is not None
        }
        defined = {item.name: self.graph.expression(scope[item.name]) for item in family.definitions}
        #: slots that act within a definition
        self.inside = {
            slot.name
            for slot in family.slots
            if any(self._of(slot) in variables_of(expr) for expr in defined.values())
        }
        self.positions = {speed: position for position, speed in kinematics(family).items()}
        self.at = self._point()

    def _variables(self) -> dict[str, Scalar]:
        family = self.family
        units = {state.name: state.unit for state in family.states}
        units |= {item.name: item.unit for item in family.inputs}
        units |= {parameter.name: si_unit(parameter.unit) for parameter in family.parameters}
        return {name: self.graph.variable(name, parse_unit(unit).dimension) for name, unit in units.items()}

    def _switch(self, item: InputVariable) -> tuple[Expr, Expr]:
        dimension = parse_unit(item.unit).dimension
        return (
            self.graph.variable(before(item.name), dimension),
            self.graph.variable(after(item.name), dimension),
        )

    def _probe(self, slot: Slot) -> Addition:
        return Addition(slot.name, "a probe", lambda m: self._of(slot))

    def _of(self, slot: Slot) -> Expr:
        return self.graph.variable(f"what is added at {slot.name}", parse_unit(slot.unit).dimension)

    def _point(self) -> dict[str, float]:
        """The point at which the equations are evaluated: slightly beside the start."""
        family = self.family
        # At the start itself a slope may vanish (of an even function, at a speed of 0), which would read as
        # "it does nothing"; half a relevant change beside it does not.
        at = {state.name: state.start + 0.5 * state.scale for state in family.states}
        at |= {item.name: item.value for item in family.inputs}
        at |= {parameter.name: parameter.value for parameter in family.parameters}
        for item in family.inputs:
            at |= {before(item.name): 0.0, after(item.name): 1.0}
        for slot in family.slots:
            at[f"what is added at {slot.name}"] = 0.0 if slot.combine == "sum" else 1.0
        return at

    def role(self, slot: Slot) -> Role:
        # The order of the cases decides: by what the slot declares of itself (a factor, a delay of commands),
        # then by its name (a derived slot of an input enters every equation that uses the input), and only
        # then by the equations that contain its probe.
        probe = self._of(slot)
        states = [name for name, rate in self.rates.items() if probe in variables_of(rate)]
        if slot.combine == "product":
            return UnusableSlot(slot, "a factor has no dimension that would say what it may depend on")
        if slot.kind == "command":
            late = [
                item
                for item in self.family.inputs
                if probe in variables_of(self.delays.get(item.name, probe))
            ]
            delayed = [item for item in late if item.name in self.delays]
            return Late(slot, delayed[0]) if delayed else UnusableSlot(slot, "it delays no input")
        named = self._by_name(slot)
        if named is not None:
            return named
        read = [output for output in self.family.outputs if probe in variables_of(self.readings[output.name])]
        # A slot that is found in a reading and in a rate is not an error of the sensor: what it adds moves
        # the process.
        if read and not states:
            return self._reading(slot, read[0])
        if len(states) != 1:
            return UnusableSlot(slot, "it acts on several states" if states else "no equation uses it")
        return self._balance(slot, states[0])

    def _by_name(self, slot: Slot) -> Role | None:
        """The role of a derived slot of an input, or of a parameter of a program."""
        for item in self.family.inputs:
            if input_slot(item.name) == slot.name:
                return Given(slot, item, item.name in self.surroundings)
        program = self.family.program
        if program is None:
            return None
        for one in self.family.parameters:
            if parameter_slot(one.name) == slot.name:
                return OfProgram(slot, one, program.sizes[one.name], one.name in program.tunable)
        return None

    def _balance(self, slot: Slot, name: str) -> Role:
        # d(ds/dt)/dw. Its sign tells a force from a drag, an inflow from an outflow; its size, e.g. 1/mass or
        # 1/capacity, converts the typical rate of the state into a typical size of the term.
        slope = evaluate(derivative(self.rates[name], self._of(slot)), self.at)
        if not slope or not math.isfinite(slope):
            return UnusableSlot(slot, "it does nothing where the family starts")
        state = {state.name: state for state in self.family.states}[name]
        # 1/s may be a rate of growth; it is a rotation if it is the rate of a position, or written in rad/s
        moves = name in self.positions or _is_one_of(state.unit, ("m/s",)) or is_speed_of_rotation(state.unit)
        around, reference = self._counted_from(state)
        return Balance(
            slot,
            name if slot.name == rate_slot(name) else slot.name,
            state,
            1.0 if slope > 0.0 else -1.0,
            abs(slope),
            moves,
            self.positions.get(name),
            None if moves else around,
            0.0 if moves else reference,
        )

    def _reading(self, slot: Slot, output: OutputVariable) -> Role:
        expr, probe = self.readings[output.name], self._of(slot)
        slope = derivative(expr, probe)
        # Effects of a sensor are written for z = g(x) + w. With any other slope, or inside a definition that
        # other equations share, their sizes would not be those of the reading.
        if not slope.constant or abs(float(slope.value)) != 1.0 or slot.name in self.inside:
            return UnusableSlot(slot, f"it is not simply added to the reading {output.name}")
        same = self._offered(output)
        if slot.name != same:
            # each would be an argument of the other's effects, and no data could distinguish the two
            return UnusableSlot(
                slot, f"it adds to the reading {output.name} as {same} does, where effects act"
            )
        variables = {variable.name: variable for variable in variables_of(expr)}
        slopes = {
            state.name: self._finite(derivative(expr, variables[state.name]))
            for state in self.family.states
            if state.name in variables
        }
        return Reading(
            slot,
            output.name if slot.kind == "sensor" else slot.name,
            output,
            float(slope.value),
            slopes,
            () if slopes else self._settings(variables),
            self._finite(expr) if _is_one_of(output.unit, _FAR_FROM_ZERO) else 0.0,
        )

    def _offered(self, output: OutputVariable) -> str:
        """The slot at which effects act on a reading that has several: a sensor's, else the first."""
        expr = self.readings[output.name]
        added = [
            slot
            for slot in self.family.slots
            if slot.name not in self.inside
            and not any(self._of(slot) in variables_of(rate) for rate in self.rates.values())
            and (slope := derivative(expr, self._of(slot))).constant
            and abs(float(slope.value)) == 1.0
        ]
        return next((slot.name for slot in added if slot.kind == "sensor"), added[0].name)

    def _settings(self, variables: Collection[str]) -> tuple[str, ...]:
        """The inputs on which a reading may depend: those in its equation; all for a bench without time."""
        return tuple(
            item.name for item in self.family.inputs if item.name in variables or not self.family.states
        )

    def _finite(self, expr: Expr) -> float:
        """Its value at the family's start; 0 if it has none there."""
        value = evaluate(expr, self.at)
        return value if math.isfinite(value) else 0.0

    def _counted_from(self, state: StateVariable) -> tuple[str | None, float]:
        dimension = parse_unit(state.unit).dimension
        for name, variable in self.surroundings.items():
            if isinstance(variable, Expr) and variable.declared == dimension:
                return name, self.at[name]
        return None, state.start if _is_one_of(state.unit, _FAR_FROM_ZERO) and not state.difference else 0.0


def is_point_on_scale(item: InputVariable) -> bool:
    """Whether an input is an absolute temperature, whose zero is far outside any bench's range."""
    return _is_one_of(item.unit, ("K",)) and not item.difference


def is_speed(item: InputVariable) -> bool:
    """Whether an input is a speed, along a path or around an axis."""
    return _is_one_of(item.unit, ("m/s",)) or is_speed_of_rotation(item.unit)


def point_of_reference(item: InputVariable) -> float | None:
    """The reference of shares of an input, SI: for an absolute temperature its default value, not 0 K."""
    return item.value if is_point_on_scale(item) and item.value else None


def counted_from(name: str, reference: float | None) -> str:
    """An input as written in equations: ``(bath − 20 degC)``, or its name alone."""
    return name if reference is None else f"({name} − {show(reference, 'degC')})"


def _is_one_of(unit: str, units: Sequence[str]) -> bool:
    dimension = parse_unit(unit).dimension
    return any(parse_unit(other).dimension == dimension for other in units)
