"""Effects of an actuator: deviations of the acting value from the commanded one.

In: the slot at an input (`Given`) or at its switches (`Late`) and the typical sizes. Out: effects there.
Each is written as the deviation ``w = u_acting − u``, which is exactly 0 where it is off; play and lag
therefore carry a state that follows u, and add the difference.
"""

from __future__ import annotations

from collections.abc import Iterator

from rigctl.effects.declaration import Effect, EffectParameter, EffectState, Own, Term
from rigctl.effects.generic.common import (
    CORNER,
    beyond,
    either_sign,
    one_sign,
    placed,
    shape,
    share,
    shown_quotient,
)
from rigctl.effects.generic.magnitudes import RESOLUTION, Magnitudes
from rigctl.effects.generic.slot_roles import (
    Given,
    Late,
    counted_from,
    is_point_on_scale,
    point_of_reference,
)
from rigctl.effects.lag import reading_error
from rigctl.engine.symbols import Scalar, absolute, constant_like, positive_part
from rigctl.physics.family import ModelFamily
from rigctl.physics.scope import Scope
from rigctl.units import interval_unit

_TAO = "Tao & Kokotovic, Adaptive Control of Systems with Actuator and Sensor Nonlinearities"


def at_input(family: ModelFamily, role: Given, sizes: Magnitudes) -> Iterator[Effect]:
    """The effects that may act at an input: all for a command, only an offset for surroundings."""
    builder = _EffectBuilder(family, role, sizes)
    yield builder.offset()
    if role.surroundings:
        return
    yield builder.gain()
    yield builder.quadratic()
    if not is_point_on_scale(role.input):  # 0 K is not a neutral value from which it could be limited
        yield builder.saturation()
        yield builder.dead_band()
    if family.in_time:
        yield builder.backlash()
        yield builder.lag()


def at_switches(family: ModelFamily, role: Late, sizes: Magnitudes) -> Iterator[Effect]:
    """A dead time."""
    name = role.input.name
    yield Effect(
        name=f"dead_time_of_{name}",
        family=family.name,
        summary=f"The command {name} acts after a dead time.",
        equation="w = τ, switches act at t + τ",
        source="Åström & Hägglund, Advanced PID Control: dead time",
        looks_like="After every switch nothing happens for a while.",
        terms=((role.slot.name, lambda m, p: p.time),),
        parameters=(one_sign("time", "s", 0.05 * sizes.shortest, "τ"),),
        confused_with=(f"lag_of_{name}",),
        needs="switches within records",
        own_family=family,
    )


class _EffectBuilder:
    def __init__(self, family: ModelFamily, role: Given, sizes: Magnitudes) -> None:
        self.family, self.role, self.sizes = family, role, sizes
        self.name = role.input.name
        self.unit = role.slot.unit
        self.shown = role.input.shown or self.unit
        self.interval = interval_unit(self.shown)
        self.span = sizes.input(self.name)
        outputs = {output.name for output in family.outputs}
        self.label = f"{self.name}_input" if self.name in outputs else self.name
        self.reference = point_of_reference(role.input)
        self.counted = counted_from(self.name, self.reference)

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
        return placed(
            self.family,
            self.role.slot.name,
            kind,
            f"_of_{self.label}",
            summary=summary,
            equation=equation,
            source=_TAO,
            looks_like=looks_like,
            term=term,
            parameters=parameters,
            states=states,
            confused=confused,
            needs=needs,
        )

    def u(self, m: Scope) -> Scalar:
        return m[self.name]

    def from_reference(self, m: Scope) -> Scalar:
        """The input; a temperature relative to the family's usual value, as 0 K is no reference for a
        share."""
        u = self.u(m)
        return u if self.reference is None else u - constant_like(self.reference, u)

    def corner(self, x: Scalar) -> Scalar:
        return constant_like(CORNER * self.span, x)

    def limit(self, meaning: str, shares: tuple[float, ...]) -> EffectParameter:
        point = is_point_on_scale(self.role.input)
        within = f"travel of {self.name}" if point else f"|{self.name}|"
        return shape("limit", self.interval, 0.5 * self.span, meaning, within=within, shares=shares)

    def offset(self) -> Effect:
        return self.effect(
            "offset",
            f"The actual input is {self.name} plus a constant.",
            "w = c",
            lambda m, p: p.size,
            (either_sign("size", self.interval, 0.01 * self.span, "c"),),
            "As if the command always differed by the same amount.",
            confused=("gain", "dead_band"),
        )

    def gain(self) -> Effect:
        return self.effect(
            "gain",
            f"The actual input differs from {self.name} by a constant factor.",
            f"w = k·{self.counted}",
            lambda m, p: p.share * self.from_reference(m),
            (EffectParameter("share", "1", 0.0, 0.01, -0.9, 9.0, "k", physical="low"),),
            "Every command has proportionally more, or less, effect.",
            confused=("quadratic", "saturation"),
        )

    def quadratic(self) -> Effect:
        def term(m: Scope, p: Own) -> Scalar:
            u = self.from_reference(m)
            return p.bend * u * absolute(u, self.corner(u))

        return self.effect(
            "quadratic",
            f"The actual input is not proportional to {self.counted}.",
            f"w = k·{self.counted}·|{self.counted.strip('()')}|",
            term,
            (either_sign("bend", shown_quotient("1", self.interval), 0.05 / self.span, "k"),),
            "Twice the command does not have twice the effect.",
            confused=("gain", "saturation", "dead_band"),
            needs="several commands",
        )

    def saturation(self) -> Effect:
        def term(m: Scope, p: Own) -> Scalar:
            return -(p.share * self._beyond(m, p.limit))

        return self.effect(
            "saturation",
            f"The actual input saturates at a limit of {self.name}.",
            f"w = −k·sign({self.name})·max(0, |{self.name}| − limit)",
            term,
            (share("share", "k; 1 is a hard limit"), self.limit("where it begins", (0.4, 0.6, 0.8, 0.95))),
            "Large commands have the effect of smaller ones.",
            confused=("quadratic", "gain"),
            needs="commands beyond the limit",
        )

    def dead_band(self) -> Effect:
        def term(m: Scope, p: Own) -> Scalar:
            return -(p.share * (self.u(m) - self._beyond(m, p.limit)))

        return self.effect(
            "dead_band",
            f"Small values of {self.name} have no effect.",
            f"w = −k·({self.name} − sign({self.name})·max(0, |{self.name}| − limit))",
            term,
            (share("share", "k; 1 is a full dead band"), self.limit("where it ends", (0.05, 0.15, 0.3))),
            "Small commands have no effect, and large ones less than they should.",
            confused=("offset", "quadratic"),
            needs="several commands",
        )

    def _beyond(self, m: Scope, limit: Scalar) -> Scalar:
        """The excess of the input beyond a limit on either side; exactly odd, so that nothing is added at
        0."""
        u = self.u(m)
        return beyond(u, limit, self.corner(u)) - beyond(-u, limit, self.corner(u))

    def backlash(self) -> Effect:
        pace = RESOLUTION * self.sizes.shortest

        def rate(m: Scope, p: Own) -> Scalar:
            # The follower moves only where |u − z| exceeds half of the play. The law is rate-independent;
            # here it closes the excess with a time constant far below the family's times, so that the
            # equations stay an ODE without events.
            u, corner = self.u(m), self.corner(self.u(m))
            pushed = positive_part(u - p.follower - p.limit, corner)
            pulled = positive_part(p.follower - u - p.limit, corner)
            return (pushed - pulled) / m.constant(10.0 * pace, "s")

        return self.effect(
            "backlash",
            f"There is play between {self.name} and the actual input.",
            f"w = k·(z − {self.name}), z follows {self.name} when it is farther than the limit",
            lambda m, p: p.share * (p.follower - self.u(m)),
            (share("share", "k; 1 is play and nothing else"), self.limit("half of the play", (0.02, 0.1))),
            "After a reversal nothing happens over a certain distance.",
            states=(
                EffectState(
                    "follower", self.unit, CORNER * self.span, rate, "z", start=self.role.input.value
                ),
            ),
            confused=("dead_band", "lag"),
            needs="reversals of the command",
        )

    def lag(self) -> Effect:
        resolution = self.sizes.resolution

        # The resolution T₀ keeps this regular at τ = 0, where the reading error below is exactly 0 (see
        # `rigctl.effects.lag`).
        def rate(m: Scope, p: Own) -> Scalar:
            return (self.u(m) - p.follower) / (p.lag + constant_like(resolution, p.lag))

        def term(m: Scope, p: Own) -> Scalar:
            return reading_error(p.follower - self.u(m), p.lag, constant_like(resolution, p.lag))

        return self.effect(
            "lag",
            f"The actual input lags {self.name}.",
            f"τ·dz/dt = {self.name} − z, w = z − {self.name}",
            term,
            (one_sign("lag", "s", 0.1 * self.sizes.shortest, "τ"),),
            "After a switch the response starts gradually, and continues after the command has ended.",
            states=(
                EffectState(
                    "follower",
                    self.unit,
                    CORNER * self.span,
                    rate,
                    "what acts, unweighted",
                    start=self.role.input.value,
                ),
            ),
            confused=("dead_time", "backlash"),
            needs="switches within records",
        )
