"""The emulated board connected to the simulated bench: it reads the sensors and drives the actuators."""

from __future__ import annotations

from collections import deque

from rigctl.backends.arduino.wiring import BITS, Wiring
from rigctl.backends.emulated.avr import FREQUENCY, SUPPLY_MV, Avr
from rigctl.backends.simulated.device import Device
from rigctl.rig import Rig

SLICE = 1e-3  #: s between two readings of the sensors
_BOOT = 0.02  # s after power-on until the board can receive
_LAST = (1 << BITS) - 1
_HEATER, _EXTEND, _RETRACT = ("D", 4), ("D", 7), ("B", 0)


class EmulatedBoard:
    """Firmware and simulated bench, advanced together.

    The microcontroller runs one slice with constant inputs; its output changes, with their exact cycles, are
    then passed to the bench, which is advanced to the same time.

    Parameters
    ----------
    program: the firmware.
    device: the simulated bench; its time starts with the board's.

    Attributes
    ----------
    valve_times: times at which a solenoid was switched, exact to the cycle, s.
    shorted: True once both solenoids have been on at the same time, which the firmware must prevent.
    """

    def __init__(self, rig: Rig, wiring: Wiring, program: bytes, device: Device) -> None:
        self._rig = rig
        self._wiring = wiring
        self._edges: list[tuple[int, tuple[str, int], bool]] = []
        self.avr = Avr(
            program, lambda port, bit, level, cycle: self._edges.append((cycle, (port, bit), level))
        )
        self.device = device
        self._levels = {_HEATER: False, _EXTEND: False, _RETRACT: False}
        self._resets = 0
        self._pwm = 0.0
        self.shorted = False
        self.valve_times: deque[float] = deque(maxlen=16)
        self._measure()
        self.run_to(_BOOT)

    @property
    def time(self) -> float:
        """Time since power-on, s."""
        return self.avr.cycle / FREQUENCY

    @property
    def outputs(self) -> tuple[bool, bool, bool]:
        """Whether the heater, the solenoid that extends and the one that retracts are on."""
        return self._levels[_HEATER], self._levels[_EXTEND], self._levels[_RETRACT]

    def run_to(self, time: float) -> None:
        """Run firmware and bench up to `time`, s."""
        end, step = round(time * FREQUENCY), round(SLICE * FREQUENCY)
        while self.avr.cycle < end:
            self.avr.run_to(min(self.avr.cycle + step, end))
            self._follow()
            self._measure()

    def close(self) -> None:
        """Switch the board off."""
        self.avr.close()

    def _follow(self) -> None:
        """Apply the board's outputs to the bench."""
        if self.avr.resets != self._resets:  # a reset makes every pin an input, which simavr does not report
            self._resets = self.avr.resets
            self._edges += [(self.avr.cycle, pin, False) for pin in self._levels]
        for cycle, pin, level in self._edges:
            if pin in self._levels and self._levels[pin] != level:
                self._levels[pin] = level
                self._switch(cycle / FREQUENCY, pin)
        self._edges.clear()
        self._follow_pwm()
        self.device.run_to(max(self.time, self.device.time))

    def _switch(self, time: float, pin: tuple[str, int]) -> None:
        heater, extend, retract = self.outputs
        self.shorted |= extend and retract
        output, value = (
            ("heater", float(heater)) if pin == _HEATER else ("valve", float(extend) - float(retract))
        )
        actuator = self._wiring.outputs.get(output)
        if output == "valve":
            self.valve_times.append(time)
        if actuator is not None:
            self.device.command(actuator, value, time, None)

    def _follow_pwm(self) -> None:
        actuator = self._wiring.outputs.get("pressure")
        if actuator is None or self._pwm == self.avr.pwm:
            return
        self._pwm = self.avr.pwm
        part = self._rig.actuators[actuator]
        low, high = float(part.low or 0.0), float(part.high or 1.0)
        self.device.command(actuator, low + self._pwm * (high - low), self.time, None)

    def _measure(self) -> None:
        """Apply the sensors' signals to the analog inputs."""
        channels = self._rig.channels.values()
        for channel, pin, value in zip(channels, self._wiring.inputs, self.device.read(), strict=True):
            converter = channel.converter
            raw = channel.raw_from_value(value) if value == value else converter.low  # noqa: PLR0124 - NaN
            code = round((raw - converter.low) / converter.step)
            self.avr.put_voltage(pin, millivolt(code))


def millivolt(code: int) -> int:
    """Return the lowest voltage that the converter reads as `code`."""
    return -(-min(max(code, 0), _LAST) * SUPPLY_MV // _LAST)
