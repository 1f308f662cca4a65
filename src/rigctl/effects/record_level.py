"""Record-level nuisance parameters: settings, zeros, switch times and initial states that differ
unintentionally.

In: a family, and the settings or unrecorded inputs of its measurements. Out: one effect with these
quantities as parameters, their priors, and how each state's initial value is known. Such quantities are
unknowns of one record each. They act at the slots of a family as effects do, so they are declared as an
effect whose parameters belong to each record instead of the model: fits and diagnoses then differentiate
them like any other parameter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from typing import Literal

import numpy as np

from rigctl.effects.declaration import Effect, EffectParameter, Own, Term, qualified
from rigctl.engine.symbols import Scalar, constant_like, exp
from rigctl.physics.derived_slots import input_slot
from rigctl.physics.families import of_shipped
from rigctl.physics.family import ModelFamily
from rigctl.physics.scope import Scope
from rigctl.rig.rig import Rig

#: name of the effect with every family's record-level quantities
RECORD = "record"
#: its parameters for switch times known only to within a sampling interval, by kind of command
SWITCHING = ("switching_up", "switching_down", "switching_off")


@dataclass(frozen=True)
class Quantity:
    """A parameter of the record-level effect, and its prior.

    Attributes
    ----------
    parameter: of the effect.
    meaning: description.
    std: of its prior around the null, SI, from the rig.
    cancels: it is the same in both readings of a difference, for example of a stroke, and so cancels.
    """

    parameter: str
    meaning: str
    std: Callable[[Rig | None], float]
    cancels: bool = False

    @property
    def name(self) -> str:
        """The parameter's name in a system."""
        return qualified(RECORD, self.parameter)


@dataclass(frozen=True)
class Start:
    """The value of a state at the start of a record.

    Attributes
    ----------
    state: of the family.
    how: "measured" starts at the first reading of the channel with the same name, and is free; "set" is a
        share of an input at the start, with a prior; "rest" is known to within `rest`, around the channel's
        reading if that is farther from 0, else around its value `at_rest`; "given" is known to within `rest`
        around the family's start, as is a "measured" one without a reading.
    input, share, spread: for "set": the state starts at share·input, with a standard deviation spread·input.
    rest: for "rest" and "given", SI.
    at_rest: for "rest", the state's value there as a function of the other states and the model's parameters,
        SI; 0 by default.
    """

    state: str
    how: Literal["measured", "set", "rest", "given"]
    input: str = ""
    share: float = 1.0
    spread: float = 0.0
    rest: float = 0.0
    at_rest: Callable[[Mapping[str, float], Mapping[str, float]], float] | None = None


@dataclass(frozen=True)
class Setting:
    """A quantity set by hand to one of a few values, each with a relative error of its own.

    Attributes
    ----------
    input: the family's input that is set.
    slot: a factor of the set value.
    std: relative repeatability of a setting, from the rig.
    """

    input: str
    slot: str
    std: Callable[[Rig | None], float]


@dataclass(frozen=True)
class RecordLevel:
    """The record-level quantities of a family.

    Attributes
    ----------
    effect: with these parameters; its parameters `SWITCHING` act only on the times of commands.
    quantities: its parameters, each once.
    starts: of the states that do not start at the family's usual values.
    setting: the quantity set by hand; in a table, all rows of one setting share its error (`with_settings`).
    settings: the values for which the effect has parameters of their own, SI.
    inputs: not recorded in some record; the effect has a parameter for the value of each.
    """

    effect: Effect | None = None
    quantities: tuple[Quantity, ...] = ()
    starts: tuple[Start, ...] = ()
    setting: Setting | None = None
    settings: tuple[float, ...] = ()
    inputs: tuple[str, ...] = ()

    @property
    def setting_names(self) -> tuple[str, ...]:
        """The names of the parameters of `settings` in a system."""
        return tuple(qualified(RECORD, _setting_name(k)) for k in range(len(self.settings)))

    def with_settings(self, points: Sequence[float]) -> RecordLevel:
        """With an unknown relative error of each of these set values, shared by all records set to it.

        The factor at the slot is ``1 + Σ_k e_k·exp(−((u − u_k)/w)²)``, u the input, w a quarter of the least
        distance between two set values: it suppresses another setting's error by seven digits.
        """
        if self.setting is None or self.effect is None or not points:
            return self
        # One effect serves all records, so each record has to pick its own error by the value of its input. A
        # Gaussian window does that without a branch: exp(−(4)²) ≈ 1e-7 at the nearest other setting.
        apart = np.diff(np.sort(np.array(points, dtype=float)))
        width = 0.25 * float(apart.min()) if apart.size else abs(points[0]) or 1.0
        term = (self.setting.slot, _set_to(self.setting.input, tuple(points), width))
        parameters = tuple(
            EffectParameter(_setting_name(k), "%", 0.0, 1e-3, -0.9, 0.9, f"error of setting {k + 1}")
            for k in range(len(points))
        )
        effect = replace(
            self.effect,
            terms=(*self.effect.terms, term),
            parameters=(*self.effect.parameters, *parameters),
        )
        return replace(self, effect=effect, settings=tuple(points))

    def with_inputs(self, inputs: Collection[str], family: ModelFamily) -> RecordLevel:
        """With a parameter for the value of each of these unrecorded inputs of the family."""
        if not inputs or self.effect is None:
            return self
        parameters = tuple(
            EffectParameter(
                item.name,
                item.unit,
                0.0,
                1.0,
                -math.inf,
                math.inf,
                f"{item.meaning or item.name}, not recorded",
                difference=item.difference,
            )
            for item in family.inputs
            if item.name in inputs
        )
        effect = replace(self.effect, parameters=(*self.effect.parameters, *parameters))
        return replace(self, effect=effect, inputs=tuple(one.name for one in parameters))

    def with_repeatability(
        self, inputs: Mapping[str, tuple[float, float]], family: ModelFamily
    ) -> RecordLevel:
        """With a relative error e of each of these inputs of a user's family, ``u + (u − u_0)·e``.

        Parameters
        ----------
        inputs: the standard deviation of each from record to record, and u_0, the zero of its scale, SI.
        """
        slots = {slot.name for slot in family.slots}
        acting = {name: one for name, one in inputs.items() if one[0] > 0.0 and input_slot(name) in slots}
        if self.effect is None or not acting:
            return self
        effect = replace(
            self.effect,
            terms=(
                *self.effect.terms,
                *((input_slot(name), _off_by(name, zero)) for name, (_, zero) in acting.items()),
            ),
            parameters=(
                *self.effect.parameters,
                *(
                    EffectParameter(
                        _error_of(name), "%", 0.0, 1e-3, -0.9, 0.9, f"error of the setting of {name}"
                    )
                    for name in acting
                ),
            ),
        )
        quantities = (
            Quantity(_error_of(name), f"error of the setting of {name}", partial(_stated, std))
            for name, (std, _) in acting.items()
        )
        return replace(self, effect=effect, quantities=(*self.quantities, *quantities))

    @property
    def null(self) -> dict[str, dict[str, float]]:
        """The effect with its parameters at their null, in the form used to build a system."""
        return {} if self.effect is None else {self.effect.name: self.effect.null}


def _setting_name(k: int) -> str:
    return f"setting_{k + 1}"


def _error_of(name: str) -> str:
    return f"setting_of_{name}"


@cache  # equal terms are one object, by which a compiled system is known again
def _off_by(name: str, zero: float) -> Term:
    return partial(_off, name, zero)


def _off(name: str, zero: float, m: Scope, p: Own) -> Scalar:
    value = m[name] if zero == 0.0 else m[name] - constant_like(zero, m[name])
    return value * p[_error_of(name)]


def _stated(std: float, _: Rig | None) -> float:
    return std


@cache
def _set_to(name: str, points: tuple[float, ...], width: float) -> Term:
    return partial(_set, name, points, width)


def _set(name: str, points: Sequence[float], width: float, m: Scope, p: Own) -> Scalar:
    total: Scalar = 1.0
    for k, point in enumerate(points):
        off = (m[name] - constant_like(point, m[name])) / constant_like(width, m[name])
        total = total + p[_setting_name(k)] * exp(-off * off)
    return total


@lru_cache(maxsize=1)
def _known() -> Mapping[str, RecordLevel]:
    return of_shipped("record_level", "RECORD_LEVEL")


def record_level(family: ModelFamily) -> RecordLevel:
    """The record-level quantities of a family.

    A family that declares none starts every state at the reading of the channel with its name; a state
    without a channel is unknown if the family gives its start a standard deviation.
    """
    # A shipped family declares its own quantities (its `record_level` module); any other gets initial states
    # alone.
    level = _known().get(family.name)
    if level is None:
        read = {output.name for output in family.outputs}
        level = RecordLevel(
            starts=tuple(
                Start(s.name, "measured" if s.name in read else "given", rest=s.start_std)
                for s in family.states
                if (s.name in read or s.start_std > 0.0) and s.name not in _unsettable(family)
            )
        )
    effect = level.effect or _nothing(family)
    return replace(level, effect=replace(effect, parameters=(*effect.parameters, *_SWITCHING)))


def _unsettable(family: ModelFamily) -> set[str]:
    """The outputs of a foreign program whose value at the start cannot be set."""
    program = family.program
    return set() if program is None else {*program.outputs} - {*program.settable}


_SWITCHING = tuple(
    EffectParameter(name, "1", 0.0, 0.5, -0.5, 1.5, f"lateness of switches {where}, in samples")
    for name, where in zip(SWITCHING, ("to more", "to less", "to 0"), strict=True)
)


def _nothing(family: ModelFamily) -> Effect:
    """The record-level effect of a family without such quantities."""
    return Effect(
        name=RECORD,
        family=family.name,
        summary="Quantities that differ from record to record.",
        equation="",
        source="repeated measurements at one condition",
        looks_like="Records of one condition differ.",
        own_family=family,
    )
