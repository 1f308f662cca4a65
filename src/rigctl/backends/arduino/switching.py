"""Switches an output of the board, and determines the time of the switch from a report or a later query."""

from __future__ import annotations

from rigctl.backends.arduino.board import Board
from rigctl.backends.arduino.line import ANSWER, TRIES, Question, TimedReply
from rigctl.backends.arduino.messages import Switched
from rigctl.backends.arduino.translation import Translation
from rigctl.backends.protocol import CommandReceipt
from rigctl.backends.transport.conversation import Conversation
from rigctl.backends.transport.outbox import Outbox
from rigctl.backends.transport.port import NoAnswer
from rigctl.clock import Clock

_REPORT = 0.5  # time-out of the report of a switch, s
_VALVE_REST = 0.05  # longest time for which the board delays a command to let a solenoid rest, s
_SLACK = 2e-3  # error of the board's times in addition to their uncertainty, s


class Switching:
    """Commands a board's outputs, with one pending command per output."""

    def __init__(self, translation: Translation, outbox: Outbox, clock: Clock) -> None:
        self._translation = translation
        self._outbox = outbox
        self._clock = clock

    def switch(
        self, board: Board, actuator: str, value: float, duration: float | None
    ) -> Conversation[CommandReceipt]:
        """Command a switch, repeatedly if necessary, until the board reports its time.

        A command that is not answered is sent again, but a pulse only if the board reports that it was not
        executed, since a repeated pulse would be longer.

        Raises
        ------
        Refused
            the board refuses the command.
        PortLost
            the outcome remains unknown.
        """
        timed = duration is not None and self._translation.times_pulse(actuator, duration)
        text = self._translation.text(actuator, value, duration if timed else None)
        begun = self._clock.now()
        # Each attempt ends in one of: the report of the switch, with its exact time; an acknowledgement
        # without a report, then the board is asked when it switched; or nothing, and the command is sent
        # again where that is harmless.
        for _ in range(TRIES):
            question = board.line.put(text)
            try:
                event = yield from self._report(board, actuator, value, begun, question)
            finally:
                board.line.withdraw(question)
            if event is not None:
                return self._receipt(board, actuator, value, event.board_us)
            accepted = question.accepted()
            if accepted is not None or (timed and not question.arrived_damaged):
                receipt = yield from self._recall(board, actuator, value, begun, accepted)
                if receipt is not None:
                    return receipt
        raise NoAnswer(f"the board does not report '{text}'")

    def _report(
        self, board: Board, actuator: str, value: float, begun: float, question: Question
    ) -> Conversation[Switched | None]:
        """Return the report of the switch; None if the board refuses, or does not report it in time."""
        deadline = question.sent + ANSWER
        accepted = False
        while True:
            event = self._find_report(board, actuator, value, begun)
            if event is not None:
                return event
            if question.answer is not None and not accepted:
                if question.answer.text.startswith("!"):
                    return None
                accepted, deadline = True, self._clock.now() + _REPORT
            if self._clock.now() >= deadline:
                return None
            yield deadline

    def _find_report(self, board: Board, actuator: str, value: float, begun: float) -> Switched | None:
        """Take the report of this switch from those received, and discard reports of the neutral position."""
        kind, raw = self._translation.event_kind(actuator), self._translation.raw(actuator, value)
        turns = self._outbox.commanded[actuator] not in (0.0, value)  # by way of neutral
        # Reports of earlier switches of the same output may still be in the queue.
        earliest = begun - board.clock_map.uncertainty - _SLACK
        for event in [event for event in board.line.switched if event.kind == kind]:
            if board.clock_map.to_host(event.board_us) < earliest:
                continue
            if event.value == raw:
                board.line.switched.remove(event)
                return event
            if event.value == 0 and turns:
                board.line.switched.remove(event)
        return None

    def _recall(
        self, board: Board, actuator: str, value: float, begun: float, accepted: TimedReply | None
    ) -> Conversation[CommandReceipt | None]:
        """Query a switch whose report has not arrived; None if it did not take place.

        The board stores only the switching times of the valve. Any other output switches between the arrival
        of the command and its answer.
        """
        if self._translation.event_kind(actuator) == "V":
            answer = yield from board.line.asking("VALV:TIME?")
            switched_on, switched_off = map(int, answer.text.split(","))
            board_us = switched_on if self._translation.raw(actuator, value) else switched_off
            # The board's number may be that of a switch one roll-over of its clock (71.6 min) ago.
            if board.clock_map.is_recent(board_us, self._clock.now() - begun + ANSWER):
                time = board.clock_map.to_host(board_us)
                if time >= begun - board.clock_map.uncertainty - _SLACK:
                    return self._receipt(board, actuator, value, board_us)
        if accepted is None:
            return None
        latest = accepted.received + (_VALVE_REST if self._translation.event_kind(actuator) == "V" else 0.0)
        middle, half = 0.5 * (accepted.sent + latest), 0.5 * (latest - accepted.sent)
        return CommandReceipt(middle, actuator, value, half)

    def _receipt(self, board: Board, actuator: str, value: float, board_us: int) -> CommandReceipt:
        time = board.clock_map.to_host(board_us)
        return CommandReceipt(time, actuator, value, board.clock_map.uncertainty)
