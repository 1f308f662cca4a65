"""Time limits that a busy computer, or one that stalls for seconds, does not exceed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from rigctl.backends.lines import bench as line_bench
from rigctl.backends.transport import guard_port


def patient(text: str, *, wake: str = "4 s", watchdog: str = "30 s", stale_after: str = "60 s") -> str:
    """A rig file of a device behind a guard: no answer counts as late, and the guard does not act by itself.

    A test of such a limit sets it: longer than a busy computer stalls.
    """
    limits = f"    timeout: 4 s\n    tries: 1\n    wake: {wake}\n    watchdog: {watchdog}\n"
    text = re.sub(r"^    (wake|watchdog|tries): .*\n", "", text, flags=re.MULTILINE)
    text, found = re.subn(r"^    timeout: .*\n", limits, text, flags=re.MULTILINE)
    assert found == 1
    return no_silence(text, stale_after)


def no_silence(text: str, stale_after: str = "60 s") -> str:
    """A rig file whose samples may come late."""
    text, found = re.subn(r"^stale_after: [\d.]+ s", f"stale_after: {stale_after}", text, flags=re.MULTILINE)
    assert found == 1
    return text


@contextmanager
def unhurried() -> Iterator[None]:
    """In this process, making outputs safe and ending guards may take as long as on a busy computer."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(line_bench, "_SAFE_ANSWER", 10.0)
        patch.setattr(guard_port, "_ENDS_WITHIN", 60.0)
        yield
