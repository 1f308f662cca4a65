"""Starts rigctl on Windows, and ends it as `windows_endings` says on stdin; run by Windows' own Python.

It has a console of its own, and puts rigctl into a job that ends with it, as editors and schedulers do.
"""

from __future__ import annotations

import ctypes
import json
import os
import queue
import subprocess
import sys
import threading
from ctypes import wintypes

kernel = ctypes.WinDLL("kernel32", use_last_error=True)
kernel.CreateJobObjectW.restype = wintypes.HANDLE
kernel.OpenProcess.restype = wintypes.HANDLE
kernel.GetModuleHandleW.restype = wintypes.HMODULE
kernel.GetProcAddress.restype = ctypes.c_void_p
kernel.GetProcAddress.argtypes = (wintypes.HMODULE, ctypes.c_char_p)
kernel.CreateRemoteThread.restype = wintypes.HANDLE
kernel.CreateRemoteThread.argtypes = (
    wintypes.HANDLE,
    *(ctypes.c_void_p,) * 4,
    wintypes.DWORD,
    ctypes.c_void_p,
)
kernel.SetInformationJobObject.argtypes = (wintypes.HANDLE, ctypes.c_int, ctypes.c_void_p, wintypes.DWORD)
kernel.AssignProcessToJobObject.argtypes = (wintypes.HANDLE, wintypes.HANDLE)
kernel.CloseHandle.argtypes = (wintypes.HANDLE,)

ALL_ACCESS = 0x1FFFFF
EVENTS = {"Ctrl-C": 0, "Ctrl-Break": 1, "console closed": 2}
PATIENCE = {"console closed": 5.0}  #: s that Windows leaves a process
BREAKAWAY_OK, KILL_ON_CLOSE = 0x800, 0x2000


def job() -> int:
    """A job whose processes end with its handle, and may leave it."""

    class Limits(ctypes.Structure):  # JOBOBJECT_EXTENDED_LIMIT_INFORMATION, of which only the flags are set
        _fields_ = (
            ("times", ctypes.c_int64 * 2),
            ("flags", wintypes.DWORD),
            ("rest", ctypes.c_size_t * 16),
        )

    limits = Limits(flags=BREAKAWAY_OK | KILL_ON_CLOSE)
    handle = kernel.CreateJobObjectW(None, None)
    assert kernel.SetInformationJobObject(handle, 9, ctypes.byref(limits), 144), ctypes.get_last_error()
    return int(handle)


def tell(pid: int, event: int) -> None:
    """Start a thread in a process that calls its handlers.

    Windows' own way is another: its console host asks the system to do so, which also ends the process. Wine
    has no way but this one for anything but Ctrl-C.
    """
    process = kernel.OpenProcess(ALL_ACCESS, False, pid)
    routine = kernel.GetProcAddress(kernel.GetModuleHandleW("kernelbase.dll"), b"CtrlRoutine")
    assert kernel.CreateRemoteThread(process, None, None, routine, event, 0, None), ctypes.get_last_error()


def named(child: subprocess.Popen[str]) -> str:
    """The ending that stdin names, or none where rigctl has ended by itself before."""
    lines = queue.Queue[bytes]()
    threading.Thread(target=lambda: lines.put(os.read(0, 100)), daemon=True).start()
    while child.poll() is None:
        try:
            return lines.get(timeout=0.02).decode().strip()
        except queue.Empty:
            pass
    return ""


def main() -> None:
    kernel.FreeConsole()
    kernel.AllocConsole()
    command = [sys.executable, "-m", "rigctl", *sys.argv[1:]]
    child = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8"
    )
    owner = job()
    in_job = bool(kernel.AssignProcessToJobObject(owner, int(child._handle)))
    how = named(child)
    if how == "terminated":
        child.kill()
    elif how == "job ended":
        assert in_job
        kernel.CloseHandle(owner)
    elif how:
        tell(child.pid, EVENTS[how])
    try:
        out, err = child.communicate(timeout=PATIENCE.get(how, 90.0))
    except subprocess.TimeoutExpired:
        child.kill()
        out, err = child.communicate()
        err += "\nended by the system\n"
    sys.stdout.write(json.dumps({"code": child.returncode, "out": out, "err": err}))
    sys.stdout.flush()
    os._exit(0)  # a thread may still wait for stdin


if __name__ == "__main__":
    main()
