"""A device on a pseudoterminal that keeps the answer to one request until it may give it."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable


class LateSerialDevice:
    """One end of a serial line, in a thread.

    Parameters
    ----------
    ends: whether the received bytes are a whole request.
    answer: the answer to a request.
    late: the request whose first answer is late.
    """

    def __init__(
        self, ends: Callable[[bytes], bool], answer: Callable[[bytes], bytes], *, late: bytes
    ) -> None:
        from pty import openpty
        from tty import setraw

        self._end, self._other = openpty()
        setraw(self._end)
        setraw(self._other)
        self.port = os.ttyname(self._other)
        self._ends, self._answer, self._late = ends, answer, late
        self._may_answer, self._answered = threading.Event(), threading.Event()
        self._over = False
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    @property
    def has_answered(self) -> bool:
        """Whether the late answer has been sent."""
        return self._answered.is_set()

    def answer_now(self) -> None:
        """Send the late answer; return once it has been sent."""
        self._may_answer.set()
        assert self._answered.wait(60.0)

    def stop(self) -> None:
        self._over = True
        self._may_answer.set()
        os.write(self._other, b"\0")
        self._thread.join()
        os.close(self._end)
        os.close(self._other)

    def _serve(self) -> None:
        request = b""
        while True:
            request += os.read(self._end, 1)
            if self._over:
                return
            if not self._ends(request):
                continue
            late, asked, request = request == self._late and not self._answered.is_set(), request, b""
            if late:
                self._may_answer.wait(60.0)
            os.write(self._end, self._answer(asked))
            if late:
                self._answered.set()
