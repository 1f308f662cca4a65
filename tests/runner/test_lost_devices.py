"""Runs that pause for a lost device, or go on without it, in virtual time."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from devices_in_virtual_time import InVirtualTime
from rigctl.backends.errors import OutOfReach, OutputsNotSafe
from rigctl.backends.protocol import CommandReceipt, Notice, PendingCommand, Sample
from rigctl.dataset import open_run
from rigctl.rig import parse_rig
from rigctl.runner.operators.requests import Order, Request
from rigctl.runner.recorder import Unrecorded
from rigctl.testing import RunLog, ScriptedClock, ScriptedControl, VirtualBench

RIG = """\
name: three
monitor_rate: 10 Hz
stale_after: 1 s
devices:
  a: {kind: simulated}
  b: {kind: simulated, lost: pause, back_within: 20 s}
  c: {kind: simulated, lost: continue}
channels:
  va: {device: a, unit: V, quantity: voltage}
  vb: {device: b, unit: V, quantity: voltage}
  vc: {device: c, unit: V, quantity: voltage}
actuators:
  x: {device: a, kind: switch}
  y: {device: b, kind: switch}
safe_state: {x: off, y: off}
limits:
  too_high: {channel: va, above: 5 V, action: stop}
"""


class Lossy(InVirtualTime):
    """A device that is silent is out of reach; when it is back, its outputs are off."""

    def __init__(self, rig: str = RIG) -> None:
        super().__init__(parse_rig(rig), ScriptedClock())
        self.lost: set[str] = set()

    def dies(self, device: str, begin: float, end: float = math.inf) -> None:
        self.parts[device].silent = lambda time: begin < time < end
        self.clock.at(begin, lambda: self.lost.add(device))
        if math.isfinite(end):
            self.clock.at(end, lambda: self._back(device))

    def _back(self, device: str) -> None:
        self.lost.discard(device)
        off = sorted(self.parts[device].commands)
        self.parts[device].commands.clear()
        message = f"{device}: samples lost"
        self.notices.append(Notice(self.clock.now(), "gap", message, {"device": device, "switched_off": off}))

    def command(self, actuator: str, value: float, *, duration: float | None = None) -> PendingCommand:
        device = self.rig.device_of(actuator)
        if device in self.lost:
            raise OutOfReach(f"{device}: no contact")
        receipt = super().command(actuator, value, duration=duration).wait()
        if duration is not None:
            self.clock.at(self.clock.now() + duration, lambda: self._end(actuator))
        return PendingCommand.answered(receipt)

    def _end(self, actuator: str) -> None:
        self.parts[self.rig.device_of(actuator)].commands.pop(actuator, None)
        self.receipts.append(CommandReceipt(self.clock.now(), actuator, 0.0))

    def take_receipts(self) -> list[CommandReceipt]:
        taken, self.receipts = self.receipts, []
        return taken

    def safe(self) -> None:
        out_of_reach: dict[str, float] = {}
        for name, part in self.parts.items():
            if name in self.lost:
                out_of_reach |= part.commands
            else:
                part.commands.clear()
        if self.lost & {"a", "b"}:
            confirmed = {"x", "y"} - {"xy"["ab".index(name)] for name in self.lost & {"a", "b"}}
            raise OutputsNotSafe("no contact", out_of_reach, self.clock.date(), confirmed)

    receipts: list[CommandReceipt] = []  # noqa: RUF012 - replaced at the first call

    def next_sample(self, timeout: float) -> Sample | None:
        sample = super().next_sample(timeout)
        if self.outputs_at is not None and sample is not None:
            self.outputs_at.append(
                (sample.time, *(bool(self.parts[d].commands.get(o)) for d, o in ("ax", "by")))
            )
        return sample

    outputs_at: list[tuple[float, ...]] | None = None


@pytest.fixture
def bench() -> Lossy:
    return Lossy()


def run(bench: Lossy, folder: Path, steps: str, *orders: tuple[float, Request]) -> RunLog:
    control = ScriptedControl(list(orders))
    return VirtualBench(folder).run(steps, rig=bench.rig, backend=bench, control=control)


ON = "steps:\n  - set: {x: on, y: on}\n"


def test_a_wait_begins_again_once_the_lost_device_is_back(bench: Lossy, tmp_path: Path) -> None:
    bench.dies("b", 2.0, 9.0)
    bench.outputs_at = []
    done = run(bench, tmp_path, ON + "  - wait: 5 s\n")
    assert done.result.status == "finished", done.result.reason
    assert done.states == [
        "arming", "running", "paused", "running", "finishing", "finished",
    ]  # fmt: skip
    assert done.result.duration == pytest.approx(9.0 + 5.0, abs=0.3)
    at = {round(time, 1): on for time, *on in bench.outputs_at}
    assert at[1.9] == [True, True]
    away = [on for time, *on in bench.outputs_at if 3.3 < time < 8.9]
    assert len(away) > 100
    assert not any(on[0] for on in away), "others are off while it is away"
    assert at[9.5] == [True, True]
    known = open_run(done.result.folder)
    (absence,) = known.info["absences"]
    assert (absence["device"], absence["lost"]) == ("b", "pause")
    assert (absence["begin"], absence["end"]) == pytest.approx((3.0, 9.0), abs=0.2)


def test_a_device_that_does_not_come_back_ends_the_run(bench: Lossy, tmp_path: Path) -> None:
    bench.dies("b", 2.0)
    done = run(bench, tmp_path, ON + "  - wait: 5 s\n")
    assert done.result.status == "failed"
    assert "b: no reading for 1" in str(done.result.reason)
    assert "it did not come back within 20 s" in str(done.result.reason)
    assert str(done.result.unconfirmed) == "b: y on"
    assert bench.parts["a"].commands == {}
    assert 22.0 < done.result.duration < 27.0
    assert open_run(done.result.folder).info["absences"][0]["end"] is None


RECORD = """\
  - hold: {channel: va, at: 1 V, within: 1 V, for: 2 s}
  - record: {name: r, rate: 10 Hz}
    do: [wait: 5 s]
    finally: [set: {y: off}]
"""


def test_a_record_is_measured_again_after_its_set_up(bench: Lossy, tmp_path: Path) -> None:
    bench.dies("b", 4.0, 9.0)
    bench.outputs_at = []
    done = run(bench, tmp_path, ON + RECORD)
    assert done.result.status == "finished", done.result.reason
    assert [outcome for _, outcome in done.records] == ["interrupted", "complete"]
    assert done.result.duration == pytest.approx(9.0 + 2.0 + 5.0, abs=0.5)
    last = [on for time, *on in bench.outputs_at if 11.5 < time < 15.5]
    assert last
    assert all(on == [True, True] for on in last), "as they were when the record began"


def test_a_loss_too_short_to_be_silence_pauses_too(bench: Lossy, tmp_path: Path) -> None:
    """Its outputs have gone off: today's ending would be 'lost'."""
    bench.dies("b", 2.0, 2.5)
    done = run(bench, tmp_path, ON + "  - wait: 5 s\n")
    assert done.result.status == "finished", done.result.reason
    assert "paused" in done.states
    assert bench.given[-1][1] == 1.0


def test_half_a_timed_command_is_not_repeated(bench: Lossy, tmp_path: Path) -> None:
    bench.dies("b", 2.0, 9.0)
    done = run(bench, tmp_path, "steps:\n  - set: {values: {y: on}, for: 6 s}\n")
    assert done.result.status == "failed"
    assert "a command for a time was cut off by it" in str(done.result.reason)
    assert done.result.unconfirmed is None


def test_a_limit_still_ends_a_run_that_waits(bench: Lossy, tmp_path: Path) -> None:
    bench.dies("b", 2.0, 15.0)
    bench.parts["a"].value = lambda time: 9.0 if time > 6.0 else 1.0
    done = run(bench, tmp_path, ON + "  - wait: 5 s\n")
    assert "va is 9 V, above the limit of 5 V" in str(done.result.reason)
    assert done.result.duration < 12.0


def test_a_second_device_that_is_lost_while_the_run_waits_ends_it(bench: Lossy, tmp_path: Path) -> None:
    bench.dies("b", 2.0, 15.0)
    bench.dies("a", 5.0)
    done = run(bench, tmp_path, ON + "  - wait: 5 s\n")
    assert done.result.status == "failed"
    assert "a: no reading for" in str(done.result.reason)


def test_a_device_that_is_lost_again_and_again_ends_the_run(bench: Lossy, tmp_path: Path) -> None:
    bench.parts["b"].silent = lambda time: time > 4.0 and time % 4.0 < 2.0
    done = run(bench, tmp_path, ON + "  - record: {name: r, rate: 10 Hz}\n    do: [wait: 30 s]\n")
    assert done.result.status == "failed"
    assert "a device was lost again and again" in str(done.result.reason)
    assert [outcome for _, outcome in done.records] == ["interrupted"] * 6


def test_a_loss_in_a_cleanup_block_ends_it(bench: Lossy, tmp_path: Path) -> None:
    bench.dies("b", 2.0, 9.0)
    done = run(bench, tmp_path, ON + "finally:\n  - wait: 8 s\n")
    assert done.result.status == "failed"
    assert "paused" not in done.states


def test_a_run_goes_on_without_a_device_that_nothing_needs(bench: Lossy, tmp_path: Path) -> None:
    bench.dies("c", 2.0)
    done = run(bench, tmp_path, ON + "  - record: {name: r, rate: 10 Hz}\n    do: [wait: 8 s]\n")
    assert done.result.status == "finished", done.result.reason
    assert done.states == ["arming", "running", "finishing", "finished"]
    assert [outcome for _, outcome in done.records] == ["complete"]
    known = open_run(done.result.folder)
    (absence,) = known.info["absences"]
    assert (absence["device"], absence["lost"], absence["end"]) == ("c", "continue", None)
    record = known.record(0)
    times = {name: record.time[np.isfinite(values)] for name, values in record.channels.items()}
    assert times["vc"].max() == pytest.approx(2.0, abs=0.11)
    assert times["va"].max() == pytest.approx(8.2, abs=0.3)
    assert any("the run goes on without it" in one.message for one in done.result.warnings)


def test_a_device_that_the_run_went_on_without_is_recorded_again(bench: Lossy, tmp_path: Path) -> None:
    bench.dies("c", 2.0, 5.0)
    done = run(bench, tmp_path, ON + "  - record: {name: r, rate: 10 Hz}\n    do: [wait: 8 s]\n")
    assert done.result.status == "finished", done.result.reason
    known = open_run(done.result.folder)
    assert known.info["absences"][0]["end"] == pytest.approx(5.0, abs=0.2)
    record = known.record(0)
    values = record.channels["vc"]
    assert record.time[np.isfinite(values)].max() > 7.5


def test_a_device_must_be_there_at_the_beginning(bench: Lossy, tmp_path: Path) -> None:
    bench.parts["c"].silent = lambda _: True
    done = run(bench, tmp_path, ON)
    assert done.result.status == "failed"
    assert "not armed: c: no reading" in str(done.result.reason)


@settings(max_examples=40)
@given(
    device=st.sampled_from("abc"),
    begin=st.integers(3, 90).map(lambda tenths: tenths / 10.0),
    lasts=st.integers(1, 300).map(lambda tenths: tenths / 10.0) | st.just(math.inf),
)
def test_whichever_device_is_lost_when_every_ending_is_safe(
    device: str, begin: float, lasts: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The outputs of the others are off within its limit, unless it is one that nothing needs."""
    bench = Lossy()
    bench.outputs_at = []
    bench.dies(device, begin, begin + lasts)
    done = run(bench, tmp_path_factory.mktemp("run"), ON + RECORD + "  - wait: 2 s\n")
    status = done.result.status
    if device == "c" or (device == "b" and begin < 8.0 and lasts < 19.0):
        assert status == "finished", done.result.reason
    for name, output in ("ax", "by"):
        if name not in bench.lost:
            assert bench.parts[name].commands.get(output, 0.0) == 0.0
    if device == "b" and lasts > 2.0:
        away = [on for time, *on in bench.outputs_at if begin + 1.3 < time < begin + lasts]
        assert not any(on[0] for on in away)
    if status == "finished":
        assert done.records[-1][1] == "complete"
        assert done.result.unconfirmed is None


def test_a_record_with_cleanup_is_set_up_again_before_it_is_repeated(bench: Lossy, tmp_path: Path) -> None:
    """It was measured again with its set-up undone: its outputs were off."""
    bench.dies("a", 4.0, 9.0)
    bench.outputs_at = []
    steps = RECORD.replace("rate: 10 Hz", "rate: 10 Hz, retries: 1").replace("set: {y: off}", "wait: 0.1 s")
    done = run(bench, tmp_path, ON + steps)
    assert done.result.status == "finished", done.result.reason
    assert [outcome for _, outcome in done.records] == ["interrupted", "complete"]
    last = [on for time, *on in bench.outputs_at if 12.0 < time < 15.5]
    assert last
    assert all(on == [True, True] for on in last)


def test_a_branch_that_waits_for_a_reading_of_the_lost_device_goes_on(bench: Lossy, tmp_path: Path) -> None:
    bench.dies("b", 1.3, 9.0)
    steps = "steps:\n  - wait: 1 s\n  - set: {x: on}\n  - if: vb > 0 V\n    do: [wait: 1 s]\n"
    done = run(bench, tmp_path, steps)
    assert done.result.status == "finished", done.result.reason
    assert done.states[1:4] == ["running", "paused", "running"]
    assert done.outcome("wait 1 s") == "complete"
    assert done.result.duration == pytest.approx(10.0, abs=0.5)


def test_a_person_ends_a_run_that_waits_for_a_device(bench: Lossy, tmp_path: Path) -> None:
    bench.dies("b", 2.0, 15.0)
    done = run(bench, tmp_path, ON + "  - wait: 5 s\n", (6.0, Request.ABORT))
    assert done.result.status == "aborted"
    assert done.result.duration < 10.5
    assert done.result.unconfirmed == "b: y on"


def on_after(bench: Lossy, time: float) -> list[float]:
    """When any output was on after a time."""
    return [sampled for sampled, *on in bench.outputs_at or () if sampled > time and any(on)]


CLEANED = """\
  - record: {name: r, rate: 10 Hz, retries: 1}
    do: [wait: 5 s]
    finally: [wait: 3 s]
"""


@pytest.mark.parametrize("device", ["a", "b"])
@pytest.mark.parametrize("status", ["failed", "aborted"])
def test_what_ends_the_run_in_the_cleanup_before_a_record_is_repeated_ends_it(
    bench: Lossy, tmp_path: Path, device: str, status: str
) -> None:
    """It was passed over as a failure of cleanup: the record was set up again, with outputs on."""
    bench.outputs_at = []
    bench.dies(device, 4.0, 9.0)
    orders = [(10.0, Request.ABORT)] if status == "aborted" else []
    if not orders:
        bench.parts["a"].value = lambda time: 9.0 if 10.0 < time < 10.5 else 1.0
    done = run(bench, tmp_path, ON + CLEANED, *orders)
    assert done.result.status == status, done.result.reason
    assert on_after(bench, 10.2) == []
    assert [outcome for _, outcome in done.records] == ["interrupted"]


class Person(ScriptedControl):
    """Pauses, and goes on once paused; what had been commanded until then is kept."""

    def __init__(self, bench: Lossy, *orders: tuple[float, Request]) -> None:
        super().__init__(list(orders))
        self.bench, self.until_paused = bench, list[tuple[float, float]]()

    def acknowledge(self, order: Order, message: str) -> None:
        super().acknowledge(order, message)
        if message.startswith("paused,"):
            self.until_paused = list(self.bench.given)
            self.orders.append((0.0, Request.CONTINUE))


@pytest.mark.parametrize("steps", ["  - wait: 5 s\n", CLEANED, CLEANED.partition("    finally")[0]])
def test_a_pause_asked_for_during_a_loss_begins_before_outputs_are_on_again(
    bench: Lossy, tmp_path: Path, steps: str
) -> None:
    bench.outputs_at = []
    bench.dies("b", 2.0, 9.0)
    person = Person(bench, (6.0, Request.CONTINUE), (6.0, Request.PAUSE))
    done = VirtualBench(tmp_path).run(ON + steps, rig=bench.rig, backend=bench, control=person)
    assert done.result.status == "finished", done.result.reason
    waits = "the run waits until a lost device is back"
    assert person.answers == [
        waits, f"{waits}, and stays paused then", "paused, outputs are safe", "the run goes on",
    ]  # fmt: skip
    assert [time for time, _ in person.until_paused if time > 2.0] == []
    assert on_after(bench, 9.0)


def test_a_decision_is_taken_with_outputs_as_they_were_before_the_loss(bench: Lossy, tmp_path: Path) -> None:
    """They were restored as before the step before it, which had switched one on."""
    bench.outputs_at = []
    bench.dies("b", 1.3, 9.0)
    decision = "  - if: vb > 0 V\n    do: [wait: 2 s]\n"
    done = run(bench, tmp_path, "steps:\n  - wait: 1 s\n  - set: {x: on}\n" + decision)
    assert done.result.status == "finished", done.result.reason
    assert len(on_after(bench, 9.3)) > 10


SLOW = RIG.replace(
    "x: {device: a, kind: switch}", "x: {device: a, kind: level, unit: V, max_rate: 5 V/s, to}"
)
SLOW = SLOW.replace("to}", "low: 0 V, high: 9 V}").replace("x: off", "x: 0 V")


@pytest.mark.parametrize(("begin", "steps"), [
    (4.0, "  - record: {name: r, rate: 10 Hz}\n    do: [wait: 5 s]\n"),
    (1.45, "  - if: vb > 2 V\n    do: [wait: 1 s]\n  - wait: 1 s\n"),
])  # fmt: skip
def test_a_loss_while_outputs_are_being_restored_is_waited_for_too(
    tmp_path: Path, begin: float, steps: str
) -> None:
    """It ended the run with an error in rigctl."""
    bench = Lossy(SLOW)
    bench.dies("b", begin, 9.0)
    bench.dies("b", 9.3, 9.5)
    bench.parts["b"].silent = lambda time: begin < time < 9.0 or 9.3 < time < 9.5
    done = run(bench, tmp_path, "steps:\n  - set: {y: on}\n  - set: {x: 5 V}\n" + steps)
    assert done.result.status == "finished", done.result.reason
    assert done.states.count("paused") == 2


def test_an_output_that_could_not_be_restored_at_once_is_commanded_again(
    bench: Lossy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The step was repeated with it off."""
    bench.outputs_at = []
    bench.dies("b", 2.0, 9.0)
    command, missed = bench.command, list[float]()

    def unanswered(actuator: str, value: float, *, duration: float | None = None) -> PendingCommand:
        if actuator != "y" or bench.clock.now() < 9.0 or missed:
            return command(actuator, value, duration=duration)
        missed.append(bench.clock.now())
        pending = PendingCommand(actuator, value)
        pending.trouble = OutOfReach("no answer")
        return pending

    monkeypatch.setattr(bench, "command", unanswered)
    done = run(bench, tmp_path, ON + "  - wait: 5 s\n")
    assert done.result.status == "finished", done.result.reason
    assert len(missed) == 1
    assert all(on == [True, True] for time, *on in bench.outputs_at if 10.0 < time < 13.0)


def test_a_step_that_is_begun_again_and_again_ends_the_run(bench: Lossy, tmp_path: Path) -> None:
    bench.parts["b"].silent = lambda time: time > 4.0 and time % 6.0 < 3.0
    done = run(bench, tmp_path, ON + "  - wait: 30 s\n")
    assert done.result.status == "failed"
    assert "wait 30 s: a device was lost again and again" in str(done.result.reason)


def test_a_device_that_answers_but_cannot_be_made_safe_is_not_waited_for_longer(
    bench: Lossy, tmp_path: Path
) -> None:
    """Each of its silences began the time anew: the run waited for ever."""
    bench.dies("b", 2.0)
    bench.parts["b"].silent = lambda time: time > 2.0 and time % 3.0 < 2.0
    done = run(bench, tmp_path, ON + "  - wait: 5 s\n")
    assert done.result.status == "failed"
    assert 22.0 < done.result.duration < 30.0


@pytest.mark.parametrize("lasts", [0.6, 3.0])
def test_neither_a_gap_nor_the_return_of_a_device_that_nothing_needs_interrupts_a_record(
    bench: Lossy, tmp_path: Path, lasts: float
) -> None:
    """A record with retries was interrupted when it came back."""
    bench.dies("c", 2.0, 2.0 + lasts)
    steps = "  - record: {name: r, rate: 10 Hz, retries: 1}\n    do: [wait: 4 s]\n"
    done = run(bench, tmp_path, ON + steps)
    assert [outcome for _, outcome in done.records] == ["complete"]


def test_outputs_that_are_moved_by_hand_are_not_switched_on_again_by_the_return_of_a_device(
    bench: Lossy, tmp_path: Path
) -> None:
    bench.outputs_at = []
    bench.dies("b", 2.0, 9.0)
    log = VirtualBench(tmp_path)
    done = log.run(
        ON + "  - wait: 20 s\n", rig=bench.rig, backend=bench, writer=Unrecorded(lambda *_, **__: None)
    )
    assert done.result.status == "failed"
    assert on_after(bench, 9.0) == []


COUNTING = RIG.replace("  c: {kind", "  d: {kind: simulated, lost: POLICY}\n  c: {kind").replace(
    "actuators:", "  uptime: {device: d, unit: s, quantity: time, counts_up: true}\nactuators:"
)


@pytest.mark.parametrize("policy", ["stop", "pause", "continue"])
@pytest.mark.parametrize("recording", [False, True])
def test_a_counter_that_starts_again_does_what_the_rig_file_says_of_its_device(
    policy: str, recording: bool, tmp_path: Path
) -> None:
    """The device has no output: those of others were counted as switched off by it, which ended the run."""
    bench = Lossy(COUNTING.replace("POLICY", policy))
    bench.parts["d"].value = lambda time: time if time < 3.0 else time - 2.9
    steps = "  - record: {name: r, rate: 10 Hz}\n    do: [wait: 5 s]\n" if recording else "  - wait: 5 s\n"
    done = run(bench, tmp_path, ON + steps)
    assert done.result.status == "finished", done.result.reason
    again = recording and policy == "pause"
    assert [outcome for _, outcome in done.records] == (
        ["interrupted", "complete"] if again else ["complete"] * recording
    )
    assert (bench.clock.now() > 7.5) is again
    events = open_run(done.result.folder).events
    assert events["message"].str.startswith("the device has restarted: uptime went from 2.9 s").sum() >= 1
