"""The board's interlocks without a host."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from firmware_build import FIRMWARE, needs_compiler

if TYPE_CHECKING:
    from board_chip import Chip

#: s for one reading of each channel: 13 cycles of the converter's clock, an eighth of a megahertz, each
CYCLE = 3 * 13 / 125e3


@pytest.mark.parametrize(
    ("counts", "cause", "bit"),
    [
        ((200, 500, 640), "over-temperature", 1),
        ((680, 500, 300), "over-pressure", 2),
        ((0, 500, 300), "sensor open or shorted", 16),
        ((200, 0, 300), "sensor open or shorted", 16),
        ((200, 1023, 300), "sensor open or shorted", 16),
        ((200, 500, 5), "sensor open or shorted", 16),
    ],
)
def test_an_interlock_switches_off_within_20_ms_reports_its_cause_and_latches(
    chip: Chip, counts: tuple[int, int, int], cause: str, bit: int
) -> None:
    chip.send("OUTP:HEAT ON\nVALV EXT\nSOUR:PRES 500")
    assert chip.pins["heater"]
    assert chip.pins["extend"]
    chip.put(*counts)
    began = chip.time
    chip.run(0.05)
    assert [name for _, name, level in chip.edges[-2:] if not level] == ["heater", "extend"]
    assert chip.edges[-1][0] - began < 0.02
    assert chip.avr.pwm == 0.0
    assert chip.ask("SYST:TRIP?") == f'{bit},"{cause}"'
    assert chip.ask("SYST:ERR?").endswith(f'"Trip;{cause}"')

    assert chip.ask("#1 SYST:TRIP:CLE") == '#1 !-221,"Settings conflict"', "while the cause lasts"
    chip.put(200, 500, 300)
    chip.run(0.02)
    for refused in ("OUTP:HEAT ON", "VALV RET", "SOUR:PRES 1"):
        assert "-221" in chip.ask(f"#2 {refused}"), "latched after the cause is gone"
    chip.send("*RST\n*CLS")
    assert chip.ask("SYST:TRIP?").startswith(str(bit)), "not cleared by the way"
    assert chip.ask("#3 SYST:TRIP:CLE") == "#3 OK"
    assert chip.ask("#4 VALV RET") == "#4 OK"


def test_one_disturbed_reading_does_not_trip(chip: Chip) -> None:
    chip.put(1000, 500, 300)
    chip.run(0.0005)
    chip.put(200, 500, 300)
    chip.run(0.05)
    assert chip.ask("SYST:TRIP?") == '0,""'


@pytest.mark.parametrize("every", [2, 3])
@pytest.mark.parametrize(
    ("faulty", "between", "bit"),
    [
        ((200, 500, 0), (200, 500, 300), 16),
        ((200, 500, 0), (200, 500, 660), 1),
        ((1023, 500, 300), (680, 500, 300), 2),
        ((680, 500, 300), (200, 500, 300), 2),
    ],
    ids=["loose", "loose and hot", "loose and over-pressure", "over-pressure"],
)
def test_good_readings_in_between_do_not_hide_a_fault(
    chip: Chip, faulty: tuple[int, ...], between: tuple[int, ...], bit: int, every: int
) -> None:
    """A loose contact: of each two or three readings of a channel, one is a faulty one."""
    chip.send("OUTP:HEAT ON")
    began, number = chip.time, 0
    while chip.pins["heater"] and chip.time - began < 0.1:
        chip.put(*(faulty if number % every == 0 else between))
        chip.run(CYCLE)
        number += 1
    assert chip.time - began < 0.05
    assert int(chip.ask("SYST:TRIP?").partition(",")[0]) & bit
    for number in range(120):  # it lasts
        chip.put(*(faulty if number % every == 0 else between))
        chip.run(CYCLE)
    chip.tell("#1 SYST:TRIP:CLE")
    for number in range(60):
        chip.put(*(faulty if number % every == 0 else between))
        chip.run(CYCLE)
    assert b"-221" in chip.avr.take()


def test_rare_disturbed_readings_do_not_trip(chip: Chip) -> None:
    for number in range(600):
        chip.put(*((1000, 500, 1010) if number % 8 == 0 else (200, 500, 300)))
        chip.run(CYCLE)
    assert chip.ask("SYST:TRIP?") == '0,""'


def test_a_silent_host_is_noticed_within_two_seconds(chip: Chip) -> None:
    chip.send("OUTP:HEAT ON")
    for _ in range(5):
        chip.send("SYST:PING", 1.2)
    assert chip.pins["heater"], "a host that speaks keeps it on"
    last = chip.time
    chip.run(2.0)
    (_, _, _), (off, name, level) = chip.edges
    assert (name, level) == ("heater", False)
    assert off - last < 2.0
    assert chip.ask("SYST:TRIP?") == '4,"host silent"'


def test_a_silent_host_does_not_trip_the_board_with_all_outputs_off(chip: Chip) -> None:
    chip.run(3.0)
    assert chip.ask("SYST:TRIP?") == '0,""'


@pytest.mark.parametrize(
    "garbage",
    [b"VALV EXT*0000\n" + bytes(range(128, 180)), b"noise\n~ 7\n#1\n", b"#1 VALVES EXT\n"],
    ids=["damaged", "lines", "no command"],
)
def test_garbage_does_not_count_as_a_sign_of_the_host(chip: Chip, garbage: bytes) -> None:
    chip.send("VALV EXT")
    for _ in range(20):
        chip.avr.send(garbage)
        chip.run(0.1)
    assert not chip.pins["extend"]
    chip.send("")
    assert chip.ask("#1 SYST:TRIP?").startswith("#1 4")


def test_a_program_that_hangs_is_restarted_with_everything_off(chip: Chip) -> None:
    chip.send("OUTP:HEAT ON\nVALV EXT\nDIAG:HANG", 0.02)
    assert chip.pins["extend"]
    chip.run(0.4)
    assert chip.avr.resets == 1
    assert chip.ask("SYST:TRIP?") == '8,"restarted by the MCU watchdog"'
    assert chip.ask("MEAS:ALL?").split(",")[4] == "0"


def test_a_trip_outlasts_the_reset_button(chip: Chip) -> None:
    chip.put(680, 500, 300)
    chip.run(0.02)
    chip.put(200, 500, 300)
    chip.avr.reset()
    chip.run(0.05)
    assert chip.ask("SYST:TRIP?") == '2,"over-pressure"'


def test_rapid_commands_respect_the_rest_time_and_never_energise_both_solenoids(chip: Chip) -> None:
    both = False
    for turn in range(150):
        chip.avr.send(b"VALV EXT\n" if turn % 2 else b"VALV RET\n")
        chip.run(0.007)
        both |= chip.pins["extend"] and chip.pins["retract"]
    chip.send("VALV OFF")
    assert not both
    switched_on = [time for time, name, level in chip.edges if level]
    released = [time for time, name, level in chip.edges if not level]
    assert len(switched_on) < 25
    assert all(on - max(off for off in released if off < on) >= 0.049 for on in switched_on[1:])


def test_only_the_latest_of_several_waiting_commands_is_carried_out(chip: Chip) -> None:
    chip.send("VALV EXT\nVALV RET\nVALV EXT,200", 0.1)
    assert chip.pins == {"heater": False, "extend": True, "retract": False}
    chip.run(0.3)
    assert not chip.pins["extend"]


@pytest.mark.parametrize("end", ["OUTP:SAFE", "*RST", "VALV OFF", "trip"])
def test_a_command_that_waits_is_forgotten_when_outputs_go_off(chip: Chip, end: str) -> None:
    chip.send("VALV EXT\nVALV RET", 0.01)
    assert chip.pins == {"heater": False, "extend": False, "retract": False}, "it rests for 50 ms"
    if end == "trip":
        chip.put(680, 500, 300)
    else:
        chip.send(end, 0.01)
    chip.run(0.2)
    assert not chip.pins["retract"]
    assert chip.ask("VALV?") == "OFF"


def test_no_output_can_be_switched_on_while_a_trip_is_latched(chip: Chip) -> None:
    chip.put(680, 500, 300)
    chip.run(0.02)
    assert "-221" in chip.ask("#1 SYST:TRIP:CLE"), "its cause lasts"
    chip.put(200, 500, 300)
    chip.run(0.02)
    for command in ("OUTP:HEAT ON", "VALV EXT", "VALV RET,100", "SOUR:PRES 500"):
        assert "-221" in chip.ask(f"#1 {command}"), command
    chip.run(0.1)
    assert chip.ask("MEAS:ALL?").split(",")[4:] == ["0", "0", "2"]
    assert chip.ask("#1 SYST:TRIP:CLE") == "#1 OK"
    assert chip.ask("#1 OUTP:HEAT ON") == "#1 OK"


def test_the_heater_cannot_be_switched_on_again_before_its_rest_time(chip: Chip) -> None:
    chip.send("OUTP:HEAT ON\nOUTP:HEAT OFF")
    assert chip.ask("#1 OUTP:HEAT ON") == '#1 !-221,"Settings conflict"'
    chip.run(2.1)
    assert chip.ask("#2 OUTP:HEAT ON") == "#2 OK"


@needs_compiler
def test_the_board_trips_when_the_heater_is_on_for_too_long(
    make_chip: Callable[[Path], Chip], tmp_path: Path
) -> None:
    subprocess.run(
        ["make", "-C", str(FIRMWARE), f"BUILD={tmp_path}", "BAUDS=115200", "EXTRA=-DHEATER_CREDIT_S=3"],
        check=True,
        capture_output=True,
    )
    chip = make_chip(tmp_path / "rigctl-uno-115200.hex")
    chip.send("OUTP:HEAT ON")
    began = chip.time
    for _ in range(6):
        chip.send("SYST:PING", 1.0)
    (_, _, _), (off, _, _) = chip.edges
    assert 3.0 <= off - began <= 4.1
    assert chip.ask("SYST:TRIP?") == '32,"heater on for too long"'
