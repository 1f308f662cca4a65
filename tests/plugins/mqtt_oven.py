"""The oven as a device that publishes on an MQTT broker: ``python -m plugins.mqtt_oven PORT``."""

from __future__ import annotations

import sys
import time
from typing import Any

from paho.mqtt.client import CallbackAPIVersion, Client

from plugins.oven import Oven

OVEN = Oven()
OUTPUTS = {f"oven/{name}/set": name for name in OVEN.outputs}


def publish(client: Client, name: str) -> None:
    client.publish(f"oven/{name}", f"{OVEN.outputs[name]:g}", qos=1, retain=True)


def connected(client: Client, _data: object, _flags: object, _reason: object, _more: object) -> None:
    client.subscribe([(topic, 1) for topic in OUTPUTS])
    client.publish("oven/status", "online", qos=1, retain=True)
    for name in OVEN.outputs:
        publish(client, name)


def commanded(client: Client, _data: object, message: Any) -> None:
    name = OUTPUTS[message.topic]
    OVEN.set(name, float(message.payload))
    publish(client, name)


def main() -> None:
    client = Client(CallbackAPIVersion.VERSION2)
    client.will_set("oven/status", "offline", qos=1, retain=True)
    client.on_connect, client.on_message = connected, commanded
    client.reconnect_delay_set(min_delay=1, max_delay=1)
    client.connect("127.0.0.1", int(sys.argv[1]))
    client.loop_start()
    OVEN.ready()
    while True:
        client.publish("oven/temperature", f"{OVEN.temperature:.3f}")
        client.publish("oven/label", "an oven")
        time.sleep(0.02)


if __name__ == "__main__":
    main()
