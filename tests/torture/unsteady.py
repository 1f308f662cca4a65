"""Beside a random ending: a loose contact while a temperature rises to its limit, or a restart.

Loose contact: from a time on every second, third, fourth or sixth reading is impossible, and the others rise
beyond the limit that stops the run. Restart: outputs go to their power-on values, which may be on; the device
says nothing or sends its greeting, at once or after some silence.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bench_stand import Stand
from rigctl.rig import Rig
from tclab_board import VERSION

#: what is beside a random ending
BESIDE = ("intermittent", "restart")
_THERMOMETERS = {"simulated": "oil_temperature", "emulated": "oil_temperature", "lines": "temperature_1"}
#: K below its limit, where the temperature begins to rise
_BELOW = 4.0
#: number of samples that a limit may take to notice, and s between two of them: between records, or of lines
_SAMPLES, _PERIOD = 3, {"simulated": 0.1, "emulated": 0.1, "lines": 0.5}


@dataclass(frozen=True)
class LooseContact:
    """A thermometer with a loose contact.

    Parameters
    ----------
    every: which reading is impossible: 2 is every second one.
    rise: K/s.
    """

    channel: str
    begin: float
    every: int
    rise: float

    @classmethod
    def drawn(cls, seed: str, kind: str, begin: float) -> LooseContact:
        rng = random.Random(f"{seed} intermittent")
        return cls(_THERMOMETERS[kind], begin, rng.choice((2, 3, 4, 6)), rng.uniform(2.0, 20.0))

    def rig(self, rig: Rig) -> Rig:
        """Without limits of the rate, which would trip before the one of the temperature."""
        kept = {name: one for name, one in rig.limits.items() if not one.of_rate}
        return rig.model_copy(update={"limits": kept})

    def due(self, rig: Rig, kind: str) -> tuple[float, float]:
        """When the limit is exceeded, and how long the run may go on then, s: there are also no values."""
        (limit,) = (
            one
            for one in rig.limits.values()
            if one.channel == self.channel and one.action == "stop" and one.bound == "above"
        )
        exceeded = self.begin + _BELOW / self.rise
        late = _SAMPLES * _PERIOD[kind] + 2.0 * limit.for_
        no_value = self.begin + 5.0 * rig.stale_after + _SAMPLES * _PERIOD[kind] - exceeded
        return exceeded, min(late, no_value) if self.every <= 4 else late

    def wrap(self, bench: Any, rig: Rig, impossible: list[float]) -> None:
        """Let the bench give such readings; the times of the impossible ones are noted."""
        next_sample, count = bench.next_sample, 0
        index = list(rig.layout.channels).index(self.channel)
        limit = min(
            one.threshold
            for one in rig.limits.values()
            if one.channel == self.channel and one.action == "stop"
        )
        low, _ = rig.channels[self.channel].band

        def given(timeout: float) -> Any:
            nonlocal count
            sample = next_sample(timeout)
            if sample is None or sample.time < self.begin:
                return sample
            count += 1
            values = list(sample.values)
            values[index] = limit - _BELOW + self.rise * (sample.time - self.begin)
            values[index] = min(values[index], rig.channels[self.channel].band[1])
            if count % self.every == 0:
                values[index] = low - 10.0
                impossible.append(sample.time)
            return type(sample)(sample.time, tuple(values), sample.commands)

        bench.next_sample = given


@dataclass(frozen=True)
class Restart:
    """A restart of the two-heater board.

    Parameters
    ----------
    power_on: % of both heaters afterwards.
    silent: s for which it starts.
    greets: whether it then sends its identity.
    """

    begin: float
    power_on: tuple[float, float]
    silent: float
    greets: bool

    @classmethod
    def drawn(cls, seed: str, begin: float) -> Restart:
        rng = random.Random(f"{seed} restart")
        power_on = rng.choice(((0.0, 0.0), (0.0, 0.0), (30.0, 0.0), (0.0, 100.0)))
        return cls(begin, power_on, rng.choice((0.0, rng.uniform(0.1, 3.0))), rng.random() < 0.5)

    def arrange(self, stand: Stand, restarted: Callable[[float], None]) -> None:
        """Let it happen; `restarted` is told when."""

        def restart() -> None:
            if stand.port is None:
                return
            sketch, now = stand.port.sketch, stand.clock.now()
            before = sketch.heaters
            sketch.reset()
            sketch.model._Q1, sketch.model._Q2 = self.power_on
            for name, old, new in zip(("heater_1", "heater_2"), before, self.power_on, strict=True):
                if old != new:
                    stand.seen.append((now, name, new / 100.0))
            restarted(now)
            stand.port._coming.clear()
            stand.port.mute = self.silent > 0.0
            if not self.silent:
                up()

        def up() -> None:
            if stand.port is not None:
                stand.port.mute = False
                if self.greets:
                    stand.port.send_unasked(f"{VERSION}\r\n".encode())

        stand.clock.at(self.begin, restart)
        if self.silent:
            stand.clock.at(self.begin + self.silent, up)
