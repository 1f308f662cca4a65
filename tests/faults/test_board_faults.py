"""Faults of the board and its line end the run safely and are named; real firmware, virtual time."""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import pytest

from board_workshop import BoardWorkshop, Script, sample_times
from rigctl.backends.arduino.messages import parse_line
from rigctl.backends.emulated.image import shipped_image
from rigctl.dataset import open_run
from rigctl.errors import RigctlError
from run_workshop import Done, Workshop

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="simavr is packaged for Linux only")

STROKES = """\
steps:
  - set: {heater: on}
  - repeat: 6
    do:
      - record: {name: stroke, rate: 100 Hz}
        do:
          - extend: {for: 0.6 s}
          - wait: 0.2 s
          - retract: {until: position < 1 mm, timeout: 3 s}
finally:
  - set: {heater: off, valve: neutral}
"""
RETRIED = STROKES.replace("rate: 100 Hz}", "rate: 100 Hz, retries: 2}")
IN_A_RECORD = 3.0  #: s, in the second stroke


@pytest.fixture
def board(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> BoardWorkshop:
    return BoardWorkshop(Workshop(tmp_path), monkeypatch)


@pytest.fixture
def script(board: BoardWorkshop) -> Script:
    return board.script


def outcomes(done: Done) -> list[str]:
    return [outcome for _, outcome in done.records]


def measured_again(done: Done) -> None:
    """All records are there, and the one that was cut off as well."""
    assert done.result.status == "finished", done.result.reason
    assert outcomes(done).count("complete") == 6
    assert outcomes(done).count("interrupted") == 1


def kept_until(done: Done, fault: float) -> None:
    """Samples before the fault are there, without a hole."""
    before = [time for time in sample_times(done) if time < fault]
    assert before[-1] > fault - 0.05
    inside = [b - a for a, b in pairwise(before) if b - a < 0.05]  # larger ones lie between two records
    assert len(before) - len(inside) <= 2 * len(done.records)


# --- the line ---


def test_a_record_is_measured_again_after_the_port_vanishes_and_returns(board: BoardWorkshop) -> None:
    done = board.run(RETRIED, faults=[f"backend_lost@{IN_A_RECORD} s..6 s"])
    measured_again(done)
    assert any("contact with the board is lost" in text for text in done.messages("fault"))
    assert any("the board is back after 3" in text for text in done.messages("note"))
    kept_until(done, IN_A_RECORD)


def test_without_retries_a_port_that_vanishes_ends_the_run(board: BoardWorkshop) -> None:
    fault = f"backend_lost@{IN_A_RECORD} s..6 s"
    done = board.failure(STROKES, "the emulated board cannot be reached", faults=[fault])
    assert "no sample for 1" in done.result.reason
    kept_until(done, IN_A_RECORD)


def test_a_brief_loss_ends_a_record_whose_valve_it_has_closed(
    board: BoardWorkshop,
) -> None:
    fault = f"backend_lost@{IN_A_RECORD} s..{IN_A_RECORD + 0.4} s"
    done = board.failure(STROKES, "meanwhile heater, valve went to the safe state", faults=[fault])
    assert outcomes(done)[-1] == "lost"


@pytest.mark.parametrize("steps", [STROKES, RETRIED])
def test_a_port_that_never_returns_ends_the_run_with_outputs_unconfirmed(
    board: BoardWorkshop, steps: str
) -> None:
    done = board.failure(
        steps, "the emulated board cannot be reached", faults=[f"backend_lost@{IN_A_RECORD} s"]
    )
    assert any("could not be made safe from here" in text for text in done.messages("fault"))
    assert done.result.duration < IN_A_RECORD + 35.0
    kept_until(done, IN_A_RECORD)


def test_garbage_and_incomplete_lines_lose_only_their_own_samples(
    board: BoardWorkshop, script: Script
) -> None:
    hit = iter(range(10**6))

    def noisy(line: bytes, _time: float) -> list[bytes]:
        if not line.startswith(b"@"):
            return [line]
        number = next(hit)
        if number % 50 == 20:
            return [line[: len(line) // 2]]  # the next line is joined to it
        return [b"\x00\xff#@*\r" + bytes(range(128, 160)) + b"\n", line] if number % 50 == 40 else [line]

    script.arriving = noisy
    done = board.run(STROKES)
    assert done.result.status == "finished", done.result.reason
    assert outcomes(done) == ["complete"] * 6
    missing = sum(event["samples"] for event in done.events("gap"))
    assert missing == pytest.approx(2 * next(hit) / 50, abs=2)
    assert any("damaged line" in text for text in done.messages("note"))


def test_a_damaged_line_becomes_a_gap_and_never_a_reading(board: BoardWorkshop, script: Script) -> None:
    damaged: list[bytes] = []

    def flipped(line: bytes, time: float) -> list[bytes]:
        if not line.startswith(b"@") or int(time * 100) % 25:
            return [line]
        place = line.index(b",", 20) - 1  # a digit of a reading
        damaged.append(bytes([*line[:place], line[place] ^ 0x04, *line[place + 1 :]]))
        assert parse_line(damaged[-1].strip()) is None
        return [damaged[-1]]

    script.arriving = flipped
    done = board.run(STROKES)
    assert done.result.status == "finished", done.result.reason
    assert sum(event["samples"] for event in done.events("gap")) == pytest.approx(len(damaged), abs=1)
    samples = open_run(done.result.folder).samples()
    assert samples["oil_temperature"].between(19.0, 21.5).all()
    assert samples["supply_pressure"].between(19.0, 21.0).all()


def test_a_board_that_sends_only_damaged_lines_ends_the_run(board: BoardWorkshop, script: Script) -> None:
    script.arriving = lambda line, time: [line.replace(b",", b";") if time > IN_A_RECORD else line]
    done = board.failure(STROKES, "what arrives from the board are damaged lines only")
    kept_until(done, IN_A_RECORD)


def test_repeated_sequence_numbers_are_dropped(board: BoardWorkshop, script: Script) -> None:
    script.arriving = lambda line, time: [line, line] if line.startswith(b"@") and time > 2.0 else [line]
    done = board.run(STROKES)
    assert done.result.status == "finished", done.result.reason
    times = sample_times(done)
    assert all(b > a for a, b in pairwise(times))
    assert done.events("gap") == []
    assert any("came twice or late, left out" in text for text in done.messages("note"))


def test_missing_sequence_numbers_are_recorded_as_gaps(board: BoardWorkshop, script: Script) -> None:
    arrived: int | None = None  # the last number of the stream that arrived
    between = 0  # numbers dropped between two that arrived: those before the first one are no gap

    def leaky(line: bytes, time: float) -> list[bytes]:
        nonlocal arrived, between
        if not line.startswith(b"@"):
            return [line]
        number = int(line[1:].split(b",")[0])
        if arrived is not None and number < arrived:
            arrived = None  # a new stream
        if time > 2.0 and int(time * 100) % 40 < 3:
            return []
        if arrived is not None:
            between += number - arrived - 1
        arrived = number
        return [line]

    script.arriving = leaky
    done = board.run(STROKES.replace("rate: 100 Hz", "rate: 100 Hz, most_missing: 10 %"))
    assert done.result.status == "finished", done.result.reason
    assert between > 40
    assert sum(event["samples"] for event in done.events("gap")) == pytest.approx(between, abs=3)


def test_out_of_order_sequence_numbers_never_reverse_time(board: BoardWorkshop, script: Script) -> None:
    late: list[bytes] = []

    def shuffled(line: bytes, time: float) -> list[bytes]:
        if not line.startswith(b"@") or time < 2.0:
            return [line]
        if late:
            return [line, late.pop()]
        if int(time * 100) % 20 == 0:
            late.append(line)
            return []
        return [line]

    script.arriving = shuffled
    done = board.run(STROKES)
    assert done.result.status == "finished", done.result.reason
    assert all(b > a for a, b in pairwise(sample_times(done)))
    assert len(done.events("gap")) > 5
    assert any("came twice or late, left out" in text for text in done.messages("note"))


# --- the board ---


def test_a_board_whose_clock_stood_still_is_not_reported_as_restarted(board: BoardWorkshop) -> None:
    """In real time its clock loses the time for which the computer, and so the host, was stalled."""

    def stand_still(_: object) -> None:
        board.script.ports[-1]._origin += 0.8

    board.script.at(IN_A_RECORD, stand_still)
    # the samples that are missing would end the record before the next comparison of the clocks
    patient = STROKES.replace("rate: 100 Hz", "rate: 100 Hz, most_missing: 80 %")
    assert patient != STROKES
    done = board.failure(patient, "the board's clock stood still for")
    assert not any("restarted" in text for text in done.messages("fault"))


def test_a_reset_of_the_board_in_a_record_ends_the_run(board: BoardWorkshop, script: Script) -> None:
    script.at(IN_A_RECORD, lambda chip: chip.avr.reset())
    done = board.failure(STROKES, "the board was restarted")
    assert "went to the safe state" in done.result.reason
    assert outcomes(done)[-1] == "lost"
    kept_until(done, IN_A_RECORD)


def test_a_record_in_which_the_board_was_reset_is_measured_again(
    board: BoardWorkshop, script: Script
) -> None:
    script.at(IN_A_RECORD, lambda chip: chip.avr.reset())
    done = board.run(RETRIED)
    measured_again(done)
    assert any("the board was restarted" in text for text in done.messages("fault"))


@pytest.mark.parametrize("steps", [STROKES, RETRIED])
def test_firmware_that_hangs_is_off_within_0_5_s_and_ends_the_run(
    board: BoardWorkshop, script: Script, steps: str
) -> None:
    off: list[float] = []

    def hang(chip: object) -> None:
        script.board.avr.send(b"DIAG:HANG\n")
        while any(script.board.outputs):
            script.board.run_to(script.board.time + 0.01)
        off.append(script.board.time)

    script.at(IN_A_RECORD, hang)
    done = board.failure(steps, "the board has tripped: restarted by the MCU watchdog")
    assert off[0] - IN_A_RECORD < 0.5
    kept_until(done, IN_A_RECORD)


@pytest.mark.parametrize("fault", ["sensor_open:oil_temperature", "sensor_out_of_range:supply_pressure"])
def test_an_open_or_shorted_sensor_trips_the_board_and_ends_the_run(board: BoardWorkshop, fault: str) -> None:
    done = board.failure(
        STROKES, "the board has tripped: sensor open or shorted", faults=[f"{fault}@{IN_A_RECORD} s"]
    )
    kept_until(done, IN_A_RECORD)
    assert done.result.duration < IN_A_RECORD + 0.3
    switched = [time for time, value in done.commands("heater") if value == 0.0]
    assert switched[0] - IN_A_RECORD < 0.02


def test_rapid_commands_switch_the_solenoids_no_faster_than_allowed(board: BoardWorkshop) -> None:
    storm = """\
steps:
  - record: {name: storm, rate: 100 Hz}
    do:
      - extend: {for: 0.5 s}              # away from the end: the rod drifts by what two turns differ
      - repeat: 40
        do:
          - set: {valve: extend}
          - set: {valve: retract}
finally:
  - set: {valve: neutral}
"""
    done = board.run(storm)
    assert done.result.status == "finished", done.result.reason
    on = [time for time, value in done.commands("valve") if value != 0.0]
    assert len(on) == 81
    assert all(b - a > 0.049 for a, b in pairwise(on))


# --- the wrong board ---


@pytest.mark.parametrize(
    ("identity", "message"),
    [
        (b"OTHERS,RIG-UNO,0,1.", "this is no board with rigctl's firmware, got 'OTHERS,RIG-UNO'"),
        (b"RIGCTL,RIG-UNO,0,2.", "the board's firmware speaks another protocol, got '2.1.1'"),
    ],
)
def test_wrong_firmware_is_reported_before_anything_moves(
    board: BoardWorkshop, tmp_path: Path, identity: bytes, message: str
) -> None:
    image = tmp_path / "other.hex"
    image.write_text(patched(shipped_image(115200), b"RIGCTL,RIG-UNO,0,1.", identity), encoding="ascii")
    bench = board.bench(image=str(image))
    with pytest.raises(RigctlError) as refused:
        bench.open()
    assert message in str(refused.value)
    assert "Flash the image" in str(refused.value) or "flash the image" in str(refused.value)
    assert board.script.board.outputs == (False, False, False)


def test_a_board_with_another_identity_after_a_loss_is_refused(board: BoardWorkshop, script: Script) -> None:
    bench = board.bench(faults=[f"backend_lost@{IN_A_RECORD} s..4 s"])
    bench.open()
    bench.start(100.0)
    bench.command("heater", 1.0).wait()
    bench.identity = {**bench.identity, "firmware": "RIG-UNO 1.9.9"}
    with pytest.raises(RigctlError, match=r"another board answers than before, got 'RIG-UNO 1\.1"):
        while bench.clock.now() < 20.0:
            bench.next_sample(0.1)
    script.board.run_to(script.board.time + 2.1)
    assert script.board.outputs == (False, False, False)


def patched(image: Path, old: bytes, new: bytes) -> str:
    """An Intel HEX image with some bytes replaced."""
    from rigctl.backends.emulated.image import read_intel_hex

    flash = read_intel_hex(image)
    assert flash.count(old) == 1
    flash = flash.replace(old, new)
    lines = []
    for address in range(0, len(flash), 16):
        data = flash[address : address + 16]
        record = bytes([len(data), address >> 8, address & 0xFF, 0, *data])
        lines.append(f":{record.hex()}{-sum(record) & 0xFF:02X}".upper())
    return "\n".join([*lines, ":00000001FF", ""])
