"""For how long this computer has been suspended: in sleep, or in hibernation.

The difference of two of the system's clocks, of which one goes on meanwhile. Steps of the calendar clock do
not matter, such as NTP makes.
"""

from __future__ import annotations

import sys
import time

#: s between two readings above which the clocks are read again, as this process was interrupted
_AT_ONCE = 0.01


def suspended_time() -> float:
    """Seconds of suspension since this computer was started, to some 0.02 s; 0 where no clocks show it."""
    for _ in range(10):
        before = _awake()
        total = _in_all()
        after = _awake()
        if after - before < _AT_ONCE:
            break
    return max(total - after, 0.0)


if sys.platform == "win32":
    import ctypes

    _kernel = ctypes.WinDLL("kernel32")
    _kernel.GetTickCount64.restype = ctypes.c_ulonglong
    _kernel.QueryUnbiasedInterruptTime.argtypes = (ctypes.POINTER(ctypes.c_ulonglong),)

    def _in_all() -> float:
        """`time.monotonic` is another clock from Python 3.13 on, and goes at another rate."""
        return float(_kernel.GetTickCount64()) * 1e-3

    def _awake() -> float:
        ticks = ctypes.c_ulonglong()  # of 100 ns
        _kernel.QueryUnbiasedInterruptTime(ctypes.byref(ticks))
        return ticks.value * 1e-7

else:
    _LINUX, _MACOS = ("CLOCK_BOOTTIME", "CLOCK_MONOTONIC"), ("CLOCK_MONOTONIC_RAW", "CLOCK_UPTIME_RAW")
    _CLOCKS = next(
        (
            [getattr(time, name) for name in pair]
            for pair in (_LINUX, _MACOS)
            if all(hasattr(time, name) for name in pair)
        ),
        [time.CLOCK_MONOTONIC, time.CLOCK_MONOTONIC],
    )

    def _in_all() -> float:
        return time.clock_gettime(_CLOCKS[0])

    def _awake() -> float:
        return time.clock_gettime(_CLOCKS[1])
