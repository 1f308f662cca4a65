"""Access control: attacks as other sites, other programs and strangers would attempt them."""

from __future__ import annotations

import asyncio
import json
import re
import socket
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import pytest

from rigctl.web.access_control import Gate, Keys, Message, Receive, Scope, Send, set_cookie
from rigctl.web.request_handling import PageRequest, post
from web.serving import Served, Window

HOSTILE_HOSTS = [
    "evil.example",
    "evil.example:{port}",
    "127.0.0.1",
    "127.0.0.1:1",
    "localhost.evil.example:{port}",
]
HOSTILE_ORIGINS = [
    "http://evil.example",
    "http://evil.example:{port}",
    "http://127.0.0.1",
    "http://127.0.0.1:1",
    "https://127.0.0.1:{port}",
    "http://localhost:{port}",  # a name of this computer, but not the one in use
    "http://127.0.0.1:{port}.evil.example",
    "null",
    "",
]


@pytest.mark.parametrize("host", HOSTILE_HOSTS)
def test_requests_with_another_host_name_are_refused_even_with_the_cookie(
    served: Served, cookie: str, host: str
) -> None:
    """DNS rebinding: a page of evil.example lets its own name resolve to this server."""
    name = host.format(port=served.port)
    for method, path in (("GET", "/runs"), ("GET", "/api/status"), ("POST", "/api/session")):
        headers = {"Host": name, "Origin": f"http://{name}"}
        status, _, text = served.ask(method, path, {"token": served.token}, headers=headers, cookie=cookie)
        assert status == 421
        assert served.project.name not in text


@pytest.mark.parametrize("origin", HOSTILE_ORIGINS)
def test_another_origin_is_refused(served: Served, cookie: str, origin: str) -> None:
    headers = {"Origin": origin.format(port=served.port)}
    for method, path in (("GET", "/api/status"), ("POST", "/api/session"), ("DELETE", "/api/jobs/x")):
        assert served.ask(method, path, {"token": served.token}, headers=headers, cookie=cookie)[0] == 403


def test_silent_connections_are_closed(served: Served) -> None:
    """The number of connections is limited: silent ones would keep others out, even from stopping a run."""
    known = f"Host: {served.host}\r\nOrigin: {served.base}\r\nContent-Length: 90\r\n\r\n{{".encode()
    parts = (
        b"",
        b"GET / HTTP/1.1\r\nHost: 127",
        b"GET / HTTP/1.1\r\nHost: x\r\n\r\nGET / HT",
        b"POST /api/session HTTP/1.1\r\n" + known,  # whose body never ends
        b"POST /api/live/off HTTP/1.1\r\n" + known,
    )
    with ExitStack() as lines:
        silent = []
        for asked in parts:
            line = lines.enter_context(socket.create_connection(("127.0.0.1", served.port), timeout=60.0))
            line.sendall(asked)
            silent.append(line)
        for line in silent:
            while line.recv(65536):  # until the server closes it
                pass


def test_requests_with_effects_need_an_origin(served: Served, cookie: str) -> None:
    assert served.ask("POST", "/api/session", {"token": served.token}, cookie=cookie)[0] == 403
    assert served.ask("DELETE", "/api/jobs/x", cookie=cookie)[0] == 403
    assert served.ask("GET", "/api/status", cookie=cookie)[0] == 200


def test_requests_for_images_or_scripts_of_another_site_are_refused(served: Served, cookie: str) -> None:
    """Such requests have no Origin, and the cookie where the other site is another port of this computer."""
    for site in ("cross-site", "same-site"):
        headers = {"Sec-Fetch-Site": site}
        assert served.ask("GET", "/api/status", headers=headers, cookie=cookie)[0] == 403


@pytest.mark.parametrize(
    "given", [None, "", "rigctl_{port}=", "rigctl_{port}=guess", "rigctl_1=x", '="; \x7f']
)
def test_without_the_cookie_only_the_empty_page_is_served(served: Served, given: str | None) -> None:
    cookie = given.format(port=served.port) if given else given
    for path in ("/api/status", "/api/jobs", "/api/nothing"):
        status, _, text = served.ask("GET", path, cookie=cookie)
        assert status == 401
        assert served.project.name not in text
    status, _, page = served.ask("GET", "/runs", cookie=cookie)
    assert status == 200
    assert served.project.name not in page


@pytest.mark.parametrize("others", ['set={"a": 1}', "a[b]=1", "no value", "é=ü", "=", 'open="', "rigctl_1=x"])
def test_cookies_of_other_servers_on_this_computer_are_ignored(
    served: Served, cookie: str, others: str
) -> None:
    """A browser sends a host's cookies to all of its ports, and they may have any form."""
    for sent in (f"{others}; {cookie}", f"{cookie}; {others}"):
        assert served.ask("GET", "/api/status", cookie=sent)[0] == 200


async def answered(headers: dict[str, str | list[str]], path: str = "/api/status", kind: str = "http") -> int:
    """Status of the access check alone, without the server's protocol checks; 200 if it admits a request."""
    keys = Keys()
    session = keys.exchange(keys.token)
    found: list[int] = []

    async def inside(scope: Scope, receive: Receive, send: Send) -> None:
        found.append(200)

    async def receive() -> Message:
        return {"type": f"{kind}.connect"}

    async def send(message: Message) -> None:
        found.append(message.get("status", message.get("code", 0)))

    usual = {"host": "127.0.0.1:8750", "cookie": f"rigctl_8750={session}"}
    pairs = [
        (name.encode(), value.encode())
        for name, values in {**usual, **headers}.items()
        for value in ([values] if isinstance(values, str) else values)
    ]
    gate = Gate(inside, keys=keys, hosts=["127.0.0.1:8750"], secure=False, open_paths={"/live"})
    scope = {
        "type": kind,
        "method": "GET",
        "path": path,
        "headers": pairs,
        "server": ("", 8750),
        "scheme": "http",
    }
    await gate(scope, receive, send)
    return found[0]


@pytest.mark.parametrize(
    ("headers", "path", "kind", "expected"),
    [
        ({}, "/api/status", "http", 200),
        ({"host": []}, "/api/status", "http", 421),
        ({"host": ["127.0.0.1:8750", "evil.example"]}, "/api/status", "http", 421),
        ({"origin": ["http://evil.example", "http://127.0.0.1:8750"]}, "/api/status", "http", 403),
        ({}, "/api/live/stream", "websocket", 1008),
        ({"origin": "http://127.0.0.1:8750"}, "/api/live/stream", "websocket", 200),
        ({"origin": "http://127.0.0.1:8750", "cookie": []}, "/live", "websocket", 1008),
        ({"cookie": []}, "/live", "http", 200),
        ({"sec-fetch-site": "cross-site"}, "/live", "http", 200),
        ({"sec-fetch-site": "cross-site"}, "/api/status", "http", 403),
        ({"sec-fetch-site": ["same-origin", "cross-site"]}, "/api/status", "http", 403),
    ],
)
def test_the_access_check_alone_gives_the_expected_status(
    headers: dict[str, str | list[str]], path: str, kind: str, expected: int
) -> None:
    with ThreadPoolExecutor() as aside:  # the browser tests run an event loop in this thread
        assert aside.submit(lambda: asyncio.run(answered(headers, path, kind))).result() == expected


def test_only_the_oldest_sessions_are_forgotten() -> None:
    keys = Keys()
    sessions = [keys.exchange(keys.token) for _ in range(101)]
    assert [keys.know(str(session)) for session in sessions] == [False, *[True] * 100]


def test_the_cookie_is_marked_secure_only_over_tls() -> None:
    for scheme, secure in (("http", False), ("ws", False), ("https", True), ("wss", True)):
        assert set_cookie({"scheme": scheme, "server": ("", 1)}, "x").endswith("; Secure") is secure


@pytest.mark.parametrize("token", ["", "x", "é" * 43, None, 7, ["a"], "A" * 5000], ids=range(7))
def test_a_wrong_token_gets_no_cookie(served: Served, token: object) -> None:
    headers = {"Origin": served.base}
    status, got, _ = served.ask("POST", "/api/session", {"token": token}, headers=headers)
    assert status == 401
    assert "set-cookie" not in got


def test_the_token_has_256_bits_and_the_cookie_is_kept_from_scripts_and_other_sites(served: Served) -> None:
    assert len(served.token) == 43  # of 6 bits
    _, got, _ = served.ask("POST", "/api/session", {"token": served.token}, headers={"Origin": served.base})
    said = got["set-cookie"]
    assert re.fullmatch(rf"rigctl_{served.port}=[\w-]{{43}}; Path=/; HttpOnly; SameSite=Strict", said)
    assert served.token not in said


def test_every_answer_has_the_security_headers(served: Served, cookie: str) -> None:
    for path in ("/runs", "/assets/app.js", "/assets/page.css", "/api/status", "/api/none"):
        _, got, _ = served.ask("GET", path, cookie=cookie)
        assert got["cache-control"] == "no-store"
        assert got["x-content-type-options"] == "nosniff"
        assert got["referrer-policy"] == "no-referrer"
        assert got["cross-origin-resource-policy"] == "same-origin"
        assert "access-control-allow-origin" not in got
        assert "server" not in got
        rules = dict(rule.split(" ", 1) for rule in got["content-security-policy"].split("; "))
        assert rules["default-src"] == "'none'"
        assert rules["script-src"] == "'self'"
        assert rules["frame-ancestors"] == "'none'"


def test_only_files_of_the_page_are_served(served: Served, cookie: str) -> None:
    inside = ("/assets/../access_control.py", "/assets/%2e%2e/access_control.py")
    for path in (*inside, "/assets//etc/passwd", "/../rigctl.toml"):
        assert served.ask("GET", path, cookie=cookie)[0] == 404


@pytest.mark.parametrize(
    "sent", [b"\x00\xff\r\n\r\n", b"GET / HTTP/1.1\r\n\r\n", b"GET / HTTP/9\r\nHost: x\r\n\r\n"]
)
def test_an_invalid_request_only_ends_its_connection(served: Served, cookie: str, sent: bytes) -> None:
    with socket.create_connection(("127.0.0.1", served.port), timeout=120) as line:
        line.sendall(sent)
        assert line.recv(100).startswith((b"HTTP/1.1 400", b"HTTP/1.1 421"))
    assert served.get("/api/status", cookie)["there"] is True


def test_a_client_that_goes_away_is_no_fault_of_the_server(caplog: pytest.LogCaptureFixture) -> None:
    """The server's output had a traceback for each."""

    async def gone() -> Message:
        return {"type": "http.disconnect"}

    async def sent(_: Message) -> None:
        pass

    def unreached(_: PageRequest) -> None:
        pytest.fail("carried out although the request is not complete")

    scope = {"type": "http", "method": "POST", "path": "/x", "headers": [], "query_string": b""}
    with ThreadPoolExecutor(1) as aside:  # the browser's own loop may run in this thread
        aside.submit(lambda: asyncio.run(post("/x", unreached).handle(scope, gone, sent))).result()
    assert caplog.messages == []


@pytest.mark.parametrize("body", [["x"], "x" * 5000, 3])
def test_a_body_that_is_not_a_json_object_is_refused_with_one_message(
    served: Served, cookie: str, body: object
) -> None:
    status, answer = served.post("/api/session", body, cookie)
    assert status == 401
    assert "changes with every start" in answer["error"]["message"]


def test_a_deeply_nested_body_is_refused_without_a_traceback(served: Served) -> None:
    head = f"POST /api/session HTTP/1.1\r\nHost: {served.host}\r\nOrigin: {served.base}\r\n"
    with socket.create_connection(("127.0.0.1", served.port), timeout=120) as line:
        line.sendall(f"{head}Content-Length: 1000\r\n\r\n{'[' * 1000}".encode())
        assert line.recv(100).startswith(b"HTTP/1.1 401")


def test_a_browser_is_authenticated_once(window: Window) -> None:
    page = window.open("/runs")
    assert "#" not in page.url  # the token is gone from the address and from the history
    assert page.locator("#project").inner_text() == window.served.project.name
    page.reload()
    page.wait_for_selector("#part[data-ready=yes]")
    cookies = window.context.cookies()
    assert [(one["httpOnly"], one["sameSite"]) for one in cookies] == [(True, "Strict")]
    assert page.evaluate("document.cookie") == ""


def test_a_browser_without_the_token_gets_instructions(window: Window) -> None:
    page = window.context.new_page()
    page.goto(f"{window.served.base}/runs")
    page.get_by_text("rigctl serve").wait_for()
    assert page.locator("#project").inner_text() == ""


def test_a_page_of_another_site_cannot_use_the_server(window: Window, served: Served) -> None:
    """Another port of this computer is the same site to a browser, which sends the cookie along."""
    window.open("/runs")
    other = window.context.new_page()
    other.route("http://127.0.0.1:9/**", lambda route: route.fulfill(body="<p>elsewhere</p>"))
    other.goto("http://127.0.0.1:9/")
    tried = f"""async () => {{
      const told = [];
      for (const [method, mode] of [["GET", "cors"], ["GET", "no-cors"], ["POST", "no-cors"]]) {{
        try {{
          const got = await fetch("{served.base}/api/status", {{ method, mode, credentials: "include" }});
          told.push(await got.text());
        }} catch {{ told.push("refused"); }}
      }}
      told.push(await new Promise((done) => {{
        const socket = new WebSocket("ws://{served.host}/api/live/stream");
        socket.onopen = () => done("open");
        socket.onerror = () => done("refused");
      }}));
      return told;
    }}"""
    assert other.evaluate(tried) == ["refused"] * 4
    assert json.loads(served.ask("GET", "/api/status", cookie=served.enter())[2])["working"] == []


def test_everything_off_works_without_holding_the_controls(window: Window) -> None:
    page = window.open("/live")
    page.get_by_text("No run is in progress").first.wait_for()
    page.get_by_role("button", name="Everything off").click()
    page.get_by_text("outputs are safe").wait_for()
