"""A port held by the guard: all data pass through it, which also shows that rigctl is alive.

rigctl's side of `rigctl.backends.transport.guard`. To the protocol above it is a `Port` like any other,
except that `read` and `write` raise `GuardActed` once after the guard has made outputs safe by itself.

The heartbeat is sent by `read`, which the sampling loop calls: a thread of its own would go on sending while
the loop hangs, which is the case that the guard is for.
"""

from __future__ import annotations

import json
import secrets
import select
import socket
import subprocess
from collections.abc import Mapping
from contextlib import suppress
from functools import partial

from rigctl.backends.transport.guard import GuardSettings
from rigctl.backends.transport.guard_frames import Frame, FrameReader, send_frame
from rigctl.backends.transport.port import PortLost
from rigctl.backends.transport.safe_commands import Duty, Outputs
from rigctl.child_process import module_command
from rigctl.clock import Clock
from rigctl.errors import ExitCode, RigctlError

_STARTS_WITHIN = 20.0  # s; Python starts slowly on a busy computer
_SIGN_OF_LIFE = 0.2  # s between two messages to the guard that show that rigctl is alive
_LONGEST_WAIT = 0.2  # s of wall time in one read, so that these messages continue
_ENDS_WITHIN = 3.0  # s for the guard's process to end


#: guards that continue after their port was closed
_GOING_ON: list[subprocess.Popen[str]] = []


class GuardActed(PortLost):
    """The guard has made outputs safe, because this process was silent for `silence` s."""

    def __init__(self, silence: float) -> None:
        super().__init__(f"rigctl stood still for {silence:.1f} s, and its guard has made the outputs safe")
        self.silence = silence


class GuardedPort:
    """A `Port` that the guard's process holds.

    Parameters
    ----------
    orders: the guard's orders.
    clock: the clock for waits; real.
    duty: the known state of the outputs when the port is closed.

    Raises
    ------
    PortLost
        the port does not exist at present.
    RigctlError
        there is no permission, or the guard cannot be started.
    """

    def __init__(self, orders: GuardSettings, clock: Clock, duty: Duty) -> None:
        self.name = orders.url
        self._clock = clock
        self._duty = duty
        self._reader = FrameReader()
        self._data = b""
        self._lost = ""
        self._silence: float | None = None
        self._last_sent = clock.now()
        self._connection, self._process = _start()
        try:
            self._begin(orders)
        except BaseException:
            self.close()
            raise

    def write(self, data: bytes) -> None:
        """Send `data`."""
        # First what the guard has said: a command must not be sent on after it has acted, or after the port
        # was lost.
        self._take(0.0)
        self._check()
        self._tell(Frame.WRITE, data)

    def read(self, until: float) -> bytes:
        """Return what has arrived by bench time `until`, as soon as something has."""
        if self._clock.now() - self._last_sent >= _SIGN_OF_LIFE:
            # As in `write`, first what the guard has said, which may have ended since: that is found below.
            with suppress(PortLost):
                self._tell(Frame.ALIVE)
        if not self._data:
            left = (until - self._clock.now()) / self._clock.speed
            self._take(min(max(left, 0.0), _LONGEST_WAIT))
        data, self._data = self._data, b""
        # Data that have arrived are handed over first; a loss is reported once there are no more of them.
        if not data:
            self._check()
        return data

    def identified(self, identity: Mapping[str, str]) -> None:
        """Tell the guard that the device on this port is the right one, which it may command."""
        self._tell(Frame.IDENTIFIED, json.dumps(dict(identity)).encode("utf-8"))

    def exchanged(self) -> None:
        """Tell the guard that another device is on this port by now, which it must not command."""
        with suppress(PortLost):
            self._tell(Frame.EXCHANGED)

    def close(self) -> None:
        """Close the port and end the guard, unless it still has to make the device safe."""
        # What is known of the outputs decides what becomes of the guard: it ends where they are safe, and
        # goes on by itself where they are not, or where nobody knows.
        outputs = self._duty.outputs
        with suppress(OSError):
            send_frame(self._connection, Frame.CLOSE, outputs.value)
        self._connection.close()
        if outputs is Outputs.DRIVEN:
            _GOING_ON.append(self._process)
            return
        try:
            self._process.wait(_ENDS_WITHIN)
        except subprocess.TimeoutExpired:
            if outputs is Outputs.SAFE:
                self._process.kill()
                self._process.wait()
            else:
                _GOING_ON.append(self._process)  # it has taken over from a guard that was trying

    def _begin(self, orders: GuardSettings) -> None:
        self._tell(Frame.CONFIGURE, orders.to_json())
        self._connection.settimeout(_STARTS_WITHIN)
        while True:
            try:
                data = self._connection.recv(65536)
            except OSError as error:
                raise PortLost(f"the guard of {self.name} does not answer: {error}") from None
            if not data:
                raise PortLost(f"the guard of {self.name} has ended")
            for frame, content in self._reader.feed(data):
                if frame is Frame.REFUSED:
                    details = json.loads(content)
                    if "lost" in details:
                        raise PortLost(details["lost"])
                    raise RigctlError(details["what"], value=details["value"], hint=details["hint"])
                if frame is Frame.OPENED:
                    self._connection.settimeout(None)
                    return

    def _take(self, wait: float) -> None:
        """Read what the guard has sent, waiting `wait` s of wall time for something."""
        try:
            if not select.select([self._connection], [], [], wait)[0]:
                return
            data = self._connection.recv(65536)
            frames = list(self._reader.feed(data))
        except (OSError, ValueError) as error:  # ValueError: closed, or no frames
            raise PortLost(f"the guard of {self.name} is gone: {error}") from None
        if not data:
            self._lost = self._lost or f"the guard of {self.name} has ended"
        for frame, content in frames:
            if frame is Frame.DATA:
                self._data += content
            elif frame is Frame.LOST:
                self._lost = content.decode("utf-8", "replace")
            elif frame is Frame.ACTED:
                self._silence = float(content)

    def _check(self) -> None:
        """Raise `PortLost` if the port is lost, and `GuardActed` once if the guard has made outputs safe."""
        if self._silence is not None:
            silence, self._silence = self._silence, None
            # Acknowledged before it is raised: whoever handles it may command again at once. A guard that has
            # ended meanwhile is found at the next use.
            with suppress(PortLost):
                self._tell(Frame.RESUME)
            raise GuardActed(silence)
        if self._lost:
            raise PortLost(self._lost)

    def _tell(self, frame: Frame, content: bytes = b"") -> None:
        self._last_sent = self._clock.now()
        try:
            send_frame(self._connection, frame, content)
        except OSError as error:
            raise PortLost(f"the guard of {self.name} is gone: {error}") from None


def _start() -> tuple[socket.socket, subprocess.Popen[str]]:
    """Start the guard's process, and connect to it."""
    secret = secrets.token_hex(16)
    # rigctl listens and the guard connects, on this computer only: the guard, which outlives rigctl, then has
    # no port on which others could reach it.
    with socket.create_server(("127.0.0.1", 0), backlog=1) as server:
        server.settimeout(_STARTS_WITHIN)
        port = str(server.getsockname()[1])
        command = module_command("rigctl.backends.transport.guard", port)
        process = _independent(command)
        try:
            return _accept(server, process, secret), process
        except BaseException:
            process.kill()
            process.wait()
            raise


def _independent(command: list[str]) -> subprocess.Popen[str]:
    """Start a process that outlives this one, its terminal and, on Windows, its job where that permits it.

    Programs that start others put them into a job on Windows, which may end all of them with the first: `py`,
    editors, schedulers.
    """
    # a console and a group of its own: it must not receive Ctrl-C, nor end with the window
    flags = getattr(subprocess, "CREATE_NO_WINDOW", 0) | getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
    out_of_job = getattr(subprocess, "CREATE_BREAKAWAY_FROM_JOB", 0)
    start = partial(
        subprocess.Popen,
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
        encoding="ascii",
        start_new_session=True,  # the same on POSIX
    )
    try:
        return start(creationflags=flags | out_of_job)
    except PermissionError:
        if not out_of_job:
            raise
        return start(creationflags=flags)


def _accept(server: socket.socket, process: subprocess.Popen[str], secret: str) -> socket.socket:
    """Accept the connection of the process that knows the secret, and no other."""
    if process.stdin is not None:
        with process.stdin as stdin:
            stdin.write(f"{secret}\n")
    while True:
        try:
            connection, _ = server.accept()
        except OSError as error:
            raise RigctlError(
                "the guard of a device without a watchdog cannot be started",
                value=str(error),
                exit_code=ExitCode.FAILED,
            ) from None
        connection.settimeout(_STARTS_WITHIN)
        try:
            # Any process of this computer may connect first. One that does not know the secret is turned
            # away.
            frames = list(FrameReader().feed(connection.recv(1024)))
        except (OSError, ValueError):
            frames = []
        if frames and secrets.compare_digest(frames[0][1], secret.encode("ascii")):
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return connection
        connection.close()
