"""bluesky: its RunEngine with soft devices, documents kept by suitcase-jsonl."""

from __future__ import annotations

import time
from pathlib import Path

import bluesky.plan_stubs as bps
import bluesky.preprocessors as bpp
from bluesky import Msg, RunEngine
from ophyd.sim import SynAxis, SynSignal
from suitcase.jsonl import Serializer
from workload import answer, row, seconds


def steps(count: int) -> dict[str, float]:
    engine = RunEngine({})
    axis, signal = SynAxis(name="axis"), SynSignal(func=lambda: 1.0, name="signal")

    def nothing():
        for _ in range(count):
            yield Msg("null")

    def moves():
        for i in range(count):
            yield from bps.mv(axis, i)

    @bpp.run_decorator()
    def reads():
        for _ in range(count):
            yield Msg("checkpoint")
            yield from bps.trigger_and_read([signal])

    return {
        name: seconds(lambda plan=plan: engine(plan())) / count
        for name, plan in (("null message", nothing), ("move", moves), ("read", reads))
    }


class Bench:
    """The smallest object the RunEngine can read: eight float channels."""

    name, parent = "bench", None

    def __init__(self):
        self.i = 0

    def read(self):
        self.i += 1
        now = time.time()
        return {f"ch{k}": {"value": v, "timestamp": now} for k, v in enumerate(row(self.i))}

    def describe(self):
        return {f"ch{k}": {"source": "sim", "dtype": "number", "shape": []} for k in range(8)}

    def read_configuration(self):
        return {}

    def describe_configuration(self):
        return {}


def rows(count: int, folder: Path) -> float:
    engine, bench, writer = RunEngine({}), Bench(), Serializer(folder)
    engine.subscribe(writer)

    @bpp.run_decorator()
    def plan():
        for _ in range(count):
            yield from bps.checkpoint()  # as bluesky's own plans do; the rewind cache grows without it
            yield from bps.create("primary")
            yield from bps.read(bench)
            yield from bps.save()

    duration = seconds(lambda: engine(plan()))
    writer.close()
    return duration


answer(steps, rows)
