"""Translates between the rig's SI values and the board's counts, bits and words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import comb

from rigctl.backends.arduino.messages import Reading
from rigctl.backends.arduino.wiring import Wiring
from rigctl.plan.loop import LoopSettings
from rigctl.rig import Rig

_LONGEST_PULSE = 60.0  # longest pulse timed by the board, s
_FULL = 1023  # counts of the PWM
_EVENT_KINDS = {"heater": "H", "valve": "V", "pressure": "P"}
_OUTPUT_OF_KIND = {kind: output for output, kind in _EVENT_KINDS.items()}
_VALVE_WORDS = {-1: "RET", 0: "OFF", 1: "EXT"}
_COEFFICIENTS = 4  # coefficients of the calibration polynomial in the board's loop: degree 3
_ANY = 1e38  # beyond any possible reading


class Translation:
    """The rig's channels and actuators on a board with a given wiring."""

    def __init__(self, rig: Rig, wiring: Wiring) -> None:
        self._rig = rig
        self._wiring = wiring
        self._sensors = tuple(zip(rig.channels.values(), wiring.inputs, strict=True))

    def event_kind(self, actuator: str) -> str:
        """Return the letter of an actuator's switch reports."""
        return _EVENT_KINDS[self._wiring.output_of(actuator)]

    def actuator_of(self, event_kind: str) -> str | None:
        """Return the actuator of a reported switch; None if the output is not connected."""
        return self._wiring.outputs.get(_OUTPUT_OF_KIND.get(event_kind, ""))

    def times_pulse(self, actuator: str, duration: float) -> bool:
        """Return whether the board itself times a pulse of `duration` s."""
        return self._wiring.output_of(actuator) == "valve" and duration <= _LONGEST_PULSE

    def raw(self, actuator: str, value: float) -> int:
        """Return the board's number for an SI value."""
        part = self._rig.actuators[actuator]
        if part.kind != "level":
            return int(value)
        low, high = float(part.low or 0.0), float(part.high or 0.0)
        return round(_FULL * (value - low) / (high - low))

    def value(self, actuator: str, raw: int) -> float:
        """Return the SI value of the board's number."""
        part = self._rig.actuators[actuator]
        if part.kind != "level":
            return float(raw)
        low, high = float(part.low or 0.0), float(part.high or 0.0)
        return low + raw / _FULL * (high - low)

    def text(self, actuator: str, value: float, duration: float | None) -> str:
        """Return the command that switches an actuator."""
        output, raw = self._wiring.output_of(actuator), self.raw(actuator, value)
        if output == "heater":
            return f"OUTP:HEAT {'ON' if raw else 'OFF'}"
        if output == "pressure":
            return f"SOUR:PRES {raw}"
        pulse = f",{duration * 1e3:.3f}" if duration is not None and raw else ""
        return f"VALV {_VALVE_WORDS[raw]}{pulse}"

    def safe_texts(self) -> tuple[str, ...]:
        """Return the commands for outputs whose safe value is not off; `OUTP:SAFE` covers the others."""
        actuators = self._rig.actuators
        return tuple(
            self.text(name, float(value), None)
            for name, value in self._rig.safe_state.items()
            if actuators[name].by == "driven" and self.raw(name, float(value)) != 0
        )

    def values(self, reading: Reading) -> tuple[float, ...]:
        """Return the channels' SI values, in the order of the rig's layout."""
        return tuple(
            channel.value_from_raw(channel.converter.low + reading.counts[pin] * channel.converter.step)
            for channel, pin in self._sensors
        )

    # --- the closed loop ----------------------------------------------------------------------------------

    def is_pwm(self, actuator: str) -> bool:
        """Return whether an actuator is the level on the board's PWM."""
        return self._wiring.outputs.get("pressure") == actuator

    def calibration(self, channel: str) -> tuple[float, ...]:
        """Return the polynomial from the converter's counts to a channel's SI value, lowest power first."""
        described = self._rig.channels[channel]
        low, step = described.converter.low, described.converter.step
        raw = described.si_coefficients  # of a polynomial in low + step*counts
        found = tuple(
            step**power * sum(raw[k] * comb(k, power) * low ** (k - power) for k in range(power, len(raw)))
            for power in range(len(raw))
        )
        degree = max((power for power, value in enumerate(found) if value != 0.0), default=0)
        return found[: degree + 1]

    def loop_numbers(self, loop: LoopSettings) -> Iterator[tuple[str, float]]:
        """Return the settings of the board's loop, SI, by their names in the protocol."""
        channel, part = self._rig.channels[loop.channel], self._rig.actuators[loop.actuator]
        calibration = self.calibration(loop.channel)
        for power in range(_COEFFICIENTS):
            yield f"C{power}", calibration[power] if power < len(calibration) else 0.0
        low, high = channel.range or (-_ANY, _ANY)
        yield from (("RLO", float(low)), ("RHI", float(high)))
        yield from (("ZERO", float(part.low or 0.0)), ("FULL", float(part.high or 0.0)))
        yield from (("TO", loop.to), ("RAMP", loop.ramp), ("FF", loop.ahead))
        yield from (("KP", loop.gain), ("KI", loop.integral), ("KD", loop.derivative))
        yield from (("TF", loop.filter_time), ("TT", loop.tracking_time))
        yield from (("LOW", loop.low), ("HIGH", loop.high), ("RATE", loop.rate))

    def loop_texts(self, loop: LoopSettings) -> Iterator[str]:
        """Return the commands for the settings of the board's loop."""
        names = list(self._rig.layout.channels)
        yield f"CONT:INP {self._wiring.inputs[names.index(loop.channel)]}"
        yield f"CONT:PER {round(loop.period * 1e3)}"
        for name, value in self.loop_numbers(loop):
            yield f"CONT:PAR {name},{loop_number(value)}"

    # --- readings -----------------------------------------------------------------------------------------

    def states(self, outputs: int, pwm: int) -> dict[str, float]:
        """Return the SI values of the connected outputs, from their bits and the PWM's counts."""
        counts = {"heater": outputs & 1, "valve": (outputs >> 1 & 1) - (outputs >> 2 & 1), "pressure": pwm}
        return {name: self.value(name, counts[output]) for output, name in self._wiring.outputs.items()}

    def commands(self, reading: Reading, commanded: Mapping[str, float]) -> tuple[float, ...]:
        """Return the outputs at the time of the reading; a level as last set."""
        bits, wired = reading.outputs, self._wiring.outputs
        now = dict(commanded)
        if "heater" in wired:
            now[wired["heater"]] = float(bits & 1)
        if "valve" in wired:
            now[wired["valve"]] = float((bits >> 1 & 1) - (bits >> 2 & 1))
        if "pressure" in wired and reading.pwm is not None:
            now[wired["pressure"]] = self.value(wired["pressure"], reading.pwm)
        elif "pressure" in wired and not bits & 8:
            now[wired["pressure"]] = self.value(wired["pressure"], 0)
        return tuple(now[name] for name in self._rig.layout.commands)


def loop_number(value: float) -> str:
    """Format a number for the board's loop, with more digits than its 24 bits."""
    return f"{value:.9G}"
