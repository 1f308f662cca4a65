"""What Windows refuses while another program has a file open: it is tried again, but not for long.

rigctl itself keeps a file open for less than a millisecond, and a file that is just being replaced cannot be
opened for as long; a virus scanner or the index of a search takes somewhat longer.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final, TypeVar

_T = TypeVar("_T")

#: errors of Windows for a file that another program has open: access denied, sharing violation
_IN_USE: Final = (5, 32)
#: time between two attempts, s
_PAUSE: Final = 0.002


def in_use(problem: OSError) -> bool:
    """Whether it is Windows' error for a file that another program has open."""
    return getattr(problem, "winerror", None) in _IN_USE


def patiently(attempt: Callable[[], _T], patience: float, refused: Callable[[OSError], bool] = in_use) -> _T:
    """Try until no other program has the file open, for at most `patience` s.

    Raises
    ------
    OSError
        it is refused for longer, or for another reason.
    """
    give_up = time.monotonic() + patience
    while True:
        try:
            return attempt()
        except OSError as problem:
            if not refused(problem) or time.monotonic() >= give_up:
                raise
            time.sleep(_PAUSE)
