"""What stdin is on Windows: a console, or a pipe from which nothing more will come."""

from __future__ import annotations

import sys

if sys.platform == "win32":
    import ctypes
    import msvcrt
    from ctypes import wintypes

    _ERROR_BROKEN_PIPE = 109  # its other end is closed, and nothing is left in it

    _kernel = ctypes.WinDLL("kernel32", use_last_error=True)
    _kernel.GetConsoleMode.argtypes = (wintypes.HANDLE, ctypes.POINTER(wintypes.DWORD))
    _kernel.PeekNamedPipe.argtypes = (
        wintypes.HANDLE,
        ctypes.c_void_p,
        wintypes.DWORD,
        *(ctypes.POINTER(wintypes.DWORD),) * 3,
    )

    def is_console(descriptor: int) -> bool:
        """Whether a file is the input of a console: no other character device has a mode."""
        mode = wintypes.DWORD()
        handle = msvcrt.get_osfhandle(descriptor)
        return bool(_kernel.GetConsoleMode(handle, ctypes.byref(mode)))

    def is_drained(pipe: int) -> bool:
        """Whether a pipe holds nothing, and nobody can write to it any more."""
        handle = msvcrt.get_osfhandle(pipe)
        if _kernel.PeekNamedPipe(handle, None, 0, None, None, None):
            return False
        return ctypes.get_last_error() == _ERROR_BROKEN_PIPE
