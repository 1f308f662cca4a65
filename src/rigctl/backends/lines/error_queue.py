"""The errors that a device keeps until it is asked for them, as instruments with SCPI do."""

from __future__ import annotations

from rigctl.backends.lines.line_client import LineClient, WrongAnswer
from rigctl.backends.transport.conversation import Conversation
from rigctl.rig import Exchange, Lines

#: errors that a queue may hold; SCPI instruments keep 10 to 30
_LONGEST = 50
_SAYS = "answer"


def errors_in_queue(
    client: LineClient, lines: Lines, timeout: float = 0.0, most: int = _LONGEST
) -> Conversation[list[str]]:
    """Send the rig file's ``confirm`` until the device answers that there is no error; return the errors.

    The queue is then empty, unless there were too many: none is later taken for the refusal of a command.

    Parameters
    ----------
    timeout: overrides that of the rig file, s.
    most: errors after which it is not sent again.

    Raises
    ------
    PortLost
        the device does not answer.
    """
    confirm = lines.confirm
    if confirm is None or not confirm.patterns:
        if confirm is not None:
            yield from client.asking(confirm, tries=1)
        return []
    # any text is an answer here: one that is not expected must not cost a resynchronisation
    replies = tuple(f"{{{_SAYS}{index}}}" for index in range(len(confirm.patterns)))
    question = Exchange(send=confirm.send, reply=replies)
    errors: list[str] = []
    while len(errors) < most:
        try:
            answer = yield from client.asking(question, tries=1, timeout=timeout)
        except WrongAnswer as error:  # one of the rig file's ``errors``
            errors.append(error.answer)
            continue
        said = [answer.found[f"{_SAYS}{index}"] for index in range(len(replies))]
        if all(pattern.match(line) is not None for pattern, line in zip(confirm.patterns, said, strict=True)):
            break
        errors.append(" / ".join(said))
    return errors
