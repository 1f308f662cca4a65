"""Drifts of a program's parameters: with a condition, or in the course of a record.

In: the slot at a parameter (`OfProgram`) and the typical sizes. Out: effects there. Equations that can be
seen have effects at their balances instead; of an FMU, or of functions that take no symbols, the parameters
are all of the inside that can be reached. A parameter that cannot change during a simulation gets the mean of
the term over each record, which is exact for a condition that is constant there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from rigctl.effects.declaration import Effect, EffectParameter, EffectState, Own, Term
from rigctl.effects.generic.common import either_sign, shown_quotient
from rigctl.effects.generic.magnitudes import Magnitudes
from rigctl.effects.generic.slot_roles import OfProgram
from rigctl.engine.symbols import Scalar
from rigctl.physics.family import InputVariable, ModelFamily
from rigctl.physics.scope import Scope
from rigctl.units import interval_unit

_LJUNG = "Ljung, System Identification: Theory for the User, on time-varying parameters"
#: typical drift over the range of a condition, or over a record, as a share of the parameter
_DRIFT = 0.1


def at_parameter(family: ModelFamily, role: OfProgram, sizes: Magnitudes) -> Iterator[Effect]:
    """A drift with each input, and in time if the parameter can change during a simulation."""
    builder = _EffectBuilder(family, role, sizes)
    for item in family.inputs:
        yield builder.with_input(item)
    if role.tunable:
        yield builder.in_time()


class _EffectBuilder:
    def __init__(self, family: ModelFamily, role: OfProgram, sizes: Magnitudes) -> None:
        self.family, self.role, self.sizes = family, role, sizes
        self.name, self.unit = role.parameter.name, interval_unit(role.parameter.unit)

    def effect(
        self,
        ending: str,
        summary: str,
        equation: str,
        term: Term,
        parameters: tuple[EffectParameter, ...],
        looks_like: str,
        needs: str,
        *,
        states: tuple[EffectState, ...] = (),
    ) -> Effect:
        return Effect(
            name=f"drift_of_{self.name}_{ending}",
            family=self.family.name,
            summary=summary,
            equation=equation,
            source=_LJUNG,
            looks_like=looks_like,
            terms=((self.role.slot.name, term),),
            parameters=parameters,
            states=states,
            needs=needs,
            own_family=self.family,
        )

    def with_input(self, item: InputVariable) -> Effect:
        unit = item.shown or item.unit
        slope = _DRIFT * self.role.size / self.sizes.input(item.name)
        # From the middle of the data: a drift is then no other value of a parameter that the fit holds, and
        # an input with one value in all data has no drift.
        origin = _origin(unit, item.value, f"input {item.name}", difference=item.difference)

        def term(m: Scope, p: Own) -> Scalar:
            return p.slope * (m[item.name] - p.origin)

        return self.effect(
            f"with_{item.name}",
            f"The parameter {self.name} changes with {item.name}.",
            self._mean(f"slope·({item.name} − origin)"),
            term,
            (
                either_sign(
                    "slope", shown_quotient(self.unit, interval_unit(unit)), slope, "change per unit"
                ),
                origin,
            ),
            f"Another value of {self.name} fits at each value of {item.name}.",
            f"several values of {item.name}",
        )

    def _mean(self, law: str) -> str:
        return f"w = {law}" if self.role.tunable else f"w = {law}, its mean over each record"

    def in_time(self) -> Effect:
        length = self.sizes.duration or self.sizes.shortest
        rate = _DRIFT * self.role.size / length
        return self.effect(
            "in_time",
            f"The parameter {self.name} changes in the course of a record.",
            "w = rate·(t − origin)",
            lambda m, p: p.rate * (p.elapsed - p.origin),
            (
                either_sign("rate", shown_quotient(self.unit, "s"), rate, "change per second"),
                _origin("s", 0.5 * length, "time", difference=True),
            ),
            f"Another value of {self.name} fits the end of a record than its beginning.",
            "long records, with the same commands early and late",
            states=(EffectState("elapsed", "s", 1.0, lambda m, p: 1.0, "time since the record began"),),
        )


def _origin(unit: str, start: float, within: str, *, difference: bool) -> EffectParameter:
    """From where a drift counts: the middle of what the data have, and not fitted, as the parameter is."""
    return EffectParameter(
        "origin",
        unit,
        None,
        start,
        -math.inf,
        math.inf,
        "from where it counts, the middle of the data",
        difference,
        within=within,
        shares=(0.5,),
        physical="none",
    )
