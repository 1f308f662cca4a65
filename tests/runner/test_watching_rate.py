"""How often the bench is read between records: closely while something may move, seldom at rest."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from rigctl.dataset import open_run
from run_workshop import Done, Workshop

Do = Callable[..., Done]


def intervals(done: Done, start: float, end: float) -> set[float]:
    """Distances in s between the samples from `start` to `end`."""
    times = open_run(done.result.folder).signals("time")
    times = times[(times > start) & (times < end)]
    return {round(float(step), 6) for step in times[1:] - times[:-1]}


def test_a_moving_rod_is_watched_closely_and_a_resting_one_is_not(do: Do) -> None:
    done = do("steps:\n  - extend: {for: 1 s}\n  - wait: 2 s\n")
    (_, (start, _), (end, _)) = [(0.0, 0.0), *done.commands("valve")][:3]
    assert intervals(done, start, end) == {0.01}
    assert intervals(done, end + 0.2, end + 1.9) == {0.1}


def test_a_record_keeps_its_rate(do: Do) -> None:
    done = do("steps:\n  - {record: {name: slow, rate: 20 Hz}, do: [{extend: {for: 1 s}}, {wait: 1 s}]}\n")
    start = done.commands("valve")[0][0]
    assert intervals(done, start, start + 1.9) == {0.05}


def test_an_ending_returns_to_the_slow_rate(do: Do) -> None:
    steps = "steps:\n  - extend: {until: position < -1 m, timeout: 0.5 s}\nfinally:\n  - wait: 1 s\n"
    done = do(steps)
    assert done.result.status == "failed"
    end = done.commands("valve")[-1][0]
    assert intervals(done, end + 0.2, end + 0.9) == {0.1}


def test_over_travel_is_noticed_before_the_end_stop_is_reached(do: Do) -> None:
    done = do("steps:\n  - set_pressure: 50 bar\n  - extend: {for: 5 s}\n")
    assert done.result.status == "failed"
    position = open_run(done.result.folder).signals("position")
    assert 0.240 < max(position) < 0.250


def test_a_rig_may_set_a_slower_watching_rate(workshop: Workshop) -> None:
    rig = workshop.rig("moving_rate: 100 Hz", "moving_rate: 1 Hz")
    done = workshop.run("steps:\n  - extend: {for: 1 s}\n", rig=rig)
    start = done.commands("valve")[0][0]
    assert intervals(done, start, start + 1.0) == {0.1}  # never slower than at rest


def test_the_rate_is_a_frequency(workshop: Workshop) -> None:
    from rigctl.errors import RigctlError

    assert math.isclose(workshop.rig().moving_rate, 100.0)
    with pytest.raises(RigctlError, match="moving_rate"):
        workshop.rig("moving_rate: 100 Hz", "moving_rate: 100 mm")
