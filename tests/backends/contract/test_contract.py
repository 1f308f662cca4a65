"""The contract of every bench: simulated, on the emulated board, and with real protocols."""

from __future__ import annotations

from itertools import pairwise

import pytest

from backends.contract.subjects import Subject, samples
from rigctl.backends.errors import BackendLost
from rigctl.backends.protocol import Backend, CommandReceipt
from rigctl.errors import RigctlError


def off(subject: Subject) -> bool:
    return subject.outputs is None or not any(subject.outputs().values())


def until_a_receipt(bench: Backend, actuator: str) -> CommandReceipt:
    """The next switch of an actuator without a pending command."""
    for _ in range(200):
        bench.next_sample(1.0)
        for receipt in bench.take_receipts():
            if receipt.actuator == actuator:
                return receipt
    raise AssertionError("no receipt came")


def refuses_what_cannot_be(subject: Subject, bench: Backend) -> None:
    """Before anything moves, and without communication with the device."""
    asked = subject.server.asked if subject.server is not None else 0
    for actuator, value, duration in (
        ("heatr", 1.0, None),
        ("heater", 0.5, None),
        ("heater", float("nan"), None),
        ("heater", 1.0, -1.0),
        ("relief_valve", 1e9, None),
    ):
        with pytest.raises(RigctlError):
            bench.command(actuator, value, duration=duration)
    for rate in (0.0, float("nan")):
        with pytest.raises(RigctlError, match="not a sampling rate"):
            bench.start(rate)
    assert off(subject)
    if subject.server is not None:
        assert subject.server.asked == asked


def test_every_bench_fulfils_the_contract_from_open_to_close(subject: Subject) -> None:
    bench, rig = subject.make(), subject.rig
    with pytest.raises(BackendLost):
        bench.next_sample(0.0)
    bench.open()
    try:
        assert bench.identity["kind"] == subject.kind
        assert bench.without_host
        refuses_what_cannot_be(subject, bench)
        bench.start(10.0)
        found = samples(bench, 6)
        assert all(a.time < b.time for a, b in pairwise(found))
        lasted = found[-1].time - found[0].time
        assert lasted == pytest.approx(5 / 10.0, abs=0.2) or (subject.real and lasted > 0.5)  # late when busy
        for sample in found:
            assert len(sample.values) == len(rig.layout.channels)
            assert sample.commands[rig.layout.commands.index("heater")] == 0.0
            assert all(map(lambda c, v: c.possible(v), rig.channels.values(), sample.values))

        before = bench.clock.now()
        receipt = bench.command("heater", 1.0).wait()
        assert (receipt.actuator, receipt.value) == ("heater", 1.0)
        assert before - receipt.uncertainty <= receipt.time <= bench.clock.now() + receipt.uncertainty
        if subject.outputs is not None:
            assert subject.outputs()["heater"] == 1.0
        assert samples(bench, 3)[-1].commands[rig.layout.commands.index("heater")] == 1.0
        bench.safe()
        assert off(subject)
        bench.safe()
        assert samples(bench, 3)[-1].commands[rig.layout.commands.index("heater")] == 0.0

        if not subject.real:  # the board enforces a rest of 2 s for its heater
            samples(bench, 25)
        bench.command("heater", 1.0, duration=0.3).wait()
        ended = until_a_receipt(bench, "heater")
        assert (ended.value, off(subject)) == (0.0, True)
        if not subject.real:
            samples(bench, 25)
        bench.command("heater", 1.0).wait()
    finally:
        bench.close()
    assert off(subject), "closing switches off"
    bench.close()
    with pytest.raises(BackendLost):
        bench.next_sample(0.0)
