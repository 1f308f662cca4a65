"""The guard of a device without a watchdog: outputs go off if rigctl dies, hangs, or closes the port."""

from __future__ import annotations

import gc
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from patience import patient, unhurried
from rigctl.backends.errors import BackendLost
from rigctl.backends.lines.bench import LineBench
from rigctl.backends.registry import create_backend
from rigctl.backends.transport import guard_port
from rigctl.backends.transport.address import Address
from rigctl.backends.transport.guard import Guard, GuardSettings
from rigctl.backends.transport.guard_frames import Frame, FrameReader, send_frame
from rigctl.backends.transport.guard_port import GuardActed, GuardedPort
from rigctl.backends.transport.port import PortLost
from rigctl.backends.transport.safe_commands import Duty, Outputs, SafeOrder
from rigctl.clock import ScaledClock, VirtualClock, real_clock
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, load_rig, parse_rig
from systems import needs_posix
from tclab_board import Served

SHIPPED = load_rig(shipped("rigs", "tclab-board.yaml"))
TCLAB = parse_rig(patient(SHIPPED.text))
#: in tests with a suspended host: longer than a busy computer stalls
WATCHED = parse_rig(patient(SHIPPED.text, watchdog="5 s"))

#: heats, reports it, and then fails in the given way
HOST = """
import sys, time
from pathlib import Path
from rigctl.backends.registry import create_backend
from rigctl.clock import real_clock
from rigctl.rig import load_rig
bench = create_backend(load_rig(Path(sys.argv[1])), None, real_clock(), {"port": sys.argv[2]})
bench.open()
bench.start(2.0)
bench.command("heater_1", 0.5).wait()
bench.next_sample(2.0)
print("heating", flush=True)
while True:
    bench.next_sample(1.0)
"""


@pytest.fixture(autouse=True)
def no_collection() -> Iterator[None]:
    """Disable garbage collection: a long pause of this process, host and device, is a standstill."""
    gc.disable()
    with unhurried():
        yield
    gc.enable()


@pytest.fixture
def board() -> Iterator[Served]:
    with Served() as served:
        yield served


@contextmanager
def opened(url: str, rig: Rig = TCLAB) -> Iterator[LineBench]:
    bench = create_backend(rig, None, real_clock(), {"port": url})
    assert isinstance(bench, LineBench)
    bench.open()
    try:
        yield bench
    finally:
        bench.close()


@contextmanager
def heating_host(board: Served, folder: Path) -> Iterator[subprocess.Popen[str]]:
    """Another process that drives the board, its heater on."""
    rig = folder / "rig.yaml"
    rig.write_text(WATCHED.text, encoding="utf-8")
    command = [sys.executable, "-c", HOST, str(rig), board.url]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as host:
        try:
            assert host.stdout is not None
            assert host.stdout.readline() == "heating\n"
            assert board.sketch.heaters == (50.0, 0.0)
            yield host
        finally:
            host.kill()


def wait_for(condition: Callable[[], object]) -> None:
    while not condition():
        time.sleep(0.005)


def test_a_guarded_bench_behaves_like_any_other(board: Served) -> None:
    with opened(board.url) as bench:
        assert bench.identity["firmware"] == "1.4.0 Arduino Uno"
        bench.start(5.0)
        bench.command("heater_2", 0.75).wait()
        samples = [bench.next_sample(60.0) for _ in range(6)]
        assert all(samples)
        assert board.sketch.heaters == (0.0, 75.0)
        assert samples[-1] is not None
        assert samples[-1].commands == (0.0, 0.75)
    assert board.sketch.heaters == (0.0, 0.0)


def test_a_killed_host_leaves_the_heaters_off(board: Served, tmp_path: Path) -> None:
    with heating_host(board, tmp_path) as host:
        host.kill()
        wait_for(lambda: board.sketch.heaters == (0.0, 0.0))


@needs_posix("a process that can be stopped (SIGSTOP)")
def test_a_suspended_host_finds_the_heaters_off_and_is_informed(board: Served, tmp_path: Path) -> None:
    with heating_host(board, tmp_path) as host:
        host.send_signal(signal.SIGSTOP)
        wait_for(lambda: board.sketch.received[-3:] == ["X", "Q1 0.00", "Q2 0.00"])
        assert board.sketch.heaters == (0.0, 0.0)
        host.send_signal(signal.SIGCONT)


def test_a_stalled_host_learns_that_the_guard_made_the_outputs_safe(board: Served) -> None:
    with opened(board.url, WATCHED) as bench:
        bench.start(5.0)
        bench.command("heater_1", 0.5).wait()
        assert bench.next_sample(60.0)
        wait_for(lambda: board.sketch.heaters == (0.0, 0.0))  # nothing is asked meanwhile
        with pytest.raises(
            BackendLost, match=r"rigctl stood still for .*its guard has made the outputs safe"
        ):
            for _ in range(20):
                bench.next_sample(1.0)
        assert board.sketch.heaters == (0.0, 0.0)
        assert any(notice.kind == "alarm" for notice in bench.take_notices())


def test_a_bench_can_be_closed_after_a_standstill(board: Served) -> None:
    with opened(board.url, WATCHED) as bench:
        bench.command("heater_1", 0.5).wait()
        wait_for(lambda: board.sketch.received[-1] == "Q2 0.00")
    assert board.sketch.heaters == (0.0, 0.0)


def test_the_guard_ends_with_the_bench_and_releases_the_port(board: Served) -> None:
    for _ in range(2):
        with opened(board.url) as bench:
            assert bench.identity["port"] == board.url
            process = bench._contact.port._process  # type: ignore[union-attr]
        assert process.returncode == 0


def test_a_guard_that_is_killed_is_replaced_with_outputs_off(board: Served) -> None:
    with opened(board.url) as bench:
        bench.start(5.0)
        bench.command("heater_1", 0.5).wait()
        assert bench.next_sample(60.0)
        bench._contact.port._process.kill()  # type: ignore[union-attr]
        notices = []

        def back() -> bool:
            bench.next_sample(0.5)
            notices.extend(bench.take_notices())
            return any("is back" in notice.message for notice in notices)

        wait_for(back)
        assert board.sketch.heaters == (0.0, 0.0)
        assert bench.next_sample(60.0)


def test_a_device_whose_port_returns_has_its_outputs_off(board: Served) -> None:
    with opened(board.url) as bench:
        bench.start(5.0)
        bench.command("heater_2", 0.5).wait()
        assert bench.next_sample(60.0)
        board.unplugged = True
        notices = []

        def told(text: str) -> bool:
            bench.next_sample(0.2)
            notices.extend(bench.take_notices())
            return any(text in notice.message for notice in notices)

        wait_for(lambda: told("contact with the device is lost"))
        board.unplugged = False
        wait_for(lambda: told("the device is back"))
        sample = bench.next_sample(60.0)
        assert sample is not None
        assert sample.commands == (0.0, 0.0)
        assert board.sketch.heaters == (0.0, 0.0)
        assert [notice.kind for notice in notices if notice.kind in ("fault", "gap")] == ["fault", "gap"]


def test_a_missing_port_is_an_error(tmp_path: Path) -> None:
    with pytest.raises((BackendLost, RigctlError), match="nothing"), opened(str(tmp_path / "nothing")):
        pass


class Written:
    """A port that keeps what was written to it."""

    name = "port"

    def __init__(self) -> None:
        self.data: list[bytes] = []

    def write(self, data: bytes) -> None:
        self.data.append(data)

    def read(self, until: float) -> bytes:
        time.sleep(0.01)
        return b""

    def close(self) -> None: ...


@contextmanager
def serving(port: Written, *safe: bytes) -> Iterator[tuple[socket.socket, Callable[[], None]]]:
    """A guard in a thread, its device identified: its connection, and what suspends its computer."""
    asleep = [100.0]
    orders = GuardSettings(
        Address("lines", "socket://x", {}), tuple(SafeOrder(text, ()) for text in safe), watchdog=60.0
    )

    def suspend() -> None:
        asleep[0] += 3600.0

    ours, theirs = socket.socketpair()
    with ours, theirs:
        guard = Guard(theirs, orders, port, ScaledClock(suspension=lambda: asleep[0]))
        thread = threading.Thread(target=guard.run)
        thread.start()
        try:
            send_frame(ours, Frame.IDENTIFIED, b"{}")
            send_frame(ours, Frame.WRITE, b"on")
            wait_for(lambda: port.data == [b"on"])
            yield ours, suspend
        finally:
            with suppress(OSError):
                send_frame(ours, Frame.CLOSE, Outputs.SAFE.value)
            thread.join()


def test_a_guard_that_was_suspended_with_its_computer_makes_outputs_safe_before_all_else() -> None:
    """Nobody was silent: rigctl goes on as soon as the guard does."""
    port = Written()
    with serving(port, b"off") as (ours, suspend):
        suspend()
        send_frame(ours, Frame.WRITE, b"on")
        assert list(FrameReader().feed(ours.recv(1024))) == [(Frame.ACTED, b"3600.000")]
        send_frame(ours, Frame.WRITE, b"on")  # not yet: rigctl has to know first
        send_frame(ours, Frame.RESUME)
        send_frame(ours, Frame.WRITE, b"asked")
        wait_for(lambda: port.data[-1] == b"asked")
    assert port.data == [b"on", b"off", b"asked"]


class Echoing(Written):
    """A device that repeats what is sent to it.

    Attributes
    ----------
    heard: how many of its answers the guard has received and dealt with.
    """

    def __init__(self) -> None:
        super().__init__()
        self.heard = self._read = 0

    def read(self, until: float) -> bytes:
        self.heard = self._read  # who reads on has dealt with the answer before
        super().read(until)
        if self._read == len(self.data):
            return b""
        self._read += 1
        return self.data[self._read - 1] + b" done"


def test_a_guard_does_not_pass_on_the_answers_to_its_own_commands() -> None:
    """They would be taken for answers to the queries that follow."""
    port, reader = Echoing(), FrameReader()
    found: list[tuple[Frame, bytes]] = []

    def receive(last: Frame) -> None:
        while not found or found[-1][0] is not last:
            found.extend(reader.feed(ours.recv(1024)))

    with serving(port, b"off") as (ours, suspend):
        receive(Frame.DATA)
        suspend()
        send_frame(ours, Frame.ALIVE)
        receive(Frame.ACTED)
        wait_for(lambda: port.heard == 2)
        send_frame(ours, Frame.RESUME)
        send_frame(ours, Frame.WRITE, b"asked")
        receive(Frame.DATA)
    acted = (Frame.ACTED, b"3600.000")
    assert found == [(Frame.DATA, b"on done"), acted, (Frame.DATA, b"asked done")]


class HalfWay(Written):
    """A port that is lost after the first of the safe commands."""

    def write(self, data: bytes) -> None:
        if data == b"stop":
            raise PortLost("the plug is pulled")
        super().write(data)


def test_a_guard_that_loses_its_port_half_way_says_that_it_has_acted() -> None:
    port = HalfWay()
    with serving(port, b"off", b"stop") as (ours, suspend):
        suspend()
        send_frame(ours, Frame.ALIVE)
        wait_for(lambda: port.data == [b"on", b"off", b"off"])  # at once, and when it ends
        ours.settimeout(10.0)  # were there nothing to receive
        assert list(FrameReader().feed(ours.recv(1024))) == [(Frame.ACTED, b"3600.000")]


class Ended:
    """A guard's process that has ended."""

    def wait(self, timeout: float | None = None) -> int:
        return 0


@contextmanager
def port_and_guard() -> Iterator[tuple[GuardedPort, socket.socket, socket.socket]]:
    """rigctl's side of a guard that a test plays: the port, its connection, and the guard's."""
    orders = GuardSettings(Address("lines", "socket://x", {}), (), watchdog=60.0)
    ours, theirs = socket.socketpair()
    with ours, theirs, pytest.MonkeyPatch.context() as patch:
        patch.setattr(guard_port, "_start", lambda: (ours, Ended()))
        send_frame(theirs, Frame.OPENED)
        port = GuardedPort(orders, VirtualClock(), Duty())
        yield port, ours, theirs
        port.close()


@pytest.mark.parametrize("use", ["read", "write"])
def test_what_a_guard_has_done_is_known_even_if_it_cannot_be_acknowledged(use: str) -> None:
    with port_and_guard() as (port, ours, theirs):
        send_frame(theirs, Frame.ACTED, b"2.300")
        ours.shutdown(socket.SHUT_WR)
        port._clock.sleep_until(2.3)  # a sign of life is due
        with pytest.raises(GuardActed, match=r"stood still for 2\.3 s"):
            port.read(2.5) if use == "read" else port.write(b"on")
        with pytest.raises(PortLost, match="is gone"):
            port.write(b"on")


@pytest.mark.parametrize("data", [b"?\x00\x00\x00\x00", b"d\xff\xff\xff\xff"], ids=["letter", "length"])
def test_bytes_of_a_guard_that_are_no_frames_are_a_loss(data: bytes) -> None:
    with port_and_guard() as (port, _, theirs):
        theirs.sendall(data)
        with pytest.raises(PortLost, match="the guard of socket://x is gone"):
            port.read(0.1)


@needs_posix("a pseudo-terminal")
def test_two_hosts_cannot_open_the_same_pseudo_terminal() -> None:
    with (
        Served(pty=True) as board,
        opened(board.url) as bench,
        pytest.raises((RigctlError, BackendLost), match="somebody else has this port open"),
        opened(board.url),
    ):
        assert bench.identity["firmware"] == "1.4.0 Arduino Uno"


def test_a_bench_without_outputs_needs_no_guard(board: Served) -> None:
    text = TCLAB.text
    passive = text[: text.index("    actuators:")] + text[text.index("model: heater_board") :]
    passive = passive.replace("model: heater_board", "").replace(
        passive[passive.index("\nactuators:") : passive.index("\nlimits:")], "\n"
    )
    passive = passive.replace("safe_state: {heater_1: 0 %, heater_2: 0 %}", "safe_state: {}")
    for line in (
        '      - {send: R1, reply: "{heater_1}", every: 1 s}\n',
        '      - {send: R2, reply: "{heater_2}", every: 1 s}\n',
    ):
        passive = passive.replace(line, "")
    bench = create_backend(parse_rig(passive), None, real_clock(), {"port": board.url})
    before = threading.active_count()
    bench.open()
    try:
        bench.start(5.0)
        assert bench.next_sample(60.0)
        assert type(bench._contact.port).__name__ == "PyserialPort"  # type: ignore[attr-defined]
        assert threading.active_count() == before
    finally:
        bench.close()


def test_frames_are_reassembled_from_any_fragments() -> None:
    whole = b"w\x00\x00\x00\x03abc" + b"a\x00\x00\x00\x00"
    reader = FrameReader()
    found = [frame for byte in whole for frame in reader.feed(bytes([byte]))]
    assert found == [(Frame.WRITE, b"abc"), (Frame.ALIVE, b"")]
    with pytest.raises(ConnectionError):
        list(FrameReader().feed(b"w\xff\xff\xff\xff"))
