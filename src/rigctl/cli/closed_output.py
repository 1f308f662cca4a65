"""Output whose reader has gone: ``rigctl diagnose … | head`` ends as other programs in a pipe do."""

from __future__ import annotations

import errno
import io
import os
import stat
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

#: exit status of a program whose output is not read to its end: a shell's number for SIGPIPE, 128 + 13
UNREAD: Final = 141


class _Pipe(io.FileIO):
    """A pipe on Windows, where writing what nobody reads is an 'invalid argument'."""

    broken = False  #: of any of them

    def write(self, data: ReadableBuffer, /) -> int:
        """Write, and raise `BrokenPipeError` as everywhere else if nobody reads it."""
        try:
            return super().write(data)
        except OSError as problem:
            if problem.errno not in (errno.EINVAL, errno.EPIPE):
                raise
            _Pipe.broken = True
            raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE)) from problem


def notice_closed_pipes() -> None:
    """On Windows, let stdout and stderr say that their reader has gone, as they do elsewhere."""
    if os.name != "nt":
        return
    for name, handle in (("stdout", 1), ("stderr", 2)):
        stream = getattr(sys, name)
        if not isinstance(stream, io.TextIOWrapper) or not stat.S_ISFIFO(os.fstat(handle).st_mode):
            continue
        # The same handle with another error; encoding and buffering stay as they were.
        pipe: Any = _Pipe(handle, "wb", closefd=False)
        text = io.TextIOWrapper(
            pipe if stream.write_through else io.BufferedWriter(pipe),
            stream.encoding,
            stream.errors,
            line_buffering=stream.line_buffering,
            write_through=stream.write_through,
        )
        setattr(sys, name, text)


def by_closed_pipe(end: BaseException) -> bool:
    """Return whether the command ended because its output's reader closed the pipe."""
    return has_broken_pipe(end) and is_unread()


def has_broken_pipe(end: BaseException) -> bool:
    """Return whether a broken pipe, of the output or of anything else, is behind an exception."""
    error: BaseException | None = end
    while error is not None and not isinstance(error, BrokenPipeError):
        error = error.__cause__ or error.__context__
    return error is not None


def is_unread() -> bool:
    """Return whether nobody reads stdout or stderr; a broken pipe may also be a device's or a worker's."""
    try:
        from select import POLLERR, POLLHUP, poll
    except ImportError:  # Windows
        return _Pipe.broken
    poller = poll()
    for handle in (1, 2):
        poller.register(handle, 0)
    return any(state & (POLLERR | POLLHUP) for _, state in poller.poll(0)) or _is_null_device()


def _is_null_device() -> bool:
    """Return whether stdout is the null device, which Rich puts there when the pipe is closed."""
    try:
        return os.path.samestat(os.fstat(1), Path(os.devnull).stat())
    except OSError:
        return False


def discard_output() -> None:
    """Discard the streams' buffers, which the interpreter would otherwise write when it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream, handle in ((sys.stdout, 1), (sys.stderr, 2)):
        try:
            stream.flush()
        except (OSError, ValueError, AttributeError):
            os.dup2(nowhere, handle)
    os.close(nowhere)
