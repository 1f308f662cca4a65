"""Identifies a line-based device on a line that has just been opened."""

from __future__ import annotations

from collections.abc import Mapping

from rigctl.backends.lines.line_client import LineClient, WrongAnswer
from rigctl.backends.transport.conversation import Conversation
from rigctl.backends.transport.port import NoAnswer, PortLost
from rigctl.clock import Clock
from rigctl.errors import ExitCode, RigctlError
from rigctl.rig import Lines

_FIRST_SILENCE = 0.3  # s that a device needs to discard an incomplete command


def handshake(client: LineClient, clock: Clock, lines: Lines) -> Conversation[Mapping[str, str]]:
    """Query the identity until there is an answer, and return it.

    A device without an identity query must answer the first query instead.

    Raises
    ------
    PortLost
        there was no answer within the time that the device may need to start, or the port is gone.
    RigctlError
        another device answers.
    """
    question = lines.identify or lines.queries[0]
    give_up = clock.now() + lines.wake
    quiet_until = clock.now() + _FIRST_SILENCE
    # The port may have been opened in the middle of a line, and many boards restart when it is opened.
    client.port.write(lines.send_ends.encode("utf-8"))  # terminates any incomplete command
    while clock.now() < quiet_until:
        yield quiet_until
    while True:
        try:
            answer = yield from client.asking(question, tries=1)
        # Until the device has had its time to start, its greeting or half a line is no proof of another
        # device.
        except WrongAnswer as error:
            if clock.now() < give_up:
                continue
            raise RigctlError(
                "another device is on this port, or it speaks at another baud rate",
                value=error.answer,
                expected=" / ".join(question.reply),
                exit_code=ExitCode.FAILED,
            ) from None
        except NoAnswer as error:
            if clock.now() < give_up:
                continue
            heard = "what arrives is no answer; another baud rate?" if client.heard else "nobody answers"
            raise PortLost(f"{client.port.name}: {heard}") from error
        client.identity = answer.found if lines.identify is not None else {}
        return client.identity
