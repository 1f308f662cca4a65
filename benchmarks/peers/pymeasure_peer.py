"""pymeasure: it has no step, so an empty Procedure run by a Worker; rows through emit into its CSV."""

from __future__ import annotations

import tempfile
from pathlib import Path

from pymeasure.experiment import Procedure, Results, Worker
from workload import CHANNELS, answer, row, seconds


class Nothing(Procedure):
    DATA_COLUMNS = ("a",)

    def execute(self):
        pass


class Rows(Procedure):
    DATA_COLUMNS = CHANNELS
    count = 0

    def execute(self):
        for i in range(self.count):
            self.emit("results", dict(zip(CHANNELS, row(i), strict=True)))


def run(procedure: Procedure, file: Path) -> None:
    worker = Worker(Results(procedure, str(file)))
    worker.start()
    worker.join(timeout=600)


def steps(count: int) -> dict[str, float]:
    folder = Path(tempfile.mkdtemp())

    def work():
        for i in range(count):
            run(Nothing(), folder / f"{i}.csv")

    return {"empty procedure": seconds(work) / count}


def rows(count: int, folder: Path) -> float:
    procedure = Rows()
    procedure.count = count
    return seconds(lambda: run(procedure, folder / "rows.csv"))


if __name__ == "__main__":
    answer(steps, rows)
