"""Effects of a sensor: deviations of the reading from the true value.

In: the slot at a `Reading` and the typical sizes. Out: effects there. Each is written as ``w = z − x``, with
x the reading's formula without this slot, whose derivative follows from the equations of the states it
reads. A bench without states has no such x(t): there the same slot takes dependences on the settings
(proportional, square, beyond a threshold, hysteretic), which is what its model may lack.
"""

from __future__ import annotations

from collections.abc import Iterator

from rigctl.effects.declaration import Effect, EffectParameter, EffectState, Own, Term
from rigctl.effects.generic.common import (
    BOUC_WEN,
    CORNER,
    SENSORS,
    beyond,
    either_sign,
    one_sign,
    placed,
    shape,
    share,
    shown_product,
    shown_quotient,
    sign,
)
from rigctl.effects.generic.magnitudes import Magnitudes
from rigctl.effects.generic.slot_roles import (
    Reading,
    counted_from,
    is_point_on_scale,
    is_speed,
    point_of_reference,
)
from rigctl.effects.lag import deviation_rate, reading_error
from rigctl.engine.symbols import Scalar, absolute, constant_like, power
from rigctl.physics.family import ModelFamily
from rigctl.physics.scope import Scope
from rigctl.units import interval_unit, show

#: exponent of the Bouc-Wen law: 1 is a gradual reversal, infinity is backlash; must be odd
_SHARP = 5


def at_reading(family: ModelFamily, role: Reading, sizes: Magnitudes) -> Iterator[Effect]:
    """The effects that may act at a reading: of the reading, or of the settings if there is no time."""
    builder = _EffectBuilder(family, role, sizes)
    yield builder.offset()
    if family.in_time:
        yield builder.drift()
    if role.slopes:
        yield builder.gain()
        yield builder.lag()
        yield builder.saturation()
        yield builder.hysteresis()
    for name in role.inputs:
        yield from builder.with_input(name)
        if family.in_time and not family.states:
            yield builder.hysteresis_with_input(name)


class _EffectBuilder:
    def __init__(self, family: ModelFamily, role: Reading, sizes: Magnitudes) -> None:
        self.family, self.role, self.sizes = family, role, sizes
        self.name = role.output.name
        self.unit = role.slot.unit
        self.shown = role.output.shown or self.unit
        self.interval = interval_unit(self.shown)
        # The range of the reading from the ranges of the states it reads, by its slopes at the start; a bench
        # without states has only the value itself.
        self.span = sum(abs(slope) * sizes.state(state) for state, slope in role.slopes.items()) or (
            sizes.reading(self.name) or 1.0
        )
        self.time = min((sizes.time(state) for state in role.slopes), default=sizes.shortest)

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
        of: str = "",
        source: str = SENSORS,
    ) -> Effect:
        label, sensor = self.role.label, self.role.slot.kind == "sensor"
        ending = f"_{'of' if sensor else 'on'}_{label}" + (f"_with_{of}" if of else "")
        return placed(
            self.family,
            self.role.slot.name,
            kind,
            ending,
            summary=summary,
            equation=equation,
            source=source,
            looks_like=looks_like,
            term=lambda m, p: self._signed(term(m, p)),
            parameters=parameters,
            states=states,
            confused=confused,
            needs=needs,
            kind="sensor" if sensor else "process",
        )

    def _signed(self, value: Scalar) -> Scalar:
        return value if self.role.direction > 0.0 else -value

    def offset(self) -> Effect:
        return self.effect(
            "offset",
            f"The reading {self.name} has a constant offset.",
            "w = c",
            lambda m, p: p.size,
            (either_sign("size", self.interval, 0.01 * self.span, "c"),),
            "All of its readings are shifted equally, and those of no other channel.",
            confused=("drift", "gain"),
        )

    def drift(self) -> Effect:
        return self.effect(
            "drift",
            f"The zero of the reading {self.name} drifts.",
            "w = k·t",
            lambda m, p: p.rate * p.elapsed,
            (either_sign("rate", shown_quotient(self.interval, "s"), 0.01 * self.span / self.time, "k"),),
            "Its error increases during a record, and that of no other channel.",
            states=(EffectState("elapsed", "s", 1.0, lambda m, p: 1.0, "time since the record began"),),
            confused=("offset",),
            needs="long records",
        )

    def gain(self) -> Effect:
        reference = show(self.role.reference, self.shown) if self.role.reference else ""
        base = f"({self.name} − {reference})" if reference else self.name
        return self.effect(
            "gain",
            f"The reading {self.name} has a gain error.",
            f"w = k·{base}",
            lambda m, p: p.share * self._above(m),
            (EffectParameter("share", "1", 0.0, 0.01, -0.9, 9.0, "k", physical="low"),),
            "Its error is proportional to its value, and that of no other channel.",
            confused=("saturation", "offset"),
        )

    def lag(self) -> Effect:
        resolution = self.sizes.resolution

        def rate(m: Scope, p: Own) -> Scalar:
            return deviation_rate(p.deviation, p.lag, constant_like(resolution, p.lag), self.role.rate(m))

        return self.effect(
            "lag",
            f"The reading {self.name} lags.",
            f"τ·dz/dt = {self.name} − z, w = z − {self.name}",
            lambda m, p: reading_error(p.deviation, p.lag, constant_like(resolution, p.lag)),
            (one_sign("lag", "s", 0.1 * self.time, "τ"),),
            "Its fast changes are delayed and rounded; at rest it is right.",
            states=(
                EffectState(
                    "deviation", self.unit, self.span / 300.0, rate, "reading less truth, unweighted"
                ),
            ),
            confused=("hysteresis",),
        )

    def saturation(self) -> Effect:
        def term(m: Scope, p: Own) -> Scalar:
            x = self.role.truth(m)
            return -(p.share * beyond(x, p.limit, constant_like(CORNER * self.span, x)))

        typical = self.role.reference + 0.7 * self.span
        far = 100.0 * self.span + abs(typical)
        return self.effect(
            "saturation",
            f"The reading {self.name} saturates at a limit.",
            f"w = −k·max(0, {self.name} − limit)",
            term,
            (
                share("share", "k; 1 is a hard limit"),
                shape(
                    "limit",
                    self.shown,
                    typical,
                    "where it begins",
                    within=f"reading {self.name}",
                    shares=(0.5, 0.7, 0.85, 0.95),
                    low=-far,
                    high=far,
                    difference=False,
                ),
            ),
            "Its high values are flattened, and those of no other channel.",
            confused=("gain",),
            needs="values beyond the limit",
        )

    def hysteresis(self) -> Effect:
        """Backlash: the reading stays constant while the true value reverses. The initial side is unknown."""
        pace = self.span / self.time

        # The side on which a record begins is unknown, and an EffectState starts at a fixed value: the state
        # is z − z₀, and z₀ is a shape that a diagnosis tries at ±1.
        def side(p: Own) -> Scalar:
            return p.play + p.side

        def rate(m: Scope, p: Own) -> Scalar:
            # With z = ±1 as fixed points of dz/dt = (ẋ − |ẋ|·z⁵)/s the play is nearly that of an ideal
            # backlash (z^∞), but with a slope that a fit can use. Jumps of inputs are not part of ẋ.
            speed = self.role.rate(m)
            size = speed * sign(speed, constant_like(1e-3 * pace, speed))
            return (speed - size * side(p) ** _SHARP) / p.distance

        return self.effect(
            "hysteresis",
            f"The reading {self.name} has play, or hysteresis of the sensor.",
            f"w = c − b·z, dz/dt = (d{self.name}/dt − |d{self.name}/dt|·z^{_SHARP})/s",
            lambda m, p: p.zero - p.size * side(p),
            (
                one_sign("size", self.interval, 0.01 * self.span, "b, half of the play"),
                either_sign("zero", self.interval, 0.01 * self.span, "c, where in the play it was zeroed"),
                shape(
                    "distance",
                    self.interval,
                    0.02 * self.span,
                    "s, over which it turns; b where it is play",
                    within=f"length of {self.name}",
                    shares=(0.003, 0.01, 0.03, 0.1),
                ),
                shape("side", "1", 0.0, "z where a record begins", grid=(-1.0, 1.0), low=-1.0, high=1.0),
            ),
            "The same value gives different readings when rising and when falling.",
            states=(EffectState("play", "1", 0.1, rate, "z less where it began, z from −1 to 1"),),
            confused=("lag", "offset"),
            needs="reversals",
        )

    def with_input(self, name: str) -> Iterator[Effect]:
        """Dependences of a steady-state value on a setting that may be missing."""
        item = {item.name: item for item in self.family.inputs}[name]
        unit, point = item.shown or item.unit, is_point_on_scale(item)
        per = interval_unit(unit)
        span = self.sizes.input(name)
        label = self.role.label
        reference = point_of_reference(item)
        counted = counted_from(name, reference)

        def from_reference(m: Scope) -> Scalar:
            u = m[name]
            return u if reference is None else u - constant_like(reference, u)

        def squared(m: Scope, p: Own) -> Scalar:
            u = from_reference(m)
            return p.coefficient * u * absolute(u, corner(u))

        def corner(u: Scalar) -> Scalar:
            return constant_like(CORNER * span, u)

        yield self.effect(
            "gain",
            f"A part of {label} is proportional to {counted}.",
            f"w = k·{counted}",
            lambda m, p: p.coefficient * from_reference(m),
            (either_sign("coefficient", shown_quotient(self.interval, per), 0.05 * self.span / span, "k"),),
            f"The error is proportional to {name}.",
            confused=("quadratic", "threshold"),
            of=name,
        )
        yield self.effect(
            "quadratic",
            f"A part of {label} is proportional to the square of {counted}.",
            f"w = k·{counted}·|{counted.strip('()')}|",
            squared,
            (
                either_sign(
                    "coefficient", shown_quotient(self.interval, per, per), 0.05 * self.span / span**2, "k"
                ),
            ),
            f"The error is proportional to the square of {name}.",
            confused=("gain", "threshold"),
            of=name,
        )

        def threshold(m: Scope, p: Own) -> Scalar:
            u = m[name]
            above = beyond(u, p.limit, corner(u)) / constant_like(span, u)
            return p.coefficient * power(above, p.exponent)

        yield self.effect(
            "threshold",
            f"Above a limit of {name} an additional part sets in.",
            f"w = k·(max(0, {name} − limit)/{show(span, unit, difference=True, digits=3)})^n",
            threshold,
            (
                either_sign("coefficient", self.interval, 0.1 * self.span, "k"),
                shape(
                    "limit",
                    unit,
                    0.5 * span,
                    "where it begins",
                    within=f"input {name}" if point else f"|{name}|",
                    shares=(0.3, 0.5, 0.65, 0.8),
                    low=-100.0 * span,
                    high=100.0 * span,
                    difference=not point,
                ),
                shape("exponent", "1", 1.0, "n", low=1.0, high=3.0),
            ),
            f"There is no error up to a limit of {name}; beyond it the error increases.",
            confused=("quadratic", "gain"),
            of=name,
        )

    def hysteresis_with_input(self, name: str) -> Effect:
        """Bouc-Wen hysteresis over an input: over its path, or over the path that a speed covers."""
        item = {item.name: item for item in self.family.inputs}[name]
        unit, speed = interval_unit(item.shown or item.unit), is_speed(item)
        span, time = self.sizes.input(name), self.sizes.shortest
        reach = span * time if speed else span
        behind = 0.01 * time  # an input has no derivative: it is that of a fast follower

        def pace(m: Scope, p: Own) -> Scalar:
            return m[name] if speed else (m[name] - p.follower) / m.constant(behind, "s")

        def rate(m: Scope, p: Own) -> Scalar:
            u = pace(m, p)
            size = u * sign(u, constant_like(1e-3 * reach / time, u))
            return (u - size * (p.bending + p.side)) / p.distance

        path, slope = (f"∫{name} dt", name) if speed else (name, f"d{name}/dt")
        follower = EffectState(
            "follower", item.unit, CORNER * span, pace, f"{name}, with its derivative", start=item.value
        )
        bending = EffectState("bending", "1", 0.1, rate, "z less where it began, z from −1 to 1")
        return self.effect(
            "hysteresis",
            f"A part of {self.role.label} depends on the direction of {path}: Bouc-Wen hysteresis.",
            f"w = F·z, dz/dt = ({slope} − |{slope}|·z)/s",
            lambda m, p: p.size * (p.bending + p.side),
            (
                either_sign("size", self.interval, 0.05 * self.span, "F, when it slips"),
                shape(
                    "distance",
                    shown_product(unit, "s") if speed else unit,
                    0.1 * reach,
                    "s, over which it is bent before it slips",
                    grid=(0.001 * reach, 0.01 * reach, reach),
                ),
                shape("side", "1", 0.0, "z where a record begins", grid=(-1.0, 1.0), low=-1.0, high=1.0),
            ),
            f"The same {name} gives different values after rising and after falling.",
            states=(bending,) if speed else (follower, bending),
            confused=("gain",),
            needs="reversals",
            of=name,
            source=BOUC_WEN,
        )

    def _above(self, m: Scope) -> Scalar:
        x = self.role.truth(m)
        return x - constant_like(self.role.reference, x) if self.role.reference else x
