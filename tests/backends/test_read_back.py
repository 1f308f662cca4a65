"""Only what was read back is believed: devices that acknowledge 'off' and stay on, on a virtual clock."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import pytest

from rigctl.backends.errors import BackendLost, OutputsNotSafe
from rigctl.backends.lines.bench import LineBench
from rigctl.backends.transport.safe_commands import Duty, Outputs
from rigctl.clock import VirtualClock
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig, parse_rig
from tclab_board import MemoryPort, Sketch

TCLAB = load_rig(shipped("rigs", "tclab-board.yaml")).text


class Board:
    """The two-heater board, whose heaters may ignore a command while it is acknowledged."""

    def __init__(self, text: str = TCLAB, answers: dict[str, bytes] | None = None) -> None:
        self.rig, self.clock, self.duty = parse_rig(text), VirtualClock(), Duty()
        self.sketch = Sketch(self.clock.now)
        self.port = MemoryPort(self.sketch, self.clock)
        self.port.delay = 0.005
        self.sketch.always |= answers or {}
        assert self.rig.backend.lines is not None
        self.bench = LineBench(
            self.rig, self.rig.backend.lines, self.clock, lambda: self.port, kind="serial", duty=self.duty
        )
        self.bench.open()

    def lie(self, actuator: int = 1) -> None:
        """From now on, every command to switch off is acknowledged and not carried out."""
        self.sketch.always |= {"X": b"X\r\n", f"Q{actuator} 0.00": b"0.00\r\n"}

    def heat(self) -> None:
        self.bench.start(2.0)
        self.bench.command("heater_1", 0.6).wait()


def test_a_device_that_acknowledges_off_and_stays_on_is_not_believed() -> None:
    board = Board()
    board.heat()
    board.lie()
    with pytest.raises(OutputsNotSafe, match="heater_1 is 60 %, though it was commanded to be 0 %") as told:
        board.bench.safe()
    assert told.value.outputs == {"heater_1": pytest.approx(0.6)}
    assert board.duty.outputs is Outputs.DRIVEN, "its guard goes on"
    board.sketch.always.clear()
    board.bench.safe()
    assert board.duty.outputs is Outputs.SAFE
    assert board.sketch.heaters == (0.0, 0.0)


def test_off_is_believed_only_once_it_is_read_back() -> None:
    """The last command was 'off' and was acknowledged; then the line dies before a state was read."""
    board = Board()
    board.heat()
    board.lie()
    board.bench.command("heater_1", 0.0).wait()
    board.port.mute = True
    with pytest.raises(OutputsNotSafe) as told:
        board.bench.safe()
    assert told.value.outputs == {"heater_1": pytest.approx(0.6)}
    assert board.sketch.heaters == (60.0, 0.0), "the witness"


def test_an_output_that_was_read_as_off_is_off_when_the_line_dies_later() -> None:
    board = Board()
    board.heat()
    board.bench.command("heater_1", 0.0).wait()
    for _ in range(4):
        board.bench.next_sample(2.0)
    board.port.mute = True
    with pytest.raises(OutputsNotSafe) as told:
        board.bench.safe()
    assert told.value.outputs == {}
    assert told.value.unseen_since is not None
    assert board.duty.outputs is Outputs.DRIVEN, "a restart may switch it on: its guard goes on"


def test_a_device_that_cannot_be_made_safe_is_not_opened() -> None:
    with pytest.raises(OutputsNotSafe, match="outputs may not be safe: heater_1 is 60 %"):
        Board(answers={"R1": b"60.00\r\n"})


def test_an_unreadable_state_does_not_show_that_an_output_is_safe() -> None:
    board = Board()
    board.heat()
    board.sketch.always["R1"] = b"?\r\n"
    with pytest.raises(OutputsNotSafe, match=r"answers '\?' to 'R1'; expected 'the state of heater_1'"):
        board.bench.safe()


def test_a_state_that_follows_its_command_late_is_waited_for() -> None:
    board = Board()
    board.heat()
    board.sketch.always["R1"] = b"60.00\r\n"
    board.clock.now()
    late = board.clock.now() + 0.3
    read = board.port.read

    def reading(until: float) -> bytes:
        if board.clock.now() >= late:
            board.sketch.always.pop("R1", None)
        return read(until)

    board.port.read = reading  # type: ignore[method-assign]
    board.bench.safe()
    assert board.clock.now() < late + 0.5


def exchange(board: Board, after: bytes) -> Sketch:
    """Put another board, which is off, on the line once a command has been answered; return it."""
    mine, neighbour = board.sketch.take, Sketch(board.clock.now)
    neighbour.always["VER"] = b"TCLab Firmware 1.4.0 of the neighbour\r\n"
    there = [mine]

    def taking(data: bytes) -> bytes:
        answer = there[-1](data)
        if after in data:
            there.append(neighbour.take)
        return answer

    board.sketch.take = taking  # type: ignore[method-assign]
    return neighbour


def test_the_states_of_another_device_confirm_nothing() -> None:
    """It takes the place of one that only acknowledges, between the last command and the query."""
    board = Board()
    board.heat()
    board.lie()
    neighbour = exchange(board, after=b"Q2 0.00")
    with pytest.raises(OutputsNotSafe, match="another device answers than before") as told:
        board.bench.safe()
    assert told.value.outputs == {"heater_1": pytest.approx(0.6)}
    assert board.duty.outputs is Outputs.DRIVEN, "its guard goes on"
    assert set(neighbour.received) == {"R1", "R2", "VER"}, "no command"


def test_an_off_that_another_device_carried_out_is_taken_back_when_it_is_found_out() -> None:
    board = Board()
    board.heat()
    board.bench.next_sample(2.0)
    exchange(board, after=b"R1")
    board.sketch.take(b"R1\n")
    board.bench.command("heater_1", 0.0)
    for _ in range(6):
        with suppress(BackendLost):
            board.bench.next_sample(2.0)
    with pytest.raises(OutputsNotSafe) as told:
        board.bench.safe()
    assert told.value.outputs == {"heater_1": pytest.approx(0.6)}
    assert board.sketch.heaters == (60.0, 0.0), "the witness"


def test_an_acknowledged_off_is_not_believed_if_the_line_dies_before_the_query() -> None:
    board = Board()
    board.heat()
    board.lie()
    board.bench.command("heater_1", 0.0).wait()
    take = board.sketch.take
    board.sketch.take = lambda data: b"" if data == b"Q2 0.00\n" else take(data)  # type: ignore[method-assign]
    with pytest.raises(OutputsNotSafe) as told:
        board.bench.safe()
    assert told.value.outputs == {"heater_1": pytest.approx(0.6)}
    assert board.sketch.heaters == (60.0, 0.0), "the witness"


CONFIRM = '    confirm: {send: "P1", reply: "0,{_}"}\n'


class Queue(dict[str, bytes]):
    """Answers of a board with a queue of errors, at ``P1``."""

    def __init__(self, errors: list[bytes]) -> None:
        super().__init__()
        self.errors = errors

    def __contains__(self, line: object) -> bool:
        return line == "P1" or super().__contains__(line)

    def __getitem__(self, line: str) -> bytes:
        if line == "P1":
            return self.errors.pop(0) if self.errors else b"0,none\r\n"
        return super().__getitem__(line)


def with_queue(errors: list[bytes]) -> Board:
    text = TCLAB.replace("    actuators:\n", f"{CONFIRM}    actuators:\n", 1)
    queue = Queue(errors)
    patched = Sketch.__init__

    def made(self: Sketch, now: Callable[[], float]) -> None:
        patched(self, now)
        self.always = queue

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Sketch, "__init__", made)
        return Board(text)


def test_errors_from_before_the_run_are_named_as_old_and_refuse_no_command() -> None:
    errors = [b"-113,old\r\n", b"-222,older\r\n"]
    board = with_queue(errors)
    assert not errors
    (note,) = [notice.message for notice in board.bench.take_notices()]
    assert note == "the device had errors from before: '-113,old', '-222,older'"
    board.heat()
    assert board.sketch.heaters == (60.0, 0.0)


def test_a_refusal_of_off_is_read_from_the_error_queue() -> None:
    errors: list[bytes] = []
    board = with_queue(errors)
    board.heat()
    errors += [b"-221,conflict\r\n"] * 400
    with pytest.raises(OutputsNotSafe, match="'-221,conflict' to 'X'"):
        board.bench.safe()


def test_another_error_in_the_queue_does_not_make_off_unconfirmed() -> None:
    """The command is sent once more, and is not refused."""
    errors: list[bytes] = []
    board = with_queue(errors)
    board.heat()
    errors += [b"-420,query unterminated\r\n", b"-410,query interrupted\r\n"]
    board.bench.safe()
    assert board.sketch.heaters == (0.0, 0.0)
    assert board.sketch.received.count("X") >= 3


def test_an_output_is_only_taken_as_answered_if_something_answers() -> None:
    setting = 'heater_1: {send: "Q1 {value:.2f}", reply: "{value}"}'
    assert setting in TCLAB
    silent = TCLAB.replace(setting, 'heater_1: {send: "Q1 {value:.2f}"}')
    assert Board(silent).bench.outputs_answered == {"heater_2"}
    assert with_queue([]).bench.outputs_answered == {"heater_1", "heater_2"}
