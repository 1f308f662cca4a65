"""The serial backend on a real pseudo-terminal, with the emulated board in another thread, in real time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from board_emulation import Emulation
from rigctl.backends.arduino.bench import ArduinoBench
from rigctl.backends.errors import BackendLost
from rigctl.backends.serial_port import create
from rigctl.clock import ScaledClock
from rigctl.errors import RigctlError
from rigctl.rig import Rig


@pytest.fixture
def emulation(uno_rig: Rig, tmp_path: Path) -> Iterator[Emulation]:
    made = Emulation(uno_rig, tmp_path / "ttyRIG")
    yield made
    made.close()


@contextmanager
def opened(rig: Rig, port: Path, **options: object) -> Iterator[ArduinoBench]:
    bench = create(rig, ScaledClock(), {"port": str(port), **options})
    bench.open()
    try:
        yield bench
    finally:
        bench.close()


def wait_for(condition: Callable[[], bool], bench: ArduinoBench) -> None:
    """Read samples until the condition holds; the timeout of the tests is the limit."""
    while not condition():
        bench.next_sample(0.05)


def test_samples_and_exact_pulses_in_real_time(uno_rig: Rig, emulation: Emulation) -> None:
    with opened(uno_rig, emulation.name) as bench:
        assert bench.identity["firmware"] == "RIG-UNO 1.1.1"
        bench.start(100.0)
        receipt = bench.command("valve", 1.0, duration=0.3).wait()
        samples = [bench.next_sample(60.0) for _ in range(60)]
        assert all(samples)
        # a computer that stalls for seconds stops the board, which reports every output
        end = next(one for one in bench.take_receipts() if one.actuator == "valve" and one.value == 0.0)
        (on, _), (off, _) = [entry for entry in emulation.switched if entry[0] > 0.0][-2:]
        assert off - on == pytest.approx(0.3, abs=0.001)
        if not end.time - receipt.time > 0.31:
            # on a busy computer the emulated board runs unevenly; exact times are tested on a virtual clock
            assert end.time - receipt.time == pytest.approx(0.3, abs=0.15)
            seen = [s.time for s in samples if s is not None and s.commands[1] == 1.0]
            known = 0.02 + 2.0 * (receipt.uncertainty + end.uncertainty)
            assert receipt.time - known <= seen[0]
            assert seen[-1] <= end.time + known


def test_contact_is_restored_with_outputs_off_when_the_plug_is_back(
    uno_rig: Rig, emulation: Emulation
) -> None:
    with opened(uno_rig, emulation.name) as bench:
        bench.start(50.0)
        bench.command("heater", 1.0).wait()
        assert bench.next_sample(60.0)
        emulation.unplug()
        notices = []

        def lost() -> bool:
            notices.extend(bench.take_notices())
            return any(n.kind == "fault" for n in notices)

        wait_for(lost, bench)
        emulation.plug()

        def back() -> bool:
            notices.extend(bench.take_notices())
            return any(n.kind == "gap" for n in notices)

        wait_for(back, bench)
        sample = bench.next_sample(60.0)
        assert sample is not None
        assert sample.commands[0] == 0.0


def test_a_second_host_on_the_port_is_refused(uno_rig: Rig, emulation: Emulation) -> None:
    with (
        opened(uno_rig, emulation.name),
        pytest.raises((RigctlError, BackendLost), match="somebody else has this port open"),
        opened(uno_rig, emulation.name),
    ):
        pass


def test_another_baud_rate_is_named_as_the_likely_cause(uno_rig: Rig, emulation: Emulation) -> None:
    bench = create(uno_rig, ScaledClock(), {"port": str(emulation.name), "baud": 9600})
    with pytest.raises(BackendLost, match="nobody answers at 9600 baud"):
        bench.open()


def test_a_missing_port_is_an_error(uno_rig: Rig, tmp_path: Path) -> None:
    bench = create(uno_rig, ScaledClock(), {"port": str(tmp_path / "nothing")})
    with pytest.raises(BackendLost, match="cannot be reached"):
        bench.open()


def test_a_killed_host_leaves_the_outputs_off(uno_rig: Rig, emulation: Emulation) -> None:
    bench = create(uno_rig, ScaledClock(), {"port": str(emulation.name)})
    bench.open()
    bench.command("heater", 1.0).wait()
    assert emulation.board.outputs[0]
    bench._contact.line.port.close()  # type: ignore[union-attr]  # as the kernel does for a dead process
    while emulation.board.outputs[0]:
        threading.Event().wait(0.01)
    assert emulation.switched[-1][0] - emulation.heard < 2.1
