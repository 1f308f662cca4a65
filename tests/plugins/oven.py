"""An oven with a heater and a fan, for devices in processes of their own: no part of rigctl is in it.

A device prints ``NAME VALUE`` when an output is set, and ``said N`` in answer to a line, so that whoever sent
the line knows that nothing is still under way. It ends with its standard input.
"""

from __future__ import annotations

import math
import os
import sys
import threading
import time


class Oven:
    """First order: 100 K above the room with the heater on, half of that with the fan at 100 %.

    With the argument ``--on`` it starts with its heater on, as a device that nobody has made safe.
    """

    lag = 2.0  # s
    room = 20.0  # degC
    most = 80.0  # %, of its fan, whatever it is told

    def __init__(self) -> None:
        self.outputs = {"heater": float("--on" in sys.argv), "fan": 0.0}
        self._temperature = self.room
        self._seen = time.monotonic()
        for name, value in self.outputs.items():
            print(name, value, flush=True)

    @property
    def temperature(self) -> float:
        """degC."""
        now = time.monotonic()
        end = self.room + 100.0 * self.outputs["heater"] * (1.0 - 0.005 * self.outputs["fan"])
        self._temperature = end + (self._temperature - end) * math.exp((self._seen - now) / self.lag)
        self._seen = now
        return self._temperature

    def set(self, output: str, value: float) -> None:
        _ = self.temperature
        value = min(value, self.most)
        self.outputs[output] = value
        print(output, value, flush=True)

    def ready(self) -> None:
        """Say that it is there, and answer lines from now on."""
        print("ready", flush=True)
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        for line in sys.stdin:
            print("said", line.strip(), flush=True)
        os._exit(0)
