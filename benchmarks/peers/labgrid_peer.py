"""labgrid: one call of a driver method under its @step decorator. It stores no rows."""

from __future__ import annotations

from pathlib import Path

import attr
from labgrid import Target
from labgrid.driver import Driver
from labgrid.factory import target_factory
from labgrid.step import step
from workload import answer, seconds


@target_factory.reg_driver
@attr.s(eq=False)
class Bench(Driver):
    @Driver.check_active
    @step(args=["value"])
    def put(self, value):
        return value


def steps(count: int) -> dict[str, float]:
    target = Target("main")
    bench = Bench(target, "bench")
    target.activate(bench)
    return {"step": seconds(lambda: [bench.put(i) for i in range(count)]) / count}


def rows(count: int, folder: Path) -> float:
    raise SystemExit("labgrid stores no rows")


answer(steps, rows)
