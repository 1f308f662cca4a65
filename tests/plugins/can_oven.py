"""The oven as a node on python-can's bus between processes, its frames made by hand."""

from __future__ import annotations

import struct
import sys
import time

import can

from plugins.oven import Oven

OVEN = Oven()
COMMAND, STATUS = 0x101, 0x100


def main() -> None:
    bus = can.Bus(interface="udp_multicast", channel="239.74.163.2", port=int(sys.argv[1]))
    OVEN.ready()
    due = time.monotonic()
    while True:
        frame = bus.recv(max(due - time.monotonic(), 0.0))
        if frame is not None and frame.arbitration_id == COMMAND:
            for name, value in (("heater", frame.data[0] & 1), ("fan", 0.5 * frame.data[1])):
                if OVEN.outputs[name] != min(value, OVEN.most):  # it is sent again and again
                    OVEN.set(name, float(value))
        if time.monotonic() >= due:
            temperature = round((OVEN.temperature + 40.0) / 0.1)
            data = struct.pack(
                "<HBB", temperature, int(OVEN.outputs["heater"]), round(2 * OVEN.outputs["fan"])
            )
            bus.send(can.Message(arbitration_id=STATUS, is_extended_id=False, data=data))
            due = time.monotonic() + 0.02


if __name__ == "__main__":
    main()
