"""Lines of the board: only complete lines count."""

from __future__ import annotations

from binascii import crc_hqx

from hypothesis import given
from hypothesis import strategies as st

from rigctl.backends.arduino.messages import LineReader, Reading, Reply, Switched, parse_line, with_checksum


def line(text: str) -> bytes:
    return f"{text}*{crc_hqx(text.encode(), 0):04X}\n".encode()


READINGS = [Reading(n, 10_000 * n, (200, 500, 300), 1, 0) for n in range(5)]
STREAM = b"".join(line(f"@{r.sequence},{r.board_us},200,500,300,1,0") for r in READINGS)


def test_every_kind_of_message_is_parsed() -> None:
    assert parse_line(line("!3,123,V,-1").rstrip()) == Switched(3, 123, "V", -1)
    assert parse_line(line("#7 OK").rstrip()) == Reply(7, "OK")
    assert parse_line(line("@65535,4294967295,0,1023,7,15,63").rstrip()) == Reading(
        65535, 4294967295, (0, 1023, 7), 15, 63
    )
    assert with_checksum("*IDN?") == line("*IDN?")


@given(st.integers(0, len(STREAM)), st.integers(1, 40))
def test_parsing_can_start_anywhere_in_the_stream_with_chunks_of_any_size(begin: int, chunk: int) -> None:
    reader = LineReader()
    data = STREAM[begin:]
    got = [m for at in range(0, len(data), chunk) for m in reader.feed(data[at : at + chunk])]
    assert got == READINGS[len(READINGS) - len(got) :]
    assert len(got) >= STREAM[begin:].count(b"\n") - 1
    assert reader.damaged == 0


@given(st.integers(0, len(STREAM) - 1), st.integers(0, 255))
def test_a_changed_byte_never_gives_a_wrong_reading(at: int, byte: int) -> None:
    data = STREAM[:at] + bytes([byte]) + STREAM[at + 1 :]
    assert [m for m in LineReader().feed(b"\n" + data) if m not in READINGS] == []


@given(st.binary(max_size=600))
def test_garbage_is_skipped(garbage: bytes) -> None:
    reader = LineReader()
    reader.feed(garbage)
    assert reader.feed(b"\n" + STREAM)[-5:] == READINGS
