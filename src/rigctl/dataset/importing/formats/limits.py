"""Limits of memory and CPU time for this process, on every system."""

from __future__ import annotations

import os
import platform
import sys
import threading
import time
from typing import Final

#: exit status of a process that exceeded its memory, if there is no other sign
OUT_OF_MEMORY: Final = 86
#: interval of memory checks if the system does not limit it, s
_EVERY: Final = 0.05


def limit_process(memory: int, seconds: float) -> None:
    """Limit this process to some bytes of memory and seconds of CPU time; it ends if it exceeds them.

    Linux limits both; so does Windows, with a job object; on macOS and others a thread checks the memory.
    """
    if sys.platform == "win32":
        _limit_by_job(memory, seconds)
    else:
        _limit_by_system(memory, seconds)


def _limit_by_system(memory: int, seconds: float) -> None:
    """Set the limits with the operating system (Linux, macOS)."""
    if sys.platform == "win32":
        return
    import resource

    darwin = platform.system() == "Darwin"
    whole_seconds = max(int(seconds), 1)
    for kind, low, high in (
        (resource.RLIMIT_CORE, 0, 0),
        (resource.RLIMIT_CPU, whole_seconds, whole_seconds + 1),
        (resource.RLIMIT_DATA, memory, memory),
    ):
        _, most = resource.getrlimit(kind)
        if most != resource.RLIM_INFINITY:
            low, high = min(low, most), min(high, most)  # noqa: PLW2901 - never above what is allowed
        resource.setrlimit(kind, (low, high))
    if darwin:  # this system does not limit memory
        threading.Thread(target=_watch, args=(memory,), daemon=True).start()


def _watch(memory: int) -> None:
    """End the process if it uses more than `memory` bytes."""
    if sys.platform == "win32":
        return
    import resource

    scale = 1 if sys.platform == "darwin" else 1024
    while resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * scale < memory:
        time.sleep(_EVERY)
    os._exit(OUT_OF_MEMORY)


def _limit_by_job(memory: int, seconds: float) -> None:
    """Put this process into a job object with limits (Windows)."""
    if sys.platform == "win32":
        import ctypes
        from ctypes import wintypes

        class BasicLimits(ctypes.Structure):
            _fields_ = (
                ("PerProcessUserTimeLimit", wintypes.LARGE_INTEGER),
                ("PerJobUserTimeLimit", wintypes.LARGE_INTEGER),
                ("LimitFlags", wintypes.DWORD),
                ("MinimumWorkingSetSize", ctypes.c_size_t),
                ("MaximumWorkingSetSize", ctypes.c_size_t),
                ("ActiveProcessLimit", wintypes.DWORD),
                ("Affinity", ctypes.c_size_t),
                ("PriorityClass", wintypes.DWORD),
                ("SchedulingClass", wintypes.DWORD),
            )

        class ExtendedLimits(ctypes.Structure):
            _fields_ = (
                ("BasicLimitInformation", BasicLimits),
                ("IoInfo", ctypes.c_ulonglong * 6),
                ("ProcessMemoryLimit", ctypes.c_size_t),
                ("JobMemoryLimit", ctypes.c_size_t),
                ("PeakProcessMemoryUsed", ctypes.c_size_t),
                ("PeakJobMemoryUsed", ctypes.c_size_t),
            )

        process_time, process_memory, extended = 0x2, 0x100, 9
        limits = ExtendedLimits()
        limits.BasicLimitInformation.LimitFlags = process_time | process_memory
        limits.BasicLimitInformation.PerProcessUserTimeLimit = int(seconds * 1e7)  # in 100 ns
        limits.ProcessMemoryLimit = memory
        kernel = ctypes.WinDLL("kernel32", use_last_error=True)
        kernel.CreateJobObjectW.restype = wintypes.HANDLE
        kernel.GetCurrentProcess.restype = wintypes.HANDLE
        kernel.SetInformationJobObject.argtypes = (
            wintypes.HANDLE,
            ctypes.c_int,
            ctypes.c_void_p,
            wintypes.DWORD,
        )
        kernel.AssignProcessToJobObject.argtypes = (wintypes.HANDLE, wintypes.HANDLE)
        # the open handle keeps the job alive as long as the process
        job = kernel.CreateJobObjectW(None, None)
        done = kernel.SetInformationJobObject(job, extended, ctypes.byref(limits), ctypes.sizeof(limits))
        if not job or not done or not kernel.AssignProcessToJobObject(job, kernel.GetCurrentProcess()):
            raise ctypes.WinError(ctypes.get_last_error())
