"""The simulated device: board, actuators, plant and sensors, without host and clock."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

from rigctl.backends.protocol import CommandReceipt, Notice
from rigctl.backends.simulated.failures import SENSOR_FAILURES
from rigctl.backends.simulated.faults import Fault, seized_by
from rigctl.backends.simulated.imperfections import Imperfections, Purpose
from rigctl.backends.simulated.outputs import Outputs
from rigctl.backends.simulated.plant import Plant
from rigctl.backends.simulated.schedule import Schedule
from rigctl.backends.simulated.sensors import Sensors
from rigctl.rig import Rig

#: s without the host after which the board makes its outputs safe
WATCHDOG = 2.0


class Device:
    """A simulation of the bench by events at exact times, in s since it was switched on.

    The plant is advanced from event to event (switches, ends of pulses, the operator's actions, faults), so
    that a pulse has exactly its commanded duration, independently of the samples.
    """

    def __init__(
        self, rig: Rig, plant: Plant, initial_commands: Mapping[str, float], flaws: Imperfections
    ) -> None:
        self._rig = rig
        self._plant = plant
        self._flaws = flaws
        self._sensors = Sensors(
            rig, flaws.generator(Purpose.SENSORS), noise=flaws.noise, quantised=flaws.quantised
        )
        settings = flaws.generator(Purpose.SETTINGS)
        self._outputs = Outputs(rig, plant, initial_commands, settings, flaws.scatter)
        self._schedule = Schedule()
        self._idle: set[str] = set()  # actuators that drive nothing, as was reported
        self._pulse_ends: dict[str, int] = {}
        self.time = 0.0
        self.receipts: list[CommandReceipt] = []
        self.notices: list[Notice] = []
        for fault in flaws.faults:
            self._schedule.add(fault.begin, partial(self._begin, fault))
            if math.isfinite(fault.end):
                self._schedule.add(fault.end, partial(self._finish, fault))

    @property
    def next_event(self) -> float:
        """Time of the next event, s; infinite if there is none."""
        return self._schedule.next_time

    def run_to(self, time: float) -> None:
        """Carry out all events up to and including `time`."""
        schedule, plant = self._schedule, self._plant
        while schedule.next_time <= time:
            due, action = schedule.take()
            plant.advance(due)
            self.time = due
            action(due)
        plant.advance(time)
        self.time = time

    def read(self) -> tuple[float, ...]:
        """Return the present readings of the sensors, SI, in the order of the rig's layout."""
        for text in self._plant.take_departures():
            self.notices.append(Notice(self.time, "note", text, {"warning": "outside_validity"}))
        return self._sensors.read(self._plant.read())

    @property
    def commands(self) -> tuple[float, ...]:
        """Return the present commands of the actuators, SI, in the order of the rig's layout."""
        return self._outputs.row

    def command(self, actuator: str, value: float, at: float, duration: float | None) -> float:
        """Schedule a switch at time `at`, or now if that has passed; an operator responds after a delay.

        With `duration`, s, the actuator then returns to its safe value. Returns the time of the switch.
        """
        when = max(at, self.time)
        if self._rig.actuators[actuator].by == "operator":
            when += self._flaws.answer_delay
        self._schedule.add(when, partial(self._switch, actuator, value, duration), commanded=True)
        return when

    def make_safe(self, time: float) -> None:
        """Switch every driven actuator to its safe value at `time`, and drop all other commands."""
        self._schedule.drop_commands()
        self._pulse_ends.clear()
        for actuator, value in self._rig.safe_state.items():
            if self._rig.actuators[actuator].by != "operator":
                self.command(actuator, float(value), time, None)

    def _switch(self, actuator: str, value: float, duration: float | None, time: float) -> None:
        pending = self._pulse_ends.pop(actuator, None)
        if pending is not None:
            self._schedule.drop(pending)
        self._note_idle(actuator, value)
        self._outputs.switch(actuator, value)
        if duration is not None:
            end = partial(self._end_pulse, actuator)
            self._pulse_ends[actuator] = self._schedule.add(time + duration, end, commanded=True)

    def _note_idle(self, actuator: str, value: float) -> None:
        """Report once that an actuator that leaves its safe value has no effect on any channel."""
        if (
            actuator in self._idle
            or value == self._rig.safe_state.get(actuator)
            or self._plant.drives(actuator)
        ):
            return
        self._idle.add(actuator)
        text = f"'{actuator}' drives nothing in this simulation: no channel will answer to it"
        self.notices.append(Notice(self.time, "note", text, {"warning": "drives_nothing"}))

    def _end_pulse(self, actuator: str, time: float) -> None:
        del self._pulse_ends[actuator]
        value = float(self._rig.safe_state[actuator])
        self._outputs.switch(actuator, value)
        self.receipts.append(CommandReceipt(time, actuator, value))

    def _begin(self, fault: Fault, time: float) -> None:
        self.notices.append(Notice(time, "fault", f"injected fault begins: {fault}", {"fault": fault.kind}))
        if fault.kind in SENSOR_FAILURES and fault.channel:
            self._sensors.by_name[fault.channel].failure = SENSOR_FAILURES[fault.kind]()
        for actuator, value in seized_by(fault, self._rig).items():
            self._outputs.seize(actuator, value)
        if fault.kind == "backend_lost" and fault.end - fault.begin > WATCHDOG:
            self._schedule.add(time + WATCHDOG, self.make_safe)

    def _finish(self, fault: Fault, time: float) -> None:
        self.notices.append(Notice(time, "fault", f"injected fault ends: {fault}", {"fault": fault.kind}))
        if fault.kind in SENSOR_FAILURES and fault.channel:
            self._sensors.by_name[fault.channel].failure = None
        for actuator in seized_by(fault, self._rig):
            self._outputs.free(actuator)
