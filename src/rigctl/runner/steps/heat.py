"""`heat`: bring the oil to a temperature and let it settle there."""

from __future__ import annotations

from contextlib import suppress

from rigctl.backends.errors import OutOfReach
from rigctl.procedure.actions import Heat
from rigctl.runner.bench import Bench
from rigctl.runner.outcomes import Outcome, StepFailed
from rigctl.runner.smoothing import Settling
from rigctl.runner.steps.seen import reading
from rigctl.runner.waits import Behaviour, Until, every_sample


def heat(action: Heat, bench: Bench) -> Behaviour:
    """Switch the heater with hysteresis until the mean reading has been within tolerance for `settle` s.

    Oil that is too hot cools by itself. The heater is off when the step is over, however it ends.

    Raises
    ------
    StepFailed
        it did not settle within `timeout` s; says what was seen.
    """
    column = bench.columns[action.channel]
    settling = Settling(action.to, action.within, action.settle)
    heater = _Thermostat(action, bench)
    give_up = bench.now + action.timeout
    row = yield from bench.fresh()
    try:
        bench.regulated.add(action.actuator)
        while not settling.add(row[0], row[column]):
            heater.regulate(row[0], settling.mean)
            sample = yield Until(give_up, every_sample)
            if sample is None:
                raise StepFailed(_gave_up(action, bench, settling), outcome=Outcome.TIMED_OUT)
            row = sample
    finally:
        heater.off()
    return Outcome.COMPLETE


class _Thermostat:
    """On below the band, off at the set-point, unchanged between; no faster than the actuator allows.

    The band lies below the set-point: a pump heats its oil too, and what heats on by itself would carry a
    reading that is at the upper end of a band out of the tolerance before it has settled.
    """

    def __init__(self, action: Heat, bench: Bench) -> None:
        actuator = bench.rig.actuators[action.actuator]
        role = bench.rig.roles.heat
        own = role.hysteresis if role is not None else None
        self._band = min(0.5 * action.within if own is None else float(own), action.within)
        self._bench = bench
        self._action = action
        self._on = float(actuator.high) if actuator.high is not None else 1.0
        self._off = bench.safe_value(action.actuator)
        self._rest = actuator.min_interval
        self._next_switch = -1.0  # s; until then the reading may still change what is wanted

    def regulate(self, time: float, mean: float) -> None:
        """Decide by the mean reading."""
        if mean < self._action.to - self._band:
            wanted = self._on
        elif mean >= self._action.to:
            wanted = self._off
        else:
            return
        bench, name = self._bench, self._action.actuator
        ready = max(self._next_switch, bench.rested_at(name, wanted))
        if time >= ready and not bench.is_at(name, wanted):
            with suppress(OutOfReach):  # by the next sample it may be back
                bench.switch(name, wanted)
                self._next_switch = time + self._rest

    def off(self) -> None:
        """Leave it off."""
        self._bench.regulated.discard(self._action.actuator)
        self._bench.release(self._action.actuator)


def _gave_up(action: Heat, bench: Bench, settling: Settling) -> str:
    def shown(value: float) -> str:
        return reading(bench, action.channel, value)

    tolerance = reading(bench, action.channel, action.within, difference=True)
    return (
        f"{action.channel} did not settle at {shown(action.to)} ± {tolerance} within {action.timeout:g} s: "
        f"it was {shown(settling.mean)}, lowest {shown(settling.lowest)}, highest {shown(settling.highest)}"
    )
