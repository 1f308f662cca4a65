"""The devices of the example plug-ins, each in a process of its own, with the server that it needs."""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

import own_process
from patience import patient

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples" / "plugins"
_STARTS_WITHIN = 60.0  # s


class Device:
    """A process whose outputs are known from what it prints; `outputs` is up to date with every answer."""

    def __init__(self, module: str, *arguments: str, **variables: str) -> None:
        self._outputs: dict[str, float] = {}
        self._said = 0
        self._asked = 0
        self._news = threading.Condition()
        self._process = subprocess.Popen(
            [sys.executable, "-m", module, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            env={**os.environ, "PYTHONPATH": str(ROOT / "tests"), **variables},
        )
        self._ready = False
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()
        self._wait(lambda: self._ready)

    @property
    def outputs(self) -> dict[str, float]:
        assert self._process.stdin is not None
        self._asked += 1
        self._process.stdin.write(f"{self._asked}\n")
        self._process.stdin.flush()
        self._wait(lambda: self._said == self._asked)
        return dict(self._outputs)

    def wait_for(self, name: str, value: float) -> None:
        """Wait until an output is set to a value."""
        self._wait(lambda: self._outputs[name] == value)

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()
        self._thread.join()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            pipe.close()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            word, _, rest = line.strip().partition(" ")
            with self._news:
                if word == "ready":
                    self._ready = True
                elif word == "said":
                    self._said = int(rest)
                else:
                    self._outputs[word] = float(rest)
                self._news.notify_all()

    def _wait(self, condition) -> None:  # type: ignore[no-untyped-def]
        with self._news:
            assert self._news.wait_for(condition, _STARTS_WITHIN), "the device does not do it"


class Stand:
    """The oven behind one protocol, and a project with the plug-in's own files.

    Attributes
    ----------
    folder: the project; its rig file has the stand's address.
    """

    def __init__(self, kind: str, folder: Path) -> None:
        self.kind, self.folder = kind, folder
        self.number = free_port()
        for name in ("oven.yaml", "step.yaml", "oven.dbc"):
            if (EXAMPLES / f"rigctl-{kind}" / name).exists():
                shutil.copy(EXAMPLES / f"rigctl-{kind}" / name, folder / name)
        (folder / "rigctl.toml").write_text("", encoding="utf-8")
        self.rig = folder / "oven.yaml"
        self.change(r"^  port: .*", f"  port: {self.port}")
        if kind == "can":
            self.change(r"    bus: .*", f"    bus: {{port: {self.number}}}")
        self._broker = self.start_broker() if kind == "mqtt" else None
        self.device = self.start()

    @property
    def port(self) -> str:
        return "udp_multicast:239.74.163.2" if self.kind == "can" else f"127.0.0.1:{self.number}"

    def change(self, pattern: str, new: str) -> None:
        """Change the rig file in one place."""
        text, found = re.subn(pattern, new, self.rig.read_text("utf-8"), count=1, flags=re.MULTILINE)
        assert found == 1, pattern
        self.rig.write_text(text, encoding="utf-8")

    def be_patient(self, *, wake: str = "60 s", silence: str = "60 s") -> None:
        """Let no answer count as late on a busy computer."""
        text = patient(self.rig.read_text("utf-8"), wake=wake, stale_after=silence)
        self.rig.write_text(text, encoding="utf-8")
        if self.kind != "epics":
            self.change(r"    max_age: .*", f"    max_age: {silence}")
        # The same steps, longer, with samples that a busy computer takes in time: a sample may take 0.5 s.
        step = self.folder / "step.yaml"
        text = step.read_text("utf-8")
        for old, new in (
            ("rate: 10 Hz", "rate: 2 Hz, most_missing: 50 %"),
            ("wait: 1 s", "wait: 4 s"),
            ("last: 0.5 s", "last: 3.5 s"),
        ):
            assert old in text
            text = text.replace(old, new)
        step.write_text(text, encoding="utf-8")

    def start(self, *arguments: str) -> Device:
        number = str(self.number)
        if self.kind == "epics":
            variables = {"EPICS_CAS_SERVER_PORT": number, "EPICS_CA_SERVER_PORT": number}
            return Device("plugins.epics_oven", *arguments, **variables)
        return Device(f"plugins.{self.kind}_oven", number, *arguments)

    def start_broker(self) -> subprocess.Popen[bytes]:
        """Start a broker, which without further settings accepts this computer only."""
        path = shutil.which("mosquitto", path=f"{os.environ['PATH']}{os.pathsep}/usr/sbin")
        if path is None:
            pytest.fail("there is no MQTT broker: 'make system' installs mosquitto")
        broker = subprocess.Popen([path, "-p", str(self.number)], stderr=subprocess.DEVNULL)
        until = time.monotonic() + _STARTS_WITHIN
        while time.monotonic() < until:
            try:
                socket.create_connection(("127.0.0.1", self.number), timeout=1.0).close()
            except OSError:
                time.sleep(0.02)
            else:
                return broker
        raise AssertionError("the broker does not start")

    def stop_broker(self) -> None:
        assert self._broker is not None
        self._broker.kill()
        self._broker.wait()

    def close(self) -> None:
        self.device.kill()
        own_process.end_guards(self.folder / "state")  # what the device had not yet confirmed
        if self._broker is not None:
            self.stop_broker()


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as free:
        return int(free.getsockname()[1])
