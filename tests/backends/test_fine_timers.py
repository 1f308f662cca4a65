"""Timers of Windows are fine during a run, and as before after it."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from rigctl.backends import fine_timers as module
from rigctl.backends.fine_timers import fine_timers
from rigctl.clock import VirtualClock
from rigctl.runner.bench_access import Access, opened
from run_workshop import Workshop


class Multimedia:
    """Windows' library: the periods that programs have asked for, ms, and whether it grants them."""

    def __init__(self, *, grants: bool = True) -> None:
        self.periods: list[int] = []
        self.asked = 0
        self._answer = 0 if grants else 97  # TIMERR_NOCANDO

    def timeBeginPeriod(self, period: int) -> int:  # noqa: N802 - Windows' name
        self.asked += 1
        if self._answer == 0:
            self.periods.append(period)
        return self._answer

    def timeEndPeriod(self, period: int) -> int:  # noqa: N802 - Windows' name
        self.periods.remove(period)
        return 0


def test_timers_are_fine_inside_and_as_before_afterwards_whatever_happens() -> None:
    library = Multimedia()
    with pytest.raises(KeyError), fine_timers(library):
        assert library.periods == [1]
        raise KeyError
    assert library.periods == []


def test_a_computer_without_finer_timers_is_left_alone() -> None:
    library = Multimedia(grants=False)
    with fine_timers(library):
        assert library.asked == 1
    assert library.periods == []


def test_this_system_has_the_library_where_it_is_needed() -> None:
    library = module._multimedia()
    assert (library is not None) == (sys.platform == "win32")
    with fine_timers():
        pass


def test_timers_are_fine_while_a_bench_is_open(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    library = Multimedia()
    monkeypatch.setattr(module, "_multimedia", lambda: library)
    how = Access(runs=tmp_path, clock=VirtualClock(), backend="simulated", options={"plant": "roles"})
    with opened(Workshop(tmp_path).rig(), how):
        assert library.periods == [1]
    assert library.periods == []
