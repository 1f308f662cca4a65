"""The simulated bench as a backend, sampled on a regular grid of an injected clock.

In: calls of the runner, and a `Device` (plant, actuators, sensors, faults) that knows no clock. Out:
samples at exact times. This module is the line between the two: it maps bench time to the device's time,
takes samples on the grid, and plays a line that is dead for a while, with what a real backend does then:
samples are lost, and outputs are made safe before anything goes on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

from rigctl.backends.commands import check_command, driven_outputs
from rigctl.backends.errors import BackendLost, OutOfReach
from rigctl.backends.protocol import CommandReceipt, Notice, PendingCommand, Sample
from rigctl.backends.simulated.device import Device
from rigctl.backends.simulated.link import Link
from rigctl.clock import Clock
from rigctl.errors import RigctlError
from rigctl.rig import Rig

#: s; a sample's time and the end of a wait may be the same sum, rounded differently
_ROUNDING = 1e-9


class SimulatedBench:
    """A `Backend` for a simulated bench.

    A sample at time t shows the bench after all switches up to and including t. Samples are taken exactly at
    ``start + k/rate``; a late caller receives all of them. On a virtual clock, two runs with the same seed
    and the same calls have identical samples.

    Parameters
    ----------
    rig: the channels and actuators.
    clock: the clock for waits.
    switch_on: makes the device when the bench is opened, which may compile the plant.
    link: the times at which the line between host and bench is dead.
    identity: the identity of the bench.
    """

    timed = True
    without_host = "the simulated board switches off by itself after 2 s without its host"

    def __init__(
        self,
        rig: Rig,
        clock: Clock,
        switch_on: Callable[[], Device],
        link: Link,
        identity: Mapping[str, str],
    ) -> None:
        self.clock = clock
        self.identity: Mapping[str, str] = {"kind": "simulated", "name": rig.name, **identity}
        self._rig = rig
        self._switch_on = switch_on
        self._link = link
        self._device: Device | None = None
        self._origin = 0.0  # clock time at which the device was switched on
        self._rate = 0.0
        self._start = 0.0  # clock time of the grid's first sample
        self._index = 0  # number of the next sample on the grid
        self._missed = 0  # samples lost since the last one that arrived
        self._lost_at: float | None = None  # clock time of the loss of contact
        self._commanded: dict[str, float] = {}  # commands to driven actuators since they were last made safe
        self._notices: list[Notice] = []

    @property
    def outputs_read(self) -> frozenset[str]:
        """All driven outputs."""
        return driven_outputs(self._rig)

    @property
    def outputs_answered(self) -> frozenset[str]:
        """All driven outputs."""
        return driven_outputs(self._rig)

    def open(self) -> None:
        """Switch the device on; its time starts now."""
        self._device = self._switch_on()
        self._origin = self.clock.now()
        self._rate = 0.0

    def close(self) -> None:
        """Switch the device and all its outputs off."""
        self._device = None

    def start(self, rate: float) -> None:
        """Start sampling at `rate` Hz."""
        if not (math.isfinite(rate) and rate > 0.0):
            raise RigctlError("not a sampling rate", value=f"{rate:g} Hz", expected="e.g. '100 Hz'")
        device = self._opened()
        self._rate = rate
        self._start = max(self.clock.now(), self._origin + device.time)
        self._index = self._missed = 0

    def next_sample(self, timeout: float) -> Sample | None:
        """Return the next sample of the grid, as soon as the clock has reached it."""
        device = self._opened()
        deadline = self.clock.now() + timeout
        when = self._next_arriving(deadline)
        if when > deadline + _ROUNDING:
            self.clock.sleep_until(deadline)
            return None
        self.clock.sleep_until(when)
        self._index += 1
        # Only now, when the sample is fetched: commands given until here have acted at their own times.
        device.run_to(when - self._origin)
        if self._missed:
            self._report_gap(when, self._make_safe_again(device, when))
        return Sample(when, device.read(), device.commands)

    def command(self, actuator: str, value: float, *, duration: float | None = None) -> PendingCommand:
        """Switch an actuator now."""
        device = self._opened()
        check_command(self._rig, actuator, value, duration)
        when = device.command(actuator, value, self._reached() - self._origin, duration)
        if self._rig.actuators[actuator].by == "driven":
            self._commanded[actuator] = value
        return PendingCommand.answered(CommandReceipt(when + self._origin, actuator, value))

    def take_receipts(self) -> list[CommandReceipt]:
        """Return the ends of pulses since the last call."""
        device = self._opened()
        if device.next_event <= self.clock.now() - self._origin:
            self._catch_up(device)
        taken, device.receipts = device.receipts, []
        for receipt in taken:
            self._commanded[receipt.actuator] = receipt.value
        return [replace(receipt, time=receipt.time + self._origin) for receipt in taken]

    def take_notices(self) -> list[Notice]:
        """Return faults and gaps since the last call."""
        device = self._opened()
        taken = device.notices + self._notices
        device.notices, self._notices = [], []
        return [replace(notice, time=notice.time + self._origin) for notice in taken]

    def safe(self) -> None:
        """Bring every driven actuator to its safe value now."""
        device = self._opened()
        now = self.clock.now() - self._origin
        if not self._link.perfect and self._link.back_at(now) > now:
            raise _lost()
        device.make_safe(now)
        self._commanded.clear()
        self._catch_up(device)

    def _opened(self) -> Device:
        if self._device is None:
            raise BackendLost("the bench is not open")
        return self._device

    def _catch_up(self, device: Device) -> None:
        """Advance the device to now, unless an earlier sample has yet to be taken."""
        now = self.clock.now()
        # A sample that is due, but not fetched yet, has to show the bench at its own time.
        if self._rate == 0.0 or self._start + self._index / self._rate > now:
            device.run_to(max(device.time, now - self._origin))

    def _next_arriving(self, deadline: float) -> float:
        """Return the clock time of the next sample that is not lost, or of the first one after `deadline`.

        Raises
        ------
        BackendLost
            contact is lost for good before that.
        """
        if self._rate == 0.0:
            return math.inf
        when = self._start + self._index / self._rate
        if self._link.perfect:
            return when
        while when <= deadline and self._link.silent(when - self._origin):
            if math.isinf(self._link.back_at(when - self._origin)):
                self.clock.sleep_until(when)
                raise _lost()
            self._index += 1
            self._missed += 1
            if self._lost_at is None and self._link.back_at(when - self._origin) > when - self._origin:
                self._lost_at = when
            when = self._start + self._index / self._rate
        return when

    def _reached(self) -> float:
        """Return the current clock time; raises `OutOfReach` or `BackendLost` if there is no contact."""
        now = self.clock.now()
        if self._link.perfect:
            return now
        back = self._origin + self._link.back_at(now - self._origin)
        if math.isinf(back):
            raise _lost()
        if back > now:
            raise OutOfReach("the bench does not answer for the moment")
        return now

    def _make_safe_again(self, device: Device, when: float) -> list[str]:
        """Make actuators safe after a loss of contact, as a host does with a real bench that has returned.

        The time at which they were switched off is known only to lie within the loss.
        """
        if self._lost_at is None:
            return []
        for receipt in device.receipts:  # pulses that ended normally
            self._commanded[receipt.actuator] = receipt.value
        resting = {name: float(value) for name, value in self._rig.safe_state.items()}
        switched_off = [name for name, value in self._commanded.items() if value != resting.get(name, value)]
        now, half = when - self._origin, 0.5 * (when - self._lost_at)
        device.make_safe(now)
        device.run_to(now)
        device.receipts += [CommandReceipt(now - half, name, resting[name], half) for name in switched_off]
        self._commanded.clear()
        self._lost_at = None
        return switched_off

    def _report_gap(self, when: float, switched_off: list[str]) -> None:
        seconds = self._missed / self._rate
        message = f"{self._missed} samples missing before {when:.3f} s ({seconds:g} s)"
        fields: dict[str, object] = {"samples": self._missed}
        if switched_off:
            message += f"; meanwhile {', '.join(switched_off)} went to the safe state"
            fields["switched_off"] = switched_off
        self._notices.append(Notice(when - self._origin, "gap", message, fields))
        self._missed = 0


def _lost() -> BackendLost:
    return BackendLost(
        "the bench does not answer any more",
        hint="Its watchdog brings the outputs to the safe state; look at the cable and the supply",
    )
