"""Signals of a CAN bus as channels and actuators, through python-can and cantools.

`rigctl` makes a whole bench of the client below: polling, read-back, loss and return of the device, a guard.
Nobody on a bus acknowledges what a command means. It therefore counts only once the device's own message
shows it; commands are sent cyclically, so that the device can switch off when they stop.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from threading import Condition
from typing import Annotated, Any

from pydantic import Field

from rigctl import PluginBackend, PluginOptions, PluginOutput, PortLost, RigctlError
from rigctl.backends.transport.readback import as_written, is_near
from rigctl.errors import require_known
from rigctl.files.name import Name
from rigctl.files.quantity import Q

_CYCLE = 0.1  # s between two commands, where the file of the messages states none

Signal = Annotated[str, Field(pattern=r"^\w+\.\w+$", description="its message and name: Message.Signal")]


class Output(PluginOutput):
    """The signals of an actuator."""

    set: Signal
    state: Signal


class Options(PluginOptions):
    """`options` of a rig file with `kind: can`."""

    dbc: str = Field(min_length=1, description="the file of the messages, relative to the rig file")
    bus: dict[str, Any] = Field(default_factory=dict, description="further arguments of python-can's bus")
    max_age: Annotated[float, Q("s", positive=True)] = Field(
        default=1.0, description="the device is lost when a message has not come for so long"
    )
    channels: dict[Name, Signal] = Field(description="the signal of each channel")
    actuators: dict[Name, Output] = Field(default_factory=dict, description="those of each driven actuator")

    def client_settings(self, folder: Path) -> dict[str, Any]:
        """Return what the client is given, once all signals are known."""
        file = folder / self.dbc
        known = {f"{message.name}.{signal.name}" for message in _messages(file) for signal in message.signals}
        outputs = self.actuators.values()
        for name in (*self.channels.values(), *(s for one in outputs for s in (one.set, one.state))):
            require_known("signal", [name], sorted(known))
        return {**super().client_settings(folder), "dbc": str(file.absolute())}


def _messages(file: Path) -> list[Any]:
    from cantools.database import load_file
    from cantools.database.errors import Error

    try:
        return list(getattr(load_file(file), "messages", ()))
    except (OSError, UnicodeError, Error) as error:
        what = "the file of the messages cannot be read"
        raise RigctlError(what, value=str(file), hint=str(error)) from None


class CanClient:
    """A node on a bus, with the newest of each message that is read.

    Raises
    ------
    PortLost
        there is no bus, or nobody sends one of the messages.
    """

    def __init__(self, url: str, settings: Mapping[str, Any], until: float) -> None:
        import can

        self._name = url
        self._timeout, self._max_age = float(settings["timeout"]), float(settings["max_age"])
        self._outputs: Mapping[str, Mapping[str, str]] = settings["actuators"]
        # what is read, in the order of the answer, and the actuator whose state it is
        self._read = [(name, "") for name in settings["channels"].values()]
        self._read += [(one["state"], actuator) for actuator, one in self._outputs.items()]
        self._messages = {message.name: message for message in _messages(Path(settings["dbc"]))}
        frames = {name.partition(".")[0] for name, _ in self._read}
        self._frames = {(m.frame_id, m.is_extended_frame): m for m in map(self._messages.get, frames) if m}
        self._written: dict[str, str] = {}  # by actuator, the number as it was written
        self._commands: dict[str, dict[str, float]] = {}  # by message, what is sent
        self._tasks: dict[str, Any] = {}  # by message, what sends it
        self._news = Condition()  # of what follows, which the library's thread sets
        self._newest: dict[str, tuple[float, Mapping[str, Any]]] = {}  # by message: its time, s, and signals
        interface, _, channel = url.partition(":")
        try:
            self._bus: Any = can.Bus(interface=interface, channel=channel, **settings["bus"])
        except (can.CanError, OSError, ValueError, TypeError) as error:
            raise PortLost(f"{url}: the bus cannot be opened: {error}") from None
        self._notifier = can.Notifier(self._bus, [self._received])
        wanted = {message.name for message in self._frames.values()}
        if not self._wait(lambda: wanted <= self._newest.keys(), max(until - time.monotonic(), 0.0)):
            missing = ", ".join(sorted(wanted - self._newest.keys()))
            self.close()
            raise PortLost(f"{url}: nobody sends {missing}")

    def answer(self, line: str) -> str | None:
        """Return the answer to ``identify``, ``read 0`` or ``write NAME VALUE``; None without an answer."""
        import can

        word, _, rest = line.partition(" ")
        try:
            if word == "write":
                return self._write(*rest.split(" "))
        except can.CanError as error:
            raise PortLost(f"{self._name}: {error}") from None
        with self._news:
            for message, (came, _) in self._newest.items():
                if time.monotonic() - came > self._max_age:
                    raise PortLost(f"{self._name}: {message} has not come for {self._max_age:g} s")
            if word == "identify":
                return f"device {self._name}"
            return " ".join(
                as_written(self._number(name), self._written.get(actuator), self._rounding(name))
                for name, actuator in self._read
            )

    def close(self) -> None:
        """Leave the bus; commands are no longer sent."""
        self._bus.stop_all_periodic_tasks()
        self._notifier.stop()
        self._bus.shutdown()

    def _write(self, actuator: str, text: str) -> str | None:
        """Send a command from now on, and wait for the message that shows it."""
        name, state = self._outputs[actuator]["set"], self._outputs[actuator]["state"]
        message, number = self._messages[name.partition(".")[0]], float(text)
        if message.name not in self._commands:
            at_first = {signal.name: signal.initial or 0 for signal in message.signals}
            self._commands[message.name] = at_first
        try:
            changed = {**self._commands[message.name], name.partition(".")[2]: number}
            data = message.encode(changed, strict=True)
        except ValueError as error:  # cantools' own are of this type
            return f"error {error}"
        self._commands[message.name] = changed
        sent = time.monotonic()
        self._send(message, data)

        def done() -> bool:
            came, _ = self._newest[state.partition(".")[0]]
            return came > sent and is_near(self._number(state), number, self._rounding(state))

        if self._wait(done, self._timeout):
            self._written[actuator] = text
            return "ok"
        came, _ = self._newest[state.partition(".")[0]]
        return f"error {state} says {self._number(state):g} after {number:g} was set" if came > sent else None

    def _send(self, message: Any, data: bytes) -> None:
        import can

        frame = can.Message(
            arbitration_id=message.frame_id, is_extended_id=message.is_extended_frame, data=data
        )
        if message.name in self._tasks:
            self._tasks[message.name].modify_data(frame)
            self._bus.send(frame)  # not only when its turn comes
        else:
            cycle = (message.cycle_time or 1e3 * _CYCLE) / 1e3
            self._tasks[message.name] = self._bus.send_periodic(frame, cycle)

    def _number(self, name: str) -> float:
        message, _, signal = name.partition(".")
        return float(self._newest[message][1][signal])

    def _rounding(self, name: str) -> float:
        """Return by how much a signal may differ from what was written: half a step."""
        message, _, signal = name.partition(".")
        return 0.5 * abs(float(self._messages[message].get_signal_by_name(signal).scale))

    def _wait(self, condition: Callable[[], bool], limit: float) -> bool:
        with self._news:
            return self._news.wait_for(condition, limit)

    def _received(self, frame: Any) -> None:
        """Keep a message; called in the library's thread."""
        message = self._frames.get((frame.arbitration_id, frame.is_extended_id))
        if message is None or frame.is_error_frame or frame.is_remote_frame:
            return
        try:
            signals = message.decode(frame.data, decode_choices=False)
        except ValueError:  # too short to be this message: it has not come
            return
        with self._news:
            self._newest[message.name] = (time.monotonic(), signals)
            self._news.notify_all()


BACKEND = PluginBackend("can", Options, CanClient, "which CAN bus?", "socketcan:can0")
