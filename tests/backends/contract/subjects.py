"""The benches that must fulfil the contract, each with a plant that it switches."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from patience import patient, unhurried
from protocol_servers import SERVERS, ScpiServer, Server
from rigctl.backends.protocol import Backend, Sample
from rigctl.backends.registry import create_backend
from rigctl.clock import Clock, VirtualClock
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, load_rig, parse_rig

PLAIN = {"plant": "roles", "noise": "off", "quantised": "off", "seed": 1}


@dataclass
class Subject:
    """A kind of bench, with independent access to its plant.

    Parameters
    ----------
    kind: in the bench's identity.
    outputs: the actual outputs, SI, by actuator; None where only the bench itself can report them.
    server: what its device is, where that is one on a port.
    """

    kind: str
    rig: Rig
    make: Callable[[], Backend]
    outputs: Callable[[], Mapping[str, float]] | None = None
    server: Server | None = None

    @property
    def real(self) -> bool:
        return self.server is not None


def shipped_rig(name: str) -> Rig:
    return load_rig(shipped("rigs", f"{name}.yaml"))


def lines_over_tcp() -> Rig:
    """The SCPI instrument, reached through the serial backend on a TCP port."""
    text = shipped_rig("oil-circuit-visa").text
    return parse_rig(text.replace("kind: visa", "kind: serial"))


def unreal(kind: str, name: str) -> Subject:
    rig, clock = shipped_rig(name), VirtualClock()
    options = PLAIN if kind == "simulated" else {"plant": "roles", "seed": 1}
    return Subject(kind, rig, lambda: create_backend(rig, kind, clock, options))


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
            server,
        )


REAL = ("lines", *SERVERS)


def samples(bench: Backend, count: int) -> list[Sample]:
    """So many samples; None in between is no sample."""
    found: list[Sample] = []
    while len(found) < count:
        sample = bench.next_sample(5.0)
        if sample is not None:
            found.append(sample)
    return found


def value(rig: Rig, sample: Sample, name: str) -> float:
    """A channel's value in its unit."""
    found = sample.values[rig.layout.channels.index(name)]
    return math.nan if math.isnan(found) else rig.channels[name].display.from_si(found)
