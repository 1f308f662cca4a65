"""MQTT topics as channels and actuators, through paho-mqtt.

`rigctl` makes a whole bench of the client below: polling, read-back, loss and return of the device, a guard.
A broker acknowledges what it has received, not what a device has done. A command therefore counts only once
the device has published the new state.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from threading import Condition
from typing import Annotated, Any

from pydantic import Field

from rigctl import PluginBackend, PluginOptions, PluginOutput, PortLost
from rigctl.backends.transport.readback import as_written, is_near
from rigctl.files.name import Name
from rigctl.files.quantity import Q
from rigctl.rig.base import RigFilePart


class Output(PluginOutput):
    """The topics of an actuator."""

    set: str = Field(min_length=1, description="where commands are published")
    state: str = Field(min_length=1, description="where the device publishes its state after each command")


class Online(RigFilePart):
    """Where the device says that it is there; its last will says that it is not."""

    topic: str = Field(min_length=1, description="the topic, retained by the broker")
    equals: str = Field(default="online", description="what is published there while the device is there")


class Options(PluginOptions):
    """`options` of a rig file with `kind: mqtt`."""

    channels: dict[Name, str] = Field(description="the topic of each channel")
    actuators: dict[Name, Output] = Field(default_factory=dict, description="those of each driven actuator")
    online: Online | None = Field(default=None, description="where the device says that it is there")
    max_age: Annotated[float, Q("s", positive=True)] = Field(
        default=2.0, description="a value published longer ago is missing"
    )


class MqttClient:
    """A connection to a broker, with the newest message of each topic.

    Raises
    ------
    PortLost
        there is no broker, or nothing is published on one of the topics.
    """

    def __init__(self, url: str, settings: Mapping[str, Any], until: float) -> None:
        from paho.mqtt.client import Client
        from paho.mqtt.enums import CallbackAPIVersion

        self._name = url
        self._timeout = float(settings["timeout"])
        self._max_age = float(settings["max_age"])
        self._channels: list[str] = list(settings["channels"].values())
        self._outputs: Mapping[str, Mapping[str, str]] = settings["actuators"]
        self._online: Mapping[str, str] | None = settings["online"]
        self._written: dict[str, str] = {}  # by actuator, the number as it was written
        self._news = Condition()  # of what follows, which the library's thread sets
        self._newest: dict[str, tuple[float, str]] = {}  # by topic: when it came, s, and the message
        self._gone = ""  # why there is no connection
        self._client: Any = Client(CallbackAPIVersion.VERSION2)
        self._client.on_connect = self._connected
        self._client.on_disconnect = self._disconnected
        self._client.on_message = self._received
        host, _, number = url.rpartition(":")
        try:
            self._client.connect(host or number, int(number) if host else 1883)
        except (OSError, ValueError) as error:
            raise PortLost(f"{url}: no MQTT broker answers: {error}") from None
        self._client.loop_start()
        try:
            self._check(max(until - time.monotonic(), 0.0))
        except BaseException:
            self.close()
            raise

    def answer(self, line: str) -> str | None:
        """Return the answer to ``identify``, ``read 0`` or ``write NAME VALUE``; None without an answer."""
        word, _, rest = line.partition(" ")
        if word == "write":
            return self._write(*rest.split(" "))
        with self._news:
            self._require_contact()
            if word == "identify":
                return f"device {self._name}"
            return " ".join([*map(self._value, self._channels), *map(self._state, self._outputs)])

    def close(self) -> None:
        """End the connection; what was published has been sent."""
        self._client.disconnect()
        self._client.loop_stop()

    def _check(self, wake: float) -> None:
        """Wait until something is published for every channel, and the device says that it is there."""
        wanted = [*self._channels, *([] if self._online is None else [self._online["topic"]])]
        if not self._wait(lambda: all(topic in self._newest for topic in wanted), wake):
            silent = " and ".join(repr(topic) for topic in wanted if topic not in self._newest)
            raise PortLost(f"{self._name}: the broker answers, but nothing is published on {silent}")

    def _write(self, actuator: str, text: str) -> str | None:
        """Publish a command, and wait for the state that the device publishes after it."""
        topics = self._outputs[actuator]
        with self._news:
            self._newest.pop(topics["state"], None)
        self._client.publish(topics["set"], f"{float(text):.9g}", qos=1)

        def done() -> bool:
            return topics["state"] in self._newest and is_near(self._number(topics["state"]), float(text))

        if self._wait(done, self._timeout):
            self._written[actuator] = text
            return "ok"
        if topics["state"] not in self._newest:
            return None
        return f"error {topics['state']} says {self._newest[topics['state']][1]!r} after {text} was set"

    def _value(self, topic: str) -> str:
        """Return the number of a channel; ``nan`` if it is too old, or to come after a command."""
        since, _ = self._newest.get(topic, (-math.inf, ""))
        return f"{self._number(topic):.15e}" if time.monotonic() - since <= self._max_age else "nan"

    def _state(self, actuator: str) -> str:
        """Return the state of an actuator, as it was written if it is the same number."""
        topic = self._outputs[actuator]["state"]
        if topic not in self._newest:
            return "nan"
        return as_written(self._number(topic), self._written.get(actuator))

    def _number(self, topic: str) -> float:
        _, text = self._newest[topic]
        try:
            return float(text)
        except ValueError:
            raise PortLost(f"{self._name}: {topic!r} says {text!r}, which is no number") from None

    def _wait(self, condition: Callable[[], bool], limit: float) -> bool:
        """Wait for a message after which a condition holds; return whether it came in time."""
        until = time.monotonic() + limit
        with self._news:
            while not condition():
                self._require_contact()
                if not self._news.wait(max(until - time.monotonic(), 0.0)):
                    return condition()
            self._require_contact()
            return True

    def _require_contact(self) -> None:
        if self._gone:
            raise PortLost(f"{self._name}: {self._gone}")
        if self._online is not None and self._online["topic"] in self._newest:
            _, said = self._newest[self._online["topic"]]
            if said != self._online["equals"]:
                raise PortLost(
                    f"{self._name}: the device is not there, {self._online['topic']!r} says {said!r}"
                )

    # --- called in the library's thread -------------------------------------------------------------------

    def _connected(self, client: Any, _data: object, _flags: object, reason: Any, _more: object) -> None:
        if reason.is_failure:
            self._lose(f"the broker refuses: {reason}")
            return
        topics = [*self._channels, *(one["state"] for one in self._outputs.values())]
        topics += [] if self._online is None else [self._online["topic"]]
        client.subscribe([(topic, 1) for topic in topics])

    def _disconnected(self, _client: Any, _data: object, _flags: object, reason: Any, _more: object) -> None:
        self._lose(f"the broker is gone: {reason}")

    def _lose(self, why: str) -> None:
        with self._news:
            self._gone = self._gone or why
            self._news.notify_all()

    def _received(self, _client: Any, _data: object, message: Any) -> None:
        if message.retain and message.topic in self._channels:
            return  # it was kept by the broker: nobody knows since when
        with self._news:
            text = message.payload.decode("utf-8", "replace").strip()
            self._newest[message.topic] = (time.monotonic(), text)
            self._news.notify_all()


BACKEND = PluginBackend("mqtt", Options, MqttClient, "where is the MQTT broker?", "192.168.0.40:1883")
