"""A server as a user starts it, and two kinds of clients: a browser, and a plain HTTP client."""

from __future__ import annotations

import http.client
import json
import os
import re
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from own_process import RIGCTL
from systems import interrupt, own_state

if TYPE_CHECKING:
    from playwright.sync_api import BrowserContext, Page


@dataclass
class Served:
    """A server that was started as a user starts it."""

    project: Path
    address: str  #: with its token
    process: subprocess.Popen[str]
    state: Path  #: the user's state folder, in which servers are known

    @property
    def token(self) -> str:
        return self.address.partition("#")[2]

    @property
    def base(self) -> str:
        return self.address.partition("#")[0].rstrip("/")

    @property
    def host(self) -> str:
        return self.base.partition("//")[2]

    @property
    def port(self) -> int:
        return int(self.host.partition(":")[2])

    def ask(
        self,
        method: str,
        path: str,
        body: object = None,
        *,
        headers: dict[str, str] | None = None,
        cookie: str | None = None,
    ) -> tuple[int, dict[str, str], str]:
        """A request by Python's own client, which adds none of a browser's headers."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=120)
        sent = {"Host": self.host, **(headers or {})}
        if cookie:
            sent["Cookie"] = cookie
        try:
            text = None if body is None else json.dumps(body)
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            for name, value in sent.items():
                connection.putheader(name, value)
            if text is not None:
                connection.putheader("Content-Length", str(len(text.encode())))
            connection.endheaders(text.encode() if text is not None else None)
            answer = connection.getresponse()
            got = {name.lower(): value for name, value in answer.getheaders()}
            return answer.status, got, answer.read().decode()
        finally:
            connection.close()

    def enter(self) -> str:
        """The cookie that the token is exchanged for."""
        status, headers, _ = self.ask(
            "POST", "/api/session", {"token": self.token}, headers={"Origin": self.base}
        )
        assert status == 204
        return headers["set-cookie"].partition(";")[0]

    def get(self, path: str, cookie: str) -> Any:
        status, _, text = self.ask("GET", path, cookie=cookie)
        assert status == 200, text
        return json.loads(text)

    def post(self, path: str, body: object, cookie: str, viewer: str = "") -> tuple[int, Any]:
        headers = {"Origin": self.base, "X-Rigctl-Viewer": viewer}
        status, _, text = self.ask("POST", path, body, headers=headers, cookie=cookie)
        return status, json.loads(text) if text else None


@contextmanager
def serving(project: Path, *options: str, state: Path, ends: int = 0) -> Iterator[Served]:
    """`rigctl serve`, until the block ends: then by Ctrl-C, with `ends` as its exit status."""
    command = [*RIGCTL, "serve", str(project), "--no-browser", *options]
    environment = {**os.environ, **own_state(state), "PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        cwd=project.parent,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    said: list[str] = []
    faults: list[str] = []
    errors = threading.Thread(target=faults.extend, args=(process.stderr,), daemon=True)
    errors.start()
    address = ""
    for line in process.stdout:
        said.append(line)
        if found := re.search(r"https?://\S+#[\w-]+", line):
            address = found.group()
            break
    if not address:
        process.wait(120)
        errors.join(5)
        raise AssertionError("".join(said + faults))
    rest = threading.Thread(target=said.extend, args=(process.stdout,), daemon=True)
    rest.start()
    try:
        yield Served(project, address, process, state)
    finally:
        interrupt(process)
        try:
            ended = process.wait(120)
            assert ended == ends or os.name != "posix", "".join(faults)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            raise
        finally:
            for reader in (rest, errors):
                reader.join(5)
            process.stdout.close()
            process.stderr.close()


class Window:
    """A separate browser window: its cookies, its pages, and the errors on their consoles."""

    def __init__(self, context: BrowserContext, served: Served) -> None:
        self.context = context
        self.served = served
        self.complaints: list[str] = []

    def open(self, path: str = "/runs") -> Page:
        """A page of the server, let in with the token."""
        page = self.context.new_page()
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("console", lambda said: self.complaints.append(said.text) if said.type == "error" else None)
        page.goto(f"{self.served.base}{path}#{self.served.token}")
        page.wait_for_selector("#part[data-ready=yes]")
        return page
