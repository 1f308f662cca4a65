"""`heat`: bring the oil to a temperature and let it settle.

The file has what belongs to this step: its fields in a procedure (`HeatFields`, `HeatStep`), its forecast
for the preview, and its behaviour on the bench (`Heat`, with the thermostat that switches the heater).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

from pydantic import Field

from rigctl.plan.action import Action, SetPoint
from rigctl.plan.behaviour import Behaviour, StepBench, Until, every_sample
from rigctl.plan.context import Context
from rigctl.plan.fields import ProcedurePart, Short
from rigctl.plan.forecast import Basis, Forecast, ForecastBench, OilTank, State
from rigctl.plan.outcomes import Outcome, StepFailed
from rigctl.plan.setpoints import check_set_point
from rigctl.plan.step import Step
from rigctl.plan.tree import Leaf
from rigctl.plan.value_text import shown_time
from rigctl.plan.values import (
    DURATION,
    PERIOD,
    TEMPERATURE_TOLERANCE,
    Duration,
    Period,
    Temperature,
    TemperatureTolerance,
)
from rigctl.steps.settling import Settling, check_settling
from rigctl.units import show


class HeatFields(ProcedurePart):
    """The temperature is reached when it has stayed within the tolerance for `settle`."""

    to: Temperature = Field(description="the desired temperature")
    within: TemperatureTolerance = Field(
        default=TEMPERATURE_TOLERANCE.read("0.5 K"), description="half width of the tolerance"
    )
    settle: Period = Field(
        default=PERIOD.read("60 s"), description="how long the temperature must stay within the tolerance"
    )
    timeout: Duration = Field(default=DURATION.read("2 h"), description="after which the step fails")


class HeatStep(Step):
    """Heat the oil, or wait until it has cooled."""

    verb: ClassVar[str] = "heat"
    example: ClassVar[str] = "- heat: {to: 40 degC, within: 0.5 K, settle: 60 s, timeout: 2 h}\n"
    heat: Annotated[HeatFields, Short("to")]

    def build(self, context: Context) -> Leaf:
        """Return a `Heat` with the actuator and channel of the rig's role."""
        role = context.heat_role()
        fields = self.heat
        to = context.si(fields.to, "heat", "to")
        with context.located("heat", "to"):
            check_set_point(context.rig, role.channel, to)
        action = Heat(
            actuator=role.actuator,
            channel=role.channel,
            to=to,
            within=context.si(fields.within, "heat", "within"),
            settle=context.si(fields.settle, "heat", "settle"),
            timeout=context.si(fields.timeout, "heat", "timeout"),
        )
        check_settling(context, "heat", action.settle, action.timeout)
        unit = context.rig.channels[role.channel].unit
        label = (
            f"heat to {show(action.to, unit)} ± {show(action.within, 'K', difference=True)}, "
            f"settle {shown_time(action.settle)}"
        )
        return context.leaf(label, action)


@dataclass(frozen=True, slots=True)
class Heat(Action):
    """Bring the oil to `to` and keep it there, ± `within`, for `settle` seconds.

    If the oil is too cold, the heater is switched with the role's hysteresis; if it is too hot, the step
    waits for natural cooling.
    """

    actuator: str
    channel: str
    to: float  #: K, absolute
    within: float  #: K, half width of the tolerance
    settle: float  #: s within the tolerance before the step is done
    timeout: float  #: s until the step fails

    def forecast(self, state: State, bench: ForecastBench) -> Forecast:
        """Forecast the time to reach the tolerance, plus the settling time."""
        if bench.tank is None or state.temperature is None:
            return self._at_most(state)
        return self._in_tank(bench.tank, state.temperature, state, bench)

    def _at_most(self, state: State, warning: str | None = None) -> Forecast:
        after = replace(state, temperature=self.to)
        return Forecast(self.timeout, Basis.AT_MOST, after, self._reaches, warning)

    @property
    def _reaches(self) -> dict[str, tuple[float, float]]:
        return {self.channel: (self.to - self.within, self.to + self.within)}

    def _in_tank(self, tank: OilTank, start: float, state: State, bench: ForecastBench) -> Forecast:
        low, high = self._reaches[self.channel]
        heating = start < low
        edge = low if heating else high
        approach = 0.0 if low <= start <= high else tank.time_to(edge, start, state.pressure, heating)
        total = approach + self.settle
        if math.isinf(approach):
            return self._at_most(state, self._never(tank, state, bench, heating))
        if total > self.timeout:
            begin, rounded = self._shown(start, bench), shown_time(float(f"{total:.2g}"))
            warning = f"takes about {rounded} from {begin}, but fails after {shown_time(self.timeout)}"
            return self._at_most(state, warning)
        reached = edge if approach > 0.0 else start
        settled = tank.after(reached, self.settle, state.pressure, heating=reached < self.to)
        drifted = tank.after(reached, self.settle, state.pressure, heating=False)
        past = None
        if drifted > high and reached >= self.to:
            past = f"the pump alone heats the oil past {self._shown(high, bench)} while it settles"
        role = bench.rig.roles.heat
        band = role.hysteresis if role is not None else None
        off_above = self.to + (0.5 * self.within if band is None else min(band, self.within))
        end = min(settled, max(off_above, drifted))
        return Forecast(total, Basis.ESTIMATED, replace(state, temperature=end), self._reaches, past)

    def _never(self, tank: OilTank, state: State, bench: ForecastBench, heating: bool) -> str:
        limit = tank.limit(state.pressure, heating)
        pressure = show(state.pressure, "bar", digits=3)
        what = "with the heater on, the oil gets no hotter" if heating else "the oil cools no further"
        return f"{what} than {self._shown(limit, bench)} at {pressure}"

    def _shown(self, temperature: float, bench: ForecastBench) -> str:
        return show(temperature, bench.rig.channels[self.channel].unit, digits=3)

    def set_point(self) -> SetPoint:
        """Return the desired temperature."""
        return SetPoint(self.channel, self.to, self.within)

    def carry_out(self, bench: StepBench) -> Behaviour:
        """Switch the heater with hysteresis until the mean reading has been within tolerance for `settle` s.

        Oil that is too hot cools by itself. The heater is off after the step, however it ends.

        Raises
        ------
        StepFailed
            the reading did not settle within `timeout` s; the message gives the readings.
        """
        column = bench.columns[self.channel]
        settling = Settling(self.to, self.within, self.settle)
        heater = _Thermostat(self, bench)
        give_up = bench.now + self.timeout
        # Before the `try`: until a reading is there, the heater has not been touched.
        row = yield from bench.fresh()
        try:
            bench.regulated.add(self.actuator)
            while not settling.add(row[0], row[column]):
                # By the mean: a single reading outside the band may be noise.
                heater.regulate(row[0], settling.mean)
                sample = yield Until(give_up, every_sample)
                if sample is None:
                    reason = settling.gave_up(bench, self.channel, self.timeout)
                    raise StepFailed(reason, outcome=Outcome.TIMED_OUT)
                row = sample
        finally:
            heater.off()
        return Outcome.COMPLETE

    def lasting(self) -> frozenset[str]:
        """Return the heater: its effect lasts beyond the step."""
        return frozenset({self.actuator})


class _Thermostat:
    """A two-position controller: on below its band, off from the set-point upwards, unchanged in between.

    It switches no more often than the actuator allows. The band lies below the set-point because the pump
    heats the oil as well: with a band around the set-point, a reading at its upper end would drift out of
    the tolerance before it had settled.
    """

    def __init__(self, action: Heat, bench: StepBench) -> None:
        actuator = bench.rig.actuators[action.actuator]
        role = bench.rig.roles.heat
        band = role.hysteresis if role is not None else None
        self._band = min(0.5 * action.within if band is None else float(band), action.within)
        self._bench = bench
        self._action = action
        self._on = float(actuator.high) if actuator.high is not None else 1.0
        self._off = bench.safe_value(action.actuator)
        self._rest = actuator.min_interval
        self._next_switch = -1.0  # earliest time of the next switch, s

    def regulate(self, time: float, mean: float) -> None:
        """Switch the heater, if necessary, according to the mean reading."""
        if mean < self._action.to - self._band:
            wanted = self._on
        elif mean >= self._action.to:
            wanted = self._off
        else:
            return
        bench, name = self._bench, self._action.actuator
        ready = max(self._next_switch, bench.rested_at(name, wanted))
        # Two rests: that of this thermostat, and that of the actuator since its last switch, whoever made it.
        due = time >= ready and not bench.is_at(name, wanted)
        if due and bench.try_switch(name, wanted):  # if the bench is out of reach, retried at the next sample
            self._next_switch = time + self._rest

    def off(self) -> None:
        """Switch the heater off, and leave it off."""
        self._bench.regulated.discard(self._action.actuator)
        self._bench.release(self._action.actuator)
