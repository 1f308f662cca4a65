"""VISA instruments: late answers are discarded, terminators are configurable, silence is reported."""

from __future__ import annotations

import socket
import threading
import time
from contextlib import suppress
from itertools import count
from threading import Semaphore
from typing import Any

import pytest

from late_serial import LateSerialDevice
from patience import patient, unhurried
from protocol_servers import ScpiServer
from rigctl.backends.registry import create_backend
from rigctl.backends.transport.port import PortLost
from rigctl.backends.visa.client import VisaClient
from rigctl.backends.visa.create import address_of
from rigctl.clock import real_clock
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig, parse_rig
from systems import needs_posix

RIG = load_rig(shipped("rigs", "oil-circuit-visa.yaml"))
#: ms, more than a busy computer takes to answer
PATIENCE = 60_000


def settings(server: ScpiServer, **other: Any) -> dict[str, Any]:
    return {**address_of(RIG, {"port": server.port}).settings, **other}


def test_a_late_answer_is_not_taken_as_the_answer_to_a_later_query() -> None:
    with ScpiServer(RIG) as server:
        client = VisaClient(server.port, settings(server, timeout=0.2))
        server.delay = 600.0
        assert client.answer("ROUT:CLOS? (@201)") is None
        server.delay = 0.0
        while not server.answered:  # the answer is not read
            time.sleep(0.01)
        client._instrument.timeout = PATIENCE
        for _ in range(3):
            assert str(client.answer("*IDN?")).startswith("ACME,")
            assert client.answer("*OPC?") == "1"
        assert client.answer("*CLS") is None
        client._instrument.timeout = 200
        server.stop()
        with pytest.raises(PortLost):
            for _ in range(10):
                client.answer("*IDN?")
        client.close()


@pytest.mark.parametrize("same", [True, False])
def test_an_instrument_is_identified_before_anything_is_sent_on_a_new_connection(same: bool) -> None:
    """A missing answer costs the socket; behind its address there may be another instrument by then."""
    with ScpiServer(RIG) as server:
        client = VisaClient(server.port, settings(server, timeout=60.0))
        assert str(client.answer("*IDN?")).startswith("ACME,")
        server.delay, client._instrument.timeout = 600.0, 200
        assert client.answer("ROUT:CLOS? (@201)") is None
        server.delay = 0.0
        while server.answered != len(server.received):
            time.sleep(0.01)
        client._instrument.timeout = PATIENCE
        before, answered = len(server.received), server._answer
        if not same:
            server._answer = lambda part: (  # type: ignore[method-assign]
                "ACME,34980,OTHER,2.1" if part == "*IDN?" else answered(part)
            )
        if same:
            assert client.answer("ROUT:CLOS (@201);*OPC?") == "1"
            assert client.answer("*OPC?") == "1"
            assert server.received[before:] == ["*IDN?", "ROUT:CLOS (@201);*OPC?", "*OPC?"]
        else:
            for _ in range(2):  # and it remains another one
                with pytest.raises(PortLost, match="another instrument answers: ACME,34980,OTHER"):
                    client.answer("ROUT:CLOS (@201);*OPC?")
            assert server.received[before:] == ["*IDN?", "*IDN?"]
        client.close()


def _talkative(listening: socket.socket, said: Semaphore) -> None:
    """An instrument that sends a greeting, and an unsolicited error after its second answer."""
    with suppress(OSError):
        line, _ = listening.accept()
        with line, line.makefile("rb") as asked:
            line.setsockopt(
                socket.IPPROTO_TCP, socket.TCP_NODELAY, 1
            )  # what it has sent is available at once
            line.sendall(b"READY\n")
            said.release()
            for count, question in enumerate(asked, start=1):
                line.sendall(b"answer to " + question)
                if count == 2:
                    line.sendall(b'-113,"Undefined header"\n')
                said.release()


def test_unsolicited_data_are_not_taken_as_an_answer() -> None:
    """One additional line used to shift every later reading to another channel."""
    with ScpiServer(RIG) as server:
        known = settings(server, timeout=60.0)
    with socket.create_server(("127.0.0.1", 0)) as listening:
        said = Semaphore(0)
        thread = threading.Thread(target=_talkative, args=(listening, said))
        thread.start()
        client = VisaClient(f"TCPIP::127.0.0.1::{listening.getsockname()[1]}::SOCKET", known)
        assert said.acquire(timeout=60.0)  # its unsolicited data have arrived
        for name in "ABCD":
            assert client.answer(f"{name}?") == f"answer to {name}?"
            assert said.acquire(timeout=60.0)
        client.close()
        thread.join()


def _answering(listening: socket.socket, answers: list[list[bytes]], go_on: threading.Event) -> None:
    """An instrument that sends its answers in pieces, one for each query; the last one never ends."""
    while answers:
        line, _ = listening.accept()
        with suppress(OSError), line, line.makefile("rb") as asked:
            for _ in asked:
                *pieces, last = answers.pop(0)
                for piece in pieces:
                    line.sendall(piece)
                    go_on.wait(60.0)  # longer than the time-out
                line.sendall(last)
                while not answers:
                    line.sendall(last)


def test_an_answer_counts_only_when_complete() -> None:
    """Incomplete answers used to be taken for numbers, and one without end filled the memory."""
    with ScpiServer(RIG) as server:
        known = settings(server, timeout=60.0)
    answers = [[b"1\n"], [b"1", b"2.5\n"], [b"3\n"], [b"+1.234E+01,"]]
    with socket.create_server(("127.0.0.1", 0)) as listening:
        go_on = threading.Event()
        thread = threading.Thread(target=_answering, args=(listening, answers, go_on))
        thread.start()
        client = VisaClient(f"TCPIP::127.0.0.1::{listening.getsockname()[1]}::SOCKET", known)
        assert client.answer("A?") == "1"
        client._instrument.timeout = 200
        assert client.answer("A?") is None
        go_on.set()
        assert client.answer("A?") == "3"
        with pytest.raises(PortLost, match=r"does not end within 4096 bytes, with '\\n'"):
            client.answer("A?")
        client.close()
        thread.join()


@needs_posix("a pseudo-terminal")
@pytest.mark.parametrize("waiting", [True, False])
def test_a_late_answer_on_a_serial_line_shifts_no_later_answer(waiting: bool) -> None:
    """Every later query was given the answer to the one before it: one channel had the values of another.

    The late answer arrives while the client still waits for it, or afterwards.
    """
    instrument = LateSerialDevice(
        lambda sent: sent.endswith(b"\n"), lambda query: b"to " + query, late=b"A?\n"
    )
    known = {"library": "@py", "timeout": 0.2, "baud": 9600, "frame": "8N1"}
    client = VisaClient(f"ASRL{instrument.port}::INSTR", {**known, "send_ends": "\n", "reply_ends": "\n"})
    read, reads = client._instrument.read_bytes, count()

    def answered_late(*given: Any, **other: Any) -> bytes:
        if next(reads) == 1:  # the first read has ended without an answer
            instrument.answer_now()
        return bytes(read(*given, **other))

    if waiting:
        client._instrument.read_bytes = answered_late
    assert client.answer("A?") is None
    assert instrument.has_answered == waiting
    instrument.answer_now()
    client._instrument.timeout = PATIENCE
    assert [client.answer(query) for query in ("B?", "C?", "A?")] == ["to B?", "to C?", "to A?"]
    client.close()
    instrument.stop()


def test_a_missing_connection_or_address_is_reported() -> None:
    with ScpiServer(RIG) as server:
        port, known = server.port, settings(server)
    with pytest.raises(PortLost, match="TCPIP"):  # when it is opened, or when it is asked
        VisaClient(port, known).answer("*IDN?")
    for name, says in ((None, "which instrument"), (5025, "which instrument")):
        with pytest.raises(RigctlError, match=says):
            address_of(RIG.model_copy(update={"backend": RIG.backend.model_copy(update={"port": name})}), {})


def test_message_terminators_are_those_of_the_instrument() -> None:
    rig = parse_rig(patient(RIG.text).replace("    tries: 1", '    tries: 1\n    send_ends: "\\r\\n"'))
    assert rig.lines is not None
    assert rig.lines.send_ends == "\n"
    with unhurried(), ScpiServer(rig) as server:
        bench = create_backend(rig, None, real_clock(), {"port": server.port})
        bench.open()
        try:
            bench.command("heater", 1.0).wait()
            assert server.circuit.outputs["heater"] == 1.0
        finally:
            bench.close()
        assert server.circuit.off
