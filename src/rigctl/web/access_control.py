"""Access control: host name, origin and cookie are checked before any part is reached.

A server on 127.0.0.1 can be reached by every program of the computer and, through the browser, by every page
that is open in it. A foreign page can send requests here and can let its own name resolve to this address
(DNS rebinding), but it cannot forge the headers ``Host`` and ``Origin``: both are checked against fixed
lists, on HTTP and on the upgrade to a socket. Every route with data or an effect also needs a cookie, which
is given in exchange for the token that the server prints.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Awaitable, Callable, Collection, Iterable, Mapping, MutableMapping
from typing import Any, Final

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

#: most sessions at a time; beyond that, the oldest must show the token again
_MOST_SESSIONS: Final = 100
#: key of a request's scope under which its session is stated
SESSION: Final = "rigctl.session"
_SAFE: Final = frozenset({"GET", "HEAD"})
#: path at which the token is exchanged for the cookie
SESSION_PATH: Final = "/api/session"
_HEADERS: Final = {
    "cache-control": "no-store",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}


class Keys:
    """The printed token, and the cookies given in exchange for it; each is 256 random bits."""

    def __init__(self) -> None:
        self.token = secrets.token_urlsafe(32)
        self._sessions: dict[str, None] = {}

    def exchange(self, token: str) -> str | None:
        """A new cookie for the right token; None for any other."""
        if not hmac.compare_digest(token.encode("utf-8", "replace"), self.token.encode("ascii")):
            return None
        session = secrets.token_urlsafe(32)
        self._sessions[session] = None
        while len(self._sessions) > _MOST_SESSIONS:
            del self._sessions[next(iter(self._sessions), "")]
        return session

    def know(self, session: str) -> bool:
        """Whether this cookie is valid."""
        given = session.encode("utf-8", "replace")
        return any(hmac.compare_digest(given, known.encode("ascii")) for known in self._sessions)


class Refused(Exception):
    """The reason for refusing a request."""

    def __init__(self, status: int, why: str) -> None:
        super().__init__(why)
        self.status = status


class Gate:
    """Wraps an application, checks requests, and adds security headers to every answer.

    Parameters
    ----------
    app: the wrapped application.
    keys: token and cookies.
    hosts: permitted values of ``Host``, each with its port.
    secure: whether the server uses TLS.
    open_paths: paths without data of the project: the frame page.
    """

    def __init__(
        self, app: App, *, keys: Keys, hosts: Collection[str], secure: bool, open_paths: Collection[str]
    ) -> None:
        self._app = app
        self._keys = keys
        self._hosts = frozenset(host.lower() for host in hosts)
        self._scheme = "https" if secure else "http"
        self._open = frozenset(open_paths) | {SESSION_PATH}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = list(scope["headers"])
        try:
            # From the cheapest and most general to the most special: the name, since a foreign name that
            # leads here is an attack; the origin, since a foreign page may ask; the cookie, since other
            # programs of this computer may.
            host = self._require_host(headers)
            self._require_origin(scope, headers, host)
            scope[SESSION] = self._session(scope, headers)
        except Refused as refused:
            await _refuse(scope, receive, self._sealed(send, ""), refused)
            return
        await self._app(scope, receive, self._sealed(send, host))

    def _require_host(self, headers: Iterable[tuple[bytes, bytes]]) -> str:
        """Check the requested host name."""
        hosts = _all(headers, b"host")
        if len(hosts) != 1 or hosts[0].lower() not in self._hosts:
            raise Refused(421, "this server has another name")
        return hosts[0].lower()

    def _require_origin(self, scope: Scope, headers: Iterable[tuple[bytes, bytes]], host: str) -> None:
        """Check that the request comes from a page of this server, or for reading from a typed address."""
        origins = _all(headers, b"origin")
        only_reads = scope["type"] == "http" and scope["method"] in _SAFE
        # Browsers send no origin with a plain navigation; `Sec-Fetch-Site` tells whether another site led
        # here.
        if not origins and only_reads:
            site = _all(headers, b"sec-fetch-site")
            if scope["path"] not in self._open and any(one not in ("same-origin", "none") for one in site):
                raise Refused(403, "another site asks")
            return
        if origins != [f"{self._scheme}://{host}"]:
            raise Refused(403, "another site asks" if origins else "no page of this server asks")

    def _session(self, scope: Scope, headers: Iterable[tuple[bytes, bytes]]) -> str:
        """Check the cookie; not needed for open paths."""
        for session in _cookies(headers, cookie_name(scope)):
            if self._keys.know(session):
                return session
        path = scope["path"]
        if scope["type"] == "http" and (path in self._open or path.startswith("/assets/")):
            return ""
        raise Refused(401, "open the address that 'rigctl serve' has printed, with what follows its #")

    def _sealed(self, send: Send, host: str) -> Send:
        """Add the headers to an answer that it does not have itself."""

        async def sealed(message: Message) -> None:
            if message["type"] == "http.response.start":
                present = {name.lower() for name, _ in message.get("headers", ())}
                added = {"content-security-policy": self._policy(host), **_HEADERS}
                message["headers"] = [
                    *message.get("headers", ()),
                    *(
                        (name.encode("ascii"), value.encode("ascii"))
                        for name, value in added.items()
                        if name.encode("ascii") not in present
                    ),
                ]
            await send(message)

        return sealed

    def _policy(self, host: str) -> str:
        """The policy for pages of this server: only its files are loaded, no inline scripts."""
        socket = f" {self._scheme.replace('http', 'ws')}://{host}" if host else ""
        return (
            f"default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
            f"connect-src 'self'{socket}; frame-src 'self'; base-uri 'none'; form-action 'none'; "
            f"frame-ancestors 'none'"
        )


def cookie_name(scope: Mapping[str, Any]) -> str:
    """The cookie's name; it contains the port, since a browser sends a host's cookies to all its ports."""
    server = scope.get("server") or ("", 0)
    return f"rigctl_{server[1]}"


def set_cookie(scope: Mapping[str, Any], session: str) -> str:
    """The value of ``Set-Cookie``: no script reads it, and no other site's request carries it."""
    secure = "; Secure" if scope["scheme"] in ("https", "wss") else ""
    return f"{cookie_name(scope)}={session}; Path=/; HttpOnly; SameSite=Strict{secure}"


def _all(headers: Iterable[tuple[bytes, bytes]], name: bytes) -> list[str]:
    return [value.decode("latin-1") for key, value in headers if key.lower() == name]


def _cookies(headers: Iterable[tuple[bytes, bytes]], name: str) -> list[str]:
    """The values of a cookie. Its neighbours are those of every server of this computer, in any form."""
    pairs = (pair.partition("=") for cookies in _all(headers, b"cookie") for pair in cookies.split(";"))
    return [value.strip() for key, _, value in pairs if key.strip() == name]


async def _refuse(scope: Scope, receive: Receive, send: Send, refused: Refused) -> None:
    if scope["type"] == "websocket":
        await receive()  # the requested upgrade
        await send({"type": "websocket.close", "code": 1008, "reason": str(refused)})
        return
    from rigctl.web.request_handling import refusal_text

    body = refusal_text(str(refused)).encode("utf-8")
    headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode("ascii"))]
    await send({"type": "http.response.start", "status": refused.status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
