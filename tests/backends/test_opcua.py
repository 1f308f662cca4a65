"""OPC UA: bad and old values count as missing, clocks may differ, refusals and mistakes are reported."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from commands import call
from patience import patient, unhurried
from protocol_servers import OpcUaServer
from rigctl.backends.protocol import Backend
from rigctl.backends.registry import create_backend
from rigctl.clock import real_clock
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, load_rig, parse_rig
from rigctl.testing.contract import samples

RIG = load_rig(shipped("rigs", "oil-circuit-opcua.yaml"))
PATIENT = parse_rig(patient(RIG.text, wake="60 s"))
PRESSURE, AGE = (RIG.layout.channels.index(name) for name in ("supply_pressure", "pressure_age"))


@pytest.fixture
def server() -> Iterator[OpcUaServer]:
    with unhurried(), OpcUaServer(RIG) as made:
        yield made


@contextmanager
def opened(server: OpcUaServer, rig: Rig = PATIENT) -> Iterator[Backend]:
    bench = create_backend(rig, None, real_clock(), {"port": server.port})
    bench.open()
    try:
        bench.start(10.0)
        yield bench
    finally:
        bench.close()


def test_an_old_value_by_the_server_s_clock_counts_as_missing(server: OpcUaServer) -> None:
    server.skew = 3600.0  # the controller's clock is an hour ahead, which must not matter
    with opened(server) as bench:
        while not (sample := bench.next_sample(1.0)):
            pass
        assert sample.values[PRESSURE] == 0.0
        assert 0.0 <= sample.values[AGE] < 0.5
        server.skew, server.frozen = 0.0, datetime.now(UTC)
        while not (math.isnan(sample.values[PRESSURE])):
            sample = bench.next_sample(1.0) or sample
        assert sample.values[AGE] > 1.0
        server.frozen = None
        while math.isnan(sample.values[PRESSURE]):
            sample = bench.next_sample(1.0) or sample
        while server.beats < 3:
            bench.next_sample(1.0)


@pytest.mark.parametrize("stopped", [False, True])
def test_a_cached_value_is_as_old_as_its_source_although_the_server_stamps_it_alike(
    server: OpcUaServer, stopped: bool
) -> None:
    """The server's present time tells, or, if that stands still too, how long it has."""
    with opened(server) as bench:
        server.caching, server.frozen = True, datetime.now(UTC)
        server.stopped = server.frozen if stopped else None
        sample = bench.next_sample(bench.clock.now() + 2.0)
        while sample is None or not sample.values[AGE] > 2.5:
            sample = bench.next_sample(1.0) or sample
        assert math.isnan(sample.values[PRESSURE])
        server.caching, server.frozen, server.stopped = False, None, None
        while math.isnan(sample.values[PRESSURE]):
            sample = bench.next_sample(1.0) or sample
        assert abs(sample.values[AGE]) < 0.5


@pytest.mark.parametrize("value", [math.inf, -math.inf])
def test_an_infinite_value_is_missing_and_the_others_are_not(
    server: OpcUaServer, monkeypatch: pytest.MonkeyPatch, value: float
) -> None:
    """An overflow in one node used to make the readings of all nodes missing, and to end the run."""
    values = server.values
    monkeypatch.setattr(server, "values", lambda: {**values(), "SupplyPressure": value})
    with opened(server) as bench:
        (sample,) = samples(bench, 1)
        assert math.isnan(sample.values[PRESSURE])
        others = [reading for place, reading in enumerate(sample.values) if place != PRESSURE]
        assert all(math.isfinite(reading) for reading in others)


def test_a_stopped_source_whose_clock_is_ahead_counts_as_missing(server: OpcUaServer) -> None:
    """Its age used to be negative, so that a stopped source counted as fresh for a day."""
    server.frozen = datetime.now(UTC) + timedelta(days=1)
    with opened(server) as bench:
        sample = bench.next_sample(bench.clock.now() + 2.0)
        assert sample is not None
        assert math.isnan(sample.values[PRESSURE])


@pytest.mark.parametrize(
    "status", ["UncertainLastUsableValue", "UncertainSubNormal", "BadOutOfService", "BadNodeIdUnknown"]
)
def test_a_value_with_a_status_other_than_good_counts_as_missing(server: OpcUaServer, status: str) -> None:
    server.statuses["SupplyPressure"] = status
    with opened(server) as bench:
        sample = bench.next_sample(bench.clock.now() + 2.0)
        assert sample is not None
        missing = [math.isnan(reading) for reading in sample.values]
        assert (missing[PRESSURE], sum(missing)) in ((True, 1), (True, 2))  # with its age


@pytest.mark.parametrize("value", ["12.5", "on", ""])
def test_a_text_value_counts_as_a_missing_reading(
    server: OpcUaServer, monkeypatch: pytest.MonkeyPatch, value: str
) -> None:
    values = server.values
    monkeypatch.setattr(server, "values", lambda: {**values(), "SupplyPressure": value})
    with opened(server) as bench:
        sample = bench.next_sample(bench.clock.now() + 2.0)
        assert sample is not None
        assert math.isnan(sample.values[PRESSURE])


def wired(node: str) -> Rig:
    """The rig with its relief valve at another node, in tenths of a bar."""
    text = RIG.text.replace('s=Circuit.ReliefValve"}', f's=Circuit.{node}", scale: 0.1, readback: false}}')
    assert text != RIG.text
    return parse_rig(text)


def test_a_value_that_the_node_cannot_hold_is_refused_and_the_session_stays_open(server: OpcUaServer) -> None:
    """The connection used to be closed for this, and the bench to be unreachable for everything else."""
    with opened(server, wired("HostAlive")) as bench:
        with pytest.raises(RigctlError, match="600 is no value of type Byte"):
            bench.command("relief_valve", 60e5).wait()
        bench.command("heater", 1.0).wait()
        assert server.circuit.outputs["heater"] == 1.0
    assert server.circuit.off


def test_an_output_mapped_to_a_text_node_is_refused(server: OpcUaServer) -> None:
    with pytest.raises(RigctlError, match="0 is no value of type String"), opened(server, wired("Plant")):
        pass
    assert server.circuit.off


def test_a_refusal_by_the_server_is_an_error(server: OpcUaServer) -> None:
    rig = parse_rig(PATIENT.text.replace("s=Circuit.Heater", "s=Circuit.Heatr"))
    with pytest.raises(RigctlError, match="does not exist"), opened(server, rig):
        pass
    assert server.circuit.off


def test_the_outputs_of_a_device_with_another_identity_are_not_changed(
    server: OpcUaServer, tmp_path: Path
) -> None:
    rig = tmp_path / "rig.yaml"
    text = PATIENT.text.replace("equals: oil circuit 4711", "equals: oil circuit 4712")
    rig.write_text(text.replace("wake: 60 s", "wake: 4 s"), encoding="utf-8")
    server.circuit.set("heater", 1.0)
    with pytest.raises(RigctlError, match="another device"), opened(server, load_rig(rig)):
        pass
    assert server.circuit.outputs["heater"] == 1.0
    done = call("doctor", "--rig", str(rig), "--port", server.port, "--json")
    assert "another device" in json.loads(done.stdout)["asked"][0]["error"]


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('node: "ns=2;s=Circuit.Heater"', 'node: "Circuit.Heater"', "node"),
        ("quantity: time", "quantity: other", "an age is a time"),
        ("read: age", "read: ages", "did you mean 'age'"),
        ("pressure_age: {node", "presure_age: {node", "did you mean 'pressure_age'"),
        ("scale: 0.01, max_age", "scale: 0, max_age", "all numbers would be the same"),
        ("kind: opcua", "kind: opc", "did you mean 'opcua'"),
    ],
)
def test_a_mistake_in_the_nodes_is_reported_with_its_place(old: str, new: str, says: str) -> None:
    assert old in RIG.text
    with pytest.raises(RigctlError, match=says) as refused:
        parse_rig(RIG.text.replace(old, new, 1), Path("rig.yaml"))
    assert "rig.yaml:" in str(refused.value)


def test_an_incomplete_server_address_is_refused() -> None:
    with pytest.raises(RigctlError, match="where is the server"):
        create_backend(RIG, None, real_clock(), {"port": "192.168.0.22:4840"})
