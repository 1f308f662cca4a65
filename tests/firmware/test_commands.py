"""The board's commands, one by one."""

from __future__ import annotations

from binascii import crc_hqx
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from board_chip import Chip


@pytest.mark.parametrize(
    ("short", "long"),
    [
        ("SYST:VERS?", "system:version?"),
        ("syst:err?", "SYSTem:ERRor:NEXT?"),
        (":SYST:TRIP?", "System:Trip?"),
        ("OUTP:HEAT?", "OUTPUT:HEATER?"),
        ("VALV?", "VALVE?"),
        ("SOUR:PRES?", "source:pressure?"),
        ("syst:conf?", "SYST:CONFIGURATION?"),
    ],
)
def test_a_header_is_written_short_or_long_in_any_case(chip: Chip, short: str, long: str) -> None:
    assert chip.ask(short) == chip.ask(long)


def test_identity_and_configuration_report_the_compiled_in_settings(chip: Chip) -> None:
    assert chip.ask("*IDN?") == "RIGCTL,RIG-UNO,0,1.1.1"
    settings = dict(part.split("=") for part in chip.ask("SYST:CONF?").split(","))
    assert (settings["baud"], settings["host_ms"], settings["pressure_trip"]) == ("115200", "1500", "675")


def test_measurements_are_the_counts_at_the_pins(chip: Chip) -> None:
    chip.put(17, 512, 638)
    _, *rest = chip.ask("MEAS:ALL?").split(",")
    assert rest == ["17", "512", "638", "0", "0", "0"]


def test_the_converter_codes_are_read_as_applied_over_the_whole_range(chip: Chip) -> None:
    for code in (*range(20, 1000, 61), 1006):
        chip.put(200, code, 300)
        assert chip.ask("MEAS:ALL?").split(",")[2] == str(code)


@pytest.mark.parametrize(
    ("command", "error"),
    [
        ("NONSENSE", '-113,"Undefined header"'),
        ("SYS:ERR?", '-113,"Undefined header"'),
        ("SYSTE:ERR?", '-113,"Undefined header"'),
        ("OUTP:HEAT", '-109,"Missing parameter"'),
        ("*IDN? 3", '-108,"Parameter not allowed"'),
        ("OUTP:HEAT PERHAPS", '-104,"Data type error"'),
        ("VALV UP", '-104,"Data type error"'),
        ("VALV EXT,-5", '-104,"Data type error"'),
        ("VALV EXT,0", '-222,"Data out of range"'),
        ("VALV EXT,60000.001", '-222,"Data out of range"'),
        ("VALV EXT,99999999999", '-222,"Data out of range"'),
        ("VALV OFF,10", '-108,"Parameter not allowed"'),
        ("SOUR:PRES 1024", '-222,"Data out of range"'),
        ("SOUR:PRES 1.5", '-104,"Data type error"'),
        ("STRM 2001", '-222,"Data out of range"'),
        ("STRM 0.001", '-222,"Data out of range"'),
        ("A" * 100, '-363,"Input buffer overrun"'),
        ("VALV EXT*0000", '-360,"Communication error"'),
    ],
)
def test_a_mistake_has_its_standard_error_number_and_moves_nothing(
    chip: Chip, command: str, error: str
) -> None:
    assert chip.send(command) == []
    assert chip.ask("SYST:ERR?") == error
    assert chip.ask("SYST:ERR?") == '0,"No error"'
    assert chip.edges == []


def test_the_error_queue_keeps_the_oldest_errors_and_reports_its_overflow(chip: Chip) -> None:
    for _ in range(10):
        chip.send("NONSENSE")
    assert chip.ask("SYST:ERR:COUN?") == "8"
    told = [chip.ask("SYST:ERR?").partition(",")[0] for _ in range(9)]
    assert told == ["-113"] * 7 + ["-350", "0"]
    chip.send("NONSENSE")
    chip.send("*CLS")
    assert chip.ask("SYST:ERR?") == '0,"No error"'


def test_a_tagged_command_is_always_answered(chip: Chip) -> None:
    assert chip.ask("#1 OUTP:HEAT ON") == "#1 OK"
    assert chip.ask("#22 OUTP:HEAT?") == "#22 1"
    assert chip.ask("#3 NONSENSE") == '#3 !-113,"Undefined header"'
    assert chip.ask("SYST:ERR?") == '0,"No error"'


def test_a_checked_command_has_a_checked_answer(chip: Chip) -> None:
    body = b"#9 *IDN?"
    answer = chip.ask(f"{body.decode()}*{crc_hqx(body, 0):04X}")
    text, _, checksum = answer.rpartition("*")
    assert text == "#9 RIGCTL,RIG-UNO,0,1.1.1"
    assert int(checksum, 16) == crc_hqx(text.encode(), 0)


@pytest.mark.parametrize("duration", [1, 7, 10.5, 250.004, 1050])
def test_a_pulse_is_timed_by_the_board_and_reported_exactly(chip: Chip, duration: float) -> None:
    chip.send(f"VALV EXT,{duration}", duration / 1e3 + 0.05)
    (on, _, _), (off, _, _) = chip.edges
    assert off - on == pytest.approx(duration / 1e3, abs=60e-6)
    told_on, told_off = map(int, chip.ask("VALV:TIME?").split(","))
    assert (told_off - told_on) * 1e-6 == pytest.approx(off - on, abs=12e-6)


def test_the_stream_is_regular_and_reports_switches(chip: Chip) -> None:
    lines = chip.send("STRM 100\nVALV EXT,100", 1.0)
    readings = [line[1:].split("*")[0].split(",") for line in lines if line.startswith("@")]
    events = [line[1:].split("*")[0].split(",") for line in lines if line.startswith("!")]
    assert [int(r[0]) for r in readings] == list(range(len(readings)))
    assert len(readings) in (99, 100)
    times = [int(r[1]) for r in readings]
    assert max(abs(b - a - 10000) for a, b in pairwise(times)) < 1000
    assert [(kind, value) for _, _, kind, value in events] == [("V", "1"), ("V", "0")]
    for line in lines:
        body, _, checksum = line.rpartition("*")
        assert int(checksum, 16) == crc_hqx(body.encode(), 0)


def test_a_command_that_lost_characters_is_not_carried_out(chip: Chip) -> None:
    """Long answers keep the board so busy that its input buffer overflows."""
    chip.send("STRM 1")
    commanded = set()
    for blanks in range(20):
        chip.avr.send(b"SYST:CONF?\n" * 3 + b" " * blanks + b"\n" + b"SOUR:PRES 1000\n" * 40)
        chip.run(0.2)
        lines = chip.avr.take().decode("latin-1").splitlines()
        commanded |= {line.split(",")[3].partition("*")[0] for line in lines if line.count(",P,") == 1}
    assert commanded == {"1000"}
    chip.send("STRM 0")
    assert chip.ask("SYST:ERR?") == '-363,"Input buffer overrun"'


def test_garbage_does_not_stop_the_board(chip: Chip) -> None:
    chip.avr.send(bytes(range(128, 256)) * 2 + b"\x00\xff*#@!:" + b"#" * 70 + b"\n#\n# \n*\n:\n?\n,\n")
    chip.run(0.1)
    chip.send("*CLS")
    chip.avr.take()
    assert chip.ask("*IDN?").startswith("RIGCTL")
    assert chip.edges == []
