"""How often the bench is read between records: closely while something may move, seldom at rest."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import pytest

from rigctl.dataset import open_run
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig, parse_rig
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


class AskedAtMost:
    """A bench that cannot be read faster than a rate, Hz."""

    def __init__(self, backend: Any, fastest: float) -> None:
        self._backend, self._fastest = backend, fastest

    def __getattr__(self, name: str) -> Any:
        return getattr(self._backend, name)

    def start(self, rate: float) -> None:
        if rate > self._fastest:
            raise RigctlError("the device cannot be asked so often", value=f"{rate:g} Hz")
        self._backend.start(rate)


def test_a_move_to_a_position_asks_a_slow_device_no_faster_than_it_answers(workshop: Workshop) -> None:
    text = shipped("rigs", "hl32-bench-lines.yaml").read_text(encoding="utf-8")
    text = text.replace("fastest: 100 Hz", "fastest: 50 Hz").replace("moving_rate: 100", "moving_rate: 20")
    rig = parse_rig(text)
    backend = AskedAtMost(workshop.backend(rig), rig.fastest)
    done = workshop.run(
        "steps:\n  - extend: {to: 100 mm}\n  - wait: 1 s\n  - extend: {for: 1 s}\n", rig=rig, backend=backend
    )
    assert (done.result.status, done.result.reason) == ("finished", None)
    *_, (start, _), (end, _) = done.commands("valve")
    assert intervals(done, start - 0.9, start) == {0.1}  # the faster rate was the move's alone
    assert intervals(done, start, end) == {0.05}


def test_a_refused_rate_is_not_asked_for_again_in_the_cleanup(workshop: Workshop) -> None:
    loop = "{actuator: relief_valve, channel: supply_pressure, to: 30 bar, gain: 1, rate: 100 Hz, for: 1 s}"
    rig = load_rig(shipped("rigs", "oil-circuit-visa.yaml"))
    done = workshop.run(
        f"steps:\n  - control: {loop}\nfinally:\n  - set: {{relief_valve: 5 bar}}\n  - wait: 1 s\n",
        rig=rig,
        backend=AskedAtMost(workshop.backend(rig), rig.fastest),
    )
    assert "cannot be asked so often" in str(done.result.reason)
    assert done.messages("note") == []
    assert [value for _, value in done.commands("relief_valve")] == [5e5, 0.0]


def test_a_slow_loop_between_records_does_not_slow_down_the_interlocks(workshop: Workshop) -> None:
    """A loop at 0.5 Hz used to read the bench at that rate until its first command."""
    loop = (
        "{actuator: relief_valve, channel: supply_pressure, to: 0 bar, gain: 0.001, rate: 0.5 Hz, for: 6 s}"
    )
    rig = load_rig(shipped("rigs", "oil-circuit-modbus.yaml"))
    done = workshop.run(f"steps:\n  - control: {loop}\n", rig=rig)
    assert done.result.status == "finished", done.result.reason
    assert intervals(done, 0.0, 5.9) == {0.1}


@pytest.mark.parametrize("name", ["monitor_rate", "moving_rate"])
@pytest.mark.parametrize("protocol", ["modbus", "opcua"])
def test_a_rate_between_records_that_a_device_cannot_keep_is_refused_with_the_file(
    protocol: str, name: str
) -> None:
    text = shipped("rigs", f"oil-circuit-{protocol}.yaml").read_text(encoding="utf-8")
    text = re.sub(r"fastest: \d+ Hz", "fastest: 5 Hz", text)
    text = re.sub(r"monitor_rate: \d+ Hz", "monitor_rate: 5 Hz", text)
    parse_rig(text)
    if name == "monitor_rate":
        text = text.replace("monitor_rate: 5 Hz", "monitor_rate: 6 Hz")
    else:  # that of a valve is 100 Hz where the file says nothing
        text = text.replace("heater: {kind: switch", "heater: {kind: directional_valve")
    with pytest.raises(
        RigctlError, match=rf"{name}: more .* at most 5 Hz, as backend.{protocol}.fastest says"
    ):
        parse_rig(text)


def test_the_rate_is_a_frequency(workshop: Workshop) -> None:
    assert math.isclose(workshop.rig().moving_rate, 100.0)
    with pytest.raises(RigctlError, match="moving_rate"):
        workshop.rig("moving_rate: 100 Hz", "moving_rate: 100 mm")
