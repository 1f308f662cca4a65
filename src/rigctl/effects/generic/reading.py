"""Effects of a sensor: what it reads beside the truth."""

from __future__ import annotations

from collections.abc import Iterator

from rigctl.effects.declaration import Effect, EffectParameter, EffectState, Own, Term
from rigctl.effects.generic.common import (
    CORNER,
    SENSORS,
    beyond,
    either_sign,
    one_sign,
    quotient,
    shape,
    share,
    sign,
)
from rigctl.effects.generic.magnitudes import Magnitudes
from rigctl.effects.generic.places import Reading
from rigctl.effects.lag import deviation_rate, reading_error
from rigctl.engine.symbols import Scalar, constant_like
from rigctl.physics.family import ModelFamily
from rigctl.physics.scope import Scope

#: a lag is regular down to this share of the family's shortest time
_RESOLUTION = 1e-3


def at_reading(family: ModelFamily, place: Reading, sizes: Magnitudes) -> Iterator[Effect]:
    """The effects that may act at a reading; most need the state that is read."""
    made = _Made(family, place, sizes)
    yield made.offset()
    yield made.drift()
    if place.state is not None:
        yield made.gain(place.state)
        yield made.lag(place.state)
        yield made.saturation(place.state)
        yield made.hysteresis(place.state)


class _Made:
    def __init__(self, family: ModelFamily, place: Reading, sizes: Magnitudes) -> None:
        self.family, self.place, self.sizes = family, place, sizes
        self.name = place.output.name
        self.unit = place.slot.unit
        self.span = sizes.state(place.state) if place.state is not None else 1.0
        self.time = sizes.time(place.state) if place.state is not None else sizes.shortest

    def effect(
        self,
        kind: str,
        summary: str,
        equation: str,
        term: Term,
        parameters: tuple[EffectParameter, ...],
        looks_like: str,
        *,
        states: tuple[EffectState, ...] = (),
        confused: tuple[str, ...] = (),
        needs: str | None = None,
    ) -> Effect:
        return Effect(
            name=f"{kind}_of_{self.name}",
            family=self.family.name,
            summary=summary,
            equation=equation,
            source=SENSORS,
            looks_like=looks_like,
            terms=((self.place.slot.name, term),),
            parameters=parameters,
            states=states,
            kind="sensor",
            confused_with=tuple(f"{one}_of_{self.name}" for one in confused),
            needs=needs,
            own_family=self.family,
        )

    def offset(self) -> Effect:
        return self.effect(
            "offset",
            f"The reading {self.name} is off by a constant.",
            "w = c",
            lambda m, p: p.size,
            (either_sign("size", self.unit, 0.01 * self.span, "c"),),
            "All of its readings are shifted alike, and no other channel is.",
            confused=("drift", "gain"),
        )

    def drift(self) -> Effect:
        return self.effect(
            "drift",
            f"The zero of the reading {self.name} wanders.",
            "w = k·t",
            lambda m, p: p.rate * p.elapsed,
            (either_sign("rate", quotient(self.unit, "s"), 0.01 * self.span / self.time, "k"),),
            "Its error grows in the course of a record, and no other channel's does.",
            states=(EffectState("elapsed", "s", 1.0, lambda m, p: 1.0, "time since the record began"),),
            confused=("offset",),
            needs="long records",
        )

    def gain(self, state: str) -> Effect:
        base = f"({state} − {self.place.reference:g})" if self.place.reference else state
        return self.effect(
            "gain",
            f"The reading {self.name} is off by a share.",
            f"w = k·{base}",
            lambda m, p: p.share * self._above(m, state),
            (EffectParameter("share", "1", 0.0, 0.01, -0.9, 9.0, "k"),),
            "Its error is in proportion to its value, and no other channel's is.",
            confused=("saturation", "offset"),
        )

    def lag(self, state: str) -> Effect:
        resolution = max(_RESOLUTION * self.sizes.shortest, 1e-9)

        def rate(m: Scope, p: Own) -> Scalar:
            return deviation_rate(p.deviation, p.lag, constant_like(resolution, p.lag), m.rate(state))

        unit = self.state_unit(state)
        scale = self.span / 300.0
        return self.effect(
            "lag",
            f"The reading {self.name} follows late.",
            f"τ·dz/dt = {state} − z, w = z − {state}",
            lambda m, p: reading_error(p.deviation, p.lag, constant_like(resolution, p.lag)),
            (one_sign("lag", "s", 0.1 * self.time, "τ"),),
            "Its fast changes come late and rounded; at rest it is right.",
            states=(EffectState("deviation", unit, scale, rate, "reading less truth, unweighted"),),
            confused=("hysteresis",),
        )

    def saturation(self, state: str) -> Effect:
        def term(m: Scope, p: Own) -> Scalar:
            x = m[state]
            return -(p.share * beyond(x, p.limit, constant_like(CORNER * self.span, x)))

        start = next(s.start for s in self.family.states if s.name == state)
        return self.effect(
            "saturation",
            f"The reading {self.name} does not go beyond a limit.",
            f"w = −k·max(0, {state} − limit)",
            term,
            (
                share("share", "k; 1 is a hard limit"),
                self._limit(state, start + 0.7 * self.span),
            ),
            "Its high values are flattened, and no other channel's are.",
            confused=("gain",),
            needs="values beyond the limit",
        )

    def _limit(self, state: str, typical: float) -> EffectParameter:
        far = 100.0 * self.span + abs(typical)
        difference = next(s.difference for s in self.family.states if s.name == state)
        return shape(
            "limit",
            self.state_unit(state),
            typical,
            "where it begins",
            within=state,
            shares=(0.5, 0.7, 0.85, 0.95),
            low=-far,
            high=far,
            difference=difference,
        )

    def hysteresis(self, state: str) -> Effect:
        unit = self.state_unit(state)
        pace = self.span / self.time

        def rate(m: Scope, p: Own) -> Scalar:
            speed = m.rate(state)
            return (speed - speed * sign(speed, constant_like(1e-3 * pace, speed)) * p.play) / p.distance

        return self.effect(
            "hysteresis",
            f"The reading {self.name} hangs behind: play, or hysteresis of the sensor.",
            f"w = −b·z, dz/dt = (d{state}/dt − |d{state}/dt|·z)/s",
            lambda m, p: -(p.size * p.play),
            (
                one_sign("size", self.unit, 0.01 * self.span, "b, half of the play"),
                shape(
                    "distance",
                    unit,
                    0.02 * self.span,
                    "s, over which it turns",
                    within=state,
                    shares=(0.01, 0.05),
                ),
            ),
            "The same value is read differently on the way up and on the way down.",
            states=(EffectState("play", "1", 0.1, rate, "z, which side of the play, −1 to 1"),),
            confused=("lag",),
            needs="reversals",
        )

    def state_unit(self, state: str) -> str:
        return next(s.unit for s in self.family.states if s.name == state)

    def _above(self, m: Scope, state: str) -> Scalar:
        x = m[state]
        return x - constant_like(self.place.reference, x) if self.place.reference else x
