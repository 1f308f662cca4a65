"""The message to a user about an error of a storage library, in one sentence."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import Any, Final

#: S3's error code for a request that was signed too far from the server's time
_SKEWED: Final = "RequestTimeTooSkewed"
#: S3 accepts 15 min; where the answer has no text (HEAD), a refusal beyond this is ascribed to the clock, s
_SKEW: Final = 14 * 60.0
_HINT: Final = "Is it there, and may you read and write in it? Nothing that was recorded here is lost"


def describe(problem: BaseException) -> tuple[str, str]:
    """Return a description of the error, and a hint."""
    skew = _clock_skew(problem)
    if skew is not None:
        ahead = "ahead of" if skew > 0.0 else "behind"
        return (
            f"the clock of this computer is {_duration(abs(skew))} {ahead} the server's",
            "Set the clock: storage refuses requests of another time. Nothing that was recorded here is lost",
        )
    message = problem.strerror if isinstance(problem, OSError) and problem.strerror else str(problem)
    text = next(iter(message.strip().splitlines()), "").rstrip(".")
    if isinstance(problem, (LookupError, TypeError)):
        # raised by the library for an answer that it cannot parse
        return f"its answer is incomplete, or not a storage's ({type(problem).__name__}: {text})", _HINT
    return text or type(problem).__name__, _HINT


def _clock_skew(problem: BaseException) -> float | None:
    """Return the time of this computer minus the server's, s, if requests were refused for it."""
    for answer in _answers(problem):
        facts = answer.get("ResponseMetadata", {})
        code = answer.get("Error", {}).get("Code")
        headers = facts.get("HTTPHeaders", {})
        try:
            server = parsedate_to_datetime(headers["date"])
            skew = (datetime.now(UTC) - server).total_seconds()
        except (KeyError, ValueError, TypeError):  # no date, or one without a time zone
            continue
        if code == _SKEWED or (facts.get("HTTPStatusCode") == 403 and abs(skew) > _SKEW):
            return skew
    return None


def _answers(problem: BaseException | None) -> Iterator[Mapping[str, Any]]:
    """Yield the server's answers that S3's library attached to an error or to its causes."""
    depth = 0
    while problem is not None and depth < 10:
        answer = getattr(problem, "response", None)
        if isinstance(answer, Mapping):
            yield answer
        problem, depth = problem.__cause__ or problem.__context__, depth + 1


def _duration(seconds: float) -> str:
    """Return a duration in words, to the minute: ``2 h 5 min``."""
    minutes = max(round(seconds / 60.0), 1)
    days, hours, minutes = minutes // 1440, minutes // 60 % 24, minutes % 60
    parts = ((days, "d"), (hours, "h"), (minutes, "min"))
    return " ".join(f"{number} {unit}" for number, unit in parts if number)
