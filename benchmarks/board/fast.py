"""Performance of board and line, in board time: complete samples, full lines, and switch-off times."""

from __future__ import annotations

import statistics
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

from rigctl.backends.emulated.create import create
from rigctl.backends.emulated.image import shipped_image
from rigctl.clock import VirtualClock
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))  # the chip is part of the tests
from board_chip import Chip

TITLE = "the board and its line, in board time"
RATE = 100.0  # Hz
BITS = 11  # of an emulated character
OVER = (680, 500, 300)  # counts of A0, A1, A2: over-pressure
#: baud rates, and sampling rates from one that always fits to one that does not
RATES = {115200: (100, 200, 283, 285, 290, 293, 300), 500000: (500, 1000, 1170, 1180, 1200, 1210, 1250)}
WARM_UP = 10.6  # s; from then on the board's microseconds have eight digits, and lines their full length


def measure(seconds: float) -> tuple[list[tuple[str, str, str]], dict[str, Any]]:
    """Rows to show and figures to keep."""
    whole, lines = samples(seconds), {baud: capacity(baud) for baud in RATES}
    killed, tripped = silent_host(), over_limit()
    rows = [
        (f"samples lost in {seconds / 60:g} min at 100 Hz", f"{whole['lost']}", "0"),
        ("lines torn", f"{whole['torn']}", "0"),
        ("arrival jitter of board and line alone, ms, 99 %", f"{whole['arrival_ms']['jitter_p99']:.2f}", "2"),
        ("times real time", f"{whole['times_real_time']:.1f}", ""),
    ]
    for baud, found in lines.items():
        rows.append(
            (
                f"load of {baud} baud without a loss",
                f"{found['best_load']:.1%} ({found['best_rate']} Hz)",
                "95 %",
            )
        )
    rows += [
        ("outputs off after the host's last word, s", f"{killed:.3f}", "2.1"),
        ("outputs off after an over-limit value, ms, worst of 50", f"{tripped * 1e3:.2f}", "20"),
    ]
    kept = {
        "samples": whole,
        "capacity": lines,
        "seconds_to_off_after_host": killed,
        "seconds_to_off_after_over_limit": tripped,
    }
    return rows, kept


def samples(seconds: float) -> dict[str, Any]:
    """Read a bench for some time: missing samples, and the jitter of sampling."""
    bench = create(
        load_rig(shipped("rigs", "hl32-bench-uno.yaml")), VirtualClock(), {"plant": "roles", "noise": "off"}
    )
    bench.open()
    bench.start(RATE)
    began, wall = bench.clock.now(), time.perf_counter()
    times: list[float] = []
    delays: list[float] = []
    notices = []
    while bench.clock.now() < began + seconds:
        sample = bench.next_sample(1.0)
        if sample is not None:
            times.append(sample.time)
            delays.append((bench.clock.now() - sample.time) * 1e3)
        notices += bench.take_notices()
    wall = time.perf_counter() - wall
    bench.close()
    return {
        "seconds": seconds,
        "rate_Hz": RATE,
        "received": len(times),
        "lost": sum(int(str(notice.fields["samples"])) for notice in notices if notice.kind == "gap"),
        "torn": sum(int(str(notice.fields.get("lines", 0))) for notice in notices),
        "arrival_ms": {"median": statistics.median(delays), "jitter_p99": _jitter(delays)},
        "largest_distance_s": max(b - a for a, b in pairwise(times)),
        "times_real_time": seconds / wall,
    }


def _jitter(delays: list[float]) -> float:
    """The 99 % quantile of the deviations from the median."""
    middle = statistics.median(delays)
    return sorted(abs(delay - middle) for delay in delays)[int(0.99 * (len(delays) - 1))]


def capacity(baud: int, seconds: float = 10.0) -> dict[str, Any]:
    """Sampling rates with their load of the line, and the number of missing samples."""
    found = []
    for rate in RATES[baud]:
        chip = chip_at(baud)
        chip.tell(f"STRM {rate}")
        chip.run(WARM_UP)
        chip.avr.take()
        began, sent = chip.time, b""
        for number in range(int(2 * seconds)):
            chip.tell(f"#{number} SYST:TIME?")  # as a host does
            chip.run(0.5)
            sent += chip.avr.take()
        load = len(sent) * BITS / chip.avr.baud / (chip.time - began)
        numbers = [int(line[1:].split(b",")[0]) for line in sent.split(b"\n")[1:-1] if line.startswith(b"@")]
        lost = sum((b - a) % 65536 - 1 for a, b in pairwise(numbers))
        found.append({"rate_Hz": rate, "load": load, "bytes": len(sent), "lost": lost})
        chip.avr.close()
    best = max((one for one in found if not one["lost"]), key=lambda one: one["load"])
    return {
        "characters_per_second": baud_of(baud) / BITS,
        "best_rate": best["rate_Hz"],
        "best_load": best["load"],
        "rates": found,
    }


def baud_of(baud: int) -> float:
    """The actual baud rate from the board's divider: 117647 for 115200, as on every Uno."""
    chip = chip_at(baud)
    real = chip.avr.baud
    chip.avr.close()
    return real


def silent_host() -> float:
    """s from the last byte of a host to the heater off."""
    chip = chip_at(115200)
    chip.tell("OUTP:HEAT ON")
    chip.run(1.0)
    chip.tell("SYST:PING")
    chip.run(0.002)
    last = chip.time
    chip.run(2.5)
    return last_off(chip)["heater"] - last


def over_limit() -> float:
    """s from a pressure over the limit to the last output off; the worst of 50 moments."""
    worst = 0.0
    for number in range(50):
        chip = chip_at(115200)
        chip.tell("OUTP:HEAT ON\nVALV EXT\nSTRM 100")
        chip.run(0.1 + number * 0.000217)
        began = chip.time
        chip.put(*OVER)
        chip.run(0.05)
        off = last_off(chip)
        worst = max(worst, max(off.values()) - began)
        assert len(off) == 2
        chip.avr.close()
    return worst


def chip_at(baud: int) -> Chip:
    """A running chip with valid inputs."""
    chip = Chip(shipped_image(baud))
    chip.run(0.03)
    return chip


def last_off(chip: Chip) -> dict[str, float]:
    """When each output last went off, s."""
    return {name: when for when, name, level in chip.edges if not level}
