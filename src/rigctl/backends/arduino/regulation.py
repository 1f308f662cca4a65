"""A closed loop that the board executes: sends its settings, and queries its state.

In: the settings of a loop (`rigctl.plan.loop`). Out: whether it is running, as the board's samples say,
and its figures of timing. While it runs, the output changes without commands of the host: it is the
board's, until an answer confirms that the loop has ended. `_unsure` names it while that is not known.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from rigctl.backends.arduino.board import Board
from rigctl.backends.arduino.line import ANSWER
from rigctl.backends.arduino.receiver import Receiver
from rigctl.backends.arduino.translation import Translation, loop_number
from rigctl.backends.protocol import CommandReceipt
from rigctl.backends.transport.conversation import ActiveConversation, Conversation
from rigctl.backends.transport.port import NoAnswer, Refused
from rigctl.clock import Clock
from rigctl.plan.loop import LoopFigures, LoopSettings, LoopState

#: the first firmware with a closed loop
SINCE = (1, 1)
_ASK = 1.0  # s between two queries of the loop's figures
_SLACK = 2e-3  # error of the board's times in addition to their uncertainty, s
_DEGREE = 3  # highest degree of the calibration polynomial on the board
_LARGEST = 3e38  # limit of the board's 32-bit numbers
_FINE = 1e-4  # smallest change of the feed-forward that is sent, as a share of the output's span
_PERIODS = (1, 60_000)  # ms
_TOGETHER = 3  # commands in flight: the board's receive buffer has 128 bytes
_TRIES = 5  # attempts per command, which is harmless if executed twice


class Regulation:
    """The loop of one board during one connection."""

    def __init__(self, translation: Translation, receiver: Receiver, clock: Clock) -> None:
        self._translation = translation
        self._receiver = receiver
        self._clock = clock
        self._loop: LoopSettings | None = None  # started, and not stopped by the host
        self._unsure = ""  # the actuator that a loop may be commanding, while that is unconfirmed
        self._began = 0.0
        self._figures: LoopFigures | None = None
        self._ahead = self._sent = 0.0
        self._asked = 0.0
        self._tending: ActiveConversation[None] | None = None

    @property
    def actuator(self) -> str:
        """The actuator that the loop commands, or may command; empty without a loop."""
        return self._loop.actuator if self._loop is not None and self.running else self._unsure

    @property
    def running(self) -> bool:
        """Whether the loop is running, according to the board's latest message."""
        if self._loop is None:
            return False
        time, looping = self._receiver.looping
        return looping or time <= self._began

    def state(self, ahead: float | None) -> LoopState:
        """Return the loop's state; `ahead` is sent when no other query is pending."""
        if ahead is not None:
            self._ahead = ahead
        return LoopState(self.running, self._figures)

    def forget(self) -> None:
        """Forget the loop after the board was made safe, lost, or given another command; figures are kept."""
        self._loop, self._unsure = None, ""
        if self._tending is not None:
            self._tending.drop()
            self._tending = None

    # --- begin and end ------------------------------------------------------------------------------------

    def begin(self, board: Board, loop: LoopSettings, value: float) -> Conversation[CommandReceipt]:
        """Send all settings and start the loop; `value` is the present output. Harmless if repeated.

        Raises
        ------
        Refused
            a trip is latched.
        PortLost
            the board does not answer.
        """
        self.forget()
        # An earlier loop, or settings of one, must not mix with these.
        yield from board.asking("CONT:CLE")
        yield from self._sending_settings(board, list(self._translation.loop_texts(loop)))
        # Set before the command and cleared by its answer: in between the loop may be driving the output.
        self._unsure = loop.actuator
        wind_up = ",CLAM" if loop.clamping else ""
        answer = yield from board.line.asking(f"CONT:STAR {'BUMP' if loop.bumpless else 'ZERO'}{wind_up}")
        self._loop, self._unsure, self._figures = loop, "", None
        # Readings up to here may be from before the start, and do not show that the loop has ended.
        self._began = answer.received + board.clock_map.uncertainty + _SLACK
        self._ahead = self._sent = loop.ahead
        self._asked = self._began
        half = 0.5 * (answer.received - answer.sent)
        return CommandReceipt(answer.sent + half, loop.actuator, value, half)

    def _sending_settings(self, board: Board, texts: list[str]) -> Conversation[None]:
        """Send settings, a few at a time, and repeat those that are not answered."""
        for start in range(0, len(texts), _TOGETHER):
            left = texts[start : start + _TOGETHER]
            for _ in range(_TRIES):
                left = yield from self._sent_once(board, left)
                if not left:
                    break
            else:
                raise NoAnswer(f"{board.port.name}: the board does not answer '{left[0]}'")

    def _sent_once(self, board: Board, texts: list[str]) -> Conversation[list[str]]:
        """Send commands together, and return those that were not answered in time."""
        questions = [board.line.put(text) for text in texts]
        deadline = self._clock.now() + ANSWER
        try:
            while self._clock.now() < deadline:
                if all(question.answer is not None for question in questions):
                    break
                yield deadline
        finally:
            for question in questions:
                board.line.withdraw(question)
        return [question.command for question in questions if question.accepted() is None]

    def end(self, board: Board, actuator: str) -> Conversation[CommandReceipt]:
        """Stop the loop, and read its output and figures; raises as `begin`."""
        figures = self._figures
        self.forget()
        self._unsure = actuator
        answer = yield from board.line.asking("CONT:STOP")
        self._unsure = ""
        # The output stays where the loop left it: what that is, only the board knows.
        counts = yield from board.asking("SOUR:PRES?")
        self._figures = _figures((yield from board.asking("CONT:FIG?"))) or figures
        half = 0.5 * (answer.received - answer.sent)
        value = self._translation.value(actuator, int(counts))
        return CommandReceipt(answer.sent + half, actuator, value, half)

    # --- while it runs ------------------------------------------------------------------------------------

    def tend(self, board: Board) -> None:
        """Continue the query in progress, or start one that is due; may raise `PortLost`."""
        if self._tending is not None:
            self._tending.go_on()
            if not self._tending.over:
                return
            self._tending = None
        if self._loop is None or not self.running:
            return
        span = self._loop.high - self._loop.low
        if abs(self._ahead - self._sent) > _FINE * span:
            self._tending = ActiveConversation(self._send_ahead(board, self._ahead))
        elif self._clock.now() >= self._asked + _ASK:
            self._tending = ActiveConversation(self._ask_figures(board))

    @property
    def due(self) -> Iterator[float]:
        """Yield the time at which to continue the query in progress, s, if there is one."""
        if self._tending is not None:
            yield self._tending.until

    def _send_ahead(self, board: Board, ahead: float) -> Conversation[None]:
        self._sent = ahead
        try:
            yield from board.asking(f"CONT:PAR FF,{loop_number(ahead)}")
        except Refused:
            return  # the next sample shows the state of the loop

    def _ask_figures(self, board: Board) -> Conversation[None]:
        self._asked = self._clock.now()
        try:
            self._figures = _figures((yield from board.asking("CONT:FIG?"))) or self._figures
        except Refused:
            return


def cannot_regulate(identity: Mapping[str, str], translation: Translation, loop: LoopSettings) -> str:
    """Return why a board cannot run a loop, one sentence; empty if it can."""
    firmware = identity.get("firmware", "")
    if _version(firmware) < SINCE:
        return (
            f"the board's firmware ({firmware.rpartition(' ')[2] or 'unknown'}) has no closed loop; it needs "
            f"{'.'.join(map(str, SINCE))} or later: flash the image that comes with this rigctl"
        )
    return unfit(translation, loop)


def unfit(translation: Translation, loop: LoopSettings) -> str:
    """Return why a board with this wiring cannot execute a loop, as one sentence; empty if it can."""
    if not translation.is_pwm(loop.actuator):
        return f"'{loop.actuator}' is not on the board's PWM, which is the one output that its loop drives"
    if (degree := len(translation.calibration(loop.channel)) - 1) > _DEGREE:
        return f"the calibration of '{loop.channel}' has degree {degree}; the board computes up to {_DEGREE}"
    milliseconds, (least, most) = loop.period * 1e3, _PERIODS
    nearest = round(milliseconds)
    if abs(milliseconds - nearest) > 1e-6 * milliseconds or not least <= nearest <= most:
        return f"a period of {milliseconds:g} ms; the board's is a whole number of milliseconds"
    for name, value in translation.loop_numbers(loop):
        if math.isfinite(value) and abs(value) > _LARGEST:
            return f"{name} is too large for the board's numbers of 32 bits"
    return ""


def _version(firmware: str) -> tuple[int, ...]:
    """Return the version numbers in ``RIG-UNO 1.1.1``."""
    numbers = firmware.rpartition(" ")[2].split(".")
    return tuple(int(number) for number in numbers if number.isdigit())


def _figures(answer: str) -> LoopFigures | None:
    """Parse the answer to ``CONT:FIG?``; None if it is invalid."""
    parts = answer.split(",")
    if len(parts) != 10 or not all(part.isdigit() for part in parts):
        return None
    updates, late, missed, saturated, *micro = (int(part) for part in parts)
    j50, j99, j100, l50, l99, l100 = (1e-6 * value for value in micro)
    return LoopFigures(updates, late, missed, saturated, (j50, j99, j100), (l50, l99, l100))
