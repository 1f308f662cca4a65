"""Request handlers: plain functions of the request, called in a thread, whose results become JSON.

Exceptions become answers too: a `RigctlError` with its parts by name, as with ``--json``.

Handlers may block (a disk, a run that is slow to answer), and so they run in threads, of a limited number
with a queue of limited length. *Everything off* must not queue behind them: such routes are `reserved`
and have threads of their own.
"""

from __future__ import annotations

import errno
import json
import logging
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Final, cast

from anyio import CapacityLimiter, to_thread
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route

from rigctl.errors import ExitCode, RigctlError
from rigctl.files.write import to_json
from rigctl.json_values import parse_json

logger = logging.getLogger(__name__)

#: bytes of a request's body; a procedure of a thousand steps has fifty thousand
_MOST_BYTES: Final = 2_000_000
#: requests that are carried out at a time, each in a thread, and how many may wait for one
_AT_A_TIME: Final = 16
_WAITING: Final = 64
#: threads of those that must not wait for any other
_RESERVED: Final = 4


@dataclass(frozen=True)
class PageRequest:
    """One request of a page.

    Parameters
    ----------
    path: values of the route's placeholders.
    query: parameters after the question mark.
    body: fields of a request with an effect.
    viewer: the window that asks; each has a unique name, which survives a reload.
    """

    path: Mapping[str, str]
    query: Mapping[str, str]
    body: Mapping[str, Any] = field(default_factory=dict)
    viewer: str = ""

    def text(self, name: str, default: str | None = None) -> str:
        """A text from path, query or body.

        Raises
        ------
        RigctlError
            it is missing, or no text.
        """
        value = self.path.get(name, self.query.get(name, self.body.get(name, default)))
        if not isinstance(value, str):
            raise RigctlError(f"{name}: a text is needed", value=None if value is None else str(value))
        return value

    def whole(self, name: str, default: int, low: int, high: int) -> int:
        """A whole number, limited to `low` and `high`.

        Raises
        ------
        RigctlError
            it is none.
        """
        value = self.query.get(name, self.body.get(name, default))
        try:
            return min(max(int(value), low), high)
        except (TypeError, ValueError, OverflowError) as problem:
            raise RigctlError(f"{name}: a whole number is needed", value=str(value)) from problem

    def texts(self, name: str) -> list[str]:
        """A list of texts in the body; empty when it is missing.

        Raises
        ------
        RigctlError
            it is no list of texts.
        """
        values = self.body.get(name, [])
        if not isinstance(values, list) or not all(isinstance(one, str) for one in values):
            raise RigctlError(f"{name}: a list of texts is needed")
        return values


Work = Callable[[PageRequest], object]


def get(path: str, work: Work) -> Route:
    """A route that only reads."""
    return Route(path, _endpoint(work), methods=["GET"])


def post(path: str, work: Work, *, reserved: bool = False) -> Route:
    """A route with an effect; its body is a JSON object.

    With `reserved` it has threads of its own, so that it is carried out however many others are stuck.
    """
    return Route(path, _endpoint(work, reserved=reserved), methods=["POST"])


def delete(path: str, work: Work) -> Route:
    """A route that removes or stops something."""
    return Route(path, _endpoint(work), methods=["DELETE"])


def _endpoint(work: Work, *, reserved: bool = False) -> Callable[[Request], Any]:
    async def endpoint(request: Request) -> Response:
        try:
            page_request = await _read(request)
            result = await _threads(reserved=reserved).carry_out(work, page_request)
            if isinstance(result, Response):
                return result
            return _json(to_json(result), 200)
        except ClientDisconnect:  # the client has disconnected
            return _json(refusal_text("the request has ended before its end"), 400)
        except RigctlError as error:
            failed = error.exit_code is ExitCode.FAILED
            return _json(json.dumps({"error": error.as_dict()}), 409 if failed else 400)
        except OSError as problem:  # the folder is gone, the disk is full
            return _json(refusal_text(f"{problem.strerror or problem}: {problem.filename or 'a file'}"), 503)
        except Exception as fault:
            logger.exception("%s %s", request.method, request.url.path)
            return _json(
                refusal_text(f"a fault of rigctl itself: {fault!r}; the server's output has more"), 500
            )

    return endpoint


class _Threads:
    """Threads for requests, which wait for one in a queue of limited length."""

    def __init__(self, count: int) -> None:
        self._limiter = CapacityLimiter(count)
        self._asked = 0

    async def carry_out(self, work: Work, request: PageRequest) -> object:
        """Return the result of the work.

        Raises
        ------
        OSError
            too many requests are waiting.
        """
        # Refused at once, rather than answered when nobody waits for it any more.
        if self._asked >= self._limiter.total_tokens + _WAITING:
            raise OSError(errno.EBUSY, os.strerror(errno.EBUSY), "the server, by other requests")
        self._asked += 1
        try:
            return await to_thread.run_sync(work, request, limiter=self._limiter)
        finally:
            self._asked -= 1


@cache
def _threads(*, reserved: bool) -> _Threads:
    """The threads of requests; those of sockets and of the page's files are others."""
    return _Threads(_RESERVED if reserved else _AT_A_TIME)


async def _read(request: Request) -> PageRequest:
    body: Mapping[str, Any] = {}
    if request.method not in ("GET", "HEAD"):
        body = await read_fields(request, _MOST_BYTES)
    viewer = request.headers.get("x-rigctl-viewer", "")[:64]
    return PageRequest(dict(request.path_params), dict(request.query_params), body, viewer)


async def read_fields(request: Request, most: int) -> Mapping[str, Any]:
    """The JSON object that is a request's body, of at most so many bytes.

    Raises
    ------
    RigctlError
        it is longer, or no JSON object.
    ClientDisconnect
        the client has gone before its end.
    """
    content = bytearray()
    async for part in request.stream():
        content += part
        if len(content) > most:
            raise RigctlError(f"more than {most} bytes are not taken at once")
    return _fields(bytes(content))


def _fields(content: bytes) -> Mapping[str, Any]:
    try:
        fields = parse_json(content or b"{}")
    except (ValueError, RecursionError) as problem:
        raise RigctlError("the request is not JSON") from problem
    if not isinstance(fields, dict):
        raise RigctlError("the request is not a JSON object")
    return cast("dict[str, Any]", fields)


def _json(text: str, status: int) -> Response:
    return Response(text, status, media_type="application/json")


def refusal_text(message: str) -> str:
    """An error without further parts, as the page reads it."""
    return json.dumps({"error": {"message": message, "what": message}}, ensure_ascii=False)
