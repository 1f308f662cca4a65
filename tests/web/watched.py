"""A run in real time on the simulated bench, in a separate process, and clients that watch it."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from websockets.sync.client import ClientConnection, connect

from rigctl.dataset.recording.writer_lock import read_state
from web.serving import Served

PROCEDURE = """\
procedure: <b onclick=alert(1)>watch me</b>
rig: rigs/patient.yaml
steps:
  - repeat: 400
    do:
      - record: {name: pulse, rate: 100 Hz}
        do:
          - extend: 0.05 s
          - wait: 0.1 s
          - retract: 0.1 s
      - hold: {for: 0.2 s, channel: supply_pressure, within: 40 bar}
finally:
  - set: {heater: off, valve: neutral}
"""


@dataclass
class InProgress:
    """A run that continues until it is aborted."""

    folder: Path
    process: subprocess.Popen[str]

    @property
    def id(self) -> str:
        return self.folder.name

    def state(self) -> str:
        found = read_state(self.folder)
        return str(found.fields.get("state")) if found is not None else ""


def wait_for(condition: Callable[[], object], seconds: float = 120.0) -> None:
    """Until something is so; a busy machine may take its time."""
    give_up = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < give_up, "it did not come to that"
        time.sleep(0.02)


@contextmanager
def run_in_progress(project: Path) -> Iterator[InProgress]:
    """A run of `PROCEDURE`; aborted at the end, if it has not ended by then."""
    (project / "procedures" / "watch-me.yaml").write_text(PROCEDURE, encoding="utf-8")
    # a busy machine may stop the simulated bench for longer than a second
    rig = (project / "rigs" / "hl32-bench.yaml").read_text(encoding="utf-8")
    assert "stale_after: 1 s " in rig
    patient = rig.replace("stale_after: 1 s ", "stale_after: 60 s ")
    (project / "rigs" / "patient.yaml").write_text(patient, encoding="utf-8")
    before = set((project / "runs").iterdir()) if (project / "runs").is_dir() else set()
    command = [sys.executable, "-m", "rigctl", "simulate", "procedures/watch-me.yaml", "--speed", "1x"]
    process = subprocess.Popen(
        command,
        cwd=project,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )

    def new() -> list[Path]:
        assert process.poll() is None, process.stderr.read() if process.stderr else ""
        there = set((project / "runs").iterdir()) if (project / "runs").is_dir() else set()
        return [each for each in there - before if (each / "state.json").is_file()]

    try:
        wait_for(new)
        (folder,) = new()
        found = InProgress(folder, process)
        wait_for(lambda: found.state() == "running")
        yield found
    finally:
        process.terminate()
        process.communicate(timeout=120)


@dataclass
class Listener:
    """Another client of the socket than the page's script."""

    socket: ClientConnection
    told: dict[str, Any] = field(default_factory=dict)
    batches: list[np.ndarray[Any, Any]] = field(default_factory=list)
    provisional: int = 0

    def want(self, run: str, window: float = 60.0, width: int = 600) -> None:
        self.socket.send(json.dumps({"run": run, "window": window, "width": width}))

    def hear(self) -> None:
        """The next message."""
        message = self.socket.recv(120)
        if isinstance(message, str):
            said = json.loads(message)
            self.told[said["kind"]] = said[said["kind"]]
            return
        rows, columns, self.provisional, anew, first = struct.unpack("<HHHHd", message[:16])
        values = np.frombuffer(message[16:], "<f4").reshape(columns, rows).astype(float)
        values[0] += first
        if anew:
            self.batches.clear()
        self.batches.append(values)

    def hear_until(self, condition: Callable[[], object]) -> None:
        give_up = time.monotonic() + 120.0
        while not condition():
            assert time.monotonic() < give_up, self.told
            self.hear()

    @property
    def rows(self) -> np.ndarray[Any, Any]:
        return np.concatenate(self.batches, axis=1) if self.batches else np.empty((1, 0))


@contextmanager
def listening(served: Served, cookie: str, viewer: str) -> Iterator[Listener]:
    """A connection of the library `websockets`."""
    address = f"ws://{served.host}/api/live/stream?viewer={viewer}"
    with connect(
        address, origin=served.base, additional_headers={"Cookie": cookie}, compression=None
    ) as socket:
        yield Listener(socket)
