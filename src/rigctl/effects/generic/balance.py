"""Effects in the balance of one state: friction if it is a speed, losses if something is stored.

In: a slot's `Balance` and the typical sizes. Out: effects at that slot. With ``ds/dt = f(...) + d·g·w``, w
is the sum of the effects, g > 0 and d = ±1 from the family's equations. Every term opposes the motion, or
drains the storage, whatever the sign with which the slot enters: a size has one meaning, and where physics
allows one sign only, its bound of 0 holds in every family.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from rigctl.effects.declaration import Effect, EffectParameter, EffectState, Own, Term
from rigctl.effects.generic.common import (
    ARMSTRONG,
    BOUC_WEN,
    CORNER,
    beyond,
    either_sign,
    one_sign,
    placed,
    quotient,
    shape,
    sign,
)
from rigctl.effects.generic.magnitudes import Magnitudes
from rigctl.effects.generic.slot_roles import Balance
from rigctl.engine.symbols import Scalar, absolute, constant_like, exp, power
from rigctl.physics.family import ModelFamily
from rigctl.physics.scope import Scope

_INCROPERA = "Incropera & DeWitt, Fundamentals of Heat and Mass Transfer"
_FLOW = "White, Fluid Mechanics"
#: dry friction reverses within this share of the relevant change of a speed: a numerical corner below the
#: resolution of sensors
_STANDSTILL = 0.05


def at_balance(family: ModelFamily, role: Balance, sizes: Magnitudes) -> Iterator[Effect]:
    """The effects that may act in a balance."""
    name = role.state.name
    at = _At(
        family,
        role,
        span=sizes.state(name),
        size=sizes.rate(name) / role.gain,
        time=sizes.time(name),
    )
    yield from _of_motion(at) if role.moves else _of_store(at)
    yield _offset(at)
    yield _drift(at)


@dataclass(frozen=True)
class _At:
    """A balance with its typical magnitudes: the range of the state, of a term, and the time of a change."""

    family: ModelFamily
    role: Balance
    span: float
    size: float
    time: float

    @property
    def unit(self) -> str:
        """Unit of a term."""
        return self.role.slot.unit

    @property
    def state_unit(self) -> str:
        return self.role.state.unit

    def x(self, m: Scope) -> Scalar:
        return m[self.role.state.name]

    def above(self, m: Scope) -> Scalar:
        """The state relative to its reference."""
        x = self.x(m)
        if self.role.surroundings is not None:
            return x - m[self.role.surroundings]
        return x - constant_like(self.role.reference, x) if self.role.reference else x

    def direction(self, m: Scope) -> Scalar:
        """The sign of a speed."""
        x = self.x(m)
        return sign(x, constant_like(_STANDSTILL * self.role.state.scale, x))

    def against(self, value: Scalar) -> Scalar:
        """A term that opposes a rising state."""
        return -value if self.role.direction > 0.0 else value

    def effect(
        self,
        kind: str,
        summary: str,
        equation: str,
        source: str,
        term: Term,
        parameters: tuple[EffectParameter, ...],
        looks_like: str,
        *,
        states: tuple[EffectState, ...] = (),
        confused: tuple[str, ...] = (),
        becomes: tuple[tuple[str, float, str], ...] = (),
        needs: str | None = None,
    ) -> Effect:
        return placed(
            self.family,
            self.role.slot.name,
            kind,
            f"_on_{self.role.label}",
            summary=summary,
            equation=equation,
            source=source,
            looks_like=looks_like,
            term=term,
            parameters=parameters,
            states=states,
            confused=confused,
            becomes=becomes,
            needs=needs,
        )


def _of_motion(at: _At) -> Iterator[Effect]:
    name, per_speed = at.role.state.name, quotient(at.unit, at.state_unit)
    # Typical sizes are shares, mostly 5 %, of the largest term that drives the state (`at.size` = rate/gain).
    # They are where a fit begins; the bounds around them are wide.
    size = one_sign("size", at.unit, 0.05 * at.size, "F, while it slides")
    yield at.effect(
        "coulomb",
        f"Dry friction of constant size opposes {name}.",
        f"w = −F·sign({name})",
        ARMSTRONG,
        lambda m, p: at.against(p.size * at.direction(m)),
        (size,),
        f"A constant part of the drive of {name} is lost, and it stops in a finite time.",
        confused=("stribeck", "hysteresis", "offset"),
    )
    yield at.effect(
        "stribeck",
        f"Dry friction opposes {name}, most strongly near standstill.",
        f"w = −(F + E·exp(−({name}/v)²))·sign({name})",
        ARMSTRONG,
        lambda m, p: at.against((p.size + p.excess * exp(-((at.x(m) / p.speed) ** 2))) * at.direction(m)),
        (
            size,
            one_sign("excess", at.unit, 0.05 * at.size, "E, by which it is larger near standstill"),
            shape(
                "speed",
                at.state_unit,
                0.03 * at.span,
                "v, where a third of E is left",
                within=name,
                shares=(0.02, 0.1),
            ),
        ),
        "Like dry friction, with a jerk at the start and at every reversal.",
        confused=("coulomb", "hysteresis"),
        becomes=(("excess", 0.0, "coulomb"),),
        needs="slow motion, and reversals",
    )
    yield at.effect(
        "viscous",
        f"A drag is proportional to {name}.",
        f"w = −k·{name}",
        ARMSTRONG,
        lambda m, p: at.against(p.coefficient * at.x(m)),
        (one_sign("coefficient", per_speed, 0.05 * at.size / at.span, "k"),),
        f"{name} settles sooner, and lower in proportion.",
        confused=("quadratic_drag",),
    )
    yield at.effect(
        "quadratic_drag",
        f"The drag of air or a liquid is proportional to the square of {name}.",
        f"w = −k·{name}·|{name}|",
        _FLOW + ": turbulent drag goes with the square",
        lambda m, p: at.against(
            p.coefficient * at.x(m) * absolute(at.x(m), constant_like(at.role.state.scale, at.x(m)))
        ),
        (
            one_sign(
                "coefficient",
                quotient(at.unit, at.state_unit, at.state_unit),
                0.05 * at.size / at.span**2,
                "k",
            ),
        ),
        "High speeds are below those with a drag proportional to speed; low ones are not.",
        confused=("viscous", "coulomb"),
        needs="several speeds",
    )
    yield _hysteresis(at)
    if at.role.position is not None:
        yield from _of_position(at, at.role.position)


def _hysteresis(at: _At) -> Effect:
    name = at.role.state.name
    distance = quotient(at.state_unit, "1/s")

    # dz/dt = (v − |v|·z)/s with |v| = v·sign(v): z follows the path ∫v dt, not the time, and tends to ±1 in
    # sliding. With s → 0 it is Coulomb friction.
    def rate(m: Scope, p: Own) -> Scalar:
        return (at.x(m) - at.x(m) * at.direction(m) * p.bending) / p.distance

    return at.effect(
        "hysteresis",
        f"A slipping spring opposes {name}: Bouc-Wen hysteresis.",
        f"w = −F·z, dz/dt = ({name} − |{name}|·z)/s",
        BOUC_WEN,
        lambda m, p: at.against(p.size * p.bending),
        (
            one_sign("size", at.unit, 0.05 * at.size, "F, when it slips"),
            shape(
                "distance",
                distance,
                0.1 * at.span * at.time,
                "s, over which it is bent before it slips",
                grid=(0.01 * at.span * at.time,),
            ),
        ),
        "After a reversal the force builds up over a distance; a move and its return differ.",
        states=(EffectState("bending", "1", 0.1, rate, "z, of the spring, −1 to 1"),),
        confused=("coulomb", "stribeck"),
        becomes=(("distance", 0.0, "coulomb"),),
        needs="reversals",
    )


def _of_position(at: _At, position: str) -> Iterator[Effect]:
    unit = quotient(at.state_unit, "1/s")
    reach = at.span * at.time
    stiffness = quotient(at.unit, unit)
    yield at.effect(
        "stiffness",
        f"A spring pulls {position} back to 0.",
        f"w = −k·{position}",
        "Hooke's law",
        lambda m, p: at.against(p.coefficient * m[position]),
        (either_sign("coefficient", stiffness, 0.05 * at.size / reach, "k"),),
        f"The driving force must increase with {position}; oscillations are faster.",
        confused=("cubic_stiffness",),
    )
    yield at.effect(
        "cubic_stiffness",
        f"A spring becomes stiffer, or softer, with {position}.",
        f"w = −k·{position}³",
        "Duffing's equation: Nayfeh & Mook, Nonlinear Oscillations",
        lambda m, p: at.against(p.coefficient * m[position] ** 3),
        (either_sign("coefficient", quotient(at.unit, unit, unit, unit), 0.05 * at.size / reach**3, "k"),),
        "Large oscillations have a different period from small ones.",
        confused=("stiffness",),
        needs="swings of several sizes",
    )


def _of_store(at: _At) -> Iterator[Effect]:
    name = at.role.state.name
    around = at.role.surroundings or ("where it starts" if at.role.reference else "0")
    base = (
        f"({name} − {at.role.surroundings})"
        if at.role.surroundings
        else (f"({name} − {at.role.reference:g})" if at.role.reference else name)
    )
    yield at.effect(
        "leak",
        f"A loss of {name} is proportional to its excess over {around}.",
        f"w = −k·{base}",
        _INCROPERA + ": linear loss",
        lambda m, p: at.against(p.coefficient * at.above(m)),
        (one_sign("coefficient", quotient(at.unit, at.state_unit), 0.05 * at.size / at.span, "k"),),
        f"{name} does not rise as far as it should, in proportion.",
        confused=("power_law", "offset", "threshold"),
    )

    # k·x·|x/span|^(n − 1) instead of k·|x|^n: odd in x, and k has the unit of the linear loss whatever the
    # exponent, with the same loss at x = span.
    def power_law(m: Scope, p: Own) -> Scalar:
        x = at.above(m)
        relative = absolute(x, constant_like(at.role.state.scale, x)) / constant_like(at.span, x)
        return at.against(p.coefficient * x * power(relative, p.exponent - 1.0))

    yield at.effect(
        "power_law",
        f"A loss of {name} is proportional to a power of its excess over {around}.",
        f"w = −k·x·|x/{at.span:.3g} {at.state_unit}|^(n − 1), x = {base}",
        _INCROPERA + ": free convection has n = 5/4; " + _FLOW + ": an orifice has n = 1/2",
        power_law,
        (
            either_sign("coefficient", quotient(at.unit, at.state_unit), 0.05 * at.size / at.span, "k"),
            shape("exponent", "1", 2.0, "n", grid=(0.5, 1.3, 3.0), low=0.25, high=6.0),
        ),
        f"High values of {name} deviate from a proportional loss, and low ones in the opposite direction.",
        confused=("leak", "threshold"),
        becomes=(("exponent", 1.0, "leak"),),
        needs="several levels",
    )

    def threshold(m: Scope, p: Own) -> Scalar:
        x = at.x(m)
        above = beyond(x, p.limit, constant_like(CORNER * at.span, x)) / constant_like(at.span, x)
        return at.against(p.size * power(above, p.exponent))

    yield at.effect(
        "threshold",
        f"Above a limit {name} overflows, or a valve opens.",
        f"w = −k·(max(0, {name} − limit)/{at.span:.3g} {at.state_unit})^n",
        "characteristic of a relief valve (n = 1) and of a weir (n = 3/2): " + _FLOW,
        threshold,
        (
            one_sign("size", at.unit, 0.5 * at.size, "k"),
            _limit(at),
            shape("exponent", "1", 1.0, "n", low=1.0, high=3.0),
        ),
        f"{name} follows the model up to a limit, and stays there.",
        confused=("power_law", "leak"),
        needs="values above the limit",
    )
    yield _storage(at)


def _limit(at: _At) -> EffectParameter:
    typical = at.role.state.start + 0.5 * at.span
    far = 100.0 * at.span + abs(typical)
    return shape(
        "limit",
        at.state_unit,
        typical,
        "where it begins",
        within=at.role.state.name,
        shares=(0.2, 0.4, 0.6, 0.75, 0.9),
        low=-far,
        high=far,
        difference=at.role.state.difference,
    )


def _storage(at: _At) -> Effect:
    name = at.role.state.name

    # The second store y₂ obeys τ·dy₂/dt = s − y₂. Its state is the difference y = s − y₂, which is 0 in
    # steady state, hence right at the start of a record that begins at rest: dy/dt = ds/dt − y/τ. `m.rate`
    # contains this term itself only through y, so there is no algebraic loop.
    def rate(m: Scope, p: Own) -> Scalar:
        return m.rate(name) - p.difference / p.time

    return at.effect(
        "storage",
        f"A second store absorbs a part of {name} and returns it with a delay.",
        f"w = −C·y/τ, dy/dt = d{name}/dt − y/τ",
        _INCROPERA + ": two lumps in series",
        lambda m, p: at.against(p.capacity * p.difference / p.time),
        (
            one_sign(
                "capacity",
                quotient(at.unit, quotient(at.state_unit, "s")),
                0.1 / at.role.gain,
                "C; where the slot is the rate itself, as a share of the first store",
            ),
            shape(
                "time",
                "s",
                at.time,
                "τ, until the second store follows",
                grid=(0.1 * at.time,),
                within="time",
                shares=(0.02, 0.1, 0.3),
            ),
        ),
        f"{name} changes fast at first and slowly afterwards, as with two time constants.",
        states=(
            EffectState(
                "difference", at.state_unit, at.role.state.scale, rate, f"y, {name} less the second store"
            ),
        ),
        confused=("leak",),
        needs="changes that are followed for long",
    )


def _offset(at: _At) -> Effect:
    return at.effect(
        "offset",
        f"A constant rate is added to {at.role.state.name}.",
        "w = c",
        "constant disturbance",
        lambda m, p: p.size,
        (either_sign("size", at.unit, 0.05 * at.size, "c"),),
        "Everything is shifted in the same direction, whatever the command.",
        confused=("drift", "coulomb" if at.role.moves else "leak"),
    )


def _drift(at: _At) -> Effect:
    return at.effect(
        "drift",
        f"The rate of {at.role.state.name} drifts with time.",
        "w = k·t",
        "first term of a slow change",
        lambda m, p: p.rate * p.elapsed,
        (either_sign("rate", quotient(at.unit, "s"), 0.01 * at.size / at.time, "k"),),
        "The error increases during a record.",
        states=(EffectState("elapsed", "s", 1.0, lambda m, p: 1.0, "time since the record began"),),
        confused=("offset",),
        needs="long records",
    )
