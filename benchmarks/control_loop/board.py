"""The jitter of the loop on the board: its firmware on the emulated chip.

Time is emulated: the processor cycles between two writes to the PWM register are counted, 16 per microsecond,
while the stream fills most of the line and a host sends twenty queries per second.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

from rigctl.backends.emulated.avr import FREQUENCY, Avr
from rigctl.backends.emulated.board import millivolt
from rigctl.backends.emulated.image import read_intel_hex, shipped_image

SECONDS = 20
#: PID with all terms and a curved calibration, in counts: the longest computation of an update
SETTINGS: dict[str, float] = {
    "C0": 1.0,
    "C1": 0.9,
    "C2": 1e-5,
    "C3": 1e-8,
    "RLO": -10.0,
    "RHI": 2000.0,
    "ZERO": 0.0,
    "FULL": 1023.0,
    "TO": 300.0,
    "RAMP": 100.0,
    "FF": 300.0,
    "KP": 1.5,
    "KI": 0.5,
    "KD": 0.02,
    "TF": 0.01,
    "TT": 3.0,
    "LOW": 0.0,
    "HIGH": 1000.0,
    "RATE": 1e5,
}
#: baud, loop's period in ms, stream in Hz
LOADS = ((115200, 10, 230), (115200, 1, 230), (500000, 1, 1000))


def measured(baud: int, period_ms: int, stream: int) -> dict[str, Any]:
    """Jitter of a loop under load, from the cycles and as reported by the board, us."""
    written: list[int] = []
    avr = Avr(read_intel_hex(shipped_image(baud)), lambda *_: None)
    try:
        avr.on_pwm(written.append)
        for channel, counts in enumerate((200, 500, 300)):
            avr.put_voltage(channel, millivolt(counts))
        avr.run_to(FREQUENCY // 50)
        lines = ["CONT:CLE", "CONT:INP 0", f"CONT:PER {period_ms}"]
        lines += [f"CONT:PAR {name},{value:.9g}" for name, value in SETTINGS.items()]
        for line in (*lines, "CONT:STAR BUMP", f"STRM {stream}"):
            _ask(avr, line)
        begun, steps = avr.cycle, SECONDS * 1000 // period_ms
        written.clear()
        for step in range(steps):
            avr.put_voltage(0, millivolt(280 + (step * 37) % 41))  # noisy, so that every update differs
            if step * period_ms % 50 < period_ms:
                avr.send(b"#1 MEAS:ALL?\n")
            avr.run_to(begun + (step + 1) * period_ms * FREQUENCY // 1000)
        _ask(avr, "STRM 0")
        own = [int(part) for part in _ask(avr, "#2 CONT:FIG?").rpartition("#2 ")[2].split(",")]
    finally:
        avr.close()
    period = period_ms * FREQUENCY // 1000
    off = sorted(abs(b - a - period) for a, b in pairwise(written) if b - a < 1.5 * period)
    return {
        "updates": own[0],
        "left_out": own[1],
        "outputs_written": len(written),
        "jitter_p99": off[math.ceil(0.99 * len(off)) - 1] / FREQUENCY * 1e6,
        "jitter_max": off[-1] / FREQUENCY * 1e6,
        "jitter_p99_own": own[5],
        "jitter_max_own": own[6],
        "delay_p99_own": own[8],
        "delay_max_own": own[9],
    }


def _ask(avr: Avr, line: str) -> str:
    """The answer within 50 ms."""
    avr.send(line.encode() + b"\n")
    avr.run_to(avr.cycle + FREQUENCY // 20)
    return avr.take().decode("latin-1").strip()


def rows(found: dict[str, dict[str, Any]]) -> list[tuple[str, ...]]:
    """A table of the results."""
    shown = ("updates", "left_out", "jitter_p99", "jitter_max", "jitter_max_own", "delay_max_own")
    head = ("us, emulated clock", *(name.replace("_", " ") for name in shown))
    return [head, *((load, *(f"{one[name]:g}" for name in shown)) for load, one in found.items())]


def all_loads() -> dict[str, dict[str, Any]]:
    """Every load, by name."""
    return {
        f"{1000 // period} Hz, {stream} samples/s at {baud} baud": measured(baud, period, stream)
        for baud, period, stream in LOADS
    }
