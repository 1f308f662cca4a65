"""The thread of one device: only it uses the device's bench, so that a slow device delays no other.

In: calls from the runner's thread, in a queue. Out: their results as futures, and what the device
reports, in the `Inbox` that all devices share. Between two calls the thread reads the device for at most
`_SLICE` s, so that no command waits longer.

At an ending, `safe` and `close` count up `_safes`: commands that still wait in the queue were made before
it, and are dropped instead of being carried out after the outputs are safe. A call in progress is not
interrupted: `safe` waits for its turn, and the runner for `safe` with a limit.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from threading import Condition, Thread
from time import monotonic
from typing import TypeVar

from rigctl.backends.errors import BackendLost, OutOfReach
from rigctl.backends.protocol import Backend, CommandReceipt, Notice, PendingCommand, Sample
from rigctl.errors import ExitCode, RigctlError

Result = TypeVar("Result")

#: s of bench time after which a thread looks for calls: a command waits for no longer
_SLICE = 0.005
#: s without a call of the host after which a device is left to its guard or its watchdog
_HOST_SILENT = 1.0
#: s between two looks whether it calls again
_LOOK = 0.05


@dataclass
class Inbox:
    """What the threads of all devices have for the host, in order of arrival; guarded by `arrived`.

    Attributes
    ----------
    samples: with the device of each.
    receipts: the switches that no command reports.
    switched: all switches, also those that a command reports, since the newest sample was fetched.
    notices: each with the name of its device.
    lost: why a device is gone for good, by device.
    answered: whether a command has been answered since the host looked last.
    called: monotonic time of the host's last call, s.
    """

    arrived: Condition = field(default_factory=Condition)
    samples: deque[tuple[str, Sample]] = field(default_factory=deque)
    receipts: list[CommandReceipt] = field(default_factory=list)
    switched: list[CommandReceipt] = field(default_factory=list)
    notices: list[Notice] = field(default_factory=list)
    lost: dict[str, str] = field(default_factory=dict)
    answered: bool = False
    called: float = field(default_factory=monotonic)


class DeviceThread:
    """Carries out the calls to one device in their order, and reads it in between.

    A host that has not called for a second may hang: the device is then not kept alive either, so that its
    guard or its own watchdog makes it safe, as if it were alone.
    """

    def __init__(self, name: str, bench: Backend, inbox: Inbox) -> None:
        self.name = name
        self.bench = bench
        self._inbox = inbox
        self._calls: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._pending: list[tuple[PendingCommand, PendingCommand]] = []  # the device's, and the host's
        self._open = self._reading = False
        self._safes = 0  # how often safe outputs were asked for
        self._thread = Thread(target=self._work, name=f"device {name}", daemon=True)
        self._thread.start()

    def call(self, work: Callable[[], Result]) -> Future[Result]:
        """Have the thread do something next, and return its future result."""
        future: Future[Result] = Future()

        def carry_out() -> None:
            try:
                future.set_result(work())
            except BaseException as error:  # noqa: BLE001 - it is raised where the result is asked for
                future.set_exception(error)

        self._calls.put(carry_out)
        return future

    def open(self) -> Future[None]:
        """Open the device, and read it from then on."""

        def work() -> None:
            self.bench.open()
            self._open = self._reading = True

        return self.call(work)

    def close(self) -> Future[None]:
        """Close the device, and end the thread."""

        def work() -> None:
            self._open = self._reading = False
            self.bench.close()

        self._safes += 1
        future = self.call(work)
        # After the call to close, which is thus still carried out.
        self._calls.put(None)
        return future

    def safe(self) -> Future[None]:
        """Make outputs safe; commands that still wait for this thread are dropped."""
        self._safes += 1
        return self.call(self.bench.safe)

    def send(self, command: Callable[[], PendingCommand], pending: PendingCommand) -> None:
        """Send a command; `pending` receives its outcome, whatever happens."""
        # Read on the caller's thread, when the command is given; compared on this thread, when its turn
        # comes.
        asked_after = self._safes

        def work() -> None:
            try:
                if self._safes != asked_after:
                    raise OutOfReach(f"{self.name}: not sent, as outputs were to be safe meanwhile")
                self._pending.append((command(), pending))
            except RigctlError as error:
                pending.trouble = error
                self._answered()
            except Exception as error:  # noqa: BLE001 - nobody may wait for its outcome for ever
                pending.trouble = RigctlError(f"{self.name}: {error!r}", exit_code=ExitCode.FAILED)
                self._answered()

        self.call(work)

    def _work(self) -> None:
        while True:
            # `_HOST_SILENT`: reading keeps the guard alive, which must not outlast a run that hangs.
            reading = self._reading and monotonic() - self._inbox.called <= _HOST_SILENT
            try:
                call = self._calls.get_nowait() if reading else self._calls.get(timeout=_LOOK)
            except Empty:
                if reading:
                    self._read()
                continue
            if call is None:
                return
            call()
            # Also after a call: it may have been answered at once, and its receipt comes before the next
            # sample.
            if self._open:  # a closed bench has nothing to report
                self._report()

    def _read(self) -> None:
        try:
            sample = self.bench.next_sample(_SLICE)
        except Exception as error:  # noqa: BLE001 - whatever it is, the device is lost, and no other with it
            self._lose(error)
            sample = None
        self._report(sample)

    def _lose(self, error: Exception) -> None:
        self._reading = False
        # Whoever waits for an answer is released: there will be none.
        text = str(error) if isinstance(error, RigctlError) else repr(error)
        for _, pending in self._pending:
            pending.trouble = lost(self.name, text)
        self._pending = []
        with self._inbox.arrived:
            self._inbox.lost.setdefault(self.name, text)
            self._inbox.answered = True
            self._inbox.arrived.notify()

    def _report(self, sample: Sample | None = None) -> None:
        """Hand over what the device has reported; what led to a sample comes before it."""
        try:
            receipts, notices = self.bench.take_receipts(), self.bench.take_notices()
        except Exception as error:  # noqa: BLE001 - as in `_read`; its calls are still carried out
            self._lose(error)
            return
        # The device's own `PendingCommand` stays on this thread; the runner's gets a copy of the outcome.
        settled = [pair for pair in self._pending if pair[0].settled]
        if sample is None and not (receipts or notices or settled):
            return
        for answered, pending in settled:
            pending.trouble, pending.receipt = answered.trouble, answered.receipt
        self._pending = [pair for pair in self._pending if not pair[0].settled]
        named = [
            Notice(one.time, one.kind, f"{self.name}: {one.message}", {**one.fields, "device": self.name})
            for one in notices
        ]
        with self._inbox.arrived:
            self._inbox.receipts += receipts
            self._inbox.switched += [*(one.receipt for one, _ in settled if one.receipt), *receipts]
            self._inbox.notices += named
            if sample is not None:
                self._inbox.samples.append((self.name, sample))
            self._inbox.answered |= bool(settled)
            self._inbox.arrived.notify()

    def _answered(self) -> None:
        with self._inbox.arrived:
            self._inbox.answered = True
            self._inbox.arrived.notify()


def lost(device: str, why: str) -> BackendLost:
    """Return the error for a device that is gone for good."""
    return BackendLost(f"{device}: {why}")
