"""A reading outside the range of its channel is no value, whatever a procedure does with it."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import pytest

from rigctl.backends.protocol import Backend, Sample
from rigctl.clock import VirtualClock
from rigctl.dataset import open_run
from rigctl.rig.possible_readings import PossibleReadings
from rigctl.testing import RunLog, assert_tripped
from run_workshop import Workshop

#: of the oil, degC, as a lost decimal point gives it; the bench is at 20 degC, its range is -10 to 150 degC
GARBLED = 2020.0 + 273.15


@dataclass
class Garbling:
    """A bench one of whose channels gives an impossible reading now and then."""

    inner: Any
    garbled: Callable[[int], bool]
    reading: float = GARBLED
    count: int = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def next_sample(self, timeout: float) -> Sample | None:
        sample: Sample | None = self.inner.next_sample(timeout)
        if sample is None:
            return None
        self.count += 1
        if not self.garbled(self.count):
            return sample
        return Sample(sample.time, (self.reading, *sample.values[1:]), sample.commands)


@pytest.fixture
def run(workshop: Workshop) -> Callable[..., RunLog]:
    def carried_out(steps: str, garbled: Callable[[int], bool], **fields: Any) -> RunLog:
        bench: Backend = Garbling(workshop.backend(workshop.rig(), VirtualClock()), garbled, **fields)  # type: ignore[assignment]
        return workshop.run(steps, backend=bench)

    return carried_out


def test_the_ends_of_a_range_are_possible(workshop: Workshop) -> None:
    rig = workshop.rig()
    possible = PossibleReadings(rig)
    bands = [channel.band for channel in rig.channels.values()]
    for ends in zip(*bands, strict=True):
        row = (0.0, -1.0, *ends, 0.0, 0.0, 20e5)
        assert possible.of(row) == row
    lost = (0.0, -1.0, math.nan, bands[1][0], bands[2][1], 0.0, 0.0, 20e5)
    np.testing.assert_array_equal(possible.of(lost), lost)
    beyond = (0.0, -1.0, bands[0][0], bands[1][0] - 1.0, bands[2][1] + 1.0, 0.0, 0.0, 20e5)
    np.testing.assert_array_equal(possible.of(beyond)[2:5], [bands[0][0], math.nan, math.nan])


def every(number: int) -> Callable[[int], bool]:
    return lambda count: count % number == 0


def test_it_does_not_end_a_wait(run: Callable[..., RunLog]) -> None:
    done = run("steps:\n  - wait: {until: oil_temperature > 100 degC, timeout: 10 s}\n", every(20))
    assert done.result.status == "failed"
    assert "did not come true within 10 s" in str(done.result.reason)


@pytest.mark.parametrize("reading", [GARBLED, math.nan, math.inf, -math.inf])
def test_it_decides_no_branch_and_no_loop(run: Callable[..., RunLog], reading: float) -> None:
    """Not even where the condition is false for it: 'not hot' is as unknown as 'hot'."""
    steps = """\
steps:
  - wait: 0.35 s
  - if: oil_temperature > 100 degC or not (oil_temperature < 100 degC)
    do: [set: {relief_valve: 30 bar}]
  - while: not (oil_temperature < 100 degC)
    do: [set: {relief_valve: 40 bar}]
"""
    done = run(steps, lambda count: count in (6, 7, 8), reading=reading)
    assert done.result.status == "finished", done.result.reason
    assert done.commands("relief_valve") == []


def test_a_measure_leaves_it_out_and_says_so(run: Callable[..., RunLog]) -> None:
    steps = """\
steps:
  - record: {name: rest, rate: 10 Hz}
    do:
      - wait: 10 s
      - measure: {name: peak, value: max(oil_temperature), unit: degC, low: 10 degC, high: 30 degC}
"""
    done = run(steps, every(29))
    assert done.result.status == "finished", done.result.reason
    assert done.result.test is not None
    assert done.result.test.result == "pass"
    (measured,) = done.events("measure")
    assert measured["value"] == pytest.approx(293.15, abs=0.1)
    assert measured["missing"] == pytest.approx(3 / 101, abs=0.011)
    assert any("peak was taken without" in text for text in done.messages("note"))


def test_a_measure_over_too_many_of_them_does_not_pass(run: Callable[..., RunLog]) -> None:
    steps = """\
steps:
  - record: {name: rest, rate: 10 Hz, most_missing: 50 %}
    do:
      - wait: 10 s
      - measure: {name: peak, value: max(oil_temperature), unit: degC, high: 30 degC, most_missing: LIMIT}
"""
    done = run(steps.replace("LIMIT", "5 %"), every(10))
    assert done.result.status == "failed"
    wanted = r"peak is 20 degC without 10 of 10\d readings of oil_temperature \(9\.\d %\), more than 5 %"
    assert re.search(wanted, str(done.result.reason))
    assert done.result.test is not None
    assert done.result.test.result == "fail"
    assert run(steps.replace("LIMIT", "10 %"), every(10)).result.status == "finished"


def test_a_record_with_too_many_of_them_is_lost(run: Callable[..., RunLog]) -> None:
    steps = "steps:\n  - record: {name: rest, rate: 10 HzRETRIES}\n    do: [wait: 10 s]\n"
    done = run(steps.replace("RETRIES", ""), every(10))
    assert [outcome for _, outcome in done.records] == ["interrupted"]
    wanted = r"lacks 10 of 10\d readings of oil_temperature \(9\.\d %\), more than 5 %"
    assert re.search(wanted, str(done.result.reason))
    again = run(steps.replace("RETRIES", ", retries: 1"), lambda count: count < 90 and count % 8 == 0)
    assert [outcome for _, outcome in again.records] == ["interrupted", "complete"]
    assert again.result.status == "finished"


def test_it_is_stored_as_it_was_read_and_counted(run: Callable[..., RunLog]) -> None:
    steps = "steps:\n  - record: {name: rest, rate: 10 Hz}\n    do: [wait: 10 s]\n"
    done = run(steps, every(29))
    assert done.result.folder is not None
    stored = open_run(done.result.folder)
    samples: pd.DataFrame = stored.samples(["oil_temperature"], record=0)
    garbled = samples["oil_temperature"] > 150.0
    assert garbled.sum() in (3, 4)
    assert samples["oil_temperature"][garbled].tolist() == pytest.approx([2020.0] * int(garbled.sum()))
    record = stored.record(0)  # what every analysis reads
    assert record.channels["oil_temperature"].tolist() == pytest.approx(
        samples["oil_temperature"].where(~garbled).add(273.15).tolist(), nan_ok=True
    )
    assert stored.records["missing"][0] == pytest.approx(garbled.sum() / len(samples))
    assert any("missing in the record" in text for text in done.messages("note"))


@pytest.mark.parametrize("every_so_many", [2, 4])
def test_a_limit_acts_on_the_readings_between_them(workshop: Workshop, every_so_many: int) -> None:
    """A loose wire: the oil is at 95 degC, its limit is 90 degC, and some of the readings are impossible."""
    hot = Garbling(workshop.backend(workshop.rig(), VirtualClock()), lambda count: count > 30, 368.15)
    loose: Any = Garbling(hot, every(every_so_many), -50.0 + 273.15)
    steps = "steps:\n  - set: {heater: on}\n  - record: {name: r, rate: 10 Hz}\n    do: [wait: 20 s]\n"
    done = workshop.run(steps, backend=loose)
    assert done.result.status == "failed"
    assert_tripped(done, "oil_too_hot" if every_so_many == 4 else "oil_temperature sensor")
    assert [time for time, value in done.commands("heater") if value == 0.0][-1] < 5.0


UPTIME = """\
  uptime: {unit: s, quantity: time, counts_up: true}
could_have:
"""


@pytest.mark.parametrize("retries", [0, 1])
def test_a_counter_that_starts_again_is_a_restart(workshop: Workshop, retries: int) -> None:
    """The outputs are those the device starts with, whatever was commanded: the record is worth nothing."""
    rig = workshop.rig("could_have:\n", UPTIME)

    class Restarting(Garbling):
        def next_sample(self, timeout: float) -> Sample | None:
            sample = self.inner.next_sample(timeout)
            if sample is None:
                return None
            uptime = sample.time if sample.time < 5.0 else sample.time - 5.0
            return Sample(sample.time, (*sample.values[:-1], uptime), sample.commands)

    bench: Any = Restarting(workshop.backend(rig, VirtualClock()), lambda _: False)
    steps = f"""\
steps:
  - record: {{name: r, rate: 10 Hz, retries: {retries}}}
    do:
      - set: {{heater: on}}
      - wait: 10 s
"""
    done = workshop.run(steps, rig=rig, backend=bench)
    assert any("the device has restarted: uptime went from" in text for text in done.messages("gap"))
    outcomes = [outcome for _, outcome in done.records]
    assert outcomes == (["interrupted", "complete"] if retries else ["lost"])
    assert (done.result.status == "finished") == bool(retries)
