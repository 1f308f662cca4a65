"""A closed loop on the board: what it is told, and what it says of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from rigctl.backends.arduino.board import Board
from rigctl.backends.arduino.line import ANSWER
from rigctl.backends.arduino.receiver import Receiver
from rigctl.backends.arduino.translation import Translation, loop_number
from rigctl.backends.protocol import CommandReceipt
from rigctl.backends.transport.conversation import Conversation, Underway
from rigctl.backends.transport.port import NoAnswer, Refused
from rigctl.clock import Clock
from rigctl.plan.loop import LoopFigures, LoopSettings, LoopState

#: the first firmware that has one
SINCE = (1, 1)
_ASK = 1.0  # s between two looks at its figures
_SLACK = 2e-3  # s by which the board's times may be off besides their uncertainty
_DEGREE = 3  # of the calibration polynomial that the board computes
_LARGEST = 3e38  # the board's numbers have 32 bits
_FINE = 1e-4  # share of the output's span below which a change of the feed-forward is not sent
_PERIODS = (1, 60_000)  # ms
_TOGETHER = 3  # commands: what the board receives while it carries one out has 128 bytes of room
_TRIES = 5  # of each; they do no harm twice


class Regulation:
    """The loop of one board, from one meeting with it to the next."""

    def __init__(self, translation: Translation, receiver: Receiver, clock: Clock) -> None:
        self._translation = translation
        self._receiver = receiver
        self._clock = clock
        self._loop: LoopSettings | None = None  # that was begun, and has not been ended from here
        self._unsure = ""  # what a loop may command of which the board has not said so
        self._began = 0.0
        self._figures: LoopFigures | None = None
        self._ahead = self._sent = 0.0
        self._asked = 0.0
        self._tending: Underway[None] | None = None

    @property
    def actuator(self) -> str:
        """What the loop commands, or may command; empty where none runs."""
        return self._loop.actuator if self._loop is not None and self.running else self._unsure

    @property
    def running(self) -> bool:
        """Whether the board's newest word is that it runs."""
        if self._loop is None:
            return False
        time, looping = self._receiver.looping
        return looping or time <= self._began

    def state(self, ahead: float | None) -> LoopState:
        """What is known of it; `ahead` is sent when the board has nothing else to answer."""
        if ahead is not None:
            self._ahead = ahead
        return LoopState(self.running, self._figures)

    def forget(self) -> None:
        """The board has been made safe, is lost, or has been commanded otherwise; its figures are kept."""
        self._loop, self._unsure = None, ""
        if self._tending is not None:
            self._tending.drop()
            self._tending = None

    # --- begin and end ------------------------------------------------------------------------------------

    def begin(self, board: Board, loop: LoopSettings, value: float) -> Conversation[CommandReceipt]:
        """Tell the board every setting and let it begin; `value` is its output now. May be asked twice.

        Raises
        ------
        Refused
            the board does not do it: a trip is latched.
        PortLost
            it does not answer.
        """
        self.forget()
        yield from board.asking("CONT:CLE")
        yield from self._telling(board, list(self._translation.loop_texts(loop)))
        self._unsure = loop.actuator
        wind_up = ",CLAM" if loop.clamping else ""
        answer = yield from board.line.asking(f"CONT:STAR {'BUMP' if loop.bumpless else 'ZERO'}{wind_up}")
        self._loop, self._unsure, self._figures = loop, "", None
        self._began = answer.received + board.clock_map.uncertainty + _SLACK
        self._ahead = self._sent = loop.ahead
        self._asked = self._began
        half = 0.5 * (answer.received - answer.sent)
        return CommandReceipt(answer.sent + half, loop.actuator, value, half)

    def _telling(self, board: Board, texts: list[str]) -> Conversation[None]:
        """Send settings, some at a time, and those again of which nothing is heard."""
        for start in range(0, len(texts), _TOGETHER):
            left = texts[start : start + _TOGETHER]
            for _ in range(_TRIES):
                left = yield from self._sent_once(board, left)
                if not left:
                    break
            else:
                raise NoAnswer(f"{board.port.name}: the board does not answer '{left[0]}'")

    def _sent_once(self, board: Board, texts: list[str]) -> Conversation[list[str]]:
        """What has not been answered of commands that were sent together."""
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
        """Stop it, and learn what its output is and how it ran; raises as `begin`."""
        figures = self._figures
        self.forget()
        self._unsure = actuator
        answer = yield from board.line.asking("CONT:STOP")
        self._unsure = ""
        counts = yield from board.asking("SOUR:PRES?")
        self._figures = _figures((yield from board.asking("CONT:FIG?"))) or figures
        half = 0.5 * (answer.received - answer.sent)
        value = self._translation.value(actuator, int(counts))
        return CommandReceipt(answer.sent + half, actuator, value, half)

    # --- while it runs ------------------------------------------------------------------------------------

    def tend(self, board: Board) -> None:
        """Go on with what the board is asked meanwhile, and ask what is due; may raise `PortLost`."""
        if self._tending is not None:
            self._tending.go_on()
            if not self._tending.over:
                return
            self._tending = None
        if self._loop is None or not self.running:
            return
        span = self._loop.high - self._loop.low
        if abs(self._ahead - self._sent) > _FINE * span:
            self._tending = Underway(self._send_ahead(board, self._ahead))
        elif self._clock.now() >= self._asked + _ASK:
            self._tending = Underway(self._ask_figures(board))

    @property
    def due(self) -> Iterator[float]:
        """When to go on with what it was asked, s."""
        if self._tending is not None:
            yield self._tending.until

    def _send_ahead(self, board: Board, ahead: float) -> Conversation[None]:
        self._sent = ahead
        try:
            yield from board.asking(f"CONT:PAR FF,{loop_number(ahead)}")
        except Refused:
            return  # the next sample says what has become of the loop

    def _ask_figures(self, board: Board) -> Conversation[None]:
        self._asked = self._clock.now()
        try:
            self._figures = _figures((yield from board.asking("CONT:FIG?"))) or self._figures
        except Refused:
            return


def cannot_regulate(identity: Mapping[str, str], translation: Translation, loop: LoopSettings) -> str:
    """Why a board cannot carry out a loop, one sentence; empty where it can."""
    firmware = identity.get("firmware", "")
    if _version(firmware) < SINCE:
        return (
            f"the board's firmware ({firmware.rpartition(' ')[2] or 'unknown'}) has no closed loop; it needs "
            f"{'.'.join(map(str, SINCE))} or later: flash the image that comes with this rigctl"
        )
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
    """The numbers in ``RIG-UNO 1.1.0``."""
    numbers = firmware.rpartition(" ")[2].split(".")
    return tuple(int(number) for number in numbers if number.isdigit())


def _figures(answer: str) -> LoopFigures | None:
    """What ``CONT:FIG?`` is answered with; None where that is something else."""
    parts = answer.split(",")
    if len(parts) != 10 or not all(part.isdigit() for part in parts):
        return None
    updates, late, missed, saturated, *micro = (int(part) for part in parts)
    j50, j99, j100, l50, l99, l100 = (1e-6 * value for value in micro)
    return LoopFigures(updates, late, missed, saturated, (j50, j99, j100), (l50, l99, l100))
