"""The bench of a line-based device: the two-heater board in memory, on a virtual clock."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from random import Random

import pytest

from rigctl.backends.errors import BackendLost, OutputsNotSafe
from rigctl.backends.lines.bench import LineBench
from rigctl.backends.protocol import Sample
from rigctl.backends.transport.guard_port import GuardActed
from rigctl.clock import VirtualClock
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, load_rig, parse_rig
from tclab_board import VERSION, MemoryPort, Sketch

TCLAB = load_rig(shipped("rigs", "tclab-board.yaml"))


@dataclass
class Board:
    bench: LineBench
    port: MemoryPort
    clock: VirtualClock

    @property
    def sketch(self) -> Sketch:
        return self.port.sketch

    def samples(self, count: int) -> list[Sample]:
        found = [self.bench.next_sample(5.0) for _ in range(count)]
        assert all(found)
        return [sample for sample in found if sample is not None]

    def messages(self, kind: str) -> list[str]:
        return [notice.message for notice in self.bench.take_notices() if notice.kind == kind]

    def interrupt(self) -> None:
        """Let the next reading find that the guard has acted."""
        read, acted = self.port.read, [GuardActed(2.3)]

        def interrupted(until: float) -> bytes:
            if acted:
                raise acted.pop()
            return read(until)

        self.port.read = interrupted  # type: ignore[method-assign]

    def interrupt_sending(self, text: bytes, times: int) -> None:
        """Let the next sendings of a line find that the guard has acted."""
        write, acted = self.port.write, [GuardActed(2.3)] * times

        def interrupted(data: bytes) -> None:
            if acted and data == text:
                raise acted.pop()
            write(data)

        self.port.write = interrupted  # type: ignore[method-assign]


@pytest.fixture
def make() -> Callable[..., Board]:
    def made(rig: Rig = TCLAB, delay: float = 0.01, kind: type[MemoryPort] = MemoryPort) -> Board:
        clock = VirtualClock()
        port = kind(Sketch(clock.now), clock)
        port.delay = delay
        assert rig.backend.lines is not None
        bench = LineBench(rig, rig.backend.lines, clock, lambda: port, kind="serial")
        bench.open()
        return Board(bench, port, clock)

    return made


@pytest.fixture
def board(make: Callable[..., Board]) -> Board:
    return make()


def with_lines(old: str, new: str) -> Rig:
    """The shipped rig with a part of its text changed."""
    assert old in TCLAB.text
    return parse_rig(TCLAB.text.replace(old, new))


def test_opening_checks_the_identity_and_switches_outputs_off_first(board: Board) -> None:
    assert board.bench.identity["firmware"] == "1.4.0 Arduino Uno"
    sent = ["VER", "X", "Q1 0.00", "Q2 0.00", "R1", "R2", "VER"]
    assert board.sketch.received == sent, "and reads them back, still from the same device"


def test_a_device_that_answers_just_within_the_timeout_is_opened(make: Callable[..., Board]) -> None:
    """This includes the commands that make it safe: the timeout of 0.2 s applies only at the end of a run."""
    board = make(delay=0.45)
    board.bench.start(0.4)
    assert board.samples(2)[-1].commands == (0.0, 0.0)


def test_a_late_identity_is_not_taken_as_the_answer_to_the_commands_that_make_safe(
    make: Callable[..., Board],
) -> None:
    """A computer that is busy when the device starts: the first answers come after they were given up."""
    delays = [0.7, 0.4, 0.4]

    class Starting(MemoryPort):
        def write(self, data: bytes) -> None:
            self.delay = delays.pop(0) if delays and data.startswith(b"VER") else 0.01
            super().write(data)

    board = make(with_lines('{send: X, reply: "{_}"}', "{send: X, reply: X}"), kind=Starting)
    assert not delays
    assert board.bench.identity["firmware"] == "1.4.0 Arduino Uno"
    assert board.sketch.received[-6:] == ["X", "Q1 0.00", "Q2 0.00", "R1", "R2", "VER"]


def test_samples_hold_the_answers_of_the_board_at_the_requested_rate(board: Board) -> None:
    board.bench.start(2.0)
    samples = board.samples(20)
    steps = [b.time - a.time for a, b in pairwise(samples)]
    assert steps == pytest.approx([0.5] * 19, abs=0.02)
    for sample in samples:
        assert sample.values == pytest.approx([294.15, 294.15], abs=1.0)
        assert sample.commands == (0.0, 0.0)


def test_slow_queries_are_sent_at_their_own_rate(board: Board) -> None:
    board.bench.start(10.0)
    board.sketch.received.clear()
    board.samples(100)
    asked = {name: board.sketch.received.count(name) for name in ("T1", "T2", "R1", "R2")}
    assert asked["T1"] == asked["T2"] == 100
    assert asked["R1"] == asked["R2"] == pytest.approx(10, abs=1)


class LateClock(VirtualClock):
    """A clock whose waits end up to 1 ms late, as on any computer."""

    late = Random(1)

    def sleep_until(self, when: float) -> None:
        if when > self.now():
            super().sleep_until(when + self.late.uniform(0.0, 1e-3))


@pytest.mark.parametrize("seed", range(5))
def test_a_slow_query_is_sent_with_every_second_sample_however_late_each_is(seed: int) -> None:
    clock = LateClock()
    clock.late = Random(seed)
    port = MemoryPort(Sketch(clock.now), clock)
    assert TCLAB.backend.lines is not None
    board = Board(LineBench(TCLAB, TCLAB.backend.lines, clock, lambda: port, kind="serial"), port, clock)
    board.bench.open()
    board.bench.start(2.0)
    clock.sleep_until(clock.now() + 1e-6)  # the first sample is late, too
    board.sketch.received.clear()
    board.samples(60)
    numbers, number = [], 0  # of the samples with which the query was sent
    for text in board.sketch.received:
        number += text == "T1"
        if text == "R1":
            numbers.append(number)
    assert number == 60
    assert numbers == list(range(1, 60, 2))


def test_the_receipt_of_a_command_is_uncertain_by_half_the_response_time(board: Board) -> None:
    board.bench.start(2.0)
    before = board.clock.now()
    receipt = board.bench.command("heater_1", 0.4).wait()
    assert board.sketch.received[-1] == "Q1 40.00"
    assert board.sketch.heaters == (40.0, 0.0)
    assert before <= receipt.time <= board.clock.now()
    assert receipt.uncertainty == pytest.approx(0.005)
    board.clock.sleep_until(400.0)
    warm = board.samples(3)[-1]
    assert warm.values[0] > 310.0
    assert warm.commands == (0.4, 0.0)


def test_an_answer_with_another_value_than_commanded_is_an_error(board: Board) -> None:
    board.sketch.odd["Q1 40.00"] = b"35.00\r\n"
    with pytest.raises(RigctlError, match=r"answers '35.00' to 'Q1 40.00'; expected '40 %'"):
        board.bench.command("heater_1", 0.4).wait()


def test_an_answer_rounded_by_the_board_confirms_the_command(board: Board) -> None:
    board.sketch.odd["Q1 33.33"] = b"33.3\r\n"
    assert board.bench.command("heater_1", 1.0 / 3.0).wait().value == pytest.approx(1.0 / 3.0)


def test_a_value_out_of_range_is_refused_before_anything_is_sent(board: Board) -> None:
    board.sketch.received.clear()
    with pytest.raises(RigctlError, match="out of range"):
        board.bench.command("heater_1", 1.2).wait()
    assert board.sketch.received == []


def test_a_rate_faster_than_the_device_can_answer_is_refused(board: Board) -> None:
    with pytest.raises(RigctlError, match="at most 10 Hz"):
        board.bench.start(20.0)


def test_a_device_that_is_too_slow_leaves_gaps(board: Board) -> None:
    board.bench.start(10.0)
    board.samples(2)
    board.bench.take_notices()
    board.port.delay = 0.15  # two queries: three times the period
    samples = board.samples(10)
    assert samples[-1].time - samples[0].time > 2.0
    gaps = [n for n in board.bench.take_notices() if n.kind == "gap"]
    assert gaps
    assert gaps[-1].fields["samples"] >= 2


def test_the_end_of_a_pulse_is_sent_in_time(board: Board) -> None:
    board.bench.start(1.0)
    receipt = board.bench.command("heater_2", 0.5, duration=3.0).wait()
    board.samples(5)
    (end,) = board.bench.take_receipts()
    assert (end.actuator, end.value) == ("heater_2", 0.0)
    assert end.time - receipt.time == pytest.approx(3.0, abs=0.05)
    assert board.sketch.heaters == (0.0, 0.0)


def test_a_late_answer_is_not_taken_as_the_answer_to_the_next_query(board: Board) -> None:
    board.bench.start(1.0)
    board.samples(1)
    board.sketch.model._T2 = 60.0  # distinguishable from the first
    board.port.delay = 0.55  # longer than the timeout: each answer would arrive for the next query
    board.bench.next_sample(6.0)
    board.port.delay = 0.01
    for sample in board.samples(5):
        assert sample.values[1] - sample.values[0] > 20.0


def test_unsolicited_lines_are_discarded_and_reported_in_a_note(board: Board) -> None:
    board.bench.start(2.0)
    board.samples(1)
    board.port.send_unasked(b"\xff\x00garbage\r\n12.5\r\n")
    samples = board.samples(3)
    assert all(290.0 < value < 300.0 for sample in samples for value in sample.values)
    (note,) = board.messages("note")
    assert note.startswith("2 lines that nobody asked for: ")
    assert "garbage" in note
    assert "'12.5'" in note


@pytest.mark.parametrize("moment", ["between", "before the answer", "instead of the answer"])
def test_a_greeting_that_nobody_asked_for_is_a_restart(board: Board, moment: str) -> None:
    """Its outputs are those it starts with, whatever was commanded: contact counts as lost meanwhile."""
    board.bench.start(2.0)
    board.samples(2)
    board.bench.command("heater_1", 0.6).wait()
    board.samples(1)
    board.sketch.reset()
    greeting = f"{VERSION}\r\n".encode()
    if moment == "between":
        board.port.send_unasked(greeting)
    else:
        board.sketch.odd["T1"] = greeting + b"23.0\r\n" * (moment == "before the answer")
    samples = [board.bench.next_sample(5.0) for _ in range(4)]
    assert samples[-1] is not None
    assert samples[-1].commands == (0.0, 0.0)
    notices = board.bench.take_notices()
    assert any("has restarted: it sent 'TCLab Firmware" in notice.message for notice in notices)
    (gap,) = [notice for notice in notices if notice.kind == "gap"]
    assert gap.fields["switched_off"] == ["heater_1"]


def test_an_identity_that_was_asked_for_and_comes_late_is_no_restart(board: Board) -> None:
    board.bench.start(0.5)
    board.samples(1)
    for delay in (0.7, 0.6):
        board.port.delay = delay  # longer than the timeout: the line is resynchronised by the identity
        board.bench.next_sample(8.0)
        board.port.delay = 0.01
        board.samples(3)
    assert not any("restarted" in notice.message for notice in board.bench.take_notices())


def test_an_output_is_read_back_before_it_is_commanded_again(board: Board) -> None:
    """A loop commands at each sample, its output is read once a second: a restart in between is seen."""
    board.bench.start(2.0)
    for level in (0.5, 0.51, 0.52):
        board.bench.command("heater_1", level).wait()
        board.samples(1)
    board.sketch.reset()
    board.bench.command("heater_1", 0.53)
    with pytest.raises(BackendLost, match="the device has set heater_1 to 0 % by itself"):
        for _ in range(4):
            board.bench.next_sample(1.0)


def test_a_query_with_a_corrupt_answer_is_repeated_after_resynchronisation(board: Board) -> None:
    board.bench.start(2.0)
    board.sketch.odd["T1"] = b"2x.3\r\n"
    board.sketch.received.clear()
    (sample,) = board.samples(1)
    assert sample.values[0] == pytest.approx(294.0, abs=1.0)
    assert board.sketch.received[:3] == ["T1", "VER", "T1"]  # brought back into step in between


def test_a_board_that_reconnects_has_its_heaters_off(board: Board) -> None:
    board.bench.start(2.0)
    board.bench.command("heater_1", 0.5).wait()
    board.samples(2)
    board.port.gone = True
    assert board.bench.next_sample(3.0) is None
    assert any("lost" in message for message in board.messages("fault"))
    board.port.gone = False
    samples = board.samples(2)
    assert samples[-1].commands == (0.0, 0.0)
    assert board.sketch.heaters == (0.0, 0.0)
    kinds = [notice.kind for notice in board.bench.take_notices()]
    assert kinds == ["note", "gap"]
    (off,) = board.bench.take_receipts()
    assert (off.actuator, off.value) == ("heater_1", 0.0)


def test_a_board_that_does_not_return_within_30_s_is_given_up(board: Board) -> None:
    board.bench.start(2.0)
    board.port.gone = True
    with pytest.raises(BackendLost, match="did not come back within 30 s"):
        for _ in range(100):
            board.bench.next_sample(1.0)


def test_a_board_that_stops_answering_is_reported_as_lost(board: Board) -> None:
    board.bench.start(2.0)
    board.port.mute = True
    assert board.bench.next_sample(5.0) is None
    assert any("does not answer 'T1'" in message for message in board.messages("fault"))


def test_a_board_that_was_reset_ends_the_run(board: Board) -> None:
    board.bench.start(2.0)
    board.bench.command("heater_1", 0.5).wait()
    board.samples(2)
    board.sketch.reset()
    states = []
    with pytest.raises(BackendLost, match="the device has set heater_1 to 0 % by itself"):
        while True:
            sample = board.bench.next_sample(2.0)
            states.append(sample.commands[0] if sample is not None else None)
    assert states[-2:] == [0.0, None]
    assert board.messages("alarm") == ["the device has set heater_1 to 0 % by itself"]


def test_safe_sends_all_its_commands_even_when_an_answer_is_missing(board: Board) -> None:
    board.bench.command("heater_1", 0.5).wait()
    board.sketch.odd["X"] = b""
    board.sketch.received.clear()
    with pytest.raises(BackendLost, match="may not be safe"):
        board.bench.safe()
    assert [text for text in board.sketch.received if text[0] in "XQ"] == ["X", "Q1 0.00", "Q2 0.00"]
    assert board.sketch.heaters == (0.0, 0.0)


def test_a_silent_board_is_made_safe_within_a_second(board: Board) -> None:
    board.bench.command("heater_1", 0.5).wait()
    answer = board.sketch._answer
    board.sketch._answer = lambda line: answer(line) and b""  # type: ignore[method-assign]
    began = board.clock.now()
    with pytest.raises(BackendLost, match="may not be safe"):
        board.bench.safe()
    assert board.clock.now() - began < 1.0
    assert board.sketch.heaters == (0.0, 0.0)


def test_closing_switches_off(board: Board) -> None:
    board.bench.command("heater_2", 0.5).wait()
    board.bench.close()
    assert board.sketch.heaters == (0.0, 0.0)
    assert board.port.closed


def test_another_device_is_refused() -> None:
    rig = with_lines("TCLab Firmware {firmware}", "Acme {firmware}")
    clock = VirtualClock()
    port = MemoryPort(Sketch(clock.now), clock)
    assert rig.backend.lines is not None
    bench = LineBench(rig, rig.backend.lines, clock, lambda: port, kind="serial")
    with pytest.raises(RigctlError, match=r"another device is on this port.*got 'TCLab Firmware 1.4.0"):
        bench.open()
    assert port.closed


def test_a_silent_port_is_reported_after_the_wake_time_of_the_device(make: Callable[..., Board]) -> None:
    clock = VirtualClock()
    port = MemoryPort(Sketch(clock.now), clock)
    port.mute = True
    assert TCLAB.backend.lines is not None
    bench = LineBench(TCLAB, TCLAB.backend.lines, clock, lambda: port, kind="serial")
    with pytest.raises(BackendLost, match="nobody answers"):
        bench.open()
    assert 5.0 < clock.now() < 8.0


def test_one_query_can_read_several_channels_from_an_answer_of_several_lines(
    make: Callable[..., Board],
) -> None:
    queries = TCLAB.text[TCLAB.text.index("      - {send: T1") : TCLAB.text.index("    actuators:")]
    names = '"{temperature_1}", "{temperature_2}", "{heater_1}", "{heater_2}"'
    scan = f"      - send: SCAN\n        reply: [{names}]"
    board = make(with_lines(queries, f"{scan}\n"))
    board.bench.start(2.0)
    board.bench.command("heater_2", 0.25).wait()
    samples = board.samples(3)
    assert board.sketch.received.count("SCAN") == 1 + 3, "it is read back once while opening"
    assert samples[-1].commands == (0.0, 0.25)
    assert samples[-1].values[0] == pytest.approx(294.0, abs=1.0)


def test_a_keep_alive_is_sent_when_no_other_command_is(make: Callable[..., Board]) -> None:
    rig = with_lines(
        "    watchdog: 2 s", '    keep_alive: {send: P1, reply: "{_}", every: 0.5 s}\n    watchdog: 2 s'
    )
    board = make(rig)
    board.bench.start(0.25)
    board.sketch.received.clear()
    board.samples(2)
    assert board.sketch.received.count("P1") == 7  # in 4 s
    board.bench.start(10.0)
    board.sketch.received.clear()
    board.samples(20)
    assert "P1" not in board.sketch.received


def test_a_setting_can_be_confirmed_by_a_query(make: Callable[..., Board]) -> None:
    board = make(with_lines("    safe:", '    confirm: {send: VER, reply: "TCLab {_}"}\n    safe:'))
    assert board.bench.command("heater_1", 0.1).wait().value == 0.1
    board.sketch.odd["VER"] = b'-222,"Data out of range"\r\n'
    with pytest.raises(RigctlError, match=r"answers '-222,.Data out of range.' to 'Q1 90.00'"):
        board.bench.command("heater_1", 0.9).wait()


def test_an_error_reply_refuses_a_command_and_makes_a_reading_nan(make: Callable[..., Board]) -> None:
    board = make(with_lines("    safe:", '    errors: ["ERR {_}"]\n    safe:'))
    board.sketch.odd["Q1 90.00"] = b"ERR too hot\r\n"
    with pytest.raises(RigctlError, match=r"answers 'ERR too hot' to 'Q1 90.00'"):
        board.bench.command("heater_1", 0.9).wait()
    board.bench.start(2.0)
    board.sketch.odd["T1"] = b"ERR sensor\r\n"
    (sample,) = board.samples(1)
    assert math.isnan(sample.values[0])
    assert sample.values[1] == pytest.approx(294.0, abs=1.0)
    assert board.messages("fault") == ["the device answers 'ERR sensor' to 'T1'"]


def test_an_unexpected_answer_to_a_status_query_ends_the_run(
    make: Callable[..., Board],
) -> None:
    asked = '      - {send: VER, reply: "TCLab {_}"}\n      - {send: T1'
    board = make(with_lines("      - {send: T1", asked))
    board.bench.start(2.0)
    board.samples(2)
    board.sketch.always["VER"] = b"TRIPPED\r\n"
    with pytest.raises(BackendLost, match=r"answers 'TRIPPED' to 'VER'"):
        for _ in range(10):
            board.bench.next_sample(1.0)
    (alarm,) = board.messages("alarm")
    assert "expected 'TCLab {_}'" in alarm


def test_outputs_switched_off_by_the_guard_get_receipts(board: Board) -> None:
    board.bench.start(2.0)
    board.bench.command("heater_1", 0.5).wait()
    board.samples(1)
    board.interrupt()
    with pytest.raises(BackendLost, match=r"rigctl stood still for 2.3 s"):
        for _ in range(10):
            board.bench.next_sample(2.0)
    (off,) = board.bench.take_receipts()
    assert (off.actuator, off.value) == ("heater_1", 0.0)


def test_a_guard_action_with_all_outputs_off_is_only_a_note(board: Board) -> None:
    board.bench.start(2.0)
    board.interrupt()
    board.samples(5)
    assert len(board.messages("note")) == 1


def test_safe_commands_are_sent_even_when_answers_are_out_of_step(board: Board) -> None:
    board.bench.start(2.0)
    board.bench.command("heater_1", 0.5).wait()
    board.sketch.always |= {"VER": b"5\r\n", "T1": b"eh?\r\n"}  # every answer belongs to another query
    board.bench.next_sample(5.0)
    board.sketch.received.clear()
    with pytest.raises(OutputsNotSafe, match="answers '5' to 'VER'"):  # who has carried them out is unknown
        board.bench.safe()
    assert board.sketch.received[:3] == ["X", "Q1 0.00", "Q2 0.00"]
    assert board.sketch.heaters == (0.0, 0.0)


def test_an_output_is_unconfirmed_if_the_guard_acts_twice_while_it_is_made_safe(
    make: Callable[..., Board],
) -> None:
    """The guard's own commands were not answered either; a heater that nothing reads may still be on."""
    text = TCLAB.text
    for number in (1, 2):
        query = f'      - {{send: R{number}, reply: "{{heater_{number}}}", every: 1 s}}\n'
        assert query in text
        text = text.replace(query, "")
    board = make(parse_rig(text))
    board.bench.command("heater_1", 0.6).wait()
    board.sketch.always |= {"X": b"X\r\n", "Q1 0.00": b"0.00\r\n"}  # acknowledged, and not carried out
    board.interrupt_sending(b"Q1 0.00\n", 2)
    with pytest.raises(OutputsNotSafe, match=r"rigctl stood still for 2.3 s") as told:
        board.bench.safe()
    assert told.value.outputs["heater_1"] == pytest.approx(0.6)
    assert board.sketch.heaters == (60.0, 0.0), "the witness"


def test_a_guard_that_acts_while_a_line_out_of_step_is_made_safe_is_reported(board: Board) -> None:
    board.bench.start(2.0)
    board.bench.command("heater_1", 0.5).wait()
    board.samples(1)
    board.port.delay = 0.2
    while board.sketch.received[-1] != "T1":
        board.bench.next_sample(0.05)
    board.port.delay = 0.01
    board.bench.take_notices()
    board.interrupt_sending(b"X\n", 1)
    board.bench.safe()  # a query is in progress, whose answer is not waited for
    assert board.sketch.heaters == (0.0, 0.0)
    assert [(end.actuator, end.value, end.uncertainty) for end in board.bench.take_receipts()] == [
        ("heater_1", 0.0, 2.3)
    ]
    (alarm,) = board.messages("alarm")
    assert alarm.startswith("rigctl stood still for 2.3 s")


def test_an_invalid_read_back_does_not_change_the_commanded_values(board: Board) -> None:
    board.bench.start(2.0)
    board.sketch.odd["R1"] = b"eh?\r\n"
    samples = board.samples(4)
    assert all(sample.commands == (0.0, 0.0) for sample in samples)
    assert not board.messages("alarm")
