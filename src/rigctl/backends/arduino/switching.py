"""Switches an output of the board, and finds out when it did: by its report, or by asking it afterwards."""

from __future__ import annotations

from rigctl.backends.arduino.board import Board
from rigctl.backends.arduino.line import ANSWER, TRIES, Answer, Question
from rigctl.backends.arduino.messages import Switched
from rigctl.backends.arduino.translation import Translation
from rigctl.backends.protocol import CommandReceipt
from rigctl.backends.transport.conversation import Conversation
from rigctl.backends.transport.outbox import Outbox
from rigctl.backends.transport.port import NoAnswer
from rigctl.clock import Clock

_REPORT = 0.5  # s for the board to report a switch
_VALVE_REST = 0.05  # s that the board may let a solenoid rest before it carries a command out
_SLACK = 2e-3  # s by which the board's times may be off besides their uncertainty


class Switching:
    """Commands one board's outputs; each of them once at a time."""

    def __init__(self, translation: Translation, outbox: Outbox, clock: Clock) -> None:
        self._translation = translation
        self._outbox = outbox
        self._clock = clock

    def switch(
        self, board: Board, actuator: str, value: float, duration: float | None
    ) -> Conversation[CommandReceipt]:
        """Command a switch until the board says when it was made.

        A command of which nothing is heard is sent again; a pulse only when the board says that it has not
        been carried out, since twice the same pulse is a longer one.

        Raises
        ------
        Refused
            the board does not do it.
        PortLost
            it does not say so either way.
        """
        timed = duration is not None and self._translation.times_pulse(actuator, duration)
        text = self._translation.text(actuator, value, duration if timed else None)
        begun = self._clock.now()
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
        """The report of the switch; None when the board refuses, or none has come in time."""
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
        """Take the report of this switch out of what has arrived, and those of the way there."""
        kind, raw = self._translation.event_kind(actuator), self._translation.raw(actuator, value)
        turns = self._outbox.commanded[actuator] not in (0.0, value)  # over neutral
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
        self, board: Board, actuator: str, value: float, begun: float, accepted: Answer | None
    ) -> Conversation[CommandReceipt | None]:
        """What is known of a switch whose report has not arrived; None when it has not been made.

        Of the valve the board remembers the times. Of the others it is known that they are switched between
        the command's arrival and its answer.
        """
        if self._translation.event_kind(actuator) == "V":
            answer = yield from board.line.asking("VALV:TIME?")
            switched_on, switched_off = map(int, answer.text.split(","))
            board_us = switched_on if self._translation.raw(actuator, value) else switched_off
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
