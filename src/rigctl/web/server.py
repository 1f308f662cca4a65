"""The server: one for each project, reachable only from this computer unless requested otherwise.

In: `Settings`. Out: a server that runs until it is interrupted. The order: refuse what would be unsafe,
take the project's lock, bind the port, and only then import the server's libraries and print the address,
so that a refusal takes no time and an address that is printed can be opened. One server for each project,
because a single lease decides who may command a run.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rigctl.errors import ExitCode, RigctlError
from rigctl.files.regular import read_text
from rigctl.json_values import parse_json
from rigctl.project import Project

if TYPE_CHECKING:
    import uvicorn

#: the default port, if it is free
USUAL_PORT: Final = 8750
_LOCAL: Final = "127.0.0.1"


@dataclass(frozen=True)
class Settings:
    """Settings of a server.

    Parameters
    ----------
    host: the address it listens at.
    port: None for the usual one, or any that is free; 0 for any that is free.
    certificate, key: files of TLS, in PEM; needed for other addresses than this computer's.
    exposed: whether other computers may reach it; must be requested explicitly.
    names: host names under which it may be addressed, besides `host`.
    """

    project: Project
    host: str = _LOCAL
    port: int | None = None
    certificate: Path | None = None
    key: Path | None = None
    exposed: bool = False
    names: tuple[str, ...] = ()

    @property
    def secure(self) -> bool:
        """Whether it uses TLS."""
        return self.certificate is not None

    def require_safe(self) -> None:
        """Refuse a non-local address without TLS and consent.

        Raises
        ------
        RigctlError
            others could reach the bench, or intercept the token.
        """
        if (self.certificate is None) != (self.key is None):
            raise RigctlError("TLS needs a certificate and its key", expected="--certificate and --key")
        if self.host == "localhost" or is_loopback(self.host):
            return
        if not self.secure or not self.exposed:
            raise RigctlError(
                "other computers could reach this address, and through it the bench",
                value=self.host,
                expected="--certificate, --key and --expose with it",
                hint="Without TLS everybody on the network can read the token along; from elsewhere "
                f"'ssh -L {USUAL_PORT}:{_LOCAL}:{USUAL_PORT} HOST' needs none of it",
            )


def is_loopback(host: str) -> bool:
    """Whether an address is this computer's own."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def serve(settings: Settings, started: Callable[[str], None], ends: Callable[[], bool] | None = None) -> None:
    """Serve a project until it is interrupted.

    Parameters
    ----------
    started: called with the complete address, including the token, once it can be opened.
    ends: called once a second; the server ends when it returns True.

    Raises
    ------
    RigctlError
        the port is in use, the project is already served, or others could reach the address.
    """
    settings.require_safe()
    with one_server(settings.project) as say_address, _listening(settings) as listener:
        import uvicorn

        from rigctl.web.access_control import Keys
        from rigctl.web.app import application
        from rigctl.web.jobs import Jobs
        from rigctl.web.request_timeout import TimeoutProtocol
        from rigctl.web.server_state import LONGEST_MESSAGE, Site

        port = int(listener.getsockname()[1])
        keys = Keys()
        address = f"{'https' if settings.secure else 'http'}://{_shown(settings.host)}:{port}/"
        site = Site(settings.project, Jobs(settings.project.root))
        app = application(site, keys, host_names(settings, port), secure=settings.secure)
        config = uvicorn.Config(
            app,
            http=TimeoutProtocol,
            ws="websockets-sansio",
            ws_max_size=LONGEST_MESSAGE,
            ws_per_message_deflate=False,
            lifespan="on",
            log_level="warning",
            access_log=False,
            proxy_headers=False,
            server_header=False,
            timeout_graceful_shutdown=1,
            ssl_certfile=settings.certificate,
            ssl_keyfile=settings.key,
        )
        say_address(address)
        _server(config, lambda: started(f"{address}#{keys.token}"), ends).run(sockets=[listener])


def host_names(settings: Settings, port: int) -> list[str]:
    """The permitted values of ``Host``."""
    if settings.host == "localhost" or is_loopback(settings.host):
        names = [_LOCAL, "localhost", _shown(settings.host)]
    else:
        hostname = socket.gethostname()
        anywhere = ip_address(settings.host).is_unspecified if _is_address(settings.host) else False
        names = [hostname, socket.getfqdn(), *([] if anywhere else [_shown(settings.host)])]
    usual = 443 if settings.secure else 80
    names = [*dict.fromkeys((*names, *settings.names))]
    return [f"{name}:{port}" for name in names] + (names if port == usual else [])


@contextmanager
def one_server(project: Project) -> Iterator[Callable[[str], None]]:
    """The lock for serving a project: only one server, so that a single lease controls who may command a run.

    Raises
    ------
    RigctlError
        another program has it; names its address.
    """
    from filelock import FileLock, Timeout

    facts = _facts_path(project)
    facts.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    lock = FileLock(facts.with_suffix(".lock"), thread_local=False)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        other = served_at(project)
        at = f" at {other['address']} (process {other['pid']})" if other else ""
        raise RigctlError(
            f"this project is served already{at}",
            value=project.root.as_posix(),
            hint="Open the address that it has printed, or end it first",
            exit_code=ExitCode.FAILED,
        ) from None
    try:
        yield lambda address: _say(facts, {"address": address, "pid": os.getpid()})
    finally:
        with suppress(OSError):
            facts.unlink()
        lock.release()


def served_at(project: Project) -> dict[str, Any] | None:
    """Address and process of the server of a project; None if none is known."""
    try:
        facts = parse_json(read_text(_facts_path(project)))
    except (OSError, ValueError):
        return None
    return facts if isinstance(facts, dict) and {"address", "pid"} <= facts.keys() else None


def _facts_path(project: Project) -> Path:
    from platformdirs import user_state_path

    name = hashlib.sha256(os.fsencode(project.root.resolve())).hexdigest()[:24]
    return user_state_path("rigctl", appauthor=False) / "servers" / f"{name}.json"


def _say(path: Path, facts: dict[str, Any]) -> None:
    with suppress(OSError):
        path.write_text(json.dumps(facts), encoding="utf-8", newline="\n")


@contextmanager
def _listening(settings: Settings) -> Iterator[socket.socket]:
    """A listening socket, on the requested port, or else on the usual one or any that is free.

    Raises
    ------
    RigctlError
        the port is in use or not to be had.
    """
    # A port that was asked for is not replaced by another: a bookmark or a tunnel leads there.
    wanted = [settings.port] if settings.port is not None else [USUAL_PORT, 0]
    problem: OSError | None = None
    for port in wanted:
        try:
            listener = _bound(settings.host, port)
        except OSError as error:
            problem = error
            continue
        with listener:
            yield listener
        return
    raise RigctlError(
        f"cannot listen there: {problem.strerror if problem else 'no port'}",
        value=f"{settings.host}:{settings.port if settings.port is not None else USUAL_PORT}",
        hint="'--port 0' takes any port that is free",
        exit_code=ExitCode.FAILED,
    )


def _bound(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        if sys.platform != "win32":  # on Windows it would let two programs bind one port
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen(128)
    except BaseException:
        listener.close()
        raise
    return listener


def _is_address(host: str) -> bool:
    try:
        ip_address(host)
    except ValueError:
        return False
    return True


def _shown(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def _server(
    config: uvicorn.Config, started: Callable[[], None], ends: Callable[[], bool] | None
) -> uvicorn.Server:
    """A server that reports when it has started, and ends normally on a signal."""
    import uvicorn

    class Server(uvicorn.Server):
        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            if not self.should_exit:
                started()

        async def on_tick(self, counter: int) -> bool:
            if ends is not None and counter % 10 == 0 and ends():
                return True
            return await super().on_tick(counter)

        @contextmanager
        def capture_signals(self) -> Iterator[None]:
            if threading.current_thread() is not threading.main_thread():
                yield
                return
            names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
            signals = [getattr(signal, name) for name in names if hasattr(signal, name)]
            before = {each: signal.signal(each, self.handle_exit) for each in signals}
            try:
                yield
            finally:
                for each, handler in before.items():
                    signal.signal(each, handler)

    return Server(config)
