"""Requests and heartbeats in files, handled by a thread: a slow disk must not delay the loop.

The loop's thread calls the methods of `Aside` and `Watching`, which only move something to or from a
queue; the wrapped control, or observer, is called by its own thread alone. The queues are deques, whose
appending and popping at the ends are atomic, so that no lock is needed, and neither side ever waits for
the other. Views are dropped if the thread is late, since only the newest matters; requests and answers
never are.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress

from rigctl.clock import Clock
from rigctl.runner.operators.requests import Control, Order
from rigctl.runner.snapshot import View

_LOOK = 0.05  # s of wall time between two looks
_ENDS_WITHIN = 2.0  # s; a disk that hangs must not keep the program from ending


class Aside:
    """A `Control` whose every method returns at once; `control` is used by its thread only.

    Heartbeats still depend on the loop: nothing is published unless it calls `publish`.
    """

    def __init__(self, control: Control) -> None:
        self._control = control
        self._orders: deque[Order] = deque()
        self._answers: deque[tuple[Order, str]] = deque()
        self._views: deque[View] = deque(maxlen=1)  # shared with another thread; no request may be lost
        self._wake = threading.Event()
        self._ended = False
        self._thread = threading.Thread(target=self._work, name="requests", daemon=True)
        self._thread.start()

    def poll(self) -> Sequence[Order]:
        """Requests that have come since the last call."""
        orders = []
        while self._orders:
            orders.append(self._orders.popleft())
        return orders

    def acknowledge(self, order: Order, message: str) -> None:
        """Acknowledge an order, soon."""
        self._answers.append((order, message))
        self._wake.set()

    def publish(self, view: View) -> None:
        """Publish the newest view; one that was not published in time is left out."""
        self._views.append(view)

    def close(self) -> None:
        """Publish what is left and end; waits at most two seconds for a disk that hangs."""
        self._ended = True
        self._wake.set()
        self._thread.join(_ENDS_WITHIN)

    def _work(self) -> None:
        while True:
            # Read before the work, so that what was handed over before `close` is still done in this last
            # round.
            ending = self._ended
            with suppress(Exception):  # neither files nor locks may end a run
                self._once()
            if ending:
                break
            self._wake.wait(_LOOK)
            self._wake.clear()
        with suppress(Exception):
            self._control.close()

    def _once(self) -> None:
        if self._views:
            self._control.publish(self._views.popleft())
        while self._answers:
            self._control.acknowledge(*self._answers.popleft())
        self._orders.extend(self._control.poll())


class Watching:
    """An observer in a separate thread: a terminal that nobody reads must not delay the loop.

    It is shown the newest view; views that it could not show in time are skipped. An exception in it is
    raised by the next call.
    """

    def __init__(self, observer: Callable[[View], None]) -> None:
        self._observer = observer
        self._views: deque[View] = deque(maxlen=1)
        self._error: Exception | None = None
        self._wake = threading.Event()
        self._ended = False
        self._thread = threading.Thread(target=self._work, name="display", daemon=True)
        self._thread.start()

    def __call__(self, view: View) -> None:
        """Hand over the newest view."""
        error, self._error = self._error, None
        if error is not None:
            raise error
        self._views.append(view)
        self._wake.set()

    def close(self) -> None:
        """Show the last view, waiting at most two seconds."""
        self._ended = True
        self._wake.set()
        self._thread.join(_ENDS_WITHIN)

    def _work(self) -> None:
        while True:
            ending = self._ended
            if self._views:
                try:
                    self._observer(self._views.popleft())
                except Exception as error:  # noqa: BLE001 - told with the next call
                    self._error = error
            if ending:
                return
            self._wake.wait(1.0)
            self._wake.clear()


def beside(control: Control, clock: Clock) -> Control:
    """The control, in a separate thread in real time; in virtual time a slow disk delays nothing."""
    return Aside(control) if math.isfinite(clock.speed) else control
