"""A host in real time: round trips, arrivals, complete samples, and outputs after it is killed."""

from __future__ import annotations

import os
import random
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

from rigctl.backends.emulated.create import make_board
from rigctl.backends.emulated.pty_bridge import PtyBridge
from rigctl.backends.serial_port import create
from rigctl.clock import real_clock
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig

TITLE = "host and board in real time, two processes on a pseudo-terminal"
RATE = 100.0  # Hz
QUERIES = ("*IDN?", "SYST:TIME?", "MEAS:ALL?", "VALV?")
ASKED = 300
_PAUSES = random.Random(1)
_MINUTE = round(60 * RATE)  # samples
RIG = shipped("rigs", "hl32-bench-uno.yaml")

_HEATS = """
import sys, time
from rigctl.backends.serial_port import create
from rigctl.clock import real_clock
from rigctl.rig import load_rig
bench = create(load_rig(sys.argv[1]), real_clock(), {"port": sys.argv[2]})
bench.open()
bench.start(100.0)
bench.command("heater", 1.0).wait()
while True:
    bench.next_sample(1.0)
"""


def measure(seconds: float) -> tuple[list[tuple[str, str, str]], dict[str, Any]]:
    """Rows to show and figures to keep."""
    scheduling = go_first()
    trips = {baud: round_trips(baud) for baud in (115200, 500000)}
    killed = after_kill(5)
    whole = arrivals(seconds)
    rows = [
        (f"samples lost in {seconds / 60:g} min at 100 Hz", f"{whole['lost']}", "0"),
        ("lines torn", f"{whole['torn']}", "0"),
        ("arrival jitter, ms, 99 % within", f"{whole['jitter_ms']['p99']:.2f}", "2"),
        ("arrival after the sample, ms, median", f"{whole['delay_ms']['median']:.2f}", ""),
        ("outputs off after a killed host, s, worst of 5", f"{max(killed):.3f}", "2.1"),
    ]
    for baud, found in trips.items():
        for query, figures in found.items():
            rows.append((f"{query} at {baud} baud, ms, median", f"{figures['median']:.2f}", "5"))
    kept = {
        "samples": whole,
        "round_trip_ms": trips,
        "seconds_to_off_after_kill": killed,
        "load_average": os.getloadavg(),
        "scheduling": scheduling,
    }
    return rows, kept


def go_first() -> str:
    """Raise the priority if that is permitted, as a bench's computer has no other work."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(20))
    except (AttributeError, PermissionError):
        return "as any process"
    return "SCHED_FIFO"


def round_trips(baud: int) -> dict[str, dict[str, float]]:
    """ms from sending a query to its complete answer, with pyserial only; also with the stream at 100 Hz."""
    import serial

    found = {}
    with emulated(baud) as name, serial.Serial(name, baud, timeout=2.0) as port:
        for stream in ("STRM 0", f"STRM {RATE:g}"):
            port.write(stream.encode() + b"\n")
            time.sleep(0.1)
            for query in QUERIES:
                label = f"{query} with the stream" if stream != "STRM 0" else query
                found[label] = figures([_asked(port, query) for _ in range(ASKED)])
    return found


def _asked(port: Any, query: str) -> float:
    began = time.perf_counter()
    port.write(query.encode() + b"\n")
    while port.readline()[:1] in (b"@", b"!"):
        pass
    took = time.perf_counter() - began
    time.sleep(_PAUSES.uniform(0.0, 0.01))  # not synchronous with the stream
    return took * 1e3


def arrivals(seconds: float) -> dict[str, Any]:
    """Samples over some time: none lost, and the latency of each."""
    with emulated(115200) as name:
        bench = create(load_rig(RIG), real_clock(), {"port": name})
        bench.open()
        bench.start(RATE)
        now = bench.clock.now
        began = now()
        delays, times, notices, loads = [], [], [], []
        while now() < began + seconds:
            sample = bench.next_sample(1.0)
            if sample is not None:
                delays.append((now() - sample.time) * 1e3)
                times.append(sample.time)
            notices += bench.take_notices()
            if len(times) // _MINUTE > len(loads):
                loads.append(os.getloadavg()[0])
        uncertainty = bench.command("valve", 0.0).wait().uncertainty
        bench.close()
    middle = statistics.median(delays)
    return {
        "seconds": seconds,
        "rate_Hz": RATE,
        "received": len(times),
        "lost": sum(int(str(n.fields["samples"])) for n in notices if n.kind == "gap"),
        "torn": sum(int(str(n.fields.get("lines", 0))) for n in notices),
        "largest_distance_s": max(b - a for a, b in pairwise(times)),
        "delay_ms": figures(delays),
        "jitter_ms": figures([abs(delay - middle) for delay in delays]),
        "by_minute": _by_minute([abs(delay - middle) for delay in delays], loads),
        "clock_uncertainty_ms": uncertainty * 1e3,
    }


def _by_minute(jitter: Sequence[float], loads: Sequence[float]) -> list[dict[str, float]]:
    """The 99 % quantile of each minute's latencies, with the load of the computer."""
    minutes = [jitter[k * _MINUTE : (k + 1) * _MINUTE] for k in range(len(loads))]
    return [
        {"jitter_ms_p99": figures(minute)["p99"], "load_average": load}
        for minute, load in zip(minutes, loads, strict=True)
    ]


def after_kill(times: int) -> list[float]:
    """s of board time from a host's SIGKILL while it heats to the heater off."""
    return [_killed_after(1.0 + 0.13 * number) for number in range(times)]


def _killed_after(seconds: float) -> float:
    board = make_board(load_rig(RIG), {"plant": "roles"})
    bridge = PtyBridge(board, real_clock())
    with _stepping(bridge.step):
        host = subprocess.Popen([sys.executable, "-c", _HEATS, str(RIG), bridge.port])
        _until(lambda: board.outputs[0])
        time.sleep(seconds)
        host.kill()
        killed = board.time
        host.wait()
        _until(lambda: not board.outputs[0])
        off = board.time
    bridge.close()
    board.close()
    return off - killed


@contextmanager
def emulated(baud: int) -> Iterator[str]:
    """Start a board in another process; yield the name of its port."""
    with tempfile.TemporaryDirectory() as folder:
        name = str(Path(folder) / "ttyRIG")
        command = [sys.executable, "-m", "rigctl", "emulate", "--rig", str(RIG), "--link", name]
        with subprocess.Popen([*command, "--baud", str(baud)], stdout=subprocess.PIPE, text=True) as process:
            try:
                assert process.stdout is not None
                process.stdout.readline()
                yield name
            finally:
                process.terminate()


@contextmanager
def _stepping(step: Callable[[], None]) -> Iterator[None]:
    end = threading.Event()

    def run() -> None:
        while not end.is_set():
            step()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()


def _until(condition: Callable[[], bool]) -> None:
    while not condition():
        time.sleep(0.002)


def figures(values: Sequence[float]) -> dict[str, float]:
    ordered = sorted(values)
    return {
        "median": statistics.median(ordered),
        "p99": ordered[int(0.99 * (len(ordered) - 1))],
        "largest": ordered[-1],
    }
