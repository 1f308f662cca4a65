"""Typical magnitudes of a family's quantities, from its declared values, as starting values of fits.

No data are used, so that an effect has the same bounds wherever it is read. Bounds are therefore wide, and a
typical size is right to a factor of about ten: a fit determines the rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from rigctl.physics.family import ModelFamily, StateVariable
from rigctl.physics.scope import Scope
from rigctl.units import parse_unit

#: range of a state, as a multiple of its relevant change
_CHANGES = 300.0
#: of a record without states: how many samples a change that shows may take
_SAMPLES = 10.0
#: resolution of a lag or a play, as a share of the family's shortest time
RESOLUTION = 1e-3


class Magnitudes:
    """Ranges of states, inputs and readings (SI), and how fast states change."""

    def __init__(self, family: ModelFamily) -> None:
        self._family = family
        record = family.standard_record
        initial = record.initial if record is not None else {}
        self._states = {state.name: _range(state, initial) for state in family.states}
        self._inputs = {item.name: [item.value] for item in family.inputs}
        self._units = {item.name: parse_unit(item.shown or item.unit).factor for item in family.inputs}
        for _, changed in record.switches if record is not None else ():
            for name, value in changed.items():
                self._inputs[name].append(value)
        self._rates = self._largest_rates()
        self.duration = record.times[-1] - record.times[0] if record is not None else None

    def state(self, name: str) -> float:
        """The range over which a state moves."""
        return self._states[name]

    def input(self, name: str) -> float:
        """The range over which an input is commanded; one of the family's own unit if unknown, as of a pump
        whose only value is ``0 ml/min``."""
        values = self._inputs[name]
        return max(values) - min(values) or max(map(abs, values)) or self._units[name]

    def rate(self, state: str) -> float:
        """The typical rate of a state when it is driven."""
        return self._rates[state]

    def time(self, state: str) -> float:
        """The time in which a state crosses its range, or a tenth of the standard record if that is
        shorter."""
        its_time = self.state(state) / self.rate(state)
        return min(its_time, 0.1 * self.duration) if self.duration else its_time

    @property
    def shortest(self) -> float:
        """The shortest of all states' times; without states some samples of the standard record, else 1 s."""
        record = self._family.standard_record
        samples = 1.0 if record is None else _SAMPLES * float(record.times[1] - record.times[0])
        return min((self.time(state.name) for state in self._family.states), default=samples)

    @property
    def resolution(self) -> float:
        """A time far below every other one, which keeps a lag regular at 0: smaller still where a program
        computes the states, since their times are not known."""
        share = RESOLUTION if self._family.program is None else RESOLUTION**2
        return max(share * self.shortest, 1e-9)

    def reading(self, name: str) -> float:
        """The magnitude of a reading at the family's start, 0 if it has none."""
        output = {output.name: output for output in self._family.outputs}[name]
        point = next(iter(self._points()), None)
        if point is None:
            return 0.0
        try:
            value = abs(float(output.formula(Scope(self._family, point))))
        except Exception:  # noqa: BLE001 - a foreign Python function
            return 0.0
        return value if math.isfinite(value) else 0.0

    def _largest_rates(self) -> dict[str, float]:
        # At rest all rates are near 0. The typical one is the largest over a star of points around the start:
        # one state or one input at the end of its range at a time.
        rates = dict.fromkeys(self._states, 0.0)
        for point in self._points():
            for name in rates:
                rates[name] = max(rates[name], self._rate(name, point))
        return {name: rate or self._states[name] for name, rate in rates.items()}

    def _rate(self, name: str, point: Mapping[str, float]) -> float:
        try:
            value = abs(float(Scope(self._family, point).rate(name)))
        except Exception:  # noqa: BLE001 - a foreign Python function; it was tried in symbols before
            return 0.0
        return value if math.isfinite(value) else 0.0

    def _points(self) -> Iterator[dict[str, float]]:
        """The start, each state moved across its range, and each input at its values."""
        family = self._family
        at: dict[str, float] = {state.name: state.start for state in family.states}
        at |= {item.name: item.value for item in family.inputs}
        at |= {parameter.name: parameter.value for parameter in family.parameters}
        yield dict(at)
        for name, size in self._states.items():
            yield {**at, name: at[name] + size}
            yield {**at, name: at[name] - size}
        for name, values in self._inputs.items():
            for value in values:
                yield {**at, name: value}


def _range(state: StateVariable, initial: Mapping[str, float]) -> float:
    moved = abs(initial.get(state.name, state.start) - state.start)
    return max(_CHANGES * state.scale, moved)
