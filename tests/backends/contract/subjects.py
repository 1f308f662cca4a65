"""The benches that must fulfil the contract, each with a plant that it switches."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from foreign_driver import DRIVERS, rig_with_driver
from patience import no_silence, patient, unhurried
from protocol_servers import SERVERS, ScpiServer, Server
from rigctl.backends.protocol import Sample
from rigctl.backends.python.permission import allowing
from rigctl.backends.registry import create_backend
from rigctl.clock import Clock, VirtualClock
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, load_rig, parse_rig
from rigctl.testing import contract

PLAIN = {"plant": "roles", "noise": "off", "quantised": "off", "seed": 1}


@dataclass
class Subject(contract.Subject):
    """A kind of bench, with independent access to its plant.

    Parameters
    ----------
    server: what its device is, where that is one on a port.
    """

    server: Server | None = None


def shipped_rig(name: str) -> Rig:
    return load_rig(shipped("rigs", f"{name}.yaml"))


def lines_over_tcp() -> Rig:
    """The SCPI instrument, reached through the serial backend on a TCP port."""
    text = shipped_rig("oil-circuit-visa").text
    return parse_rig(text.replace("kind: visa", "kind: serial"))


def unreal(kind: str, name: str) -> Subject:
    rig, clock = shipped_rig(name), VirtualClock()
    options = PLAIN if kind == "simulated" else {"plant": "roles", "seed": 1}
    # the board enforces a rest of 2 s for its heater
    return Subject(kind, rig, lambda: create_backend(rig, kind, clock, options), real=False, rest=2.5)


def served(kind: str, clock: Clock) -> Iterator[Subject]:
    rig = lines_over_tcp() if kind == "lines" else shipped_rig(f"oil-circuit-{kind}")
    rig = parse_rig(patient(rig.text, wake="60 s"))  # a server in Python is slow
    make = ScpiServer if kind == "lines" else SERVERS[kind]
    with unhurried(), make(rig) as server:
        port = f"socket://127.0.0.1:{server.number}" if kind == "lines" else server.port
        yield Subject(
            "serial" if kind == "lines" else kind,
            rig,
            lambda: create_backend(rig, None, clock, {"port": port}),
            lambda: server.circuit.outputs,
            lambda: server.asked,
            server=server,
        )


def driven(folder: Path, clock: Clock) -> Iterator[Subject]:
    """The SCPI instrument by a foreign driver in Python."""
    (folder / "faults").write_text("", encoding="utf-8")
    rig = parse_rig(no_silence(rig_with_driver(folder)))
    with (
        pytest.MonkeyPatch.context() as patch,
        unhurried(),
        allowing(["bench_driver"]),
        ScpiServer(shipped_rig("oil-circuit-visa")) as server,
    ):
        patch.setenv("PYTHONPATH", str(DRIVERS))  # of its process
        patch.syspath_prepend(str(DRIVERS))
        options = {"port": f"127.0.0.1:{server.number}"}
        yield Subject(
            "python",
            rig,
            lambda: create_backend(rig, None, clock, options),
            lambda: server.circuit.outputs,
            lambda: server.asked,
            server=server,
        )


REAL = ("lines", *SERVERS)


def value(rig: Rig, sample: Sample, name: str) -> float:
    """A channel's value in its unit."""
    found = sample.values[rig.layout.channels.index(name)]
    return math.nan if math.isnan(found) else rig.channels[name].display.from_si(found)
