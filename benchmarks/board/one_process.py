"""The latency of samples in real time, with only board, line and host program.

The emulated board and the host are one process, which excludes the terminal driver of a busy computer.
"""

from __future__ import annotations

from typing import Any

from benchmarks.board.real_time import RATE, RIG, figures, go_first
from rigctl.backends.emulated.create import create
from rigctl.clock import real_clock
from rigctl.rig import load_rig

TITLE = "host and board in real time, one process"


def measure(seconds: float) -> tuple[list[tuple[str, str, str]], dict[str, Any]]:
    """Rows to show and figures to keep."""
    scheduling = go_first()
    bench = create(load_rig(RIG), real_clock(), {"plant": "roles"})
    bench.open()
    bench.start(RATE)
    now = bench.clock.now
    began = now()
    delays = []
    while now() < began + seconds:
        sample = bench.next_sample(1.0)
        if sample is not None:
            delays.append((now() - sample.time) * 1e3)
    lost = [notice for notice in bench.take_notices() if notice.kind == "gap"]
    bench.close()
    delay = figures(delays)
    jitter = figures([abs(one - delay["median"]) for one in delays])
    rows = [
        (f"samples lost in {seconds / 60:g} min at 100 Hz", f"{len(lost)}", "0"),
        ("arrival jitter, ms, 99 % within", f"{jitter['p99']:.2f}", "2"),
        ("arrival after the sample, ms, median", f"{delay['median']:.2f}", ""),
    ]
    kept = {
        "seconds": seconds,
        "samples": len(delays),
        "delay_ms": delay,
        "jitter_ms": jitter,
        "scheduling": scheduling,
    }
    return rows, kept
