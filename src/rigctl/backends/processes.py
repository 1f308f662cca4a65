"""Whether the process with a given id still exists."""

from __future__ import annotations

import os
import sys


def process_exists(pid: int) -> bool:
    """Return whether a process exists, also one of another user."""
    if pid <= 0:  # would query a whole process group
        return False
    if sys.platform == "win32":
        return _runs_on_windows(pid)
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


if sys.platform == "win32":
    import ctypes
    from ctypes import wintypes

    _SYNCHRONIZE = 0x0010_0000  # the right to wait for the end of a process, and no other
    _WAIT_TIMEOUT = 0x102
    _ERROR_INVALID_PARAMETER = 87  # no process has this id

    _kernel = ctypes.WinDLL("kernel32", use_last_error=True)
    _kernel.OpenProcess.restype = wintypes.HANDLE
    _kernel.OpenProcess.argtypes = (wintypes.DWORD, wintypes.BOOL, wintypes.DWORD)
    _kernel.WaitForSingleObject.argtypes = (wintypes.HANDLE, wintypes.DWORD)
    _kernel.CloseHandle.argtypes = (wintypes.HANDLE,)

    def _runs_on_windows(pid: int) -> bool:
        """`os.kill` would end the process here. A handle shows it, and also whether it has ended: an ended
        process keeps its id while any program has a handle to it."""
        if pid >= 1 << 32:
            return False
        handle = _kernel.OpenProcess(_SYNCHRONIZE, False, pid)
        if not handle:
            return ctypes.get_last_error() != _ERROR_INVALID_PARAMETER
        try:
            return bool(_kernel.WaitForSingleObject(handle, 0) == _WAIT_TIMEOUT)
        finally:
            _kernel.CloseHandle(handle)
